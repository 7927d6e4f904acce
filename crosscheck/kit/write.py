"""Write a case kit: a folder that says everything about one comparison, the same bytes every time."""

from __future__ import annotations

import csv
import json
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from crosscheck.engines.base import sample_times
from crosscheck.engines.shared.export_files import NotExported
from crosscheck.engines.shared.probe_states import configurations, list_probe_rates
from crosscheck.engines.shared.urdf_text import write_urdf
from crosscheck.kit import tree
from crosscheck.kit.page import render_readme
from crosscheck.kit.parts import write_parts
from crosscheck.kit.resolved import build_case_file
from crosscheck.kit.schemas import KIT, read_schema
from crosscheck.kit.tables import CaseData, CaseFile, CertificateFile
from crosscheck.measures.record import Record
from crosscheck.measures.series_csv import TIME, write_table
from crosscheck.measures.series_csv import write as write_series
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

MOTION = "the motion: time, then q, qd and qdd of every coordinate that is given"
PROBE = "configurations at which `certificate.json` is asked, one a row"
RATES = (
    "rates and accelerations for the slopes of torques in `certificate.json`, one row per configuration of `probe.csv`"
)
TREE = (
    "the tree once more, one line per moving joint, fixed joints merged: for programs that want no JSON; `parent` is the line "
    "of the joint before, counted from 0, -1 the world; closures, springs and forces stand in `case.json` alone"
)
ROBOT = "the mechanism as URDF, without what that format has no words for (springs, closures: said at its head)"
EXPECTED = "the series with error bars, and the certificate, of the reference"


def write(
    mechanism: Mechanism, case: Case, folder: Path, expected: Record | None = None, refinement: int = 1
) -> CaseFile:
    """Write the kit of a case into a folder, which is made, and return what ``case.json`` says.

    expected : record of the reference, None for a blind kit; refinement : times [-] by which step and mesh are to be finer
    Raises OSError.
    """
    folder.mkdir(parents=True, exist_ok=True)
    file = build_case_file(mechanism, case, refinement)
    said = file.case
    spacing = said.step if said.integrated else said.sample
    files = {"motion.csv": MOTION}
    _write_json(folder / "case.json", file.model_dump(mode="json"))
    write_table(folder / "motion.csv", *build_motion_table(mechanism, case, said, spacing))
    files |= write_parts(mechanism, folder)
    if mechanism.is_rigid:
        files |= {"probe.csv": PROBE, "tree.csv": TREE}
        header = [f"q/{c.name} [{c.unit}]" for c in said.coordinates]
        write_table(folder / "probe.csv", header, configurations(mechanism, case))
        if (rates := list_probe_rates(mechanism)) is not None:
            files["probe_rates.csv"] = RATES
            header = [f"qd/{v.name} [{v.unit}]" for v in said.velocities]
            header += [f"qdd/{v.name} [{v.acceleration_unit}]" for v in said.velocities]
            write_table(folder / "probe_rates.csv", header, np.hstack(rates))
        _write_tree_rows(folder / "tree.csv", mechanism)
        if (text := _convert_to_urdf(mechanism)) is not None:
            files["robot.urdf"] = ROBOT
            (folder / "robot.urdf").write_text(text, encoding="utf-8")
    (folder / "schema").mkdir(exist_ok=True)
    for name in KIT:
        (folder / "schema" / f"{name}.schema.json").write_text(read_schema(name), encoding="utf-8")
    if expected is not None:
        files["expected/"] = EXPECTED
        _write_expected(folder / "expected", expected, file)
    (folder / "README.md").write_text(render_readme(file, files, spacing), encoding="utf-8")
    return file


def build_motion_table(mechanism: Mechanism, case: Case, data: CaseData, spacing: float) -> tuple[list[str], Array]:
    """Return header and rows of ``motion.csv``: time [s], then q, qd, qdd of what the motion gives [rad], [m], [s]."""
    time = sample_times(case) if spacing == case.sample else spacing * np.arange(round(case.end / spacing) + 1)
    q, qd, qdd = case.motion.evaluate(mechanism, time)
    coordinates = [(k, c) for k, c in enumerate(data.coordinates) if c.given]
    velocities = [(k, v) for k, v in enumerate(data.velocities) if v.given]
    header = [
        TIME,
        *(f"q/{c.name} [{c.unit}]" for _, c in coordinates),
        *(f"qd/{v.name} [{v.unit}]" for _, v in velocities),
        *(f"qdd/{v.name} [{v.acceleration_unit}]" for _, v in velocities),
    ]
    rows = [k for k, _ in velocities]
    return header, np.hstack([time[:, None], q[:, [k for k, _ in coordinates]], qd[:, rows], qdd[:, rows]])


def _convert_to_urdf(mechanism: Mechanism) -> str | None:
    """Return the mechanism as URDF, None where that format cannot say it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return write_urdf(mechanism)
    except NotExported:
        return None


def _write_tree_rows(path: Path, mechanism: Mechanism) -> None:
    with path.open("w", encoding="utf-8", newline="") as stream:
        lines = csv.writer(stream, lineterminator="\n")
        lines.writerow(tree.HEADER)
        lines.writerows(tree.list_tree_rows(mechanism))


def _write_expected(folder: Path, record: Record, file: CaseFile) -> None:
    """Write what the reference gives: of all its series those that are asked for, and its certificate."""
    folder.mkdir(exist_ok=True)
    asked = {one.quantity for one in file.case.asked}
    write_series(folder / "series.csv", record.time, [s for s in record.series.values() if s.quantity in asked])
    if "problem" not in record.certificate:
        said = {key: value for key, value in record.certificate.items() if key in CertificateFile.model_fields}
        _write_json(folder / "certificate.json", said)
    meta = {"tool": record.engine, "version": record.version, "case": file.digest}
    _write_json(folder / "meta.json", {**meta, "mechanism": file.mechanism.name, "name": file.case.name})


def _write_json(path: Path, plain: Mapping[str, Any]) -> None:
    path.write_text(json.dumps(plain, indent=1, allow_nan=False) + "\n", encoding="utf-8")
