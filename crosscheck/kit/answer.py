"""Read an answer to a case kit: ``series.csv``, ``certificate.json``, ``meta.json``; whatever is wrong becomes words.

An answer comes from strangers: sizes are bounded before anything is read, no file is followed out of its folder, and every
number is checked.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TypeVar, cast

import numpy as np
from pydantic import BaseModel, ValidationError

from crosscheck.engines.base import sample_times
from crosscheck.kit.resolved import build_case_file, list_idle_velocities, list_quantity_series
from crosscheck.kit.tables import CertificateFile, MetaFile
from crosscheck.measures.record import PlainCertificate, Record, Series, list_effort_units, series
from crosscheck.measures.series_csv import check_names, check_times, list_all_series, read
from flexinv.errors import InputError
from flexinv.files.load_cases import Case
from flexinv.files.regular_files import LOOP, MISSING, describe_kind
from flexinv.model.mechanism import Mechanism

LARGEST_JSON = 20_000_000  # [bytes]: the certificate of a humanoid has a hundred thousand
T = TypeVar("T", bound=BaseModel)


def read_answer(folder: Path, mechanism: Mechanism, case: Case, engine: str) -> Record:
    """Return the record of an answer folder; series in the units of the kit [N m], [N], [m].

    Raises InputError that says what is wrong: missing or doubled columns, other units, times, coordinates or cases.
    """
    meta = read_table(resolve_file(folder, "meta.json"), MetaFile) or MetaFile()
    answer = Record(engine, version=meta.version, settings=_collect_settings(meta))
    _check_addressed(folder, meta, mechanism, case)
    if meta.skipped:
        return replace(answer, status="skipped", message=meta.skipped)
    file = resolve_file(folder, "series.csv")
    if not file.is_file():
        raise InputError(f"{folder} holds no series.csv: nothing was answered")
    time, found = read(file)
    check_times(file, time, times := sample_times(case), case.sample)
    check_names(file, list_all_series(mechanism), found.values())
    _check_complete(file, mechanism, case, found)
    still = {f"torque/{name}" for name in list_idle_velocities(mechanism, case)} - set(found)
    units = dict(zip(mechanism.velocity_names, list_effort_units(mechanism), strict=True))
    for name in mechanism.velocity_names:
        if f"torque/{name}" in still:
            found |= series(f"torque/{name}", units[name], np.zeros(time.size))
    _check_finite(file, found, time)
    certificate = read_certificate(resolve_file(folder, "certificate.json"), mechanism)
    return replace(answer, time=times, series=found, wall_time=meta.wall_time, certificate=certificate)


def resolve_file(folder: Path, name: str) -> Path:
    """Return a file of a folder, be it there or not.  Raises InputError for a link out of it, a pipe, a device or a folder."""
    file = folder / name
    words = describe_kind(file)
    if words == LOOP:
        raise InputError(f"{file}: {words}; expected a regular file")
    if not file.resolve().is_relative_to(folder.resolve()):
        raise InputError(f"{file} leads out of its folder; expected a file")
    if words not in ("", MISSING):
        raise InputError(f"{file}: {words}; expected a regular file")
    return file


def read_table(path: Path, model: type[T]) -> T | None:
    """Return a JSON file as a table, None where there is none.  Raises InputError."""
    try:
        if not path.is_file():
            return None
        if (size := path.stat().st_size) > LARGEST_JSON:
            raise InputError(f"{path} has {size / 1e6:.0f} MB, expected at most {LARGEST_JSON / 1e6:.0f} MB")
        return model.model_validate(json.loads(path.read_text(encoding="utf-8-sig")))
    except InputError:
        raise
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise InputError(f"{path}: {where or 'the whole'}: {first['msg']}; see {model.__name__} in schema/") from None
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path} cannot be read: {error}") from None


def _collect_settings(meta: MetaFile) -> dict[str, str | float]:
    """Return the settings that an answer states, for the report."""
    said = {
        "tool": meta.tool,
        "formulation": meta.formulation,
        "step [s]": meta.step,
        "mesh": meta.mesh,
        "notes": meta.notes,
    }
    return {name: value for name, value in said.items() if value is not None and value != ""}


def _check_addressed(folder: Path, meta: MetaFile, mechanism: Mechanism, case: Case) -> None:
    """Raise InputError where an answer says that it is another case's."""
    for what, said, ours in (("mechanism", meta.mechanism, mechanism.name), ("case", meta.name, case.name)):
        if said and said != ours:
            raise InputError(f"{folder / 'meta.json'}: an answer for {what} {said!r}, expected {ours!r}")
    if meta.case:
        known = {build_case_file(mechanism, case, k).digest for k in (1, 2, 4)}
        if meta.case not in known:
            raise InputError(
                f"{folder / 'meta.json'}: an answer for the case {meta.case}, which is not this one: the files have "
                "changed since, or it is another case's; make the kit anew and answer that"
            )


def _check_complete(file: Path, mechanism: Mechanism, case: Case, series: dict[str, Series]) -> None:
    """Raise InputError where a quantity is there in part: a column was forgotten; reactions and sections are free."""
    for quantity in ("torque", "tip", "deflection"):
        quantity_series = list_quantity_series(mechanism, case, quantity)
        there = [name for name in quantity_series if name in series]
        missing = [name for name in quantity_series if name not in series]
        if missing and (
            quantity == "torque" or (there and quantity in case.quantities and _has_partial_vector(missing, there))
        ):
            raise InputError(f"{file}: column '{missing[0]} [{quantity_series[missing[0]]}]' is missing")


def _has_partial_vector(missing: list[str], there: list[str]) -> bool:
    """Return True if a vector is there in part: x without y."""
    return bool({name.rpartition("/")[0] for name in missing} & {name.rpartition("/")[0] for name in there})


def _check_finite(file: Path, series: dict[str, Series], time: np.ndarray) -> None:
    """Raise InputError where a number is not finite, or an error bar negative."""
    for one in series.values():
        for what, values in (("", one.values), (" error", one.error)):
            if values is None:
                continue
            bad = ~np.isfinite(values) if not what else ~(np.isfinite(values) & (values >= 0.0))
            if bad.any():
                k = int(np.flatnonzero(bad)[0])
                raise InputError(
                    f"{file}: column {one.name + what!r}: {int(bad.sum())} of {values.size} values are no "
                    f"{'half-widths' if what else 'finite numbers'}, the first at t = {time[k]:.6g} s ({values[k]})"
                )


def read_certificate(file: Path, mechanism: Mechanism) -> PlainCertificate:
    """Return the certificate in a file; {} without one, {"broken": why} where it cannot be read or compared."""
    try:
        table = read_table(file, CertificateFile)
        if table is None:
            return {}
        _check_shapes(file, table, mechanism)
    except InputError as error:
        return {"broken": str(error)}
    stated = {name: value for name, value in table.model_dump(mode="json").items() if value not in (None, {}, [])}
    return cast(PlainCertificate, stated)


def _check_shapes(file: Path, found: CertificateFile, mechanism: Mechanism) -> None:
    """Raise InputError where rows of a table have not all as many numbers as there are velocities."""
    nv = mechanism.nv
    if any(len(row) != nv for row in found.gravity or ()):
        raise InputError(f"{file}: gravity: expected {nv} numbers in each row, one per velocity")
    if any(len(matrix) != nv or any(len(row) != nv for row in matrix) for matrix in found.mass_matrix or ()):
        raise InputError(f"{file}: mass_matrix: expected {nv} rows of {nv} numbers for each configuration")
