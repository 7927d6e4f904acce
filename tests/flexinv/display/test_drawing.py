"""The small drawing of a mechanism: true to scale, in the plane or in space, harmless as text."""

from __future__ import annotations

import re
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from flexinv.display import drawing

ROD = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0]])  # [m]
MAST = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.5]])  # [m]


def lines(svg: str) -> list[np.ndarray]:
    """Return the drawn lines, (points, 2) [px] each."""
    paths = [one.get("d", "") for one in ET.fromstring(svg).iter("{http://www.w3.org/2000/svg}path")]
    return [np.array(re.findall(r"-?[0-9.]+", path), dtype=float).reshape(-1, 2) for path in paths]


def test_lengths_keep_their_ratio_up_is_up_and_all_is_inside() -> None:
    rod, mast = lines(drawing.draw_svg([[(ROD, False), (MAST, True)]], "an L"))
    # numbers are printed to 0.1 px: a length of two of them is off by 0.15 px at most
    assert np.ptp(rod[:, 0]) == pytest.approx(2 * np.ptp(mast[:, 1]), abs=0.3)
    assert mast[1, 1] < mast[0, 1]  # pixels count downwards
    for line in (rod, mast):
        assert (line >= 0).all()
        assert (line <= [drawing.WIDTH, drawing.HEIGHT]).all()


def test_later_instants_are_darker_and_links_that_bend_have_their_own_colour() -> None:
    text = drawing.draw_svg([[(ROD, False)], [(MAST, True)]], "two")
    shades = [float(shade) for shade in re.findall(r'opacity="([0-9.]+)"', text)]
    assert shades == [drawing.FAINTEST, 1.0]
    assert re.findall(r'stroke="(#\w+)"', text) == [drawing.RIGID_COLOUR, drawing.BENDS_COLOUR]


def test_a_mechanism_in_space_is_seen_from_the_side_and_from_above() -> None:
    x = np.eye(3)
    assert drawing.find_motion_plane(x * [1.0, 1.0, 0.0]) == (0, 1)
    assert drawing.find_motion_plane(x) is None
    seen = drawing.convert_to_view(x, None)
    assert np.linalg.norm(seen[2]) == pytest.approx(
        np.cos(drawing.ELEVATION), rel=1e-12
    )  # an upright rod, foreshortened
    assert seen[2, 1] > 0
    assert seen[2, 0] == pytest.approx(0.0, abs=1e-15)  # the sum of three products of numbers below one


def test_one_point_alone_is_drawn_and_its_name_is_only_text() -> None:
    text = drawing.draw_svg([[(np.zeros((1, 3)), False)]], '"><script>')
    assert "<script" not in text
    assert lines(text)[0] == pytest.approx(np.array([[drawing.WIDTH / 2, drawing.HEIGHT / 2]]))


@pytest.mark.parametrize(("count", "expected"), [(1, [0]), (2, [0, 1]), (101, [0, 20, 40, 60, 80, 100])])
def test_the_instants_begin_and_end_with_the_motion(count: int, expected: list[int]) -> None:
    assert drawing.list_drawn_samples(count) == expected
