"""Names of a mechanism: parts are looked up by them and results are given by them, so none stands twice."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import flexinv
from flexinv.errors import InputError
from flexinv.model.mechanism import (
    WORLD,
    Attachment,
    Body,
    Closure,
    Force,
    Inertia,
    Joint,
    Link,
    Mechanism,
    Placement,
    Spring,
)


def arm(*welds: str) -> Mechanism:
    """A hinge "h" about y that carries one weld after the other, 0.1 m apart along x, 1 kg on each."""
    hinge = Joint("h", "revolute", WORLD, "arm", axis=np.array([0.0, 1.0, 0.0]))
    links, joints, carrier = [Link("arm")], [hinge], "arm"
    for k, name in enumerate(welds):
        body = Body("b", Inertia(1.0, np.zeros(3), np.zeros((3, 3))))
        at = Placement(np.array([0.1, 0.0, 0.0]))
        links.append(Link(f"part {k}", (body,)))
        joints.append(Joint(name, "fixed", carrier, f"part {k}", at, actuated=False))
        carrier = f"part {k}"
    return Mechanism("arm", tuple(links), tuple(joints))


def test_three_welds_of_one_name_are_refused() -> None:
    """By hand 1 kg at 0.1, 0.2 and 0.3 m: -5.886 N m; joints that share a name would share a place."""
    torques = flexinv.joint_torques(arm("f", "f_2", "f_3"), np.zeros((1, 1)), np.zeros((1, 1)), np.zeros((1, 1)))
    assert float(np.ravel(torques)[0]) == pytest.approx(-9.81 * (0.1 + 0.2 + 0.3), rel=1e-12)  # rounding
    with pytest.raises(InputError, match="joints named twice: f; expected a name of its own for each"):
        arm("f", "f", "f")


TIE = Closure("tie", "spherical", Attachment(WORLD), Attachment("arm"))
SPRING = Spring("pull", Attachment(WORLD), Attachment("arm"), stiffness=1.0, rest=0.1)
PUSH = Force("push", Attachment("arm"), np.array([[0.0, 0.0, -1.0, 0.0, 0.0, 0.0]]))


@pytest.mark.parametrize(
    ("kind", "more"),
    [
        ("links", {"links": (Link("arm"), Link("arm"))}),
        ("closures", {"closures": (TIE, TIE)}),
        ("springs", {"springs": (SPRING, SPRING)}),
        ("forces", {"forces": (PUSH, PUSH)}),
    ],
)
def test_parts_of_one_kind_and_name_are_refused(kind: str, more: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=f"{kind} named twice: "):
        replace(arm(), **more)


def test_coordinates_of_one_name_are_refused() -> None:
    """A ball joint "b" has a coordinate b.qx, and so has a hinge of that name."""
    joints = Joint("b", "spherical", WORLD, "arm"), Joint("b.qx", "revolute", "arm", "hand")
    with pytest.raises(InputError, match=r"coordinates named twice: b\.qx; expected other names"):
        Mechanism("two", (Link("arm"), Link("hand")), joints)


def test_parts_of_two_kinds_may_share_a_name() -> None:
    mechanism = replace(arm("weld"), closures=(replace(TIE, name="h"),), forces=(replace(PUSH, name="h"),))
    for again in (copy.deepcopy(mechanism), pickle.loads(pickle.dumps(mechanism))):
        assert [one.name for one in again.closures] == ["h"]


def test_a_joint_of_no_known_kind_is_refused() -> None:
    with pytest.raises(InputError, match=r"kind = 'hinge': expected one of revolute"):
        Mechanism("arm", (Link("arm"),), (Joint("h", "hinge", WORLD, "arm"),))
