"""Tables that a report carries beside the matrix: each made by one function, in a child process of its own.

A study's function returns a dict: ``text``, ``columns`` [(key, title, unit)], ``rows`` [{key: value, "verdict": ...}]
and perhaps ``plot`` {"x": key, "y": key, "group": key, "log": bool}: one curve for every value of the group's column;
``figures`` and ``tables`` beside the one that is judged (``crosscheck.verdicts.results.StudyRow`` says how they look).
Where it does not apply it returns {"status": "skipped", "message": why}.
"""

from __future__ import annotations

from crosscheck.run.work import Study

__all__ = ["STUDIES", "Study"]

STUDIES: dict[str, Study] = {
    s.name: s
    for s in (
        Study("robots", "Every robot of example-robot-data", "crosscheck.studies.robots"),
        Study("incremental", "The paper's incremental mode", "crosscheck.studies.incremental"),
        Study("feedforward", "Feed-forward replayed in other engines", "crosscheck.studies.feedforward", asks=True),
        Study("identifications", "Logs of machines, identified and judged", "crosscheck.studies.identifications"),
        Study("ladder", "Which rungs of the ladder every engine holds", "crosscheck.conform.study", asks=True),
        Study("switching", "Phases of mechanisms that open and close", "crosscheck.studies.switching"),
    )
}
