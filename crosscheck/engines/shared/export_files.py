"""Files of every export: the motion and the expected effort as CSV, in the coordinates of the engine that reads them."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict

import numpy as np
from numpy.typing import NDArray

from crosscheck.engines.shared.wrenches import evaluate_wrench
from crosscheck.measures.record import WRENCH
from flexinv.model.mechanism import Mechanism

Array = NDArray[np.float64]
TEMPLATES = Path(__file__).resolve().parents[2] / "export"


class NotExported(ValueError):
    """This mechanism cannot be written for this engine; the message says why and what can."""


@dataclass(frozen=True)
class Motion:
    """Motion and expected effort of an engine, in its own coordinates and order.

    q : (samples, nq); v, a, effort : (samples, nv), effort being what is expected of it; units of the engine
    q_names, v_names : of the columns
    """

    time: Array
    q: Array
    v: Array
    a: Array
    effort: Array
    q_names: Sequence[str]
    v_names: Sequence[str]


class JointNumbers(TypedDict):
    """Properties of joints by coordinate, in the engine's order [kg m^2], [N m s/rad], [N m], ..."""

    rotor_inertia: list[float]
    damping: list[float]
    friction: list[float]


class JointSpring(TypedDict):
    """A spring in a joint [N m/rad], [rad], ..., and where the joint's coordinates stand."""

    joint: str
    stiffness: float
    rest: float
    v: int
    q: list[int]


class LoopPhase(TypedDict):
    """Samples of a phase, from first to before last, and the names of what closes loops there."""

    first: int
    last: int
    closures: list[str]


class SharingSettings(TypedDict):
    """Settings of loops: which coordinates have drives, with which weights [-], and what closes when."""

    driven: list[bool]
    weight: list[float]
    phases: list[LoopPhase]


def write(folder: Path, motion: Motion, script: str, files: Mapping[str, str], settings: Mapping[str, object]) -> None:
    """Write ``motion.csv``, ``expected.csv``, ``settings.json``, ``run.py`` and the model's own files into a folder.

    script : name of the template of ``run.py``
    """
    columns = [f"q {n}" for n in motion.q_names]
    columns += [f"{what} {n}" for what in ("v", "a") for n in motion.v_names]
    write_table(folder / "motion.csv", motion.time, columns, np.hstack([motion.q, motion.v, motion.a]))
    write_table(folder / "expected.csv", motion.time, motion.v_names, motion.effort)
    (folder / "settings.json").write_text(json.dumps(dict(settings), indent=1) + "\n", encoding="utf-8")
    common, body = ((TEMPLATES / name).read_text(encoding="utf-8") for name in ("common.py.txt", script))
    (folder / "run.py").write_text(body.replace("# COMMON\n", common), encoding="utf-8")
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")


def collect_sharing_settings(
    mechanism: Mechanism, order: NDArray[np.intp], spans: Iterable[tuple[slice, Sequence[str]]]
) -> SharingSettings:
    """Return the settings of loops: which coordinates have drives, with which weights [-], and what closes when.

    order : which of the mechanism's velocity coordinates stands at every place of the engine's
    spans : samples of every phase, and the names of what closes loops there
    """
    return {
        "driven": [bool(x) for x in mechanism.actuated[order]],
        "weight": [float(x) for x in mechanism.weights[order]],
        "phases": [{"first": samples.start, "last": samples.stop, "closures": list(names)} for samples, names in spans],
    }


def write_forces(folder: Path, mechanism: Mechanism, time: Array) -> None:
    """Write ``forces.csv``, where forces are given: force [N] and moment [N m] of each, along the axes they are given in."""
    if mechanism.forces:
        names = [f"{force.name} {part}" for force in mechanism.forces for part in WRENCH]
        rows = np.array(
            [np.concatenate([evaluate_wrench(force, float(t)) for force in mechanism.forces]) for t in time]
        )
        write_table(folder / "forces.csv", time, names, rows)


def write_table(file: Path, time: Array, names: Sequence[str], values: Array) -> None:
    """Write a CSV whose first column is the time [s]; numbers in the shortest form that gives them back."""
    with file.open("w", encoding="utf-8", newline="") as stream:
        out = csv.writer(stream, lineterminator="\n")
        out.writerow(["time", *names])
        out.writerows([repr(float(t)), *map(repr, map(float, row))] for t, row in zip(time, values, strict=True))


def check_rigid(mechanism: Mechanism, engine: str) -> None:
    """Raise NotExported where a link is a beam."""
    if not mechanism.is_rigid:
        meshes = ", ".join(link.name for link in mechanism.meshed)
        if meshes:
            raise NotExported(f"links that are meshes ({meshes}) are not exported yet")
        names = ", ".join(link.name for link in mechanism.beams)
        raise NotExported(f"beams ({names}) are exported for exudyn-ancf and exudyn-ge, not for {engine}")
