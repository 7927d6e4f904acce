"""Figures by matplotlib, which is loaded when one is drawn: panels of curves over time with bands for their error bars."""

from __future__ import annotations

import base64
import importlib.util
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from flexinv.display.curve_table import DrawnCurve
from flexinv.errors import InputError
from flexinv.typing import Array

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Figure
    from numpy.typing import ArrayLike

PANEL_SIZE = (8.0, 4.5)  # [inch] of one panel
NEXT_HEIGHT = 2.8  # [inch] of each further one
MOST_LEGEND_COLUMNS = 6  # of a legend
LEGEND_LENGTH = 100  # characters side by side


@dataclass(frozen=True)
class Band:
    """A curve by name, values (samples,) [any unit], and its error bar of the same size, or None."""

    name: str
    values: Array
    error: Array | None = None


@dataclass(frozen=True)
class Panel:
    """Curves over time (samples,) [s] on one axis, whose label names quantity and unit."""

    label: str
    time: Array
    bands: Sequence[Band]


def check_matplotlib(caller: str) -> None:
    """Raise InputError, as the ``caller`` words it, where matplotlib is not installed [-]."""
    if importlib.util.find_spec("matplotlib") is None:
        raise InputError(f"{caller} needs matplotlib: write pip install 'flexinv[plot]'")


def draw_panels(panels: Sequence[Panel], title: str) -> Figure:
    """Return a matplotlib Figure of panels above each other, with one time axis [s]."""
    figure: Figure = _make_figure_class()(
        figsize=(PANEL_SIZE[0], PANEL_SIZE[1] + NEXT_HEIGHT * (len(panels) - 1)), layout="constrained"
    )
    first = None
    for k, panel in enumerate(panels):
        axes = figure.add_subplot(len(panels), 1, k + 1, sharex=first)
        first = first or axes
        for band in panel.bands:
            (line,) = axes.plot(panel.time, band.values, label=band.name, linewidth=1.2)
            if band.error is not None:
                low = band.values - band.error
                axes.fill_between(panel.time, low, band.values + band.error, color=line.get_color(), alpha=0.25)
        axes.set(ylabel=panel.label, xlabel="time [s]" if k == len(panels) - 1 else "")
        axes.grid(alpha=0.3)
        if panel.bands:
            widest = max(len(band.name) for band in panel.bands)
            columns = int(np.clip(LEGEND_LENGTH // (widest + 6), 1, min(MOST_LEGEND_COLUMNS, len(panel.bands))))
            axes.legend(
                ncols=columns,
                fontsize="small",
                frameon=False,
                loc="lower left",
                bbox_to_anchor=(0.0, 1.0),
                borderaxespad=0.0,
            )
    figure.suptitle(title)
    return figure


def list_curves(figure: Figure) -> Iterator[DrawnCurve]:
    """Yield the curves and the stairs of a figure, named by panel, curve and axis [units of the axes].

    A curve is called by its gid, or by its label; what spans a panel at one place is a mark, and no curve.  Panels in space
    are left out.
    """
    for panel in (one for one in figure.axes if one.name != "3d"):
        drawn = [line for line in panel.lines if line.get_transform() == panel.transData]
        for k, line in enumerate(drawn, 1):
            yield _make_curve(panel, line, k, line.get_xdata(), line.get_ydata())
        for k, steps in enumerate((one for one in panel.patches if hasattr(one, "get_data")), len(drawn) + 1):
            heights, edges, _ = steps.get_data()
            yield _make_curve(panel, steps, k, edges, heights)


def _make_curve(panel: Axes, drawn: Artist, number: int, places: ArrayLike, values: ArrayLike) -> DrawnCurve:
    label = str(drawn.get_gid() or drawn.get_label())
    name = f"curve {number}" if label.startswith("_") else label
    title = f"{panel.get_title()}: " if panel.get_title() else ""
    return DrawnCurve(panel.get_xlabel(), f"{title}{name} {panel.get_ylabel()}", np.asarray(places), np.asarray(values))


@cache
def _make_figure_class() -> type[Figure]:
    """The class of figures that a notebook shows, whether or not it has loaded pyplot."""
    from matplotlib.figure import Figure

    class ShownFigure(Figure):
        def _repr_html_(self) -> str:
            file = io.BytesIO()
            self.savefig(file, format="png", dpi=100)
            data = base64.b64encode(file.getvalue()).decode("ascii")
            return f'<img alt="figure" style="max-width:100%" src="data:image/png;base64,{data}"/>'

        def __reduce__(self) -> tuple[object, ...]:  # a copy or a pickle is a Figure of matplotlib's own class
            return Figure.__new__, (Figure,), self.__getstate__()

    return ShownFigure
