"""Cases in tests/data/cases and what each command has to say of them: exit code, words that stand there, words that do not.

    PLAIN     by what the package installs itself: MuJoCo, Pinocchio, usd-core
    BY_DRAKE  SDF, and readers of packages: in the environment of plugins/crosscheck-drake

`said` runs a case as a user does.  Run all: python -m pytest tests/crosscheck/equivalence/test_case_files.py, and in the
environment of plugins/crosscheck-drake its tests.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from click.testing import CliRunner

from crosscheck.cli import main

FOLDER = Path(__file__).parents[1] / "data" / "cases"
SAME, DIFFERENT, OPEN = 0, 1, 2


@dataclass(frozen=True)
class Case:
    """A command with files of the folder, its exit code, and what it says.

    words : each stands in what is printed; never : none of these does
    """

    command: tuple[str, ...]
    code: int
    words: tuple[str, ...] = ()
    never: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Return the command as one line."""
        return " ".join(self.command)


def case(line: str, code: int, *words: str, never: tuple[str, ...] = ()) -> Case:
    """Return a case of a command line."""
    return Case(tuple(line.split()), code, words, never)


UNPROVEN = "usd-core reads the stage and computes no dynamics"
PLAIN = (
    # names that stand twice
    case(
        "compare c48b_two_arms.xml c48b_two_arms.usda --unproven", SAME, "name tool of 2 bodies: called by their paths"
    ),
    case("compare c48b_two_arms.usda c48b_two_arms.usda --unproven", SAME, never=("is not explained",)),
    case("compare c48b_two_arms.usda c48b_two_arms.usda", OPEN, "Not proven to be the same machine", UNPROVEN),
    case("compare c48_fixed_base.xml --readers mujoco,pinocchio", DIFFERENT, "pose of base of the machine by 0.3"),
    # USD: units and schemas of engines
    case(
        "compare c14_damp.xml c14_newton_damp.usda --unproven", SAME, "The same machine", never=("radians for degrees",)
    ),
    case("compare c14_damp.xml c14_both_damp.usda --unproven", SAME, "The same machine", never=("contradiction",)),
    case("compare c14_stiff.xml c14_mjc_stiff.usda --unproven", SAME, "The same machine", never=("B has none",)),
    case("compare c14_damp.xml c14_newton_damp.usda", OPEN, "Not proven", UNPROVEN),
    case("compare c12_none.usda c12_newton_mimic.usda", DIFFERENT, "coupling that only B has", "1 j1 - 0.5 j2 = -0.05"),
    # readers: the format's own compiler is the reference
    case("compare c40_include.xml --readers mujoco,pinocchio", OPEN, "Against the reader mujoco, pinocchio: nothing"),
    case(
        "compare c41_replicate.xml --readers mujoco,pinocchio",
        DIFFERENT,
        "Against the reader mujoco, pinocchio: another",
    ),
    case("compare c35_tree_loop.xml --readers mujoco,pinocchio", SAME, "pinocchio: the same machine"),
    case("compare c16_floating.urdf c16_floating.xml", SAME, "The same machine"),
    case("compare c16_floating.urdf --readers flexinv,pinocchio,mujoco", SAME, "the same machine"),
    # XML that others read, meshes that are missing
    case("compare c36_fitmesh.xml c36_fitmesh.xml", SAME, "MuJoCo does not find it"),
    case("lint c36_fitmesh.xml", SAME, "not_here.obj"),
    case("compare c46_comment.xml c46_comment.xml@pinocchio", SAME, "The same machine", never=("UTF-8",)),
    case("lint c46_comment.xml", SAME, "-- within a comment"),
    case("compare c46_prefix.urdf c46_prefix.urdf@mujoco --judge rigid", SAME, never=("each tag closed",)),
    case("lint c46_prefix.urdf", SAME, "without xmlns:drake"),
    # shapes without inertia
    case(
        "lint c33_pad.urdf", SAME, "MuJoCo takes 0.236 kg", "PyBullet and DART take 1 kg", "Pinocchio and Drake nothing"
    ),
    case("compare c33_pad.urdf --readers flexinv,pinocchio,mujoco", DIFFERENT, "1.33562", "mujoco: another one"),
)
BY_DRAKE = (
    case("compare c49_duo.sdf c49_duo.sdf", SAME, "name swing of 2 joints", never=("the harness failed", "KeyError")),
    case("compare c49_duo.sdf c49_duo_heavy.sdf", DIFFERENT, "duo::right::rod"),
    case("compare c49_duo_heavy.sdf c49_duo.xml", SAME, "duo::left::swing is lswing"),
    case("compare c15_plain.sdf c15_plain.sdf", SAME, "held against Drake"),
    case("compare c15_plain.sdf c15_nospring.sdf", DIFFERENT, "spring stiffness"),
    case("compare c15_plain.sdf c15_added.sdf", DIFFERENT, "added-mass", "spring stiffness", "dry friction"),
    case("compare c16_floating.urdf@drake c16_floating.xml", SAME, "held against Drake", never=("moves in B only",)),
    case("compare c40_include.xml --readers all", OPEN, "Against the reader mujoco", never=("the harness failed",)),
    case("compare c35_tree_loop.xml --readers mujoco,pinocchio", SAME, "pinocchio: the same machine"),
)


def said(one: Case) -> tuple[int, str]:
    """Return exit code [-] and what a case's command prints, in one line."""
    words = [_placed(word) for word in one.command]
    result = CliRunner().invoke(main, words, env={"COLUMNS": "1000"})
    return result.exit_code, " ".join(result.output.split())


def _placed(word: str) -> str:
    name, at, reader = word.partition("@")
    return f"{FOLDER / name}{at}{reader}" if (FOLDER / name).is_file() else word


def complaints(one: Case) -> list[str]:
    """Return what is wrong with a case [-], nothing where all is right."""
    code, text = said(one)
    wrong = [f"exit code {code}, expected {one.code}"] if code != one.code else []
    wrong += [f"it does not say: {words}" for words in one.words if words not in text]
    wrong += [f"it says: {words}" for words in one.never if words in text]
    return [*wrong, text] if wrong else []
