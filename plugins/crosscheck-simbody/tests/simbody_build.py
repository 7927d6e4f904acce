"""Compile the program of this folder, or a copy of it with a mistake in it; say in words what is missing for that."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parents[1]
# A folder into which the Debian packages were unpacked; "": they are installed.
PREFIX = os.environ.get("SIMBODY_PREFIX", "")
LIMITS = """
[[engines.{name}.limits]]
quantity = "torque"
maximum = 1e-9
reason = "closed formulas on both sides: rounding, which Newton's method on closures enlarges"
"""


def why_not() -> str:
    """What is missing here, in words; "" where the program can be compiled."""
    missing = [tool for tool in ("g++", "make") if shutil.which(tool) is None]
    if missing:
        return f"there is no {' and no '.join(missing)}"
    headers = {"simbody/Simbody.h": "libsimbody-dev", "nlohmann/json.hpp": "nlohmann-json3-dev"}
    for header, package in headers.items():
        if not Path(f"{PREFIX}/usr/include/{header}").is_file():
            return f"{package} is not installed (apt-get install {package}; SIMBODY_PREFIX names a folder of unpacked packages)"
    return ""


def build(folder: Path, *changes: tuple[str, str]) -> Path:
    """The program in a folder, compiled with these pieces of its source exchanged; each has to be there once."""
    source = (HERE / "answer.cpp").read_text(encoding="utf-8")
    for old, new in changes:
        assert source.count(old) == 1, old
        source = source.replace(old, new)
    folder.mkdir(parents=True)
    (folder / "answer.cpp").write_text(source, encoding="utf-8")
    shutil.copy(HERE / "Makefile", folder)
    words = ["make", f"PREFIX={PREFIX}", "CXXFLAGS=-O0"]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    assert not done.returncode, done.stderr
    return folder / "answer"


def engines(file: Path, programs: dict[str, tuple[Path, str]]) -> Path:
    """crosscheck.toml with programs, each asked for the cases that fit a pattern."""
    rows = [
        f'[engines.{name}]\ncommand = ["{program}", "{{kit}}", "{{out}}"]\ncases = ["{cases}"]\n{LIMITS.format(name=name)}'
        for name, (program, cases) in programs.items()
    ]
    file.write_text("\n".join(rows), encoding="utf-8")
    return file


def crosscheck(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """The command line, in a folder, with nothing that earlier runs kept."""
    environment = {**os.environ, "CROSSCHECK_KEPT": ""}
    return subprocess.run(
        [sys.executable, "-m", "crosscheck", *words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
