"""Record of one engine on one case: named series with units, or the reason why there are none.

A record goes to disk as two files, ``<stem>.json`` (words) and ``<stem>.npz`` (numbers, no pickle).
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypedDict, get_args
from zipfile import BadZipFile

import numpy as np
from numpy.typing import ArrayLike

from crosscheck.arrays import write_arrays
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

Status = Literal["ok", "error", "timeout", "skipped"]
XYZ = ("x", "y", "z")
WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")
WRENCH_UNITS = ("N", "N", "N", "N m", "N m", "N m")
# Squares and differences of smaller numbers, and sums of a million of those, stay far below the largest number of a computer.
# No unit makes a quantity of a machine that large: a larger number comes from a computation that has run away.
LARGEST = 1e100
RESULTANTS = ("axial", "shear_y", "shear_z", "twist", "bending_y", "bending_z")


class RecordError(ValueError):
    """A record that is not what it has to be: wrong shape, NaN, truncated, unreadable."""


@dataclass(frozen=True)
class Series:
    """One quantity over the sample times of its record.

    name : "torque/<velocity name>", "wrench/<joint>/fx", "reaction/<closure>/fx", "tip/<link>/x", "deflection/<beam link>/y", ...
    unit : of the values, "N m"
    values : (samples,) [unit]
    error : (samples,) [unit], half-width of the engine's own error bar, or None where it has none
    refined, left : (samples,) [unit], what refinements tend to and the half-width of its bar, None where they do not say
    """

    name: str
    unit: str
    values: Array
    error: Array | None = None
    refined: Array | None = None
    left: Array | None = None

    @property
    def quantity(self) -> str:
        """Return the quantity that a limit is stated for: the part before the first slash."""
        return self.name.split("/", 1)[0]


class BudgetLine(TypedDict, total=False):
    """Origin of the error bar of a series [unit of the series].

    bar : largest half-width; peak : largest magnitude, peak_bar : its own bar from the peaks of the runs
    order : observed order [-] by what was refined, None where it is not observable; how : words by what was refined
    bars, left : largest half-widths by what was refined, of the bar and of what its runs tend to
    """

    bar: float
    peak: float
    peak_bar: float
    order: Mapping[str, float | None]
    how: Mapping[str, str]
    bars: Mapping[str, float]
    left: Mapping[str, float]


Rows = Sequence[Sequence[float]]


class PlainCertificate(TypedDict, total=False):
    """JSON of a certificate: fields of `crosscheck.measures.certificate.Certificate`, whose docstring gives units and shapes.

    problem : why there is none; broken : why one that is there cannot be read
    """

    mass: float | None
    masses: Mapping[str, float]
    beam_masses: Mapping[str, float]
    beam_moments: Mapping[str, float]
    moments: Mapping[str, Sequence[float]]
    inertias: Mapping[str, Rows]
    com: Rows | None
    mass_matrix: Sequence[Rows] | None
    gravity: Rows | None
    torque_by_place: Sequence[Rows] | None
    torque_by_rate: Sequence[Rows] | None
    axes: Mapping[str, Rows]
    order: Sequence[str]
    stiffness: Mapping[str, float]
    part_stiffness: Mapping[str, float]
    part_frequencies: Mapping[str, float]
    damping: Mapping[str, float]
    friction: Mapping[str, float]
    springs: Mapping[str, float]
    closure_points: Mapping[str, Sequence[float]]
    closure_axes: Mapping[str, Sequence[float]]
    given: Mapping[str, str]
    residual: float | None
    rank: int | None
    problem: str
    broken: str


@dataclass(frozen=True)
class Record:
    """Results of one engine for one case.

    time : (samples,) [s]; series : by name; wall_time : [s] of the engine's own run
    settings : what the engine was told (tolerances, mesh, step), JSON values
    status : "ok", or why there are no series; message : words for the reader of the report
    budget : where the error bars come from, by series: see ``crosscheck.measures.budget.add_error_bars``
    certificate : what the engine's own model says of itself (``crosscheck.measures.certificate``), or {"problem": why not},
        or {"broken": why one that is there cannot be read}
    """

    engine: str
    status: Status = "ok"
    message: str = ""
    version: str = ""
    settings: Mapping[str, Any] = field(default_factory=dict)
    time: Array = field(default_factory=lambda: np.zeros(0))
    series: Mapping[str, Series] = field(default_factory=dict)
    wall_time: float = 0.0
    model_hash: str = ""
    budget: Mapping[str, BudgetLine] = field(default_factory=dict)
    certificate: PlainCertificate = field(default_factory=PlainCertificate)


def series(name: str, unit: str, values: ArrayLike, error: ArrayLike | None = None) -> dict[str, Series]:
    """Return ``{name: Series}`` of one array.

    values, error : (samples,) [unit]
    """
    bar = None if error is None else np.asarray(error, dtype=np.float64)
    return {name: Series(name, unit, np.asarray(values, dtype=np.float64), bar)}


def make_column_series(
    names: Sequence[str], units: Sequence[str], values: ArrayLike, error: ArrayLike | None = None
) -> dict[str, Series]:
    """Return one series per column, by name.

    values, error : (samples, columns) [units of the columns]
    Raises RecordError where names, units and columns differ in number.
    """
    table = np.asarray(values, dtype=np.float64)
    bars = None if error is None else np.asarray(error, dtype=np.float64)
    if table.ndim != 2 or not len(names) == len(units) == table.shape[1]:
        raise RecordError(f"{len(names)} names and {len(units)} units for values of shape {table.shape}")
    if bars is not None and bars.shape != table.shape:
        raise RecordError(f"error bars of shape {bars.shape} for values of shape {table.shape}")
    return {
        n: Series(n, u, table[:, k], None if bars is None else bars[:, k])
        for k, (n, u) in enumerate(zip(names, units, strict=True))
    }


def torque_series(mechanism: Mechanism, torque: ArrayLike, error: ArrayLike | None = None) -> dict[str, Series]:
    """Return "torque/<velocity name>" of every velocity coordinate.

    torque, error : (samples, nv) [N m or N], in the order of ``mechanism.velocity_names``
    """
    names = [f"torque/{name}" for name in mechanism.velocity_names]
    return make_column_series(names, list_effort_units(mechanism), torque, error)


def vector_series(prefix: str, unit: str, values: ArrayLike, error: ArrayLike | None = None) -> dict[str, Series]:
    """Return "<prefix>/x", "/y", "/z", such as ``vector_series("tip/forearm", "m", x)``.

    values, error : (samples, 3) [unit]
    """
    return make_column_series([f"{prefix}/{axis}" for axis in XYZ], [unit] * 3, values, error)


def make_wrench_series(joint: str, wrench: ArrayLike) -> dict[str, Series]:
    """Return "wrench/<joint>/fx" ... "mz": what the joint puts on its child, at the joint, in the child's frame.

    wrench : (samples, 6), force [N] then moment [N m]
    """
    return _make_wrench_columns(f"wrench/{joint}", wrench)


def make_reaction_series(closure: str, wrench: ArrayLike) -> dict[str, Series]:
    """Return "reaction/<closure>/fx" ... "mz": what a closure puts on its second frame, there and along its axes.

    wrench : (samples, 6), force [N] then moment [N m]; of a closure whose second frame is the world's, on the world
    """
    return _make_wrench_columns(f"reaction/{closure}", wrench)


def _make_wrench_columns(prefix: str, wrench: ArrayLike) -> dict[str, Series]:
    return make_column_series([f"{prefix}/{c}" for c in WRENCH], WRENCH_UNITS, wrench)


def make_internal_series(beam: str, station: str, resultants: ArrayLike) -> dict[str, Series]:
    """Return "internal/<beam>/<station>/axial" ... "bending_z" of one section.

    resultants : (samples, 6): axial, shear_y, shear_z [N], twist, bending_y, bending_z [N m]
    """
    names = [f"internal/{beam}/{station}/{c}" for c in RESULTANTS]
    return make_column_series(names, ["N"] * 3 + ["N m"] * 3, resultants)


def list_effort_units(mechanism: Mechanism) -> tuple[str, ...]:
    """Return the unit of the effort of every velocity coordinate, "N m" or "N"."""
    kinds = {"prismatic": ("N",), "free": ("N",) * 3 + ("N m",) * 3}
    return tuple(u for j in mechanism.joints for u in kinds.get(j.kind, ("N m",) * j.nv))


def check(record: Record, time: Array) -> None:
    """Raise RecordError unless an "ok" record is complete, finite and of sizes that can be squared, on the times asked for.

    time : (samples,) [s], the grid of the case
    """
    if record.status != "ok":
        return
    if not record.series:
        raise RecordError(f"{record.engine} says ok and gives no series")
    if record.time.shape != time.shape:
        raise RecordError(
            f"{record.engine} gives {record.time.size} of {time.size} samples"
            + (f" and stops at t = {record.time[-1]:.6g} s of {time[-1]:.6g} s" if record.time.size else "")
        )
    # Grids are built from the same end and sample spacing: they differ by the rounding of a few additions.
    if not np.allclose(record.time, time, rtol=0.0, atol=1e-9 * max(1.0, float(time[-1]))):
        raise RecordError(f"{record.engine} gives other sample times than those asked for")
    for one in record.series.values():
        _check_series(record, one)


def _check_series(record: Record, one: Series) -> None:
    bars = ("error bars", one.error), ("error bars of what refinements tend to", one.left)
    for what, values in (("values", one.values), *bars, ("values that refinements tend to", one.refined)):
        if values is None:
            continue
        if values.dtype.kind not in "fiu":
            raise RecordError(f"{one.name}: {what} of type {values.dtype}, expected real numbers")
        if values.shape != record.time.shape:
            raise RecordError(f"{one.name}: {what} of shape {values.shape} for {record.time.size} samples")
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise RecordError(
                f"{one.name}: {bad.size} of {values.size} {what} are not finite, "
                f"the first at t = {record.time[bad[0]]:.6g} s"
            )
        worst = int(np.abs(values).argmax()) if values.size else 0
        if values.size and abs(values[worst]) > LARGEST:
            raise RecordError(
                f"{one.name}: {what} of {values[worst]:.3g} {one.unit} at t = {record.time[worst]:.6g} s; expected at most "
                f"{LARGEST:g}: the computation has run away"
            )
    for what, values in bars:
        if values is not None and (values < 0.0).any():
            below = np.flatnonzero(values < 0.0)
            raise RecordError(
                f"{one.name}: {len(below)} {what} are negative, the first at t = {record.time[below[0]]:.6g} s"
            )


def save(record: Record, stem: Path) -> None:
    """Write ``<stem>.npz`` and then ``<stem>.json`` (a reader that finds the second finds both).

    Raises RecordError where entries of a series are masked: what stands below a mask is no number of the engine.
    """
    arrays = {"time": record.time}
    words = []
    for k, one in enumerate(record.series.values()):
        arrays[f"s{k}"] = one.values
        if any(np.ma.is_masked(part) for part in (one.values, one.error, one.refined, one.left)):
            raise RecordError(f"{one.name}: entries are masked, expected a number at every sample")
        bars = {"e": one.error, "r": one.refined, "l": one.left}
        arrays |= {f"{letter}{k}": values for letter, values in bars.items() if values is not None}
        words.append({"name": one.name, "unit": one.unit})
    plain = {f.name: getattr(record, f.name) for f in dataclasses.fields(record)}
    plain |= {"series": words, "settings": dict(record.settings), "budget": dict(record.budget)}
    plain |= {"certificate": dict(record.certificate)}
    del plain["time"]
    write_arrays(stem.with_name(stem.name + ".npz"), arrays)
    text = json.dumps(plain, indent=1, allow_nan=False)
    stem.with_name(stem.name + ".json").write_text(text + "\n", encoding="utf-8")


def read_record(stem: Path) -> Record:
    """Read what ``save`` wrote.  Raises RecordError where a file is missing, cut off or not a record."""
    try:
        plain = json.loads(stem.with_name(stem.name + ".json").read_text(encoding="utf-8"))
        words = plain.pop("series")
        with (
            stem.with_name(stem.name + ".npz").open("rb") as stream,
            np.load(stream, allow_pickle=False) as arrays,
        ):
            read = [
                Series(w["name"], w["unit"], arrays[f"s{k}"], *(arrays.get(f"{letter}{k}") for letter in "erl"))
                for k, w in enumerate(words)
            ]
            record = Record(**plain, time=arrays["time"], series={s.name: s for s in read})
    except (OSError, ValueError, LookupError, TypeError, EOFError, BadZipFile, zlib.error) as error:
        raise RecordError(f"no record at {stem}: {error}") from error
    if record.status not in get_args(Status):
        expected = ", ".join(get_args(Status))
        raise RecordError(f"{record.engine} gives the status {str(record.status)[:60]!r}, expected one of {expected}")
    if not isinstance(record.message, str):
        raise RecordError(f"{record.engine} gives the message {str(record.message)[:60]}, expected words")
    return record


def compute_fingerprint(*things: object) -> str:
    """Return a short hash of data: dataclasses, arrays, mappings, sequences, plain values."""
    digest = hashlib.sha256()
    for thing in things:
        _add_to_digest(digest.update, thing)
    return digest.hexdigest()[:16]


def _add_to_digest(update: Any, thing: object) -> None:
    update(type(thing).__name__.encode())
    if dataclasses.is_dataclass(thing) and not isinstance(thing, type):
        for f in dataclasses.fields(thing):
            update(f.name.encode())
            _add_to_digest(update, getattr(thing, f.name))
    elif isinstance(thing, np.ndarray):
        update(str(thing.shape).encode() + np.ascontiguousarray(thing).tobytes())
    elif isinstance(thing, Mapping):
        for key in sorted(thing, key=str):
            update(str(key).encode())
            _add_to_digest(update, thing[key])
    elif isinstance(thing, Sequence) and not isinstance(thing, str):
        for one in thing:
            _add_to_digest(update, one)
    elif isinstance(thing, Path):
        update(thing.name.encode())  # the same model in another folder is the same model
    else:
        update(repr(thing).encode())
