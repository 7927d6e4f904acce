"""Links that measured joints alone carry need no march for their masses: efforts are those of a march with them, to rounding."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from identify_campaign import CLASSES, moving, read_random_machine

from crosscheck.identification.machine import Machine
from crosscheck.identification.parameters import MASS, Parameter
from crosscheck.identification.responses.carried_links import (
    build_carried_links,
    find_carried_links,
    list_marched_masses,
)
from crosscheck.identification.responses.response import (
    MeasuredMotion,
    SolverModel,
    build_response,
    compute_link_inertias,
)
from flexinv.typing import Array

# Of the largest effort: the march ends its iterations at a square of 1e-18 of the last increment, and where it ends there
# depends on the masses; what is rigid adds 1e-15.
CLOSE = 1e-9


def make_case(kind: str) -> tuple[Machine, MeasuredMotion, Array]:
    """Return a random machine, its motion, and z (parameters,) of a truth [-]."""
    random = np.random.default_rng([2, CLASSES.index(kind)])
    machine = read_random_machine(kind, 2, random)
    return machine, moving(machine, random, kind), 0.5 * random.normal(size=len(machine.space.parameters))


@pytest.mark.parametrize(("kind", "marched"), [("drives", 12), ("beams", 2)])
def test_efforts_are_those_of_a_march(kind: str, marched: int) -> None:
    """The spring's link and its stiffness and damping are marched, the first link's ten numbers are not."""
    machine, motion, z = make_case(kind)
    values = machine.space.compute_values(z)
    direct = build_response(machine.mechanism, machine.space, machine.settings, motion, once=True)(values)
    response = build_response(machine.mechanism, machine.space, machine.settings, motion)
    at_known = response(machine.space.compute_values(np.zeros(len(z))))[0]
    efforts = response(values)[0]
    assert len(response.asked) == marched  # type: ignore[attr-defined]
    assert np.abs(efforts - direct[0]).max() < CLOSE * np.abs(direct[0]).max()
    assert np.abs(efforts - at_known).max() > 0.01 * np.abs(direct[0]).max()


def test_links_behind_a_spring_are_not_carried() -> None:
    machine, _, _ = make_case("drives")
    assert find_carried_links(machine.mechanism, ["j0"]) == {"l0"}
    assert find_carried_links(machine.mechanism, ["j0", "spring"]) == {"l0", "arm"}
    assert find_carried_links(machine.mechanism, []) == set()


def test_masses_are_marched_where_gravity_or_places_are_free() -> None:
    machine, motion, _ = make_case("drives")
    space = machine.space
    tilt = Parameter("gravity tilt x", "world", "rad", 0.0, 0.01, False)
    tilted = replace(space, parameters=(*space.parameters, tilt))
    model = SolverModel.build(machine.mechanism, machine.settings, motion)
    known = compute_link_inertias(space, model.mechanism, {})
    carried, none = (
        build_carried_links(model.mechanism, one, model.given, motion.time, motion.names, known)
        for one in (space, tilted)
    )
    masses = [one.key for one in space.parameters if one.kind == MASS]
    assert carried is not None
    assert none is None
    assert len(list_marched_masses(masses, model.mechanism, carried)) == 10
    assert len(list_marched_masses(masses, model.mechanism, none)) == 20


def test_a_payload_of_a_carried_link_needs_no_march() -> None:
    machine, motion, _ = make_case("drives")
    model = SolverModel.build(machine.mechanism, machine.settings, motion)
    known = compute_link_inertias(machine.space, model.mechanism, {})
    carried = build_carried_links(model.mechanism, machine.space, model.given, motion.time, motion.names, known)
    keys = [(MASS, "payload of l0.m"), (MASS, "payload of arm.m")]
    assert list_marched_masses(keys, model.mechanism, carried) == keys[1:]
