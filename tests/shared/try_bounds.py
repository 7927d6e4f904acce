"""Run the fast tests with the oldest, the pinned or the newest versions of what flexinv needs.

    python tests/shared/try_bounds.py lowest --python python3.13

Makes an environment of that Python below build/bounds, installs the checkout with every extra there, and runs the tests that are
neither slow nor in need of a browser.  The last line says which versions they met, and how many tests passed.  Machine code of
kernels is kept beside the environment, so that no version of Numba meets what another has compiled.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
EXTRAS = ".[all,fmu]"
FAST = "not slow and not browser"
# What pip is told beside the extras.  Everything is new in an environment that is made once, so the newest needs two words more
# only where it is used again.
BOUNDS: dict[str, list[str]] = {
    "lowest": ["--constraint", "docs/release/lower-bounds.txt"],
    "pinned": ["--constraint", "constraints.txt"],
    "newest": ["--upgrade", "--upgrade-strategy", "eager"],
}
# The packages whose versions the last line says.
NAMED = ("numpy", "scipy", "pandas", "numba", "pin", "mujoco", "exudyn", "pydantic", "click", "pytest")
_VERSIONS = """
import json, platform, sys
from importlib.metadata import version
print(json.dumps({"Python": platform.python_version()} | {name: version(name) for name in sys.argv[1:]}))
"""


def make_environment(python: str, folder: Path) -> Path:
    """Return the interpreter of a new environment with pip in ``folder``; one that is there stays."""
    interpreter = folder / "bin" / "python"
    if interpreter.is_file():
        return interpreter
    made = subprocess.run([python, "-m", "venv", str(folder)], check=False)
    if made.returncode:  # Debian's Python has no ensurepip: its own pip fills the environment
        subprocess.run([python, "-m", "venv", "--clear", "--without-pip", str(folder)], check=True)
        subprocess.run([python, "-m", "pip", "--python", str(interpreter), "install", "pip"], check=True)
    return interpreter


def name_environment(python: str, bounds: str) -> Path:
    """Return the folder of the environment of these bounds and this Python, by its minor version."""
    asked = [python, "-c", "import sys; print('%d.%d' % sys.version_info[:2])"]
    minor = subprocess.run(asked, check=True, capture_output=True, text=True).stdout.strip()
    return ROOT / "build" / "bounds" / f"{bounds}-{minor}"


def read_versions(interpreter: Path) -> dict[str, str]:
    """Return the versions of Python and of the packages ``NAMED`` in an environment."""
    asked = [str(interpreter), "-c", _VERSIONS, *NAMED]
    versions: dict[str, str] = json.loads(subprocess.run(asked, check=True, capture_output=True, text=True).stdout)
    return versions


def count_outcomes(summary: str) -> dict[str, int]:
    """Return how many tests passed, were skipped, failed or broke, by pytest's last line; no such line is an error.

    Raises ValueError.
    """
    counts = {
        kind.rstrip("s"): int(number)
        for number, kind in re.findall(r"(\d+) (passed|skipped|failed|errors?)\b", summary)
    }
    if not counts or " in " not in summary:
        raise ValueError(f"no summary of pytest: {summary!r}")
    return {kind: counts.get(kind, 0) for kind in ("passed", "skipped", "failed", "error")}


def describe_run(bounds: str, versions: Mapping[str, str], counts: Mapping[str, int], seconds: float) -> str:
    """Return the line that says what was tried and what came of it; ``seconds`` [s]."""
    with_versions = ", ".join(f"{name} {version}" for name, version in versions.items())
    outcomes = ", ".join(f"{number} {kind}" for kind, number in counts.items())
    return f"{bounds}: {with_versions}: {outcomes} in {seconds:.0f} s"


def run_tests(interpreter: Path, arguments: list[str], show: Callable[[str], object]) -> tuple[int, str]:
    """Run pytest in the checkout; return its exit code [-] and its last line, and show every line as it comes."""
    folder = interpreter.parents[1]
    asked = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "machine_code")}
    command = [str(interpreter), "-m", "pytest", "-m", FAST, *arguments]
    last = ""
    with subprocess.Popen(command, cwd=ROOT, env=asked, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            show(line)
            last = line.strip() or last
    return process.returncode, last


def main() -> int:
    """Make the environment, run the tests, say what came of them; return pytest's exit code [-]."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bounds", choices=BOUNDS)
    parser.add_argument("--python", default=sys.executable, help="the interpreter to try with (default: this one)")
    options, arguments = parser.parse_known_args()
    folder = name_environment(options.python, options.bounds)
    interpreter = make_environment(options.python, folder)
    install = [str(interpreter), "-m", "pip", "install", "--quiet", *BOUNDS[options.bounds], "--editable", EXTRAS]
    subprocess.run(install, cwd=ROOT, check=True)
    begin = time.monotonic()
    code, last = run_tests(interpreter, arguments, sys.stdout.write)
    seconds = time.monotonic() - begin
    sys.stdout.write(describe_run(options.bounds, read_versions(interpreter), count_outcomes(last), seconds) + "\n")
    return code


if __name__ == "__main__":
    sys.exit(main())
