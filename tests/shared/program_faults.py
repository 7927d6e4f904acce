"""Mistakes planted in an outside engine's own source: does crosscheck name them?  python tests/shared/program_faults.py

The engine is `kit_programs/rigid.py`: a program that shares nothing with this project, and knows a case from its kit alone.  Each
mistake is a copy of it with one piece of its source exchanged; the tests draw a few of them by a seed.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np

SOURCE = Path(__file__).with_name("kit_programs") / "rigid.py"
ROOT = Path(__file__).resolve().parents[2]
LADDER = ROOT / "crosscheck" / "conform" / "ladder"
FEW = 3  # causes that may stand side by side
ENOUGH = 0.75  # of the mistakes: six of eight


@dataclass(frozen=True)
class Mistake:
    """A mistake: the rung where it shows, what of the source is exchanged, and the causes of the dictionary that say it."""

    rung: str
    old: str
    new: str
    causes: frozenset[str]


BODY = 'inertia = r @ np.array(body["inertia"]) @ r.T'
TREE = "tau = robot.torque(q[k], v[k], a[k])\n        efforts"
CARRIED = 'joint["rotor_inertia"] * a[k] + joint["damping"] * v[k] + joint["friction"] * np.sign(v[k])'
AXIS = 'axis = frame @ np.array(joint["axis"])'
MISTAKES = {
    "tensor about the origin": Mistake("tree", BODY, 'c = np.array(body["com"]) * (body["mass"] == 1.6)\n'
        '                inertia = r @ (np.array(body["inertia"]) + body["mass"] * (c @ c * np.eye(3) - np.outer(c, c))) @ r.T',
        frozenset({"inertia about the origin", "inertia about the wrong point"})),
    "sign of an effort": Mistake("tree", TREE, TREE.replace("\n", "\n            tau[1] = -tau[1]\n"),
        frozenset({"effort sign of a joint", "axis sign"})),
    "no rotors": Mistake("drives", CARRIED, CARRIED.replace('joint["rotor_inertia"]', "0.0"),
        frozenset({"rotor inertia dropped", "rotor inertia", "rotor inertia scale"})),
    "no damping": Mistake("drives", CARRIED, CARRIED.replace('joint["damping"]', "0.0"),
        frozenset({"damping dropped", "viscous damping", "damping scale"})),
    "no dry friction": Mistake("drives", CARRIED, CARRIED.replace('joint["friction"]', "0.0"),
        frozenset({"friction dropped", "dry friction", "friction scale"})),
    "rest of a spring": Mistake("drives", '(q[k] - joint["rest"])', "q[k]",
        frozenset({"rest of a joint spring", "effort offset"})),
    "gravity": Mistake("tree", 'np.array(mechanism["gravity"])', '1.02 * np.array(mechanism["gravity"])',
        frozenset({"gravity magnitude", "base acceleration"})),
    "centre of mass": Mistake("tree", 'd = r @ np.array(place)',
        "d = r @ (np.array(place) + 0.02 * (list(place) == [0.25, 0.01, 0.03]))",
        frozenset({"centre of mass shifted"})),
    "columns exchanged": Mistake("tree", "zip(robot.names, units, strict=True)",
        "zip([*robot.names[1::-1], *robot.names[2:]], units, strict=True)", frozenset({"order of efforts"})),
    "mass of a body": Mistake("tree", 'body["mass"] * (acc - self.gravity)',
        'body["mass"] * (1.0 + 0.1 * (body["mass"] == 0.9)) * (acc - self.gravity)',
        frozenset({"body mass", "mass scale", "payload"})),
}  # fmt: skip


@dataclass(frozen=True)
class FaultOutcome:
    """What crosscheck said of a program with a mistake: causes that it named, and its words."""

    named: tuple[str, ...]
    words: str

    def right(self, mistake: Mistake) -> bool:
        """The mistake is named first, or in a set of three."""
        return len(self.named) <= FEW and bool(mistake.causes & set(self.named))

    def wrong(self, mistake: Mistake) -> bool:
        """Something else is named, and not the mistake."""
        return bool(self.named) and not mistake.causes & set(self.named)


def campaign(names: Iterable[str], folder: Path) -> dict[str, FaultOutcome]:
    """What crosscheck says of the programs with these mistakes, which are written into a folder."""
    chosen, rows = list(names), []
    for number, name in enumerate(chosen):
        mistake = MISTAKES[name]
        source = SOURCE.read_text(encoding="utf-8")
        assert source.count(mistake.old) == 1, name
        (folder / f"program{number}.py").write_text(source.replace(mistake.old, mistake.new), encoding="utf-8")
        command = json.dumps([sys.executable, f"program{number}.py", "{kit}", "{out}"])
        rows.append(f'[engines.program{number}]\ncommand = {command}\ncases = ["{mistake.rung}/*"]\n')
    (folder / "crosscheck.toml").write_text("\n".join(rows), encoding="utf-8")
    rungs = sorted({MISTAKES[name].rung for name in chosen})
    words = ["run", *rungs, "--models", str(LADDER), "--config", "crosscheck.toml", "--trust-commands", "--jobs", "1"]
    words += ["--engines", "flexinv,program*", "--out", "report"]
    subprocess.run(
        [sys.executable, "-m", "crosscheck", *words], cwd=folder, capture_output=True, text=True, check=False
    )
    said = json.loads((folder / "report" / "results.json").read_text(encoding="utf-8"))
    result = {one["engine"]: one for one in said["diagnoses"]}
    assert len(result) == len(chosen), [run["message"] for run in said["runs"]]
    return {name: heard(result[f"program{k}"]) for k, name in enumerate(chosen)}


def heard(diagnosis: dict[str, object]) -> FaultOutcome:
    """A diagnosis of results.json."""
    named = diagnosis["named"]
    assert isinstance(named, list)
    return FaultOutcome(tuple(str(one["cause"]) for one in named), str(diagnosis["words"]))


def drawn(count: int, seed: int) -> list[str]:
    """Names of some mistakes, drawn by a seed."""
    return sorted(np.random.default_rng(seed).choice(sorted(MISTAKES), count, replace=False).tolist())


def main() -> int:
    """Plant all of them, show what was named, and return 0 where enough of them are named and none wrongly."""
    with tempfile.TemporaryDirectory() as folder:
        result = campaign(MISTAKES, Path(folder))
    for name, one in result.items():
        verdict = "right" if one.right(MISTAKES[name]) else "WRONG" if one.wrong(MISTAKES[name]) else "unnamed"
        click.echo(f"{verdict:8} {name:26} {', '.join(one.named) or one.words}")
    right = sum(one.right(MISTAKES[name]) for name, one in result.items())
    wrong = sum(one.wrong(MISTAKES[name]) for name, one in result.items())
    click.echo(f"{right} of {len(result)} named first or in a set of {FEW}, {wrong} wrongly")
    return int(right < ENOUGH * len(result) or wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
