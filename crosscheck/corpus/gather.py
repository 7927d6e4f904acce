"""Gather what a corpus is made of: run every engine, or take what earlier runs kept, and find the consensus of each case."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from crosscheck.corpus.authors import find_author
from crosscheck.corpus.consensus import CaseConsensus, EnginePanel, find_case_consensus
from crosscheck.corpus.notes import CorpusTable
from crosscheck.measures.record import Record, read_record
from crosscheck.run.runner import run
from crosscheck.run.work import Notify, Work
from crosscheck.verdicts.plan import Task
from crosscheck.verdicts.results import Results


def run_panel(work: Work, notes: CorpusTable, folder: Path, notify: Notify, command: str = "") -> EnginePanel:
    """Run the engines of a work into a folder of its own, and return them with their authors and results."""
    return make_panel(work, notes, run(work, folder, notify, command))


def make_panel(work: Work, notes: CorpusTable, results: Results) -> EnginePanel:
    """Return the engines of a work with their authors and the results of their run."""
    of_trees, of_loops = (
        {name: find_author(one, notes.engines, loops) for name, one in work.engines.items()} for loops in (False, True)
    )
    return EnginePanel(work.engines, of_trees, of_loops, results)


def find_all_consensus(work: Work, panel: EnginePanel, folder: Path) -> Iterator[CaseConsensus]:
    """Yield the consensus of every case that some engine came to an answer for [units of its series]."""
    for task in work.plan.tasks:
        records = read_records(panel.results, task, folder)
        if records:
            yield find_case_consensus(task, records, panel.judge_loops() if task.mechanism.closures else panel)


def read_records(results: Results, task: Task, folder: Path) -> dict[str, Record]:
    """Return the records of a case by engine [units of their series], as a run left them in a folder."""
    here = task.folder.name, task.case.name
    return {
        r.engine: read_record(folder / r.series) for r in results.runs if (r.mechanism, r.case) == here and r.series
    }
