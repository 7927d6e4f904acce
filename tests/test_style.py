"""The house rules hold everywhere, and each rule refuses a small text that breaks it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import house_rules as rules
import pytest

ROOT = Path(__file__).resolve().parent.parent
NUMERICAL = sorted((ROOT / "flexinv").rglob("*.py"))
PACKAGES = NUMERICAL + sorted((ROOT / "crosscheck").rglob("*.py"))
ALL = PACKAGES + sorted((ROOT / "tests").rglob("*.py")) + sorted((ROOT / "docs").rglob("*.py"))
TEXTS = [
    path
    for folder in ("flexinv", "crosscheck", "tests", "models", "docs", ".")
    for path in sorted((ROOT / folder).glob("*" if folder == "." else "**/*"))
    if path.suffix in (".py", ".toml", ".md", ".txt", ".csv", ".html", ".j2", ".js", ".urdf") or path.name == "Makefile"
]


def name(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts)


def check(paths: list[Path], rule: Callable[[Path], list[str]]) -> None:
    broken = [f"{path.relative_to(ROOT)}, {line}" for path in paths for line in rule(path)]
    assert not broken, "\n" + "\n".join(broken)


def test_public_functions_give_units() -> None:
    check(NUMERICAL, lambda path: rules.units_in_docstrings(path.read_text()))


def test_functions_are_annotated() -> None:
    check(PACKAGES, lambda path: rules.annotations(path.read_text()))


def test_modules_and_functions_are_short() -> None:
    check(ALL, lambda path: rules.sizes(path.read_text()))


def test_imports_point_down() -> None:
    check(PACKAGES, lambda path: rules.layering(name(path), path.read_text()))
    for paths in (NUMERICAL, PACKAGES):
        broken = rules.cycles({name(path): path.read_text() for path in paths})
        assert not broken, "\n".join(broken)


def test_only_command_lines_print() -> None:
    check(
        [p for p in PACKAGES if p.name != "cli.py" and p.parent.name != "commands"],
        lambda path: rules.prints(path.read_text()),
    )


def test_no_tolerance_is_padded() -> None:
    check(ALL, lambda path: rules.padded_tolerances(path.read_text()))


def test_exceptions_are_raised() -> None:
    check(ALL, lambda path: rules.forgotten_raise(path.read_text()))


def test_no_file_names_a_machine() -> None:
    check(TEXTS, lambda path: rules.machine_paths(path.read_text()))


# --- the rules themselves -------------------------------------------------------------------------------------------

LONG = "def f() -> None:\n" + "    x = 1\n" * (rules.FUNCTION_LINES + 1)
BAD = {
    "f has no docstring": (rules.units_in_docstrings, "def f(): pass"),
    "f gives no unit": (rules.units_in_docstrings, 'def f(y):\n    "Return x[0] and y[name] of [joints.NAME]."'),
    "A.f gives no unit": (rules.units_in_docstrings, 'class A:\n    def f(self) -> Array:\n        "Return a length."'),
    "A.p gives no unit": (
        rules.units_in_docstrings,
        'class A:\n    @property\n    def p(self) -> float:\n        "Peak."',
    ),
    "f has no annotation of x, return": (rules.annotations, "def f(x): pass"),
    "f has no annotation of y": (rules.annotations, "def f(x: int, *, y=1) -> int: return x"),
    f"{rules.MODULE_LINES + 1} lines, at most": (rules.sizes, "x = 1\n" * (rules.MODULE_LINES + 1)),
    f"f has {rules.FUNCTION_LINES + 1} lines": (rules.sizes, LONG),
    "print outside": (rules.prints, "def f():\n    print('x')"),
    "sys.stdout.write outside": (rules.prints, "import sys\nsys.stdout.write('x')"),
    "padded tolerance tol * 10": (rules.padded_tolerances, "assert x < tol * 10"),
    "padded tolerance 1.5 * limit": (rules.padded_tolerances, "assert x < 1.5 * limit"),
    "padded tolerance 2 * case.tolerance": (rules.padded_tolerances, "close(x, y, atol=2 * case.tolerance)"),
    "InputError is built but not raised": (rules.forgotten_raise, "def f():\n    InputError('x')"),
    "line 2: " + "/home" + "/somebody": (rules.machine_paths, "x\ny = '" + "/home" + "/somebody/a.toml'"),
}


@pytest.mark.parametrize("complaint", BAD)
def test_a_broken_rule_is_found(complaint: str) -> None:
    rule, text = BAD[complaint]
    found = rule(text)
    assert len(found) == 1
    assert complaint in found[0]


MISPLACED = {
    "flexinv stands alone": ("flexinv.files.case", "from crosscheck.record import Record"),
    "only the command line draws": ("flexinv.solution", "import matplotlib.pyplot as plt"),
    "and loads what draws when it does": ("flexinv.cli", "from matplotlib import pyplot"),
    "a command line is imported by nobody": ("crosscheck.portrait", "from flexinv.cli import main"),
    "only crosscheck/engines/mujoco*.py may": ("crosscheck.runner", "import mujoco"),
    "only crosscheck/engines/exudyn*.py may": ("crosscheck.engines.mujoco", "def f():\n    import exudyn as exu"),
    "only crosscheck/engines/pinocchio*.py may": ("flexinv.rigid", "from pinocchio import rnea"),
    "an adapter reads primary data only": ("crosscheck.engines.exudyn_rigid", "from flexinv.rotations import exp_so3"),
    "reads primary data only (errors": ("crosscheck.engines.pinocchio", "from flexinv import joint_torques"),
    "an engine does not know another": ("crosscheck.engines.mujoco_model", "from crosscheck.engines.exudyn import run"),
    "does not know another": ("crosscheck.engines.mujoco", "import crosscheck.engines.flexinv"),
    "imports are written in full": ("flexinv.files.case", "from .motion import Motion"),
}


@pytest.mark.parametrize("complaint", MISPLACED)
def test_a_misplaced_import_is_found(complaint: str) -> None:
    found = rules.layering(*MISPLACED[complaint])
    assert len(found) == 1
    assert complaint in found[0]


def test_imports_in_their_place_are_silent() -> None:
    for module, source in (
        ("flexinv.cli", "def plot():\n    import matplotlib"),
        ("flexinv.cli", "from flexinv.cli_follow import follow_task"),
        ("crosscheck.__main__", "from crosscheck.cli import main"),
        ("flexinv.cli", "if TYPE_CHECKING:\n    from matplotlib.figure import Figure"),
        ("crosscheck.engines.mujoco_model", "import mujoco\nfrom crosscheck.engines.mujoco import run"),
        (
            "crosscheck.engines.exudyn_ge",
            "from flexinv.mechanism import Mechanism\nfrom flexinv.files.case import Case",
        ),
        ("crosscheck.engines.flexinv", "import flexinv\nfrom flexinv.scheme import solve"),
        ("crosscheck.report.html", "import plotly"),
    ):
        assert rules.layering(module, source) == []


def test_a_cycle_is_found_and_a_tree_is_not() -> None:
    tree = {"a.x": "from a.y import f\nimport a.z", "a.y": "from a import z", "a.z": "import numpy"}
    assert rules.cycles(tree) == []
    assert rules.cycles({**tree, "a.z": "from a.x import g"}) != []
    assert rules.cycles({**tree, "a.z": "def late():\n    from a.x import g"}) == []


def test_units_are_recognised() -> None:
    for unit in (
        "[-]",
        "[N m]",
        "[rad/s^2]",
        "[kg m^2]",
        "[N m s/rad]",
        "[m/s]",
        "[any unit]",
        "[1/m]",
        "[%]",
        "[m, rad, s]",
        "[unit of b]",
    ):
        assert rules.units_in_docstrings(f'def f(x):\n    "A value {unit}."') == []
    assert rules.units_in_docstrings('def f(name: str) -> str:\n    "Words have no unit."') == []


def test_paths_inside_the_project_are_no_machine_paths() -> None:
    assert rules.machine_paths("models/work/mechanism.toml  https://example.org/home/page  ./tmp/x") == []
