"""Records of a mechanism are valid from their first moment on, whoever makes them, and take what NumPy can read as numbers."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest

import flexinv
from flexinv.errors import InputError
from flexinv.model import mechanism as parts
from flexinv.model.attachments import GasLaw, TableLaw

NAN, INF = float("nan"), float("inf")
Made = Callable[..., Any]
M: Any = parts  # what is called with arguments that no type allows
GAS: Any = GasLaw
TABLE: Any = TableLaw
LOAD: Any = flexinv.Load
BODY = parts.Body("bob", parts.Inertia(1.0))
ONE = [1.0]


def joint(**given: Any) -> Any:
    return M.Joint(**{"name": "j", "kind": "revolute", "parent": "world", "child": "bob", **given})


def arm(**given: Any) -> Any:
    return M.Mechanism(**{"name": "arm", "links": (parts.Link("bob", (BODY,)),), "joints": (joint(),), **given})


def section(**given: Any) -> Any:
    whole = {"stations": [0.0], "stiffness": [[1.0] * 6], "mass_per_length": [1.0], "rotary_inertia": [[0.0] * 3]}
    return M.Section(**{**whole, **given})


END = parts.Attachment("world")
WRONG: list[tuple[Callable[[], Any], str]] = [
    (lambda: M.Inertia(-1.0), "Inertia: mass = -1: expected a mass, 0 or more [kg]; write 1"),
    (lambda: M.Inertia(NAN), "Inertia: mass = nan: expected a finite number [kg]"),
    (lambda: M.Inertia("1"), "Inertia: mass = '1': expected a finite number [kg]; write 1"),
    (lambda: M.Inertia(True), "Inertia: mass = True: expected a finite number [kg]"),
    (lambda: M.Inertia(np.datetime64(3, "s")), "Inertia: mass = "),
    (lambda: M.Inertia(1.0, [0, 0]), "Inertia: com = [0, 0]: expected finite numbers (3,) [m]"),
    (lambda: M.Inertia(1.0, [0, 0, NAN]), "Inertia: com[2] = nan: expected a finite number [m]"),
    (lambda: M.Inertia(1.0, [0, 0, 1j]), "Inertia: com: expected numbers, got complex ones"),
    (lambda: M.Inertia(1.0, np.ma.masked_array(3 * ONE, [0, 1, 0])), "Inertia: com: expected numbers, got a masked array"),
    (lambda: M.Inertia(1.0, None, np.eye(3)), "Inertia: com: expected numbers, got None"),
    (lambda: M.Inertia(1.0, tensor=np.diag([1, 1, 3])), "one principal moment exceeds the sum of the others"),
    (lambda: M.Inertia(1.0, tensor=-np.eye(3)), "a principal moment is negative"),
    (lambda: M.Inertia(1.0, tensor=np.triu(np.ones((3, 3)))), "it is not symmetric"),
    (lambda: M.Inertia.build_unchecked(NAN), "Inertia: mass = nan: expected a finite number [kg]"),
    (lambda: M.Placement([0, 0, 0], 2 * np.eye(3)), "of which R R^T is off the identity by 3"),
    (lambda: M.Placement(rotation=-np.eye(3)), "of which det R = -1, a reflection"),
    (lambda: M.Attachment(3), "Attachment: link = 3: expected a text"),
    (lambda: M.Attachment("a", station=1.5), "Attachment: station = 1.5: expected a finite number from 0 to 1 [-]"),
    (lambda: M.Body("b", 1.0), "Body 'b': inertia = 1.0: expected a Inertia"),
    (lambda: M.Body(None, BODY.inertia), "Body: name = None: expected a text"),
    (lambda: M.Link("a", (1,)), "Link 'a': bodies[0] = 1: expected a Body"),
    (lambda: M.Link("a", BODY), "Link 'a': bodies = a Body: expected a list or a tuple"),
    (lambda: M.Link("a", (replace(BODY, station=0.5),)), "Link 'a': body 'bob' has station 0.5, expected no station"),
    (lambda: section(stiffness=[[1.0] * 5]), "Section: stiffness = "),
    (lambda: section(mass_per_length=[-1.0]), "numbers (n,) [kg/m], 0 or more"),
    (lambda: section(mass_per_length=[1.0, 2.0]), "Section: mass_per_length has 2 rows: expected 1, one for each station"),
    (lambda: section(stations=[2.0]), "expected one or more fractions of the length"),
    (lambda: M.Beam(0.0, section()), "Beam: length = 0.0: expected a finite number above 0 [m]"),
    (lambda: M.Beam(1.0, section(), elements=1.5), "Beam: elements = 1.5: expected a whole number: 1 or more"),
    (lambda: joint(kind="hinge"), "Joint 'j': kind = 'hinge': expected one of revolute, "),
    (lambda: joint(axis=[0, 0, 2]), "expected a direction of length 1 (3,) [-]; write [0.0, 0.0, 1.0]"),
    (lambda: joint(damping=-0.1), "Joint 'j': damping = -0.1: expected a finite number, 0 or more"),
    (lambda: joint(actuated="yes"), "Joint 'j': actuated = 'yes': expected True or False"),
    (lambda: joint(limits=3), "Joint 'j': limits = 3: expected a Limits"),
    (lambda: M.Limits(effort=NAN), "Limits: effort = nan: expected a number, 0 or more [N m or N]"),
    (lambda: M.Drive(moves="gear"), "Drive: moves = 'gear': expected one of link, motor"),
    (lambda: M.Closure("c", "welded", END, END), "Closure 'c': kind = 'welded': expected one of fixed, "),
    (lambda: M.Closure("c", "fixed", END, END, active=[(1, 0)]), "expected intervals (start, end) with start < end [s]"),
    (lambda: M.Spring("s", END, END, -1.0), "Spring 's': stiffness = -1.0: expected a finite number, 0 or more [N/m]"),
    (lambda: M.Force("f", END, np.zeros(6)), "Force 'f': wrench = an array of shape (6,): expected finite numbers (n, 6)"),
    (lambda: GAS(1.0, 0.0), "GasLaw: travel = 0: expected the volume of the gas"),
    (lambda: TABLE([0.1, 0.1], [1, 2]), "TableLaw: length = [0.1, 0.1]: expected two lengths or more, increasing [m]"),
    (lambda: LOAD("bob", [0, 0, NAN]), "load on 'bob': force[2] = nan: expected a finite number [N]"),
    (lambda: arm(gravity=9.81), "Mechanism 'arm': gravity = 9.81: expected finite numbers (3,) [m/s^2]"),
    (lambda: arm(joints=(joint(), joint())), "Mechanism 'arm': joints named twice: j"),
    (lambda: arm(joints=()), "Mechanism 'arm': no joint carries bob"),
    (lambda: arm(joints=(joint(parent="x"),)), "joint 'j' hangs on 'x', expected 'world' or a link of a joint before it"),
    (lambda: arm(joints=(joint(child="x"),)), "joint 'j' carries 'x', which is no link"),
    (lambda: arm(forces=(parts.Force("f", parts.Attachment("x"), np.zeros((1, 6))),)), "something is attached to 'x'"),
    (lambda: flexinv.Motion((3,), 1.0), "tracks = (3,): expected a tuple, each a Track"),  # type: ignore[arg-type]
]  # fmt: skip


@pytest.mark.parametrize(("make", "said"), WRONG, ids=[f"{k}: {said[:40]}" for k, (_, said) in enumerate(WRONG)])
def test_what_cannot_be_is_refused_when_it_is_made(make: Callable[[], Any], said: str) -> None:
    with pytest.raises(InputError, match=re.escape(said)):
        make()


NUMBERS = [0.0, 0.0, 1.0]


@pytest.mark.parametrize(
    "given",
    [
        NUMBERS, (0, 0, 1), np.array([0, 0, 1]), np.array(NUMBERS, dtype=np.float32), np.array(NUMBERS, dtype=">f8"),
        np.array(NUMBERS, dtype=object), pd.Series(NUMBERS), np.ma.masked_array(NUMBERS), np.repeat(NUMBERS, 2)[::2],
    ],
)  # fmt: skip
def test_numbers_are_taken_in_every_dress(given: Any) -> None:
    for held in (joint(axis=given).axis, parts.Inertia(1.0, given).com, arm(gravity=given).gravity):
        assert type(held) is np.ndarray
        assert held.dtype is np.dtype(float)
        assert not held.flags.writeable
        np.testing.assert_array_equal(held, NUMBERS)


def test_whole_numbers_become_floats_and_lists_tuples() -> None:
    made = arm(links=[parts.Link("bob", [parts.Body("bob", M.Inertia(np.float32(1)))])], joints=[joint(damping=1)])  # type: ignore[arg-type]
    assert made == arm(joints=(joint(damping=1.0),))
    assert isinstance(made.joints, tuple)
    assert type(made.joints[0].damping) is type(made.links[0].bodies[0].inertia.mass) is float


def test_an_inertia_of_a_file_is_kept_as_it_stands() -> None:
    """Files of real robots have such, and torques are defined with them: readers take them over, and say so."""
    odd = parts.Inertia.build_unchecked(-1.0, np.zeros(3), np.diag([1.0, 1.0, 3.0]))
    assert isinstance(odd, parts.Inertia)
    assert odd.replace_unchecked(mass=1.0).mass == 1.0
    assert odd.replace_unchecked(tensor=np.eye(3)) == parts.Inertia.build_unchecked(-1.0, tensor=np.eye(3))
    with pytest.raises(InputError, match="expected a mass, 0 or more"):
        replace(odd, com=np.ones(3))
