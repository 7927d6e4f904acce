"""Cards of results in a headless Chromium: nothing is cut or empty on wide and narrow pages, and nothing is asked for."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import chromium
import numpy as np
import pytest

import flexinv
from flexinv.display.drawing import convert_to_file, draw_svg

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(chromium.find() is None, reason="no Chromium or Chrome on this machine"),
]
# A picture is empty where it has no size, and cut where it or what it draws reaches out of its frame.
PICTURES = """Array.from(document.querySelectorAll('svg'), svg => {
  const frame = svg.getBoundingClientRect();
  const shown = Array.from(svg.querySelectorAll('path, text, rect')).filter(one => one.getClientRects().length);
  const parts = shown.map(one => one.getBoundingClientRect());
  const cut = parts.some(p => p.left < frame.left - 2 || p.right > frame.right + 2 || p.top < frame.top - 2
    || p.bottom > frame.bottom + 2);
  return [frame.width, frame.height, frame.right <= innerWidth + 1, cut];
})"""
FITS = "document.documentElement.scrollWidth <= innerWidth + 1"
TABLES = """Array.from(document.querySelectorAll('table'), table =>
  table.scrollWidth <= table.parentElement.clientWidth + 1 || getComputedStyle(table.parentElement).overflowX === 'auto')"""


@pytest.fixture(scope="module")
def page() -> Iterator[chromium.Browser]:
    program = chromium.find()
    assert program is not None
    with chromium.browser(program) as browser:
        yield browser


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
    pictures = page.evaluate(PICTURES)
    assert len(pictures) == (4 + 1) + 3 + (5 + 1)  # the robot's solution has forces beside torques; three modes
    for wide, high, inside, cut in pictures:
        assert wide >= 150
        assert high >= 80
        assert inside
        assert not cut
    assert all(page.evaluate(TABLES))
    assert page.complaints() == []
    assert [address for address in page.requests() if not address.startswith(("file://", "data:"))] == []


def test_the_moving_picture_moves(page: chromium.Browser, file: Path) -> None:
    page.open(f"file://{file}")
    where = "document.querySelector('circle').cx.animVal.value"
    before = page.evaluate(where)
    page.wait(f"{where} !== {before}")


def test_a_picture_that_is_cut_is_found(page: chromium.Browser, tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.html"
    wrong.write_text('<svg viewBox="0 0 100 100" width="200"><path d="M50 50L150 50" stroke="red"/></svg>')
    page.open(f"file://{wrong}")
    assert page.evaluate(PICTURES)[0][3]


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
