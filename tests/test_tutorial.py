"""The tutorial "Bring your own engine": its commands and files, in an empty folder, as a reader would type them."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = Path(__file__).resolve().parent.parent / "docs" / "tutorials" / "own-engine.md"
STEP = re.compile(r"^(?:`(\S+)`:\n\n)?```(console|c|toml)\n(.*?)^```$", re.M | re.S)


def steps() -> list[tuple[str, str]]:
    """Files (name, text) and commands ("", line) of the page, in its order."""
    result = []
    for name, language, text in STEP.findall(PAGE.read_text()):
        if language == "console":
            result += [("", line.removeprefix("$ ")) for line in text.splitlines()]
        else:
            assert name, f"a block of {language} without the name of its file"
            result.append((name, text))
    return result


def test_the_page_has_all_three_ways() -> None:
    commands = [text for name, text in steps() if not name]
    assert {name for name, _ in steps()} == {"", "pendulum.c", "crosscheck.toml"}
    assert sum("conform" in line for line in commands) == 2
    assert any("records" in line for line in commands)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
def test_the_tutorial_runs(tmp_path: Path) -> None:
    scripts = Path(sys.executable).parent
    surroundings = os.environ | {
        "PATH": f"{scripts}{os.pathsep}{os.environ['PATH']}",
        "XDG_CONFIG_HOME": str(tmp_path / "config"),
    }
    (home := tmp_path / "team").mkdir()
    for name, text in steps():
        if name:
            (home / name).write_text(text)
            continue
        words = shlex.split(text)
        if words[:4] == ["python", "-m", "pip", "install"]:
            continue  # what is tested is installed
        if words == ["crosscheck", "run"]:  # all engines: here the tutorial's own and one other
            words += ["--engines", "flexinv,mine,pinocchio"]
        done = subprocess.run(words, cwd=home, env=surroundings, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, f"{text}\n{done.stdout}\n{done.stderr}"
    assert "pendulum holds 1 of 13 rungs" in done.stdout
    assert "blind (seed" in done.stdout
