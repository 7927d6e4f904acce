"""Round trips: what is exported to URDF and to MJCF is the mechanism that it was, for every model that the format can say."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import rigid_trees as trees

from crosscheck.engines.shared.export_files import NotExported
from crosscheck.engines.shared.urdf_text import list_unwritten_parts, write_urdf
from crosscheck.equivalence.compare import compare
from crosscheck.equivalence.sources import describe
from crosscheck.lifting.description import Description
from flexinv.files.from_urdf import from_urdf
from flexinv.model.mechanism import WORLD, Body, Inertia, Joint, Link, Mechanism, Placement

MODELS = Path(__file__).resolve().parents[3] / "models"
NAMES = sorted(path.parent.name for path in MODELS.glob("*/mechanism.toml"))
SLOW = ("talos",)
MESHED = ("meshed_arm", "slider_crank_meshed", "four_bar_bracket", "ur5_meshed_forearm")
# What a format has no word for, by model: a word of the reason that the export gives.
CANNOT = {
    "urdf": {"screw_lift": "helical"} | dict.fromkeys(MESHED, "meshes"),
    "mjcf": {"screw_lift": "ratio"} | dict.fromkeys(MESHED, "meshes"),
}


def described(name: str) -> Description:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return describe(MODELS / name)


def sayable(mechanism: Mechanism, form: str) -> Mechanism:
    """The mechanism without what the format has no word for, as its own head says."""
    lost = (
        [words for words in list_unwritten_parts(mechanism) if not words.startswith("gravity")]
        if form == "urdf"
        else []
    )
    closures = tuple(c for c in mechanism.closures if not any(w.startswith(f"closure {c.name} ") for w in lost))
    joints = tuple(
        replace(j, stiffness=0.0, rest=0.0) if f"spring of joint {j.name}" in lost else j for j in mechanism.joints
    )
    return replace(mechanism, joints=joints, closures=closures)


def written(mechanism: Mechanism, form: str, folder: Path) -> Path:
    if form == "urdf":
        text, name = write_urdf(mechanism), "model.urdf"
    else:
        from crosscheck.engines.mujoco.export import build_mjcf

        text, name = build_mjcf(mechanism)[1], "model.xml"
    (folder / name).write_text(text)
    return folder / name


def test_a_body_in_place_of_the_urdfs_own_is_exported(tmp_path: Path) -> None:
    """The URDF's inertial of that link is gone from the text: it would count twice."""
    heavy = trees.reweighed(from_urdf(trees.urdf(tmp_path)))
    again = from_urdf(written(heavy, "urdf", tmp_path))
    masses = [sum(body.inertia.mass for link in m.links for body in link.bodies) for m in (heavy, again)]
    assert masses == pytest.approx([11.5, 11.5], rel=1e-15)  # 4 + 1.5 + 1 of the URDF, 2.5 twice


@pytest.mark.parametrize("form", ["urdf", "mjcf"])
@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] if n in SLOW else []) for n in NAMES])
def test_what_is_exported_is_what_it_was(name: str, form: str, tmp_path: Path) -> None:
    if form == "mjcf":
        pytest.importorskip("mujoco")
    source = described(name)
    if not source.mechanism.is_rigid or name in CANNOT[form]:
        with pytest.raises(NotExported, match=CANNOT[form].get(name, "beam")):
            written(source.mechanism, form, tmp_path)
        return
    file = written(source.mechanism, form, tmp_path)
    comparison = compare(replace(source, mechanism=sayable(source.mechanism, form), features=()), file)
    assert [d.words for d in comparison.differences] == []
    assert comparison.equal


@pytest.mark.parametrize(("name", "feature"), [("kuka_kr300", "spring"), ("elastic_drives", "elastic-drive")])
def test_what_no_format_has_a_word_for_is_named(name: str, feature: str, tmp_path: Path) -> None:
    """A spring between two points and an elastic drive whose link is moved stand in our own formats alone."""
    source = described(name)
    file = written(source.mechanism, "urdf", tmp_path)
    comparison = compare(replace(source, mechanism=sayable(source.mechanism, "urdf")), file)
    assert [d.cause for d in comparison.differences] == [f"{feature} that only A has"]
    assert compare(source, source).equal


def edited(name: str, form: str, folder: Path, change: Callable[[str], str]) -> list[str]:
    """What is named where an exported text is changed."""
    source = described(name)
    file = written(source.mechanism, form, folder)
    text = file.read_text()
    assert change(text) != text
    file.write_text(change(text))
    comparison = compare(replace(source, mechanism=sayable(source.mechanism, form), features=()), file)
    return [d.cause for d in comparison.differences]


LOST = {
    "double_pendulum": ('<mass value="0.5"', '<mass value="0.6"', "mass"),
    "kuka_kr300": ('damping="', 'damping="1', "damping"),
    "panda": ('lower="-2.8973"', 'lower="-2"', "lower limit"),
    "elastic_drives": ('rotor_inertia value="', 'rotor_inertia value="1', "rotor inertia"),
}


@pytest.mark.parametrize("name", LOST)
def test_an_export_that_lost_something_is_not_what_it_was(name: str, tmp_path: Path) -> None:
    before, after, cause = LOST[name]
    assert edited(name, "urdf", tmp_path, lambda text: text.replace(before, after, 1)) == [cause]


def test_closures_are_compared_where_they_are(tmp_path: Path) -> None:
    """A hinge is two points that MuJoCo holds; moved, bent or lost it is named."""
    pytest.importorskip("mujoco")
    moved = partial(re.sub, '("hinge6/first." pos=)"1.0 ', r'\1"1.125 ')
    assert edited("bricard", "mjcf", tmp_path, moved) == ["point of closure"]
    bent = partial(re.sub, '("hinge6/first0" pos=)"1.0 ', r'\1"1.125 ')  # two points that no hinge can hold
    assert "loop that only A closes" in edited("bricard", "mjcf", tmp_path, bent)
    lost = partial(re.sub, "<connect.*/>", "")
    assert edited("bricard", "mjcf", tmp_path, lost) == ["loop that only A closes"]


def test_a_centre_of_mass_that_is_rounding_of_zero_can_be_exported(tmp_path: Path) -> None:
    """MuJoCo refuses capsules that are as short as rounding: they show nothing, and are left out."""
    pytest.importorskip("mujoco")
    body = Inertia(1.0, np.array([-3e-18, -2e-17, 7e-18]), np.eye(3) / 100)
    joint = Joint("swing", "revolute", WORLD, "rod", Placement(), axis=np.array([0.0, 1.0, 0.0]))
    mechanism = Mechanism("rod", (Link("rod", (Body("rod", body),)),), (joint,))
    assert compare(mechanism, written(mechanism, "mjcf", tmp_path)).judged.causes == ()
