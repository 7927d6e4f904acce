"""A project outside of this one: the skeleton runs as it is, also from a wheel in a fresh environment, in an empty folder."""

from __future__ import annotations

import os
import shutil
import site
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from crosscheck.cli import main
from crosscheck.workflows.skeleton import write
from flexinv.errors import InputError


def test_the_skeleton_is_written_once_and_nothing_is_replaced(tmp_path: Path) -> None:
    done = CliRunner().invoke(main, ["init", str(tmp_path / "team")])
    assert done.exit_code == 0, done.output
    files = {f.relative_to(tmp_path / "team").as_posix() for f in (tmp_path / "team").rglob("*") if f.is_file()}
    assert {
        "crosscheck.toml",
        "my_engine.py",
        ".gitignore",
        "README.md",
        "models/double_pendulum/mechanism.toml",
    } < files
    with pytest.raises(InputError, match="is there already, and stays"):
        write(tmp_path / "team")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "crosscheck.toml").write_text("mine")
    assert CliRunner().invoke(main, ["init", str(tmp_path / "other")]).exit_code == 2
    assert [f.name for f in (tmp_path / "other").iterdir()] == ["crosscheck.toml"]


@pytest.mark.slow
def test_the_skeleton_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    write(tmp_path / "team")
    monkeypatch.chdir(tmp_path / "team")
    assert CliRunner().invoke(main, ["trust", "--yes"]).exit_code == 0
    done = CliRunner().invoke(main, ["run", "--engines", "flexinv,mine"])
    assert done.exit_code == 0, done.output
    words = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "models", "--crosscheck-engines", "mine"]
    tested = subprocess.run(words, capture_output=True, text=True, timeout=300)
    assert tested.returncode == 0, tested.stdout + tested.stderr
    assert "mine runs  the Python object my_engine:Mine" in tested.stdout
    assert "1 passed" in tested.stdout


def built(root: Path, folder: Path) -> Path:
    """A wheel of this project; skipped in words where it cannot be built (no network for its build environment)."""
    source = folder / "source"
    source.mkdir()
    for name in ("flexinv", "crosscheck", "models"):
        shutil.copytree(root / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(root / name, source)
    words = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(folder), str(source)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300)
    if done.returncode:
        pytest.skip(f"no wheel can be built here: {(done.stderr.strip() or done.stdout.strip()).splitlines()[-1]}")
    (wheel,) = folder.glob("flexinv-*.whl")
    return wheel


@pytest.mark.slow
def test_a_wheel_in_a_fresh_environment_and_an_empty_folder(root: Path, tmp_path: Path) -> None:
    """What the wheel needs beside is borrowed from this environment by a path; flexinv and crosscheck are the wheel's own.

    Kernels that this checkout has compiled from the same text are taken along: compiling them anew shows nothing of the wheel.
    """
    wheel = built(root, tmp_path)
    python = tmp_path / "venv" / "bin" / "python"
    words = [sys.executable, "-m", "venv", "--without-pip", str(tmp_path / "venv")]
    subprocess.run(words, check=True, capture_output=True, timeout=120)
    own = next((tmp_path / "venv" / "lib").glob("python*")) / "site-packages"
    # --target leaves alone what is installed here; --prefix would remove it
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", str(own), str(wheel)]
    subprocess.run(install, check=True, capture_output=True, timeout=120)
    (own / "borrowed.pth").write_text("\n".join(site.getsitepackages()) + "\n")
    for kernel in (root / "flexinv").rglob("__pycache__/*.nb[ic]"):
        (own / kernel.parent.relative_to(root)).mkdir(exist_ok=True)
        shutil.copy(kernel, own / kernel.parent.relative_to(root))
    team = tmp_path / "team"
    team.mkdir()
    kept = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    surroundings = kept | {"XDG_CONFIG_HOME": str(tmp_path / "config")}

    def call(*words: str) -> str:
        done = subprocess.run(
            [str(python), "-m", *words], cwd=team, env=surroundings, capture_output=True, text=True, timeout=500
        )
        assert done.returncode == 0, f"{words}\n{done.stdout}\n{done.stderr}"
        return done.stdout + done.stderr

    ask = [str(python), "-c", "import crosscheck; print(crosscheck.__file__)"]
    where = subprocess.run(ask, cwd=team, env=surroundings, capture_output=True, text=True, timeout=120)
    assert str(tmp_path / "venv") in where.stdout, where.stderr
    call("crosscheck", "init")
    call("crosscheck", "kit", "double_pendulum")
    call("crosscheck", "trust", "--yes")
    call("crosscheck", "run", "--engines", "flexinv,mine")
    assert "mine 0.1 holds 1 of 13 rungs" in call("crosscheck", "conform", "mine", "--rungs", "double_pendulum,loop")
    assert '"$schema"' in call("crosscheck", "schema", "mechanism")
    assert "1 passed" in call("pytest", "-q", "-p", "no:cacheprovider", "models", "--crosscheck-engines", "mine")
    assert (team / "reports" / "latest" / "index.html").is_file()
