"""Curves, bars, figures and moving pictures: no peak is lost, seen on white and on dark, and one drawing for all of them."""

from __future__ import annotations

import pickle
import re
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

import flexinv
from flexinv.display import curves, drawing
from flexinv.display.animation import Animation
from flexinv.display.bars import draw_bars
from flexinv.display.curves import draw_curves, list_drawn_points, write_path

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def bent(root: Path) -> flexinv.Solution:
    arm = flexinv.load_mechanism(root / "models" / "flex_two_link")
    motion = flexinv.Motion.point_to_point({"joint1": 0.0, "joint2": 0.0}, {"joint1": 0.5, "joint2": 1.0}, duration=0.2)
    return flexinv.solve(arm, motion, step=2e-3, error=True)


@pytest.mark.parametrize("at", [0, 1, 4711, 99_998, 99_999])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_no_peak_is_left_out(at: int, sign: float) -> None:
    values = np.zeros(100_000)
    values[at] = sign
    kept = list_drawn_points(values)
    assert at in kept
    assert len(kept) <= 2 * curves.POINTS + 2
    assert (np.diff(kept) > 0).all()


def test_a_line_is_broken_where_numbers_are_missing() -> None:
    assert write_path(np.arange(5.0), np.array([0.0, 1.0, np.nan, 3.0, 4.0])) == "M0.0 0.0L1.0 1.0M3.0 3.0L4.0 4.0"


@pytest.mark.parametrize(
    "values", [np.full(7, np.nan), np.zeros(7), np.full(7, 1e300), np.array([-1e308, 1e308, 0, 0, 0, 0, 0])]
)
def test_curves_of_any_numbers_are_inside(values: np.ndarray) -> None:
    text = draw_curves([("a", np.linspace(0.0, 1.0, 7), values)], "N m", "a")
    ET.fromstring(text)
    assert "nan" not in text.replace("nan N m", "")
    numbers = [float(n) for d in re.findall(r'd="(M[^"]*)"', text) for n in re.findall(r"-?[0-9.]+", d)]
    assert all(0.0 <= n <= curves.CURVES_WIDTH for n in numbers)


def test_both_axes_say_their_numbers_and_units() -> None:
    text = draw_curves([("a", np.array([0.5, 2.0]), np.array([-3.0, 4.5]))], "N m", "torque")
    texts = [one.text for one in ET.fromstring(text).iter(f"{SVG}text")]
    assert texts[:5] == ["4.5", "-3", "[N m]", "0.5 s", "2 s"]


def find_luminance(colour: str) -> float:
    """Return the relative luminance of a colour (WCAG 2.2) [-]."""
    parts = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


@pytest.mark.parametrize("colour", [*curves.COLOURS, drawing.RIGID_COLOUR, drawing.BENDS_COLOUR, "#808080"])
@pytest.mark.parametrize("page", ["#ffffff", "#131416", "#111111"])
def test_lines_are_seen_on_white_and_on_dark_pages(colour: str, page: str) -> None:
    light, dark = sorted((find_luminance(colour), find_luminance(page)), reverse=True)
    assert (light + 0.05) / (dark + 0.05) >= 3.0  # WCAG 1.4.11


def test_bars_are_as_long_as_their_numbers() -> None:
    tree = ET.fromstring(draw_bars([("a <b>", 4.0), ("c", 1.0), ("d", float("nan"))], "%", "shares"))
    widths = [float(one.get("width", "")) for one in tree.iter(f"{SVG}rect")]
    assert widths[0] == pytest.approx(4 * widths[1], abs=0.3)  # printed to 0.1 px
    assert widths[2] == 0.0


def test_plot_draws_torques_with_bars_and_deflections(bent: flexinv.Solution) -> None:
    figure = bent.plot()
    efforts, deflections = figure.axes
    assert efforts.get_ylabel() == "torque [N m]"
    assert deflections.get_ylabel() == "deflection of the tip [m]"
    assert deflections.get_xlabel() == "time [s]"
    for k, line in enumerate(efforts.lines):
        assert (np.asarray(line.get_ydata()) == bent.torque[:, k]).all()
    assert len(efforts.collections) == 2  # error bars
    assert figure._repr_html_().startswith('<img alt="figure"')
    assert type(pickle.loads(pickle.dumps(figure))).__module__ == "matplotlib.figure"


def test_plot_of_a_rigid_robot_has_forces_beside_torques(root: Path) -> None:
    folder = root / "models" / "panda"
    robot = flexinv.load_mechanism(folder)
    case = next(iter(flexinv.load_cases(folder, robot).values()))
    labels = [axes.get_ylabel() for axes in flexinv.solve(robot, case.motion, step=1e-2).plot().axes]
    assert labels == ["torque [N m]", "force [N]"]


def test_plot_without_matplotlib_names_the_package(bent: flexinv.Solution, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("flexinv.display.figures.importlib.util.find_spec", lambda name: None)
    with pytest.raises(flexinv.InputError, match=r"plot\(\) needs matplotlib: write pip install 'flexinv\[plot\]'"):
        bent.plot()


def read_frames(picture: Animation) -> list[np.ndarray]:
    """Return the points (points, 2) [px] of every frame of the links that bend."""
    tree = ET.fromstring(picture.svg)
    moved = [one.get("values", "") for one in tree.iter(f"{SVG}animate") if one.get("attributeName") == "d"]
    return [np.array(re.findall(r"-?[0-9.]+", shape), dtype=float).reshape(-1, 2) for shape in moved[-1].split(";")]


def test_the_moving_picture_is_where_the_nodes_are(bent: flexinv.Solution) -> None:
    """First and last frame are the first and the last sample; one scale and one shift for all frames."""
    frames = read_frames(bent.animate())
    assert {len(frame) for frame in frames} == {len(frames[0])}  # browsers move points between shapes of as many
    parent = bent.mesh.parent
    bends = [n for n in range(bent.mesh.size) if bent.mesh.kind[n] == flexinv.model.joint_kinds.SECTION]
    scale = shift = None
    for k in (0, -1):
        x = np.concatenate([bent.nodes.x[k, [parent[n], n], :2] for n in bends]) * [1.0, -1.0]
        if scale is None:
            scale = np.ptp(frames[k][:, 0]) / np.ptp(x[:, 0])
            shift = frames[k][0] - scale * x[0]
        assert np.abs(frames[k] - scale * x - shift).max() <= 0.3  # printed to 0.1 px: scale, shift and point


def test_a_moving_picture_lasts_as_long_as_is_said_and_is_saved(bent: flexinv.Solution, tmp_path: Path) -> None:
    picture = bent.animate(4.0)
    assert picture.seconds == 4.0
    assert 'dur="4s"' in picture.svg
    assert "20 times slower than it happens" in repr(picture)
    assert "script" not in picture._repr_html_()
    ET.fromstring(picture._repr_html_())
    page = picture.save(tmp_path / "a.html").read_text()
    assert picture.svg in page
    ET.fromstring(page.removeprefix("<!DOCTYPE html>\n"))
    ET.fromstring(picture.save(tmp_path / "a.svg").read_text())
    with pytest.raises(flexinv.InputError, match=r"ends in \.svg or \.html"):
        picture.save(tmp_path / "a.mp4")
    for wrong in (0.0, -1.0, float("nan"), "slow"):
        with pytest.raises(flexinv.InputError, match="seconds"):
            bent.animate(wrong)  # type: ignore[arg-type]


def test_a_click_stops_the_moving_picture_and_the_next_one_plays_it(bent: flexinv.Solution) -> None:
    """All that moves ends by the same click, stays where it is, and begins again by the click on what is shown then."""
    tree = ET.fromstring(bent.animate().svg)
    names = {one.get("id"): one for one in tree.iter() if one.get("id")}
    moved = list(tree.iter(f"{SVG}animate"))
    assert {one.get("attributeName") for one in moved} == {"d", "cx"}
    assert {one.get("fill") for one in moved} == {"freeze"}
    ((begin, end),) = {(one.get("begin", ""), one.get("end", "")) for one in moved}
    stop, play = (
        re.fullmatch(pattern, text) for pattern, text in ((r"(\w+)\.click", end), (r"0s;(\w+)\.click", begin))
    )
    assert stop is not None
    assert play is not None
    shown = names[play[1]]
    assert shown.get("display") == "none"
    (sign,) = shown.iter(f"{SVG}set")
    assert (sign.get("begin"), sign.get("end")) == (end, begin.removeprefix("0s;"))
    sizes = [(one.get("width"), one.get("height")) for one in (names[stop[1]], *shown.iter(f"{SVG}rect"))]
    assert sizes[0] == sizes[1] == tuple(tree.get("viewBox", "").split()[2:])
    other = ET.fromstring(bent.animate(4.0).svg)  # beside it on a page
    assert not names.keys() & {one.get("id") for one in other.iter()}


def test_whoever_asked_for_less_motion_sees_the_drawing(bent: flexinv.Solution) -> None:
    tree = ET.fromstring(bent.animate().svg)
    (style,) = (one.text or "" for one in tree.iter(f"{SVG}style"))
    always, calm = style.split("@media (prefers-reduced-motion:reduce)")
    assert always == ".flexinv-still{display:none}"
    assert calm.startswith("{.flexinv-still{display:inline}.flexinv-moving{display:none}")
    moving = [one for one in tree.iter() if one.get("class") == "flexinv-moving"]
    assert {id(x) for one in moving for x in one.iter(f"{SVG}animate")} == {id(x) for x in tree.iter(f"{SVG}animate")}
    (still,) = (one for one in tree.iter() if one.get("class") == "flexinv-still")
    assert len(still) == drawing.FRAMES


def test_a_solution_of_one_instant_does_not_move(root: Path) -> None:
    still = flexinv.statics(flexinv.load_mechanism(root / "models" / "flex_two_link"), {})
    with pytest.raises(flexinv.InputError, match="one sample"):
        still.animate()
    assert "cannot be described" not in repr(still)
    ET.fromstring(still._repr_html_())
