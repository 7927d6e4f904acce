"""Identifications that nights repeat: every mechanism whose identify.toml says by [night] which logs identify and which judge."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from crosscheck.identification.bands import ChannelJudgement
from crosscheck.identification.identify import identify, judge_blocks, read_machine, read_of
from crosscheck.identification.page import COLUMNS, judge_channel
from crosscheck.identification.settings import FILE
from crosscheck.verdicts.study_table import Line, StudyTable
from flexinv.errors import InputError

TEXT = """Mechanisms with logs of their own: parameters are identified from logs, and what these have not seen judges the
predicted torques and their bands, against the limits of identify.toml. In blocks means that each part of a log is
judged by what the others tell, and that all parts are pooled."""
HEADS = (("mechanism", "mechanism", ""), *(c for c in COLUMNS if c[0] not in ("part",)))


def run_study(models: str) -> StudyTable:
    """Return the table of the report: how well logs held out are explained [-], with verdicts by the limits."""
    rows: list[Line] = []
    for folder in sorted(file.parent for file in Path(models).glob(f"*/{FILE}")):
        rows += _list_judged_rows(folder)
    if not rows:
        return {"status": "skipped", "message": f"no {FILE} among the models has a table [night]"}
    return {"text": TEXT.replace("\n", " "), "columns": HEADS, "rows": rows}


def _list_judged_rows(folder: Path) -> Iterator[Line]:
    try:
        settings = read_machine(folder).settings
        if settings.night is None:
            return
        for row in judge_night(folder):
            word, message = judge_channel([*settings.limits, *settings.night.limits], row)
            yield vars(row) | {"mechanism": folder.name, "verdict": word, "message": message}
    except InputError as error:
        yield {"mechanism": folder.name, "verdict": "error", "message": str(error)}


def judge_night(folder: Path) -> list[ChannelJudgement]:
    """Return the judged channels of a mechanism's [night], of logs that did not identify [-].  Raises InputError."""
    machine = read_machine(folder)
    night = machine.settings.night
    assert night is not None
    logs = [str(folder / log) for log in night.log]
    if night.blocks is not None:
        return judge_blocks(machine, read_of(machine, logs[0]), night.blocks)
    identification = identify(folder, logs, [str(folder / log) for log in night.hold_out])
    return (
        [row for row in identification.judged if row.log != "together"]
        if len(night.hold_out) == 1
        else identification.judged
    )
