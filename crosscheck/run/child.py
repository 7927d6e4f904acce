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
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from crosscheck.doors.outside_bars import convert_door_bars, of_package
from crosscheck.engines import ENGINES, add_import_path, open_adapter
from crosscheck.engines.base import Adapter, offered
from crosscheck.engines.shared.export_files import NotExported
from crosscheck.engines.shared.rounding import add_rounding_bars, build_perturbed_case
from crosscheck.kit.resolved import needs_integration
from crosscheck.measures.mechanisms import read_mechanism
from crosscheck.measures.record import Record, compute_fingerprint, read_record, save
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


def run_case(job: dict[str, Any]) -> None:
    """Run one engine on one case and save its record."""
    name = job["engine"]
    try:
        record = _run(job, open_adapter(job))
    except Exception as error:
        traceback.print_exc()
        record = Record(
            engine=name, status="error", message=_describe_error(error), certificate=_make_failed_certificate(job)
        )
    save(record, Path(job["out"]))


def _run(job: dict[str, Any], adapter: Adapter) -> Record:
    name = job["engine"]
    mechanism = read_mechanism(job["mechanism"])
    case = load_cases(job["mechanism"], mechanism)[job["case"]]
    known = {"engine": name, "model_hash": compute_fingerprint(mechanism, case.motion)}
    if way := job["options"].pop("shake", 0):
        case = build_perturbed_case(case, way)
    if (reason := ask_for_refusal(adapter, mechanism, case, name)) is not None:
        return Record(status="skipped", message=reason, version=adapter.version(), **known)
    record = replace(_run_adapter(job, adapter, mechanism, case), **known)
    stated = record.version if "settings" in job else ""  # a program or a record says its own
    record = replace(record, version=stated or adapter.version())
    if record.status == "ok" and job["options"].get("certificate", True):
        record = replace(record, certificate=record.certificate or make_certificate(adapter, mechanism, case, name))
    stepped = "settings" in job and needs_integration(
        mechanism, case
    )  # the bars of a program's steps are its own business
    if stepped or not job["options"].get("error", True):
        return record
    return add_rounding_bars(adapter, record, mechanism, case, job["options"])


def ask_for_refusal(adapter: Adapter, mechanism: Mechanism, case: Case, engine: str) -> str | None:
    """Return the reason why an engine cannot do a case, None where it can.  Raises TypeError where it says neither."""
    reason: object = adapter.unsupported(mechanism, case, engine)
    if reason is not None and not isinstance(reason, str):
        raise TypeError(
            f"unsupported returned {str(reason)[:60]}; expected the reason in words, or None where the engine can"
        )
    return reason


def _run_adapter(job: dict[str, Any], adapter: Adapter, mechanism: Mechanism, case: Case) -> Record:
    """Return the record of an adapter; bars of an engine from outside that nobody asked for are marked as such."""
    name = job["engine"]
    options = job["options"]
    if "settings" in job or (name in ENGINES and ENGINES[name].module == job["module"]):
        return convert_door_bars(adapter.run(mechanism, case, name, options))
    return of_package(adapter, mechanism, case, name, options)


def _make_failed_certificate(job: dict[str, Any]) -> dict[str, Any]:
    """Return the certificate of an engine whose run failed: it may say why."""
    try:
        mechanism = read_mechanism(job["mechanism"])
        case = load_cases(job["mechanism"], mechanism)[job["case"]]
        return make_certificate(open_adapter(job), mechanism, case, job["engine"])
    except Exception as error:
        return {"problem": _describe_error(error)}


def make_certificate(adapter: Adapter, mechanism: Mechanism, case: Case, engine: str) -> dict[str, Any]:
    """Return the certificate of the engine's own model, or the reason why there is none."""
    if (certify := offered(adapter, "certify")) is None:
        return {"problem": "this formulation has nothing to be asked for"}
    try:
        return cast(
            dict[str, Any], replace(certify(mechanism, case, engine), given=describe_supplied_data(mechanism)).plain
        )
    except InputError as error:
        return {"problem": str(error)}
    except Exception as error:
        traceback.print_exc()
        return {"problem": _describe_error(error)}


def describe_supplied_data(mechanism: Mechanism) -> dict[str, str]:
    """Return in words the data that flexinv computed and gave to an engine, by their names."""
    stated = mechanism.modal_damping
    return (
        {}
        if stated is None or stated.seconds is None
        else {"damping of beams": f"{stated}, computed by flexinv and given to every engine"}
    )


def describe(job: dict[str, Any]) -> None:
    """Write the engine's version and what it can do."""
    adapter = open_adapter(job)
    _write(job, {"version": adapter.version(), "abilities": adapter.abilities()})


def write_abilities(job: dict[str, Any]) -> None:
    """Write what the adapter is, then for every case why it cannot do it (null where it can): a line of JSON each."""
    with Path(job["out"]).open("w", encoding="utf-8", buffering=1) as lines:
        adapter = open_adapter(job)
        lines.write(json.dumps({"version": adapter.version(), "abilities": adapter.abilities()}) + "\n")
        asked = pickle.loads(Path(job["out"]).with_suffix(".asked").read_bytes())
        for (folder, engine), (mechanism, case) in zip(job["cases"], asked, strict=True):
            here = {**job, "engine": engine, "mechanism": folder}
            lines.write(json.dumps({"reason": _find_refusal(here, mechanism, case)}) + "\n")


def _find_refusal(job: dict[str, Any], mechanism: Mechanism, case: Case) -> str | None:
    """Return the reason why an engine cannot do a case; None also where that cannot be asked: its run will say so."""
    try:
        return ask_for_refusal(open_adapter(job), mechanism, case, job["engine"])
    except Exception:
        traceback.print_exc()
        return None


def write_study(job: dict[str, Any]) -> None:
    """Write the table that the function ``job["function"]`` of a module gives, which may be imported from ``job["path"]``."""
    add_import_path(job)
    function = getattr(importlib.import_module(job["module"]), job["function"])
    _write(job, function(**job["options"]))


def write_export(job: dict[str, Any]) -> None:
    """Write what the engine was given into a folder; what cannot be exported is the answer, in words."""
    adapter = open_adapter(job)
    mechanism = read_mechanism(job["mechanism"])
    case = load_cases(job["mechanism"], mechanism)[job["case"]]
    expected = read_record(Path(job["expected"])).series
    effort = np.stack([expected[f"torque/{name}"].values for name in mechanism.velocity_names], axis=1)
    try:
        if (write := offered(adapter, "export")) is None:
            raise NotExported(f"there is no export for {job['engine']}")
        write(mechanism, case, job["engine"], effort, Path(job["folder"]))
    except NotExported as error:
        _write(job, {"problem": str(error)})
    else:
        _write(job, {"problem": ""})


def _write(job: dict[str, Any], answer: object) -> None:
    Path(job["out"]).write_text(json.dumps(answer, allow_nan=False), encoding="utf-8")


def _describe_error(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__


KINDS_OF_JOBS = {
    "run": run_case,
    "describe": describe,
    "abilities": write_abilities,
    "study": write_study,
    "read": read,
    "export": write_export,
}


if __name__ == "__main__":
    main(sys.argv[1])
