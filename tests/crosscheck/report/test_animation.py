"""The moving picture: where it draws the links is where the records say they are."""

from __future__ import annotations

import base64
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from crosscheck.measures.record import Record, vector_series
from crosscheck.report import animation
from crosscheck.verdicts.plan import discover, list_skeleton_links

TIME = np.linspace(0.0, 1.0, 401)


def decode(text: str, *shape: int) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), dtype="<f4").reshape(shape)


def path(*start: float) -> np.ndarray:
    return np.array(start) + np.outer(np.sin(TIME), [1.0, 2.0, 0.0])


PARTS = (
    {"link": "upper", "parent": "world", "bends": True, "at": [0.5, 0.0, 0.0]},
    {"link": "lower", "parent": "upper", "bends": False, "at": None},
)
TIPS = vector_series("tip/upper", "m", path(1.0, 0.0, 0.0)) | vector_series("tip/lower", "m", path(2.0, 0.0, 0.0))
NODES = (
    vector_series("shape/upper/0.0000", "m", path(0.0, 0.0, 0.0))
    | vector_series("shape/upper/0.5000", "m", path(0.5, 0.1, 0.0))
    | vector_series("shape/lower/origin", "m", path(1.0, 0.0, 0.0))
)
MAIN = Record("flexinv", time=TIME, series=TIPS | NODES)


def test_links_run_from_their_joint_through_their_nodes_to_their_tip() -> None:
    data = animation.build_animation(PARTS, {"flexinv": MAIN})
    assert data is not None
    assert [(p["name"], p["points"], p["parent"]) for p in data["links"]] == [("upper", 3, -1), ("lower", 2, 0)]
    base = decode(data["base"], animation.FRAMES, 5, 3)
    np.testing.assert_allclose(base[0, :, 0], [0.0, 0.5, 1.0, 1.0, 2.0])
    np.testing.assert_allclose(base[-1, 2], path(1.0, 0.0, 0.0)[-1], rtol=1e-6)
    np.testing.assert_allclose(decode(data["time"], animation.FRAMES)[[0, -1]], [0.0, 1.0])
    assert data["tips"] == {}


def test_a_link_without_length_is_where_the_next_one_begins() -> None:
    """Files of robots give joints and no tips: a line runs from joint to joint, and no link is a dot alone."""
    at_joints = {f"tip/{name}": path(place, 0.0, 0.0) for name, place in (("upper", 0.0), ("lower", 1.0))}
    tips = {k: s for stem, values in at_joints.items() for k, s in vector_series(stem, "m", values).items()}
    nodes = {k: s for k, s in NODES.items() if "0.5000" not in k}
    data = animation.build_animation(PARTS, {"flexinv": Record("flexinv", time=TIME, series=tips | nodes)})
    assert data is not None
    assert [p["points"] for p in data["links"]] == [2, 3]
    np.testing.assert_allclose(decode(data["base"], animation.FRAMES, 5, 3)[0, :, 0], [0.0, 0.0, 0.0, 1.0, 1.0])


def test_another_engine_is_known_by_its_tips_and_by_how_far_they_are_apart() -> None:
    moved = {n: replace(s, values=s.values + 1e-3 * (n == "tip/lower/z")) for n, s in TIPS.items() if "lower" in n}
    data = animation.build_animation(PARTS, {"flexinv": MAIN, "other": Record("other", time=TIME, series=moved)})
    assert data is not None
    assert data["known"]["other"] == [False, True]
    assert data["apart"]["other"] == pytest.approx(1e-3)
    tips = decode(data["tips"]["other"], animation.FRAMES, 2, 3)
    np.testing.assert_allclose(tips[:, 1, 2], 1e-3, rtol=1e-6)


def test_without_flexinv_the_tips_make_the_picture_and_without_tips_there_is_none() -> None:
    data = animation.build_animation(PARTS, {"other": Record("other", time=TIME, series=TIPS)})
    assert data is not None
    base = decode(data["base"], animation.FRAMES, 4, 3)
    np.testing.assert_allclose(base[0], [[0.5, 0, 0], [1, 0, 0], [1, 0, 0], [2, 0, 0]])
    assert animation.build_animation(PARTS, {"none": Record("none", time=TIME)}) is None
    assert animation.build_animation((), {"flexinv": MAIN}) is None


def test_large_mechanisms_get_fewer_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(animation, "MOST", 12 * 7 * 40)  # forty frames of five points and two tips
    data = animation.build_animation(PARTS, {"flexinv": MAIN})
    assert data is not None
    assert decode(data["time"], -1).size == 40


def test_a_mechanism_says_what_its_picture_connects(root: Path) -> None:
    task, *_ = discover(root / "models", ["flex_two_link"]).tasks
    parts = list(list_skeleton_links(task.mechanism))
    assert [(p["link"], p["parent"], p["bends"], p["at"]) for p in parts] == [
        ("link1", "world", True, [0.0, 0.0, 0.0]),
        ("link2", "link1", True, None),
    ]
