"""The numbers behind the plots: one small script per case and quantity, loaded when a reader asks for it.

A page opened from the file system may not read files, but it may load scripts: each file calls
``crosscheckData(key, {...})``.  Arrays are base64 of little-endian float32: enough for the eye, and the differences
are taken in float64 before.  Beside each script lies what it draws as CSV, with all digits, for whoever wants the numbers.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NotRequired, TypedDict

import numpy as np

from crosscheck import output_folder as owned
from crosscheck.measures.limits import REFERENCE
from crosscheck.measures.record import Record, read_record
from crosscheck.measures.spectrum import RINGING, compute_ringing_spectrum
from crosscheck.report import animation
from crosscheck.report.curve_files import list_engine_curves
from crosscheck.report.encoding import convert_to_base64
from crosscheck.verdicts.results import CaseRow, Results, make_slug
from flexinv.display.curve_table import DrawnCurve, render_curves
from flexinv.typing import Array

VISIBLE = 1e-3  # of the range: on a plot 360 pixels high a narrower error bar is inside its line
HIGHEST = 4.0  # the spectrum is drawn up to this many times the highest marked peak


class QuantityNames(TypedDict):
    """A quantity that can be drawn: its name, that of its file, its series; tables : words and files of its numbers."""

    name: str
    slug: str
    series: list[str]
    tables: list[tuple[str, str]]


class CaseManifest(TypedDict):
    """Names by which the page of a case loads its numbers; rest [s]."""

    slug: str
    engines: list[str]
    reference: str
    rest: float
    spectrum: str
    animation: bool
    quantities: list[QuantityNames]


class EngineLine(TypedDict):
    """A series of one engine; error, difference : where they can be seen (arrays as base64)."""

    value: str
    error: NotRequired[str]
    difference: NotRequired[str]


@dataclass(frozen=True)
class Spectra:
    """Spectra of one series: frequency (lines,) [Hz], amplitude (lines,) [unit] and marked peaks by engine."""

    frequency: Array
    amplitude: Mapping[str, Array]
    peaks: dict[str, list[list[float]]]


class SpectrumData(TypedDict):
    """Spectra by engine: frequency [Hz] and amplitude (arrays as base64), and the peaks that are marked."""

    frequency: str
    amplitude: dict[str, str]
    peaks: dict[str, list[list[float]]]


class SeriesData(TypedDict):
    """One series of all engines; limits : largest difference allowed [unit], by engine."""

    unit: str
    engines: dict[str, EngineLine]
    limits: dict[str, float]
    spectrum: NotRequired[SpectrumData]


class QuantityData(TypedDict):
    """One quantity: time [s] (an array as base64), and its series by name."""

    time: str
    series: dict[str, SeriesData]


def write_case(results: Results, case: CaseRow, out: Path) -> CaseManifest:
    """Write the data of one case below ``out/data`` and return what the page has to know to load it."""
    records = read_records(results, case, out)
    folder = out / "data" / case.slug
    folder.mkdir(parents=True, exist_ok=True)
    names = [_write_quantity(results, case, records, q, folder) for q in list_drawn_quantities(case, records)]
    return {
        "slug": case.slug,
        "engines": list(records),
        "reference": find_reference(records),
        "rest": case.rest,
        "spectrum": f"Spectrum after the motion, from {case.rest:.4g} s"
        if case.held
        else "Spectrum of the whole signal",
        "animation": animation.write(case, records, folder),
        "quantities": names,
    }


def _write_quantity(
    results: Results, case: CaseRow, records: Mapping[str, Record], quantity: str, folder: Path
) -> QuantityNames:
    """Write script and CSV of one quantity of a case into a folder, and return their names."""
    slug = make_slug(quantity)
    key = f"{case.slug}/{slug}"
    spectra = collect_spectra(results, case, records, quantity)
    data = build_quantity_data(results, case, records, quantity, spectra)
    owned.write(folder / f"{slug}.js", f"crosscheckData({json.dumps(key)}, {json.dumps(data, allow_nan=False)});\n")
    owned.write(folder / f"{slug}.csv", render_curves(list_engine_curves(records, quantity)))
    tables = [(quantity, f"{slug}.csv")]
    if spectra:
        curves = [
            DrawnCurve("frequency [Hz]", f"{engine}: {name} [{data['series'][name]['unit']}]", one.frequency, amplitude)
            for name, one in spectra.items()
            for engine, amplitude in one.amplitude.items()
        ]
        owned.write(folder / f"{slug}-spectrum.csv", render_curves(curves))
        tables.append((f"spectrum of {quantity}", f"{slug}-spectrum.csv"))
    return {"name": quantity, "slug": slug, "series": list(data["series"]), "tables": tables}


def read_records(results: Results, case: CaseRow, out: Path) -> dict[str, Record]:
    """Return the records of the engines that gave series for the case."""
    rows = [r for r in results.runs if (r.mechanism, r.case) == (case.mechanism, case.case) and r.series]
    return {row.engine: read_record(out / row.series) for row in rows}


def list_drawn_quantities(case: CaseRow, records: Mapping[str, Record]) -> list[str]:
    """Return the quantities to draw: those that the case compares, and the torque in any case."""
    given = {s.quantity for record in records.values() for s in record.series.values()}
    return [q for q in dict.fromkeys([*case.quantities, "torque"]) if q in given]


def find_reference(records: Mapping[str, Record]) -> str:
    """Return the engine that differences are taken from: flexinv, or the first one."""
    return REFERENCE if REFERENCE in records else next(iter(records), "")


def collect_spectra(
    results: Results, case: CaseRow, records: Mapping[str, Record], quantity: str
) -> dict[str, Spectra]:
    """Return the spectra of a quantity that rings, by series; none of others."""
    if quantity not in RINGING:
        return {}
    found = {name: _find_spectra(results, case, records, name) for name in _list_series(records, quantity)}
    return {name: one for name, one in found.items() if one is not None}


def _list_series(records: Mapping[str, Record], quantity: str) -> list[str]:
    return list(dict.fromkeys(s.name for r in records.values() for s in r.series.values() if s.quantity == quantity))


def build_quantity_data(
    results: Results, case: CaseRow, records: Mapping[str, Record], quantity: str, spectra: Mapping[str, Spectra]
) -> QuantityData:
    """Return time and every series of a quantity, by series and engine."""
    time = next(iter(records.values())).time
    series = {n: _build_series_data(results, case, records, n) for n in _list_series(records, quantity)}
    for name, one in spectra.items():
        series[name]["spectrum"] = {
            "frequency": convert_to_base64(one.frequency),
            "amplitude": {engine: convert_to_base64(a) for engine, a in one.amplitude.items()},
            "peaks": one.peaks,
        }
    return {"time": convert_to_base64(time), "series": series}


def _build_series_data(results: Results, case: CaseRow, records: Mapping[str, Record], name: str) -> SeriesData:
    owner = next(r.series[name] for r in records.values() if name in r.series)
    base = records[find_reference(records)].series.get(name)
    lines = {}
    for engine, record in records.items():
        if (one := record.series.get(name)) is None:
            continue
        line: EngineLine = {"value": convert_to_base64(one.values)}
        if one.error is not None and one.error.max() > VISIBLE * np.ptp(one.values):
            line["error"] = convert_to_base64(one.error)
        if base is not None and engine != find_reference(records):
            line["difference"] = convert_to_base64(one.values - base.values)
        lines[engine] = line
    return {"unit": owner.unit, "engines": lines, "limits": _collect_limits(results, case, name, owner.unit)}


def _collect_limits(results: Results, case: CaseRow, name: str, unit: str) -> dict[str, float]:
    """Return the largest difference allowed [unit], by engine."""
    here = [c for c in results.comparisons if (c.mechanism, c.case) == (case.mechanism, case.case)]
    return {
        c.engine: c.limit * c.scale
        for c in here
        if c.quantity == name.split("/", 1)[0] and c.unit == unit and c.limit and c.scale
    }


def _find_spectra(results: Results, case: CaseRow, records: Mapping[str, Record], name: str) -> Spectra | None:
    """Return the spectra of one series up to `HIGHEST` times the highest marked peak; None where no engine has any."""
    marks = {
        r.engine: [list(mark) for mark in r.peaks[name]]
        for r in results.runs
        if (r.mechanism, r.case) == (case.mechanism, case.case) and r.engine in records and name in r.peaks
    }
    lines = {}
    axis = np.zeros(0)
    for engine, record in records.items():
        if name in record.series:
            spectrum = compute_ringing_spectrum(record.time, record.series[name].values, case.rest)
            if spectrum is not None:
                axis, lines[engine] = spectrum
    if not lines:
        return None
    highest = max((mark[0] for peaks in marks.values() for mark in peaks), default=0.0)
    kept = axis <= HIGHEST * highest if highest > 0.0 else np.ones(axis.size, dtype=bool)
    return Spectra(axis[kept], {engine: a[kept] for engine, a in lines.items()}, marks)
