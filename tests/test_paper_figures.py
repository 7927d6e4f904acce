"""The script that draws the figures of the paper anew says what the paper says, and writes the numbers of every curve."""

from __future__ import annotations

import csv
import importlib
from pathlib import Path

import pytest

from flexinv.display.curve_table import render_curves
from flexinv.display.figures import list_curves

pytest.importorskip("matplotlib")
pytest.importorskip("exudyn")  # of the figures beside them, in the same folder


def test_figures_show_what_the_paper_states(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(root / "docs" / "figures"))
    paper = importlib.import_module("paper")
    text = (root / "docs" / "reproduce.md").read_text()
    drawn = {number: paper.FIGURES[number]() for number in (6, 9, 10)}
    assert "period after the motion 0.0998 s" in drawn[6][1]
    for number, words in ((6, "1.0145"), (6, "0.5895"), (10, "0.3640"), (10, "0.1420")):
        assert words in drawn[number][1]
        assert words in text  # of the page, which says what came out
    for number, (figure, _) in drawn.items():
        head = next(csv.reader(render_curves(list_curves(figure)).splitlines()))
        kept = next(csv.reader((root / "docs" / "figures" / f"paper_{number}.csv").read_text().splitlines()))
        assert head == kept
        assert len(head) > len(figure.axes[0].lines)
    assert set(paper.FIGURES) == {
        int(file.stem.removeprefix("paper_")) for file in (root / "docs" / "figures").glob("paper_*.csv")
    }
