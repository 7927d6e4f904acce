"""Consensus of the cases of a board: read from a corpus, and the distance of a release's efforts from it."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from crosscheck.bisect.cases import COMPUTED, TIME
from crosscheck.bisect.causes import SAME_EFFORTS
from crosscheck.bisect.observations import Observation
from crosscheck.corpus.consensus import REACHED, CaseConsensus
from crosscheck.corpus.entry import make_case_id
from crosscheck.corpus.judging import CaseBands, judge_series, make_bands, read_bands, read_manifest
from crosscheck.kit.resolved import build_case_file, list_idle_velocities
from crosscheck.measures.record import Series
from crosscheck.measures.series_csv import check_times
from crosscheck.verdicts.compare import WHOLE
from crosscheck.verdicts.plan import Task
from flexinv.errors import InputError

NO_CORPUS = "No corpus was given: efforts are held against flexinv's. Write one with crosscheck corpus --out corpus."
TURNED = ("free", "spherical")  # kinds of joints of which engines choose the axes of velocities
CasePlace = tuple[str, str]  # mechanism and case


@dataclass(frozen=True)
class BoardConsensus:
    """Consensus of those cases that have one in every torque; notes : what a reader of the board has to know of the others."""

    cases: Mapping[CasePlace, CaseBands] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def find_bands(self, task: Task) -> CaseBands | None:
        """Return the consensus of a case, None where there is none."""
        return self.cases.get((task.folder.name, task.case.name))


def read_consensus(corpus: Path, tasks: Iterable[Task]) -> BoardConsensus:
    """Return the consensus that a corpus holds of some cases, if they are still the same.

    Raises InputError where there is no corpus, or its files have changed.
    """
    known = read_manifest(corpus)
    cases: dict[CasePlace, CaseBands] = {}
    other = []
    for task in tasks:
        entry = known.get(make_case_id(task.folder.name, task.case.name))
        if entry is None or entry["status"] not in REACHED:
            continue
        if entry["case.json"] != build_case_file(task.mechanism, task.case).digest:
            other.append(f"{task.folder.name}/{task.case.name}")
        elif (bands := read_bands(corpus, entry)) is not None:
            cases[task.folder.name, task.case.name] = _scale_bands(bands)
    words = f"The corpus has a consensus on another state of {', '.join(other)}: write it anew with crosscheck corpus."
    return BoardConsensus(cases, (words,) if other else ())


def collect_consensus(found: Iterable[CaseConsensus]) -> BoardConsensus:
    """Return the consensus of those cases that were just found to have one in every torque."""
    reached = [one for one in found if one.status in REACHED]
    return BoardConsensus(
        {(one.task.folder.name, one.task.case.name): _scale_bands(make_bands(one)) for one in reached}
    )


def _scale_bands(bands: CaseBands) -> CaseBands:
    """Return the bands of the efforts, each with the largest range of its unit [unit]: what limits of a case are parts of."""
    names = [name for name in bands.rows if name.split("/", 1)[0] in WHOLE]
    largest: dict[str, float] = {}
    for name in names:
        unit = bands.series[name].unit
        row = bands.rows[name]
        largest[unit] = max(largest.get(unit, 0.0), row["range"] or row["size"])
    rows = {name: {**bands.rows[name], "range": largest[bands.series[name].unit]} for name in names}
    return replace(bands, rows=rows, series={name: bands.series[name] for name in names})


def compute_digest(bands: CaseBands | None) -> str:
    """Return a digest of a consensus: a cell that was held against another one is computed anew; "" of none."""
    if bands is None:
        return ""
    state = hashlib.sha256()
    for name, one in sorted(bands.series.items()):
        assert one.error is not None
        state.update(f"{name} [{one.unit}] {bands.rows[name]['range']!r}".encode())
        state.update(one.values.tobytes() + one.error.tobytes())
    return state.hexdigest()[:12]


def has_own_coordinates(task: Task, bands: CaseBands, expected: Observation) -> bool:
    """Return True if a script has coordinates of its engine's own: names of columns say it, or a turned basis does.

    expected : flexinv's efforts as the script has them.  Only joints of several axes have a basis that can be turned.
    """
    idle = {f"torque/{name}" for name in list_idle_velocities(task.mechanism, task.case)}
    names = {f"torque/{name}" for name in expected.names if name != TIME}
    if not set(bands.series) <= names <= set(bands.series) | idle:
        return True
    turned = any(joint.kind in TURNED for joint in task.mechanism.joints)
    return turned and compute_consensus_distance(bands, expected) > SAME_EFFORTS


def compute_consensus_distance(bands: CaseBands, observation: Observation) -> float:
    """Return the largest distance of efforts from a consensus, as a part of their range [-]; 0 inside.

    Infinite where a number is missing or is none.
    """
    names = [name for name in observation.names if f"torque/{name}" in bands.series]
    if TIME not in observation.names or len(names) < len(bands.series):
        return float("inf")
    place = Path(COMPUTED)
    time = observation.table[:, observation.names.index(TIME)]
    sample = float(bands.time[1] - bands.time[0]) if bands.time.size > 1 else 1.0
    try:
        check_times(place, time, bands.time, sample)
        distances = [_compute_series_distance(bands, observation, name, place) for name in names]
    except InputError:
        return float("inf")
    return max(distances, default=0.0)


def _compute_series_distance(bands: CaseBands, observation: Observation, name: str, place: Path) -> float:
    """Return the distance of one effort from its band, as a part of the range [-].  Raises InputError for what is no number."""
    values = np.ascontiguousarray(observation.table[:, observation.names.index(name)])
    full = f"torque/{name}"
    return judge_series(bands, Series(full, bands.series[full].unit, values), place).distance
