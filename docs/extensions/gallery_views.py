"""What the gallery of examples needs: the project's models, numbers of the pictures, and views in space beside them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import plotly
import plotly.graph_objects as go
from matplotlib import pyplot
from sphinx_gallery.scrapers import matplotlib_scraper

from flexinv.display.curve_table import render_curves
from flexinv.display.figures import list_curves

ROOT = Path(__file__).resolve().parent.parent.parent
SCRIPT = "plotly.min.js"
# No button of a view leads to another machine: the same as in the reports (crosscheck/report/assets/plots.js).
QUIET = {"showSendToCloud": False, "plotlyServerURL": "", "displaylogo": False}
# A browser may read what a closed view shows, also where it is called lazy: the address is given when it is opened.
OPENED = "for (const f of this.querySelectorAll('iframe:not([src])')) f.src = f.dataset.view"


def in_the_project(gallery: dict[str, Any], file: str, when: str) -> None:
    """Let an example find the project's models while it runs, as it does in the project's folder, where a reader runs it."""
    models = Path(gallery["src_dir"]) / "gallery" / "models"
    models.unlink(missing_ok=True)
    if when == "before":
        models.symlink_to(ROOT / "models")


def scrape_figures(block: Any, names: dict[str, Any], gallery: dict[str, Any]) -> str:
    """Save the figures of a block as pictures, the numbers of their curves as CSV, and return the text that shows both."""
    tables = [render_curves(list_curves(pyplot.figure(number))) for number in pyplot.get_fignums()]
    text: str = matplotlib_scraper(block, names, gallery)
    folder = Path(gallery["src_dir"]) / "_static" / "views"
    for table in filter(None, tables):
        count = names["_tables"] = names.get("_tables", 0) + 1
        folder.mkdir(parents=True, exist_ok=True)
        file = f"{Path(names['src_file']).stem}_{count}.csv"
        (folder / file).write_text(table, encoding="utf-8")
        text += f'\n.. raw:: html\n\n    <p><a href="../_static/views/{file}" download>Numbers of these curves as CSV</a></p>\n'
    return text


def scrape(block: Any, names: dict[str, Any], gallery: dict[str, Any]) -> str:
    """Write the plotly figures that a block has made as pages, and return the text that shows them when they are opened.

    All pages share one script, which lies beside them and is read when the first of them is opened.
    """
    shown = names.setdefault("_shown", set())
    figures = {name: value for name, value in names["example_globals"].items() if isinstance(value, go.Figure)}
    figures = dict(sorted(figures.items(), key=lambda item: item[0].startswith("_")))  # an example's own names first
    folder = Path(gallery["src_dir"]) / "_static" / "views"
    text = ""
    for name, figure in figures.items():
        if id(figure) in shown:
            continue
        shown.add(id(figure))
        folder.mkdir(parents=True, exist_ok=True)
        script = folder / SCRIPT
        if not script.exists():
            script.write_text(plotly.offline.get_plotlyjs(), encoding="utf-8")
        page = f"{Path(names['src_file']).stem}_{name}.html"
        figure.write_html(folder / page, include_plotlyjs=SCRIPT, auto_play=False, config=QUIET)
        text += (
            "\n.. raw:: html\n\n"
            f'    <details class="view" ontoggle="{OPENED}"><summary>Open the view in space</summary>'
            f'<iframe data-view="../_static/views/{page}" title="A view that turns with the mouse" width="100%" '
            'height="520"></iframe></details>\n'
        )
    return text
