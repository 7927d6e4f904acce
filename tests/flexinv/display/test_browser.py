"""Cards of results in a headless Chromium: nothing is cut or empty on wide and narrow pages, and nothing is asked for."""

from __future__ import annotations

import json
from pathlib import Path

import chromium
import numpy as np
import pytest
import uncut

import flexinv
from flexinv.display.drawing import convert_to_file, draw_svg

pytestmark = chromium.MARKS
page = pytest.fixture(scope="module")(chromium.lend_page)
SIZES = "Array.from(document.querySelectorAll('svg'), svg => [svg.clientWidth, svg.clientHeight])"
FITS = "document.documentElement.scrollWidth <= innerWidth + 1"


@pytest.fixture(scope="module")
def file(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page as a notebook has it: results of an arm that bends and of a robot, one below the other."""
    shown: list[str] = []
    for name in ("flex_two_link", "panda"):
        folder = root / "models" / name
        mechanism = flexinv.load_mechanism(folder)
        case = next(iter(flexinv.load_cases(folder, mechanism).values()))
        solution = flexinv.solve(mechanism, case.motion, step=5e-3)
        shown += [one._repr_html_() for one in (mechanism, case.motion, solution, solution.animate())]
        if mechanism.beams:
            shown.append(flexinv.natural_modes(mechanism, count=3)._repr_html_())
    head = '<!DOCTYPE html><html><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
    style = '<meta name="color-scheme" content="light dark"><link rel="icon" href="data:,"></head>'
    file = tmp_path_factory.mktemp("cards") / "page.html"
    file.write_text(f"{head}{style}<body>{''.join(shown)}</body></html>")
    return file


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("width", [1400, 500])
def test_no_table_and_no_picture_is_cut_or_empty(page: chromium.Browser, file: Path, width: int, dark: bool) -> None:
    page.open(f"file://{file}", width, dark=dark)
    assert page.evaluate(FITS)
    assert uncut.list_cut(page) == []
    sizes = page.evaluate(SIZES)
    assert len(sizes) == (4 + 1) + 3 + (5 + 1)  # the robot's solution has forces beside torques; three modes
    assert [one for one in sizes if one[0] < 150 or one[1] < 80] == []
    assert page.complaints() == []
    assert [address for address in page.requests() if not address.startswith(("file://", "data:"))] == []


def test_the_moving_picture_moves(page: chromium.Browser, file: Path) -> None:
    """By itself, by a way that is seen, and around again: the picture repeats."""
    page.open(f"file://{file}")
    place = "(c => { const b = c.getBoundingClientRect(); return [b.left, b.top]; })(document.querySelector('circle'))"
    before = page.evaluate(place)
    page.wait(f"JSON.stringify({place}) !== {json.dumps(json.dumps(before, separators=(',', ':')))}")
    assert page.evaluate(place) != before
    at = "(s => { s.pauseAnimations(); s.setCurrentTime(%r); })(document.querySelector('circle').closest('svg'))"
    places = []
    for time in (0.0, 0.2, 0.4):  # [s], within the first round
        page.evaluate(at % time)
        places.append(page.evaluate(place))
    assert np.ptp(np.array(places), axis=0).max() > 5  # [px]


@pytest.mark.parametrize("width", [1400, 500])
def test_a_drawing_in_the_column_of_a_table_has_its_size(page: chromium.Browser, tmp_path: Path, width: int) -> None:
    """The list of mechanisms shows it so: an image no wider than its column, whose width is that of what stands in it."""
    drawn = draw_svg([[(np.eye(3), False)]], "a triangle")
    sizes = []
    for name, svg in (("file", convert_to_file(drawn)), ("part", drawn)):
        (tmp_path / f"{name}.svg").write_text(svg)
        row = f'<tr><td><img src="{name}.svg"></td><td>{90 * "word "}</td></tr>'
        file = tmp_path / f"{name}.html"
        style = "<style>img { max-width: 100%; height: auto; }</style>"  # as the theme of the site has it
        file.write_text(f"<!DOCTYPE html>{style}<table>{row}</table>")
        page.open(f"file://{file}", width)
        sizes.append(page.evaluate("(b => [b.width, b.height])(document.images[0].getBoundingClientRect())"))
    assert min(sizes[0]) >= 30
    assert sizes[1] == [0, 0]  # without a size of its own it was not there at all
