"""Tables of studies as their functions give them: what is in them, key by key, and what may stand beside the rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NotRequired, TypedDict

Column = tuple[str, str, str]  # key, title, unit
# A line of a table by keys of its columns.  Every study has columns of its own, those of others among them, so that nothing
# but the column says what a value is.
Line = Mapping[str, Any]


class StudyPlot(TypedDict):
    """Curves of a table: keys of the columns along x and y, the one that groups rows into curves, logarithmic axes."""

    x: str
    y: str
    group: str
    log: bool


class Curve(TypedDict):
    """A curve by its points [units of the axes]."""

    x: Sequence[float]
    y: Sequence[float]


class StudyFigure(TypedDict):
    """A figure beside a table: title, words of the axes, curves by name.

    table : name of the CSV file with its numbers, where the study has written more of them than are drawn
    """

    title: str
    x: str
    y: str
    curves: Mapping[str, Curve]
    table: NotRequired[str]


class SideTable(TypedDict):
    """A table beside the one that is judged.

    leads : it stands before that one, and in summary.md, as what was asked for; summarised : it stands in summary.md, too
    """

    title: str
    columns: Sequence[Column]
    rows: Sequence[Line]
    leads: NotRequired[bool]
    summarised: NotRequired[bool]


class StudyTable(TypedDict, total=False):
    """Answer of a study's function: a table, or a status ("skipped") with a message that says why there is none.

    heading : what stands over the table that is judged, where others lead
    """

    text: str
    heading: str
    columns: Sequence[Column]
    rows: Sequence[Line]
    plot: StudyPlot
    figures: Sequence[StudyFigure]
    tables: Sequence[SideTable]
    status: str
    message: str
