"""What README, site, NOTATION, notebooks and docstrings show runs in a fresh process, and says what it says."""

from __future__ import annotations

import ast
import doctest
import importlib
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from reader_pages import PAGES, ROOT, blocks, project, with_blocks

GALLERY = sorted((ROOT / "docs" / "gallery").glob("*.py"))
MODULES = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in (ROOT / "flexinv").rglob("*.py")
    if path.name != "__init__.py"
)
COMMANDS = ("flexinv", "crosscheck")
# What a page shows of a shell without running it: installation, other machines, whole nights.  Such a block is called text.
FILE = re.compile(r"^`(models/\S+\.toml)`:?\n\n```toml\n(.*?)^```$", re.M | re.S)


@pytest.mark.slow
@pytest.mark.parametrize("page", with_blocks("python"))
def test_python_on_the_page_runs(page: str, tmp_path: Path) -> None:
    """Blocks run one after another, as a reader would type them, from the project's folder; files go elsewhere."""
    code = blocks((ROOT / page).read_text(), "python")
    assert ends_with(code, page, project(tmp_path)) == (len(code), "")


def ends_with(code: list[str], page: str, folder: Path) -> tuple[int, str]:
    """Return how many blocks ran, and what stopped the next one; "" where nothing did.

    They run in a process of their own, which has imported nothing that the reader has not.
    """
    script = folder / "reader.py"
    lines = "".join(f"exec(compile({block!r}, {page!r}, 'exec'), names)\nran.append(1)\n" for block in code)
    told = "import atexit, pathlib\nran = []\natexit.register(lambda: pathlib.Path('ran').write_text(str(len(ran))))\n"
    script.write_text(f"{told}names = {{'__name__': 'reader'}}\n{lines}")
    done = subprocess.run([sys.executable, script.name], cwd=folder, capture_output=True, text=True)
    return int((folder / "ran").read_text()), done.stderr if done.returncode else ""


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in with_blocks("sh") if page != "README.md"])
def test_commands_on_the_page_run(page: str, tmp_path: Path) -> None:
    assert typed(page, project(tmp_path))


def typed(page: str, folder: Path) -> dict[str, str]:
    """What each command of a page says.  Files that the page shows are written, then its commands run one after the other."""
    text, said = (ROOT / page).read_text(), {}
    for name, content in FILE.findall(text):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(content)
    for line in (line for block in blocks(text, "sh") for line in block.splitlines() if line.strip()):
        words = shlex.split(line, comments=True)
        assert words[0] in COMMANDS, f"{page} shows {line!r}: write ```text where a command is not to be run"
        words = [
            one for word in words for one in (sorted(map(str, folder.glob(word))) if "*" in word else []) or [word]
        ]
        command = [sys.executable, "-m", *words]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=600)
        assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}"
        said[" ".join(words)] = done.stdout + done.stderr
    return said


@pytest.mark.slow
def test_commands_of_the_readme_make_a_mechanism_with_limits_and_find_it_within_them(tmp_path: Path) -> None:
    said = typed("README.md", project(tmp_path))
    new, verify, run = (line for line in said if "my_arm" in line)
    assert [line.split()[:3] for line in (new, verify, run)] == [
        ["crosscheck", word, "my_arm"] for word in ("new", "verify", "run")
    ]
    assert "freedoms" in said[verify]
    assert re.search(r"^  move mujoco +holds$", said[verify], re.M)
    assert "wrote them into models/my_arm/cases.toml" in said[verify]
    limits = tomllib.loads((tmp_path / "models" / "my_arm" / "cases.toml").read_text())["limits"]
    assert all("error bars" in limit["reason"] for limit in limits)
    assert not any("measured " in limit["source"] for limit in limits)  # engines that did not run
    assert (tmp_path / "reports" / "verify" / "my_arm" / "picture-move.svg").is_file()
    assert "are within their limits." in said[run]
    assert (tmp_path / "reports" / "latest" / "index.html").is_file()


# The cells of a notebook, one after another, in one process and with the names that a notebook has.
NOTEBOOK = """
import json
cells = [cell for cell in json.load(open({file!r}))["cells"] if cell["cell_type"] == "code"]
names = {{"__name__": "__main__"}}
for k, cell in enumerate(cells):
    exec(compile("".join(cell["source"]), f"cell {{k}}", "exec"), names)
"""


def notebook(example: Path, folder: Path) -> Path:
    """The notebook of an example, made by what makes those of the site."""
    maker = pytest.importorskip("sphinx_gallery.notebook")
    script = shutil.copy(example, folder)
    maker.python_to_jupyter_cli([str(script)])
    return Path(script).with_suffix(".ipynb")


@pytest.mark.slow
@pytest.mark.parametrize("example", GALLERY, ids=lambda path: path.stem)
def test_a_notebook_of_the_gallery_runs(example: Path, tmp_path: Path) -> None:
    file = notebook(example, project(tmp_path))
    done = subprocess.run(
        [sys.executable, "-c", NOTEBOOK.format(file=file.name)], cwd=tmp_path, capture_output=True, text=True, timeout=600,
        env=os.environ | {"MPLBACKEND": "agg"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


def test_notebook_and_script_are_one_program(tmp_path: Path) -> None:
    """Nor does one of them ask for what only a script has: what runs as a notebook runs as a script."""
    for example in GALLERY:
        cells = json.loads(notebook(example, tmp_path).read_text())["cells"]
        shown = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
        said = ast.parse(example.read_text())
        said.body = said.body[1:]  # the docstring is a cell of words
        assert ast.dump(ast.parse(shown)) == ast.dump(said), example.stem
        assert "__file__" not in shown, example.stem


def test_the_gallery_has_its_nine_examples() -> None:
    assert [path.stem[:2] for path in GALLERY] == [f"{k:02d}" for k in range(1, len(GALLERY) + 1)]
    assert len(GALLERY) >= 9


def draws(text: str) -> bool:
    """Return True if the last part of an example with code makes a picture or a view in space."""
    parts = [part for part in re.split(r"^# %%.*$", text, flags=re.M) if re.search(r"^[^#\s]", part, re.M)]
    return bool(re.search(r"plt\.|\baxes\b|go\.Figure|\.plot\b", parts[-1]))


def test_every_example_ends_in_a_picture() -> None:
    assert [path.stem for path in GALLERY if not draws(path.read_text())] == []
    assert not draws("# %%\nfigure, axes = plt.subplots()\n# %%\nprint(1)\n# %%\n# words\n")


def test_make_targets_on_the_page_exist() -> None:
    makefile = (ROOT / "Makefile").read_text()
    targets = set(re.findall(r"^(\w+):", makefile, re.M))
    shown = {
        name
        for page in PAGES
        for name in re.findall(r"\bmake (report|outside|test|check|docs|lint|wheel|clean)\b", (ROOT / page).read_text())
    }
    assert {"report", "outside", "test", "docs"} <= shown <= targets


def test_every_extra_of_the_package_is_on_the_first_page() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    rows = " ".join(re.findall(r"^\| (`.*?`) \|", (ROOT / "docs" / "start.md").read_text(), re.M))
    assert [name for name in extras if f"`{name}`" not in rows] == []


def test_links_on_the_pages_lead_somewhere() -> None:
    broken = [
        f"{page}: {target}"
        for page in (
            *PAGES,
            "CHANGELOG.md",
            "CONTRIBUTING.md",
            "flexinv/README.md",
            "crosscheck/README.md",
            "models/README.md",
        )
        for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", (ROOT / page).read_text())
        if "://" not in target and not written(ROOT / page, target)
    ]
    assert not broken


def written(page: Path, target: str) -> bool:
    """A file is there, or the site writes it: pages of mechanisms come from the folders of models."""
    path = (page.parent / target).resolve()
    relative = path.relative_to(ROOT).as_posix()
    if relative.startswith("docs/mechanisms/"):
        return path.stem == "index" or (ROOT / "models" / path.stem).is_dir()
    return path.exists()


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text().splitlines()) <= 150


@pytest.mark.parametrize("module", MODULES)
def test_docstring_examples_run(module: str) -> None:
    assert doctest.testmod(importlib.import_module(module)).failed == 0


def test_a_wrong_example_is_found(tmp_path: Path) -> None:
    code = blocks("text\n```python\nassert 1 + 1 == 3\n```\n", "python")
    assert len(code) == 1
    ran, words = ends_with(["\nx = 1\n", *code, "\nx = 2\n"], "page", tmp_path)
    assert ran == 1
    assert 'File "page", line 3' in words  # the line of the page, where a reader looks
    assert "AssertionError" in words


def test_a_page_that_leaves_before_its_end_is_found(tmp_path: Path) -> None:
    """An end without an error is no proof that the rest was run."""
    assert ends_with(["\nraise SystemExit\n", "\nassert False\n"], "page", tmp_path) == (0, "")


def test_a_name_that_only_tests_have_imported_is_found(tmp_path: Path) -> None:
    """Other tests have imported all of flexinv in this process: a reader has not."""
    ran, words = ends_with(["\nimport flexinv\nflexinv.drives\n"], "page", tmp_path)
    assert ran == 0
    assert "no attribute 'drives'" in words
