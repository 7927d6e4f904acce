"""All engines of this folder beside ours, by one command; needs Python and pip alone to begin with.

    python plugins/outside.py prepare          environment, programs, FMUs and crosscheck.toml below build/outside; once
    python plugins/outside.py report           every mechanism in every engine -> build/outside/report/index.html
    python plugins/outside.py conform          every outside engine climbs the ladder, and once more blind (FMUs do not)
    python plugins/outside.py test             the packages' own tests, and the mistakes in Simbody's program

What is missing (a compiler, Debian's Simbody, a wheel for this system) is said, and the others go on.  `make outside` is
the first two.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
FOLDER = ROOT / "build" / "outside"
# Packages of this folder, and what pip installs for each; drake without its dependencies: they would fetch Mosek.
PACKAGES = {
    "dart": ("dartpy",),
    "drake": ("--no-deps", "drake"),
    "newton": ("newton",),
    "pyelastica": ("pyelastica",),
}
# What each may be off: the error bars of those that compute otherwise stand in their own packages.
ROUNDED = "closed formulas on both sides: rounding"
RODS = "rods of another formulation, marched explicitly: the error bars of its meshes"
LIMITS = {
    "dart": (("torque", 1e-9, ROUNDED), ("tip", 1e-9, ROUNDED)),
    "drake": (("torque", 1e-9, ROUNDED), ("tip", 1e-9, ROUNDED)),
    "newton": (
        ("torque", 2e-5, "single precision: some hundred units in the last place of the forces that it adds up"),
        ("tip", 1e-5, "single precision: some hundred units in the last place of the largest distance"),
    ),
    "pyelastica": (
        ("torque", 1e-2, f"{RODS}; most where the torque jumps"),
        ("axial", 1e-2, f"{RODS}; most where the torque jumps"),
        ("deflection", 2e-3, RODS),
        ("tip", 2e-4, RODS),
        ("frequency", 1e-3, RODS),
    ),
}
LONG = 1800  # [s] for one engine and case: explicit rods take millions of steps
OURS = "flexinv,pinocchio,mujoco,exudyn*"
EXTRAS = ".[engines,robots,report,fmu]"
CONFIG = """# Written by plugins/outside.py.
[engines.fmu]
fmu = "fmus/{mechanism}.fmu"
abilities = "FMUs of rigid mechanisms, inverse dynamics, compiled from case kits"

[[engines.fmu.limits]]
quantity = "torque"
maximum = 1e-9
reason = "closed formulas on both sides: rounding"

[engines.plant]
fmu = "plants/{mechanism}.fmu"
abilities = "FMUs of rigid trees, forward dynamics: replay alone"
"""


def say(words: str) -> None:
    """Write a line to the terminal."""
    sys.stdout.write(f"{words}\n")
    sys.stdout.flush()


def call(words: Sequence[object], cwd: Path = ROOT) -> int:
    """Run a command, which is shown, and return its exit code."""
    shown = [str(word) for word in words]
    say("$ " + " ".join(shown))
    return subprocess.run(shown, cwd=cwd, check=False).returncode


def python(folder: Path) -> Path:
    """Return the Python of the environment."""
    return folder / "venv" / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def environment(folder: Path) -> list[str]:
    """Make the environment and return what is missing, in words; what is there already stays."""
    if not python(folder).is_file() and call([sys.executable, "-m", "venv", folder / "venv"]):
        raise SystemExit("no environment can be made here: python -m venv failed")
    pip = [python(folder), "-m", "pip", "install", "--quiet"]
    if call([*pip, "--constraint", "constraints.txt", "--editable", EXTRAS, "pytest"]):
        raise SystemExit("this project could not be installed; what pip said stands above")
    missing = []
    for name, wheels in PACKAGES.items():
        packages = ["--constraint", "constraints.txt", *wheels] if wheels[0] != "--no-deps" else [*wheels]
        if call([*pip, *packages]) or call([*pip, "--no-deps", HERE / f"crosscheck-{name}"]):
            missing.append(f"{name}: pip did not install {wheels[-1]}")
    return missing


def programs(folder: Path) -> list[str]:
    """Compile Simbody's program and the FMUs, write crosscheck.toml, and return what is missing, in words."""
    missing, text = [], CONFIG
    for name in installed(folder):
        for quantity, maximum, reason in LIMITS[name]:
            row = [
                f"[[engines.{name}.limits]]",
                f'quantity = "{quantity}"',
                f"maximum = {maximum}",
                f'reason = "{reason}"',
            ]
            text += "\n" + "\n".join(row) + "\n"
    for tool in ("make", "g++", "gcc"):
        if shutil.which(tool) is None:
            missing.append(f"there is no {tool}")
    prefix = os.environ.get("SIMBODY_PREFIX", "")
    if call(["make", "-C", HERE / "crosscheck-simbody", f"PREFIX={prefix}"]):
        missing.append("simbody: its program does not compile (Debian: libsimbody-dev, nlohmann-json3-dev)")
    else:
        stated = (HERE / "crosscheck-simbody" / "crosscheck.toml").read_text(encoding="utf-8")
        text += "\n" + stated.replace('"./answer"', f'"{HERE / "crosscheck-simbody" / "answer"}"')
    maker = [python(folder), HERE / "crosscheck-fmu-example" / "make_fmu.py", "--models", ROOT / "models"]
    if call([*maker, folder / "fmus"]) or call([*maker, folder / "plants", "--forward"]):
        missing.append("fmu: FMUs could not be compiled")
    (folder / "crosscheck.toml").write_text(text, encoding="utf-8")
    return missing


def installed(folder: Path) -> list[str]:
    """Return the names of the packages that are installed."""
    ask = "import importlib.util as u, sys; print(*[n for n in sys.argv[1:] if u.find_spec('crosscheck_' + n)])"
    done = subprocess.run([python(folder), "-c", ask, *PACKAGES], capture_output=True, text=True, check=False)
    return done.stdout.split()


def engines(folder: Path) -> list[str]:
    """Return the names of the outside engines that are there."""
    text = (folder / "crosscheck.toml").read_text(encoding="utf-8")
    return [*installed(folder), *(name for name in ("simbody", "fmu") if f"[engines.{name}]" in text)]


def crosscheck(folder: Path, command: str, *words: object) -> int:
    """Run crosscheck in the environment with the engines of this folder, and return its exit code."""
    config = ["--config", folder / "crosscheck.toml", "--trust-commands"]
    return call([python(folder), "-m", "crosscheck", command, *words, *config])


def report(folder: Path, names: Iterable[str], jobs: int) -> int:
    """Run every mechanism in our engines and the outside ones, and return the exit code."""
    wanted = ",".join([OURS, *engines(folder), "plant"])
    more = ["--models", "models", "--studies", "feedforward,ladder", "--jobs", jobs, "--timeout", LONG]
    return crosscheck(folder, "run", *names, "--engines", wanted, *more, "--out", folder / "report")


def conform(folder: Path, jobs: int) -> int:
    """Let every outside engine climb the ladder, then blind, and return the gravest exit code.

    FMUs hold the numbers of their mechanisms, and are not asked blind.
    """
    wanted, more = engines(folder), ["--jobs", jobs, "--timeout", LONG]
    seeing = [name for name in wanted if name != "fmu"]
    codes = [crosscheck(folder, "conform", ",".join(wanted), *more, "--out", folder / "conform")]
    if seeing:
        codes.append(crosscheck(folder, "conform", ",".join(seeing), "--blind", *more, "--out", folder / "blind"))
    return max(codes)


def test(folder: Path) -> int:
    """Run the tests of every package in the environment and return the gravest exit code."""
    known = sorted(f.parent for f in HERE.glob("crosscheck-*/tests"))
    return max(call([python(folder), "-m", "pytest", "-q", "-p", "no:cacheprovider", "tests"], one) for one in known)


def main() -> int:
    """Do what the command line says and return the exit code."""
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("step", choices=("prepare", "report", "conform", "test"))
    words.add_argument("names", nargs="*", help="of report: mechanisms or patterns; without names all")
    words.add_argument("--folder", type=Path, default=FOLDER, help="where all of it is made; default: build/outside")
    words.add_argument("--jobs", type=int, default=1, help="engines running at a time; times are true of one")
    asked = words.parse_args()
    folder = asked.folder.resolve()
    if asked.step == "prepare":
        folder.mkdir(parents=True, exist_ok=True)
        missing = [*environment(folder), *programs(folder)]
        say(f"ready: {', '.join(engines(folder))}" + "".join(f"\nmissing: {one}" for one in missing))
        return 0
    if not (folder / "crosscheck.toml").is_file():
        raise SystemExit(f"{folder} is not prepared; write python plugins/outside.py prepare")
    if asked.step == "report":
        return report(folder, asked.names, asked.jobs)
    return conform(folder, asked.jobs) if asked.step == "conform" else test(folder)


if __name__ == "__main__":
    sys.exit(main())
