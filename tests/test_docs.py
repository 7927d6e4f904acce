"""What README, NOTATION and the docstrings show runs, and says what it says."""

from __future__ import annotations

import doctest
import importlib
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from flexinv.cli.commands import main
from flexinv.files.load_mechanism import load_mechanism

ROOT = Path(__file__).resolve().parent.parent
PAGES = ("README.md", "NOTATION.md")
MODULES = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in (ROOT / "flexinv").rglob("*.py")
    if path.name != "__init__.py"
)


def blocks(text: str, language: str) -> list[str]:
    """Fenced blocks of one language, padded so that line numbers in tracebacks are the page's."""
    found = re.finditer(rf"^```{language}\n(.*?)^```$", text, re.M | re.S)
    return ["\n" * (text[: block.start()].count("\n") + 1) + block.group(1) for block in found]


@pytest.mark.parametrize("page", PAGES)
def test_python_on_the_page_runs(page: str, tmp_path: Path) -> None:
    """Blocks run one after another, as a reader would type them, from the project's folder; files go elsewhere."""
    (tmp_path / "models").symlink_to(ROOT / "models")
    code = blocks((ROOT / page).read_text(), "python")
    assert code, f"{page} shows no Python"
    read(code, page, tmp_path)


def read(code: list[str], page: str, folder: Path) -> None:
    """Run blocks in a process of their own, which has imported nothing that the reader has not."""
    script = folder / "reader.py"
    lines = "".join(f"exec(compile({block!r}, {page!r}, 'exec'), names)\n" for block in code)
    script.write_text(f"names = {{'__name__': 'reader'}}\n{lines}")
    done = subprocess.run([sys.executable, script.name], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_files_on_the_page_load(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The README's new mechanism is a folder of two TOML files; its commands run as written."""
    text = (ROOT / "README.md").read_text()
    (tmp_path / "models").mkdir()
    for model in (ROOT / "models").iterdir():
        (tmp_path / "models" / model.name).symlink_to(model)
    monkeypatch.chdir(tmp_path)
    files = re.findall(r"^`(models/\S+\.toml)`:?\n\n```toml\n(.*?)^```$", text, re.M | re.S)
    assert [Path(name).name for name, _ in files] == ["mechanism.toml", "cases.toml"]
    for name, content in files:
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(content)
    post = load_mechanism(tmp_path / "models" / "crane").link_of["post"]
    assert tuple(post.tip) == (0, 0, 1), "the crane's post stands where its boom begins"
    commands = [line for block in blocks(text, "sh") for line in block.split("\n") if line.startswith("flexinv ")]
    assert len(commands) >= 2
    for command in commands:
        main(shlex.split(command, comments=True)[1:])
    assert "peak" in capsys.readouterr().out


def test_make_targets_on_the_page_exist() -> None:
    makefile = (ROOT / "Makefile").read_text()
    targets = set(re.findall(r"^(\w+):", makefile, re.M))
    shown = set(re.findall(r"\bmake (\w+)", (ROOT / "README.md").read_text()))
    assert {"report", "test"} <= shown <= targets


def test_links_on_the_pages_lead_somewhere() -> None:
    broken = [
        f"{page}: {target}"
        for page in (*PAGES, "CHANGELOG.md", "flexinv/README.md", "crosscheck/README.md", "models/README.md")
        for target in re.findall(r"\]\(([^)#]+)\)", (ROOT / page).read_text())
        if "://" not in target and not (ROOT / page).parent.joinpath(target).exists()
    ]
    assert not broken


@pytest.mark.parametrize("module", MODULES)
def test_docstring_examples_run(module: str) -> None:
    assert doctest.testmod(importlib.import_module(module)).failed == 0


def test_a_wrong_example_is_found(tmp_path: Path) -> None:
    code = blocks("text\n```python\nassert 1 + 1 == 3\n```\n", "python")
    assert len(code) == 1
    with pytest.raises(AssertionError, match="assert 1"):
        read(code, "page", tmp_path)


def test_a_name_that_only_tests_have_imported_is_found(tmp_path: Path) -> None:
    """This file imports `flexinv.cli.commands`, and all of flexinv with it: a reader has not."""
    with pytest.raises(AssertionError, match="no attribute 'drives'"):
        read(["\nimport flexinv\nflexinv.drives\n"], "page", tmp_path)
