"""The process in which one engine runs: ``python -m crosscheck.run.child job.json``.

The job names the adapter module and what it shall do; the answer goes to files beside the job, so whatever the
engine prints harms nobody.  The parent (``crosscheck.run.isolation``) judges how the process ended.
"""

from __future__ import annotations

import importlib
import json
import os
import pickle
import sys
import traceback
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from crosscheck.doors.outside_bars import convert_door_bars, of_package
from crosscheck.engines import ENGINES, Door, add_import_path, open_adapter
from crosscheck.engines.base import Adapter, offered
from crosscheck.engines.base import Options as EngineOptions
from crosscheck.engines.job_files import (
    AbilitiesJobFile,
    AdapterDescription,
    CaseJobFile,
    DescribeJobFile,
    ExportAnswer,
    ExportJobFile,
    RefusalLine,
    StudyJobFile,
)
from crosscheck.engines.shared.export_files import NotExported
from crosscheck.engines.shared.rounding import add_rounding_bars, build_perturbed_case
from crosscheck.kit.resolved import needs_integration
from crosscheck.measures.mechanisms import read_mechanism
from crosscheck.measures.record import PlainCertificate, Record, compute_fingerprint, read_record, save
from crosscheck.run.processes import apply_file_size_limit, end_with_parent, make_subreaper
from crosscheck.run.reading_job import read
from flexinv.errors import InputError
from flexinv.files.load_cases import Case, load_cases
from flexinv.model.mechanism import Mechanism


def main(job_file: str) -> None:
    """Do the job, write the answer, and leave without tearing down an engine that may crash on its way out."""
    end_with_parent()
    make_subreaper()
    apply_file_size_limit()
    job = json.loads(Path(job_file).read_text(encoding="utf-8"))
    KINDS_OF_JOBS[job["kind"]](job)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)


def run_case(job: CaseJobFile) -> None:
    """Run one engine on one case and save its record."""
    name = job["engine"]
    try:
        record = _run(job, open_adapter(job, name, job["mechanism"]))
    except Exception as error:
        traceback.print_exc()
        record = Record(
            engine=name, status="error", message=_describe_error(error), certificate=_make_failed_certificate(job)
        )
    save(record, Path(job["out"]))


def _run(job: CaseJobFile, adapter: Adapter) -> Record:
    name = job["engine"]
    mechanism = read_mechanism(job["mechanism"])
    case = load_cases(job["mechanism"], mechanism)[job["case"]]
    model_hash = compute_fingerprint(mechanism, case.motion)
    options = dict(job["options"])
    if way := options.pop("shake", 0):
        case = build_perturbed_case(case, way)
    if (reason := ask_for_refusal(adapter, mechanism, case, name)) is not None:
        return Record(name, "skipped", reason, adapter.version(), model_hash=model_hash)
    record = _run_adapter(job, adapter, mechanism, case, options)
    record = replace(record, engine=name, model_hash=model_hash)
    stated = record.version if "settings" in job else ""  # a program or a record says its own
    record = replace(record, version=stated or adapter.version())
    if record.status == "ok" and options.get("certificate", True):
        record = replace(record, certificate=record.certificate or make_certificate(adapter, mechanism, case, name))
    stepped = "settings" in job and needs_integration(
        mechanism, case
    )  # the bars of a program's steps are its own business
    if stepped or not options.get("error", True):
        return record
    return add_rounding_bars(adapter, record, mechanism, case, options)


def ask_for_refusal(adapter: Adapter, mechanism: Mechanism, case: Case, engine: str) -> str | None:
    """Return the reason why an engine cannot do a case, None where it can.  Raises TypeError where it says neither."""
    if (meshed := [link.name for link in mechanism.meshed]) and not getattr(adapter, "MESHES", False):
        return f"{engine} is given no links that are meshes yet; here: {', '.join(meshed)}"
    reason: object = adapter.unsupported(mechanism, case, engine)
    if reason is not None and not isinstance(reason, str):
        raise TypeError(
            f"unsupported returned {str(reason)[:60]}; expected the reason in words, or None where the engine can"
        )
    return reason


def _run_adapter(
    job: CaseJobFile, adapter: Adapter, mechanism: Mechanism, case: Case, options: EngineOptions
) -> Record:
    """Return the record of an adapter; bars of an engine from outside that nobody asked for are marked as such."""
    name = job["engine"]
    if "settings" in job or (name in ENGINES and ENGINES[name].module == job["module"]):
        return convert_door_bars(adapter.run(mechanism, case, name, options))
    return of_package(adapter, mechanism, case, name, options)


def _make_failed_certificate(job: CaseJobFile) -> PlainCertificate:
    """Return the certificate of an engine whose run failed: it may say why."""
    try:
        mechanism = read_mechanism(job["mechanism"])
        case = load_cases(job["mechanism"], mechanism)[job["case"]]
        adapter = open_adapter(job, job["engine"], job["mechanism"])
        return make_certificate(adapter, mechanism, case, job["engine"])
    except Exception as error:
        return {"problem": _describe_error(error)}


def make_certificate(adapter: Adapter, mechanism: Mechanism, case: Case, engine: str) -> PlainCertificate:
    """Return the certificate of the engine's own model, or the reason why there is none."""
    if (certify := offered(adapter, "certify")) is None:
        return {"problem": "this formulation has nothing to be asked for"}
    try:
        certificate = replace(certify(mechanism, case, engine), given=describe_supplied_data(mechanism))
        plain: PlainCertificate = certificate.plain
    except InputError as error:
        return {"problem": str(error)}
    except Exception as error:
        traceback.print_exc()
        return {"problem": _describe_error(error)}
    return plain


def describe_supplied_data(mechanism: Mechanism) -> dict[str, str]:
    """Return in words the data that flexinv computed and gave to an engine, by their names."""
    stated = mechanism.modal_damping
    return (
        {}
        if stated is None or stated.seconds is None
        else {"damping of beams": f"{stated}, computed by flexinv and given to every engine"}
    )


def describe(job: DescribeJobFile) -> None:
    """Write the engine's version and what it can do."""
    _write(job["out"], _describe_adapter(open_adapter(job, job["engine"])))


def _describe_adapter(adapter: Adapter) -> AdapterDescription:
    return {"version": adapter.version(), "abilities": adapter.abilities()}


def write_abilities(job: AbilitiesJobFile) -> None:
    """Write what the adapter is, then for every case why it cannot do it (null where it can): a line of JSON each."""
    with Path(job["out"]).open("w", encoding="utf-8", buffering=1) as lines:
        lines.write(json.dumps(_describe_adapter(open_adapter(job, job["engine"]))) + "\n")
        asked = pickle.loads(Path(job["out"]).with_suffix(".asked").read_bytes())
        for (folder, engine), (mechanism, case) in zip(job["cases"], asked, strict=True):
            line: RefusalLine = {"reason": _find_refusal(job, engine, folder, mechanism, case)}
            lines.write(json.dumps(line) + "\n")


def _find_refusal(door: Door, engine: str, folder: str, mechanism: Mechanism, case: Case) -> str | None:
    """Return the reason why an engine cannot do a case; None also where that cannot be asked: its run will say so."""
    try:
        return ask_for_refusal(open_adapter(door, engine, folder), mechanism, case, engine)
    except Exception:
        traceback.print_exc()
        return None


def write_study(job: StudyJobFile) -> None:
    """Write the table that the function ``job["function"]`` of a module gives, which may be imported from ``job["path"]``."""
    add_import_path(job.get("path", ""))
    function = getattr(importlib.import_module(job["module"]), job["function"])
    _write(job["out"], function(**job["options"]))


def write_export(job: ExportJobFile) -> None:
    """Write what the engine was given into a folder; what cannot be exported is the answer, in words."""
    adapter = open_adapter(job, job["engine"], job["mechanism"])
    mechanism = read_mechanism(job["mechanism"])
    case = load_cases(job["mechanism"], mechanism)[job["case"]]
    expected = read_record(Path(job["expected"])).series
    effort = np.stack([expected[f"torque/{name}"].values for name in mechanism.velocity_names], axis=1)
    answer: ExportAnswer = {"problem": ""}
    try:
        if (write := offered(adapter, "export")) is None:
            raise NotExported(f"there is no export for {job['engine']}")
        write(mechanism, case, job["engine"], effort, Path(job["folder"]))
    except NotExported as error:
        answer = {"problem": str(error)}
    _write(job["out"], answer)


def _write(out: str, answer: object) -> None:
    Path(out).write_text(json.dumps(answer, allow_nan=False), encoding="utf-8")


def _describe_error(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__


# What is done with the file of a job by its kind; each takes the form that `crosscheck.engines.job_files` has of it.
KINDS_OF_JOBS: Mapping[str, Callable[[Any], None]] = {
    "run": run_case,
    "describe": describe,
    "abilities": write_abilities,
    "study": write_study,
    "read": read,
    "export": write_export,
}


if __name__ == "__main__":
    main(sys.argv[1])
