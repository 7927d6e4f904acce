"""The house rules hold everywhere, and each rule refuses a small text that breaks it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import house_rules as rules
import house_table as table
import kept_names
import kept_sizes
import naming_rules as names
import pytest

from flexinv import _HOME

ROOT = Path(__file__).resolve().parent.parent
NUMERICAL = sorted((ROOT / "flexinv").rglob("*.py"))
PACKAGES = NUMERICAL + sorted((ROOT / "crosscheck").rglob("*.py"))
# Developers' tools, which are not installed: the rules of a single file hold for them, too.
TOOLS = [
    path
    for folder in ("benchmarks", "campaigns/beyond", "campaigns/days", "campaigns/log_faults")
    for path in sorted((ROOT / folder).rglob("*.py"))
]
# What the build of the site writes below docs/.
BUILT = {ROOT / "docs" / name for name in ("_build", "_static", "examples", "mechanisms", "reference/generated")}
ALL = (
    PACKAGES
    + TOOLS
    + sorted((ROOT / "tests").rglob("*.py"))
    + sorted(path for path in (ROOT / "docs").rglob("*.py") if not BUILT & set(path.parents))
)
TEXTS = [
    path
    for folder in ("flexinv", "crosscheck", "benchmarks", "campaigns", "tests", "models", "docs", ".")
    for path in sorted((ROOT / folder).glob("*" if folder == "." else "**/*"))
    if not BUILT & set(path.parents)
    if path.suffix in (".py", ".toml", ".md", ".txt", ".csv", ".html", ".j2", ".js", ".urdf") or path.name == "Makefile"
]


VERBS = names.read_verbs((ROOT / "CONTRIBUTING.md").read_text())
# Functions with more than eight parameters, and why they stay so.
FLAT = {
    "flexinv/rigid/blocks.py: compute_torque_blocks": "one sample takes 2.3 us; records as arguments add 1.4 us",
}
# Words that had several meanings; each has one now.
# What does the same in two forms has the same names: time integration and beams in space and in a plane, vectors and lanes,
# kernels with private parts of Numba and without.
TWINS = (
    ("flexinv.dynamics", "flexinv.planar"),
    ("flexinv.elements.beam", "flexinv.elements.planar_beam"),
    ("flexinv.kernels.vec3", "flexinv.kernels.simd"),
    ("flexinv.kernels.compiler.plain", "flexinv.kernels.compiler.arrays"),
    ("flexinv.kernels.compiler.plain", "flexinv.kernels.compiler.code_cache"),
    ("flexinv.kernels.compiler.plain", "flexinv.kernels.compiler.record_types"),
)
# Names that mean the same in every module that defines them, each for its own iteration, file, or type.
SAME = (
    "INCREMENT", "MOST_HALVINGS", "MOST_ITERATIONS", "MOST_STEPS",  # where an iteration ends
    "LARGEST_FILE",  # that is read, of its kind
    "MeshTable",  # the mesh, in the file of a mechanism and in that of its cases
    "LINE",  # of the cache: signed for Python, unsigned for kernels
    "T",  # any type
)  # fmt: skip
KERNEL = "compiled code apart from the code that calls it: a change of the caller compiles nothing anew"
EQUATIONS = "equations of their own, at the head of the file"
COMPARED = "a step of the comparison, in a file of its own name"
ASKED = "what an engine's own model answers, apart from what is lifted from it"
CARD = "how a result is shown, apart from the result"
# Modules that one other imports and that fit into it, and why they stay apart.
ALONE = {
    "crosscheck.equivalence.card": CARD,
    "crosscheck.board.jobs": "what is sent to the workers of a cluster, apart from what stays here",
    "crosscheck.report.markdown": "a format of its own, as the others",
    "crosscheck.bisect.dependencies": "one more environment, apart from the words of an answer",
    "crosscheck.studies.robot_sweep": "states and torques of many robots, which the benchmarks take, too",
    "crosscheck.causes.quantity_causes": "what no effort shows, a question of its own",
    "crosscheck.causes.repair": "full runs that prove a cause, apart from the words of a diagnosis",
    "flexinv.optimal_motion.motion_figure": "figures, which are loaded when one is drawn",
    "flexinv.dynamics.idle_joints": "it needs the linearisation and the start, which need the solver that asks it",
    "flexinv.export.forward.rotations": "functions in C of their own, which not every library has",
    "flexinv.export.flexible.rest_plan": "a start of its own, which not every library has",
    "crosscheck.identification.estimation.march_steps": "errors in time, apart from days; the campaign takes it, too",
    "crosscheck.linting.part_cells": "how cells hang together, without what is stated of them",
    "crosscheck.linting.part_motions": "ready matrices, of which alone eigenvalues are asked for",
    "crosscheck.linting.part_statements": "what is stated of a part, without its mesh",
    "flexinv.files.meshes.nastran": "a format of its own, as Abaqus's",
    "crosscheck.linting.parts": "meshes of links, which need their matrices; lint itself looks at files",
    "flexinv.parts.node_order": "an order of elimination, graph alone, apart from what is eliminated",
    "flexinv.kernels.compiler.kernel_compiler": "Numba's compiler; keeping what it makes on the disk is another matter",
    "flexinv.kernels.compiler.arrays": "private parts of Numba for threads, apart from those for records",
    "flexinv.kernels.compiler.plain": "the other way to compile kernels, without private parts of Numba",
    "crosscheck.identification.logs.bag": "a file format of its own",
    "crosscheck.doors.program_files": "a walk through folders, apart from engines and their trust",
    "crosscheck.run.answer_stores": "answers of earlier runs, apart from the doing of jobs",
    "crosscheck.engines.exudyn.own_dynamics": ASKED,
    "crosscheck.engines.pinocchio.own_dynamics": ASKED,
    "flexinv.rigid.derivative_kernel": KERNEL,
    "flexinv.sampled.limits_passed": "a judge of a motion, beside the others",
    "flexinv.rigid.regressor_kernel": KERNEL,
    "crosscheck.causes.apply": "changes of an engine's efforts, apart from the model that is fitted",
    "crosscheck.commands": "the commands, of which the program is made",
    "crosscheck.doors.record": "what a door makes of answers on disk, beside the programs and packages of the others",
    "crosscheck.engines.exudyn.ends": "questions to an engine's own model, one a module",
    "crosscheck.engines.exudyn.static_probes": "questions to an engine's own model, one a module",
    "crosscheck.engines.exudyn.weights": "questions to an engine's own model, one a module",
    "crosscheck.engines.flexinv.determinacy": EQUATIONS,
    "crosscheck.engines.flexinv_c.adapter": "found by its name: an engine's adapter",
    "crosscheck.engines.pinocchio.adapter": "found by its name: an engine's adapter",
    "crosscheck.identification.logs.relations": EQUATIONS,
    "crosscheck.kit.page": "the page of a kit in words, apart from its data",
    "crosscheck.equivalence.beams.sampled": "numbers of a beam, apart from what differs in them",
    "crosscheck.equivalence.matching.numbers": COMPARED,
}


@pytest.fixture(scope="module", autouse=True)
def trees() -> Iterator[None]:
    """The trees of all texts, parsed once for all rules and kept no longer than these tests run."""
    yield
    rules.forget()


def name(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts)


def check(paths: list[Path], rule: Callable[[Path], list[str]]) -> None:
    broken = [f"{path.relative_to(ROOT)}, {line}" for path in paths for line in rule(path)]
    assert not broken, "\n" + "\n".join(broken)


def test_public_functions_give_units() -> None:
    check(NUMERICAL, lambda path: rules.units_in_docstrings(path.read_text()))


def test_functions_are_annotated() -> None:
    check(PACKAGES + TOOLS, lambda path: rules.unannotated(path.read_text()))


def test_modules_and_functions_are_short() -> None:
    check(ALL, lambda path: rules.sizes(path.read_text()))


def test_functions_say_few_things() -> None:
    def rule(path: Path) -> list[str]:
        here = f"{path.relative_to(ROOT)}: "
        kept = {key.removeprefix(here) for key in kept_sizes.KEPT if key.startswith(here)}
        return rules.oversized(path.read_text(), kept)

    check(PACKAGES, rule)


def test_sizes_that_are_kept_are_there_and_have_a_reason() -> None:
    for key, reason in kept_sizes.KEPT.items():
        path, _, function = key.partition(": ")
        assert reason, key
        assert function in names.function_names((ROOT / path).read_text()), key


def test_one_thought_is_one_statement() -> None:
    check(PACKAGES + TOOLS, lambda path: rules.packed(path.read_text()))


def test_swaps_and_unpacking_are_no_packing() -> None:
    for text in ("a, b = b, a", "a, b = f()", "a, b = a + b, a", "(a, b), c = f(), g(a)", "x[0], x[1] = x[1], x[0]"):
        assert rules.packed(text) == []


def test_types_of_arrays_are_defined_once() -> None:
    check(PACKAGES + TOOLS, lambda path: rules.second_types(name(path), path.read_text()))
    text = "Array = NDArray[np.float64]"
    assert rules.second_types("crosscheck.causes.fit", text) == [
        "line 1: Array is defined again; write from flexinv.typing import Array"
    ]
    assert rules.second_types("crosscheck.engines.mujoco.rod", text) == []


def test_imports_point_down() -> None:
    check(PACKAGES, lambda path: rules.layering(name(path), path.read_text()))
    for paths in (NUMERICAL, PACKAGES):
        broken = rules.cycles({name(path): path.read_text() for path in paths})
        assert not broken, "\n".join(broken)


def test_folders_are_not_crowded() -> None:
    folders = {path.parent for path in PACKAGES}
    counted = {str(f.relative_to(ROOT)): sum(p.name != "__init__.py" for p in f.glob("*.py")) for f in folders}
    assert names.crowded(counted) == []


def test_tests_lie_in_the_folders_of_what_they_test() -> None:
    for package in ("flexinv", "crosscheck"):
        inside = {p.parent.relative_to(ROOT / "tests") for p in (ROOT / "tests" / package).rglob("test_*.py")}
        assert [str(folder) for folder in sorted(inside) if not (ROOT / folder / "__init__.py").is_file()] == []


def test_records_have_names() -> None:
    check(PACKAGES + TOOLS, lambda path: names.letter_records(path.read_text()))


def test_functions_have_few_parameters() -> None:
    def rule(path: Path) -> list[str]:
        here = str(path.relative_to(ROOT))
        return [line for line in names.many_parameters(path.read_text()) if f"{here}: {line.split()[2]}" not in FLAT]

    check(PACKAGES + TOOLS, rule)


def test_words_have_one_meaning() -> None:
    sources = {name(path): path.read_text() for path in NUMERICAL}
    assert names.homonyms(sources, TWINS, SAME, ("_LINE",)) == []


def test_modules_that_one_other_imports_have_a_reason() -> None:
    sources = {name(path).removesuffix(".__init__"): path.read_text() for path in PACKAGES}
    assert names.lonely(sources, rules.importers(sources), ALONE) == []


def test_functions_begin_with_verbs() -> None:
    assert len(VERBS) <= 60
    assert not VERBS & {"get", "do", "handle", "process"}
    check(PACKAGES + TOOLS, lambda path: names.without_verb(path.read_text(), VERBS, kept_names.NAMES))


def test_names_that_are_kept_are_there() -> None:
    known = {name for path in PACKAGES + TOOLS for name in names.function_names(path.read_text())}
    assert sorted(kept_names.NAMES - known) == []


def test_docstrings_do_not_ask() -> None:
    check(PACKAGES + TOOLS, lambda path: names.questions(path.read_text()))


def test_public_functions_live_in_modules_of_their_names() -> None:
    # one page of mathematics: base parameters are combinations of the columns of the regressor
    assert names.homeless(_HOME, known=("base_parameters",)) == []


def test_only_command_lines_print() -> None:
    check(
        [p for p in PACKAGES if p.name != "cli.py" and p.parent.name not in ("cli", "commands")],
        lambda path: rules.prints(path.read_text()),
    )


def test_no_tolerance_is_padded() -> None:
    check(ALL, lambda path: rules.padded_tolerances(path.read_text()))


def test_exceptions_are_raised() -> None:
    check(ALL, lambda path: rules.forgotten_raise(path.read_text()))


@pytest.mark.parametrize("package", ["flexinv", "crosscheck"])
def test_data_have_types(package: str) -> None:
    sources = {name(path): path.read_text() for path in PACKAGES}
    assert rules.open_dicts({m: text for m, text in sources.items() if m.split(".")[0] == package}) == []


def test_no_file_names_a_machine() -> None:
    check(TEXTS, lambda path: rules.machine_paths(path.read_text()))


# --- the rules themselves -------------------------------------------------------------------------------------------

LONG = "def f() -> None:\n" + "    x = 1\n" * (rules.FUNCTION_LINES + 1)
WORDY = "def f():\n    return " + " + ".join(["x"] * table.MOST_TOKENS)
FORKED = "def f():\n    return " + " or ".join(["x"] * (table.MOST_BRANCHES + 2))
BAD = {
    "f has no docstring": (rules.units_in_docstrings, "def f(): pass"),
    "f gives no unit": (rules.units_in_docstrings, 'def f(y):\n    "Return x[0] and y[name] of [joints.NAME]."'),
    "A.f gives no unit": (rules.units_in_docstrings, 'class A:\n    def f(self) -> Array:\n        "Return a length."'),
    "A.p gives no unit": (
        rules.units_in_docstrings,
        'class A:\n    @property\n    def p(self) -> float:\n        "Peak."',
    ),
    "f has no annotation of x, return": (rules.unannotated, "def f(x): pass"),
    "f has no annotation of y": (rules.unannotated, "def f(x: int, *, y=1) -> int: return x"),
    f"{rules.MODULE_LINES + 1} lines, at most": (rules.sizes, "x = 1\n" * (rules.MODULE_LINES + 1)),
    f"f has {rules.FUNCTION_LINES + 1} lines": (rules.sizes, LONG),
    "f has 905 tokens and 0 branches": (rules.oversized, WORDY),
    f"and {table.MOST_BRANCHES + 1} branches, at most": (rules.oversized, FORKED),
    "f is small enough: take it off the list": (lambda text: rules.oversized(text, {"f"}), "def f(): pass"),
    "(a, b) in one assignment": (rules.packed, "a, b = f(1), g(2)"),
    "print outside": (rules.prints, "def f():\n    print('x')"),
    "sys.stdout.write outside": (rules.prints, "import sys\nsys.stdout.write('x')"),
    "padded tolerance tol * 10": (rules.padded_tolerances, "assert x < tol * 10"),
    "padded tolerance 1.5 * limit": (rules.padded_tolerances, "assert x < 1.5 * limit"),
    "padded tolerance 2 * case.tolerance": (rules.padded_tolerances, "close(x, y, atol=2 * case.tolerance)"),
    "InputError is built but not raised": (rules.forgotten_raise, "def f():\n    InputError('x')"),
    "f calls a record m (m.mass)": (names.letter_records, "def f(m, x):\n    return m.mass * x.shape[0]"),
    "told begins with no verb": (lambda text: names.without_verb(text, VERBS, ()), "def told(): pass"),
    "rows_of begins with no verb": (
        lambda text: names.without_verb(text, VERBS, ()),
        "class A:\n    def rows_of(self): pass",
    ),
    "'Which way it turns.' asks": (names.questions, 'def f():\n    "Which way it turns."'),
    "'Return whether it turns.' asks": (
        names.questions,
        'class A:\n    def f(self):\n        "Return whether it turns."',
    ),
    "line 2: " + "/home" + "/somebody": (rules.machine_paths, "x\ny = '" + "/home" + "/somebody/a.toml'"),
}


@pytest.mark.parametrize("complaint", BAD)
def test_a_broken_rule_is_found(complaint: str) -> None:
    rule, text = BAD[complaint]
    result = rule(text)
    assert len(result) == 1
    assert complaint in result[0]


MISPLACED = {
    "flexinv stands alone": ("flexinv.files.load_cases", "from crosscheck.measures.record import Record"),
    "only the command line draws": ("flexinv.analysis.solution", "import matplotlib.pyplot as plt"),
    "and loads what draws when it does": ("flexinv.cli.commands", "from matplotlib import pyplot"),
    "a command line is imported by nobody": ("crosscheck.workflows.model_summary", "from flexinv.cli import main"),
    "only crosscheck/engines/mujoco/ may": ("crosscheck.run.runner", "import mujoco"),
    "only crosscheck/engines/exudyn/ may": (
        "crosscheck.engines.mujoco.adapter",
        "def f():\n    import exudyn as exu",
    ),
    "only crosscheck/engines/pinocchio/ may": ("flexinv.kinematics.nodal_motion", "from pinocchio import rnea"),
    "an adapter reads primary data only": (
        "crosscheck.engines.exudyn.rigid",
        "from flexinv.kernels.so3 import exp_so3",
    ),
    "reads primary data only (errors": ("crosscheck.engines.pinocchio.adapter", "from flexinv import joint_torques"),
    "an engine does not know another": (
        "crosscheck.engines.mujoco.model",
        "from crosscheck.engines.exudyn.adapter import run",
    ),
    "does not know another": ("crosscheck.engines.mujoco.adapter", "import crosscheck.engines.flexinv"),
    "imports are written in full": ("flexinv.files.load_cases", "from .motion import Motion"),
}


@pytest.mark.parametrize("complaint", MISPLACED)
def test_a_misplaced_import_is_found(complaint: str) -> None:
    result = rules.layering(*MISPLACED[complaint])
    assert len(result) == 1
    assert complaint in result[0]


def test_imports_in_their_place_are_silent() -> None:
    for module, source in (
        ("flexinv.cli.commands", "def plot():\n    import matplotlib"),
        ("flexinv.cli.commands", "from flexinv.cli.simulate import follow_task"),
        ("crosscheck.__main__", "from crosscheck.cli import main"),
        ("flexinv.cli.commands", "if TYPE_CHECKING:\n    from matplotlib.figure import Figure"),
        ("crosscheck.engines.mujoco.model", "import mujoco\nfrom crosscheck.engines.mujoco.adapter import run"),
        (
            "crosscheck.engines.exudyn.ge",
            "from flexinv.model.mechanism import Mechanism\nfrom flexinv.files.load_cases import Case",
        ),
        ("crosscheck.engines.flexinv.adapter", "import flexinv\nfrom flexinv.analysis.solve import solve"),
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


def test_dicts_of_anything_are_counted_and_so_are_their_aliases() -> None:
    one = "def f() -> dict[str, Any]: pass\n"
    assert rules.open_dicts({"p.a": one * rules.OPEN_DICTS}) == []
    (complaint,) = rules.open_dicts({"p.a": one * rules.OPEN_DICTS, "p.b": one})
    assert complaint.startswith(f"{rules.OPEN_DICTS + 1} times dict[str, Any], at most {rules.OPEN_DICTS}; write a ")
    assert complaint.endswith("p.b, line 1")
    hidden = "Row = dict[str, Any]\n" + "def f() -> Row: pass\n" * rules.OPEN_DICTS
    assert len(rules.open_dicts({"p.a": hidden})) == 1
    assert len(rules.open_dicts({"p.a": "Row = dict[str, Any]", "p.b": "x: list[Row]\n" * rules.OPEN_DICTS})) == 1
    assert rules.open_dicts({"p.a": "def f() -> dict[str, int]: pass\n" * (rules.OPEN_DICTS + 1)}) == []


def test_paths_inside_the_project_are_no_machine_paths() -> None:
    assert rules.machine_paths("models/work/mechanism.toml  https://example.org/home/page  ./tmp/x") == []


def test_a_crowded_folder_and_a_function_without_a_home_are_found() -> None:
    assert names.crowded({"a": names.MODULES, "b": names.MODULES + 1}) == [
        f"b: {names.MODULES + 1} modules, at most {names.MODULES}"
    ]
    homes = {"solve": "analysis.solve", "Solution": "analysis.solution", "follow": "tracking.path"}
    assert names.homeless(homes) == ["follow lives in tracking.path"]
    assert names.homeless(homes, known=("follow",)) == []


def test_a_word_with_two_meanings_is_found() -> None:
    sources = {
        "a": "NONE = 0\n_X = 1",
        "b": "def NONE(): pass\n_X = 2",
        "c": "SURE, MANY = 1, 2",
        "d": "class SURE: x = 1",
    }
    assert names.homonyms(sources) == ["NONE is defined in a, b", "SURE is defined in c, d"]
    assert names.homonyms(sources, known=("NONE", "SURE")) == []
    assert names.homonyms({"a": "F: int = 1", "b": "F = 2"}) == ["F is defined in a, b"]
    twins = {"p.space.x": "def f(): pass", "p.plane.y": "def f(): pass"}
    assert names.homonyms(twins) == ["f is defined in p.space.x, p.plane.y"]
    assert names.homonyms(twins, (("p.space", "p.plane"),)) == []
    assert names.homonyms(twins, (("p.space.x", "p.plane.y"),)) == []
    assert names.homonyms({**twins, "p.z": "f = 1"}, (("p.space", "p.plane"),)) != []
    assert names.homonyms({"a": "def f(): pass", "b": "@app.command()\ndef f(): pass"}) == []


def test_a_module_for_one_other_is_found() -> None:
    sources = {"p.a": "import p.b\n", "p.b": "x = 1\n", "p.c": "x = 1\n" * names.LINES, "q.d": "x = 1\n"}
    imports = {"p.b": ["p.a"], "p.c": ["p.a"], "q.d": ["p.a"]}  # one fits, one is too long, one is in another folder
    assert names.lonely(sources, imports, {}) == ["p.b is imported by p.a alone: merge them"]
    assert names.lonely(sources, imports, {"p.b": "a reason"}) == []
    assert names.lonely(sources, {**imports, "p.b": ["p.a", "q.d"]}, {"p.b": "a reason"}) == [
        "p.b needs no reason to stay apart"
    ]


def test_many_parameters_are_found() -> None:
    nine = ", ".join("abcdefghi")
    assert names.many_parameters(f"def f({nine}): pass") == ["line 1: f has 9 parameters"]
    assert names.many_parameters(f"def f({nine[:-3]}, i=0): pass") == []
    assert names.many_parameters(f"@click.command()\ndef f({nine}): pass") == []
