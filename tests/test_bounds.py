"""The command that tries the oldest and the newest of what flexinv needs."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
import try_bounds
import yaml

OUTCOMES = "= 2 failed, 2301 passed, 3 skipped, 14 deselected, 1 error in 402.11s (0:06:42) ="


def test_outcomes_are_those_of_pytest() -> None:
    expected = {"passed": 2301, "skipped": 3, "failed": 2, "error": 1}
    assert try_bounds.count_outcomes(OUTCOMES) == expected
    assert try_bounds.count_outcomes("12 passed in 0.10s") == {"passed": 12, "skipped": 0, "failed": 0, "error": 0}


@pytest.mark.parametrize("line", ["", "Killed", "no tests ran in 0.01s"])
def test_a_run_without_a_summary_is_an_error(line: str) -> None:
    with pytest.raises(ValueError, match="no summary of pytest"):
        try_bounds.count_outcomes(line)


def test_the_line_says_versions_and_outcomes() -> None:
    versions = try_bounds.read_versions(Path(sys.executable))
    assert list(versions) == ["Python", *try_bounds.NAMED]
    line = try_bounds.describe_run("newest", versions, try_bounds.count_outcomes(OUTCOMES), 402.4)
    assert line.startswith(f"newest: Python {versions['Python']}, numpy {versions['numpy']}, ")
    assert line.endswith("2301 passed, 3 skipped, 2 failed, 1 error in 402 s")


def test_tests_run_with_machine_code_of_their_own(tmp_path: Path) -> None:
    """A test that fails gives pytest's exit code; kernels of other versions stay where they are."""
    test = tmp_path / "test_it.py"
    test.write_text(
        "import os\n"
        "def test_folder():\n    print(os.environ['NUMBA_CACHE_DIR'])\n    assert False\n"
        "def test_other():\n    pass\n"
    )
    interpreter = tmp_path / "bin" / "python"
    interpreter.parent.mkdir()
    interpreter.write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    interpreter.chmod(0o755)
    lines: list[str] = []
    code, last = try_bounds.run_tests(interpreter, ["-p", "no:cacheprovider", str(test)], lines.append)
    assert code == 1
    assert try_bounds.count_outcomes(last) == {"passed": 1, "skipped": 0, "failed": 1, "error": 0}
    assert str(tmp_path / "machine_code") in "".join(lines)


def test_the_environment_is_named_by_bounds_and_python(root: Path) -> None:
    name = f"newest-{sys.version_info[0]}.{sys.version_info[1]}"
    assert try_bounds.name_environment(sys.executable, "newest") == root / "build" / "bounds" / name


def test_bounds_are_said_and_nothing_else() -> None:
    asked = [sys.executable, try_bounds.__file__, "oldest"]
    result = subprocess.run(asked, capture_output=True, text=True, check=False)
    assert result.returncode == 2
    assert "'oldest'" in result.stderr


def test_the_workflow_runs_this_command_on_every_python(root: Path) -> None:
    workflow = yaml.safe_load((root / ".github" / "workflows" / "tests.yml").read_text())
    job = workflow["jobs"]["bounds"]
    assert set(job["strategy"]["matrix"]["bounds"]) <= set(try_bounds.BOUNDS)
    assert job["strategy"]["matrix"]["python"] == workflow["jobs"]["all"]["strategy"]["matrix"]["python"]
    runs = [step["run"] for step in job["steps"] if "run" in step]
    assert all(run.startswith("python tests/shared/try_bounds.py ${{ matrix.bounds }}") for run in runs)
    for option in (*try_bounds.BOUNDS["lowest"], *try_bounds.BOUNDS["pinned"]):
        assert option.startswith("--") or (root / option).is_file()
