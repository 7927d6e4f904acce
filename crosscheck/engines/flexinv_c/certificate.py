"""Certificate of the exported library: gravity, mass matrix, losses and springs, or weight, asked of the program itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crosscheck.engines.flexinv_c.adapter import make_program, make_rigid_settings, plan_case
from crosscheck.engines.flexinv_c.program import Array, Program, Question
from crosscheck.engines.shared.probe_states import configurations
from crosscheck.measures.certificate import Certificate
from flexinv.errors import InputError
from flexinv.files.load_cases import Case
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import WORLD, Joint, Mechanism

WEIGHED_STEPS = 64  # of a mechanism with beams at rest


def certify(mechanism: Mechanism, case: Case, engine: str) -> Certificate:
    """Return mass matrix [kg m^2], [kg], gravity torque [N m], [N], damping, friction and springs of a rigid library.

    Of closed loops those of the cut tree, which is exported for that: the library of the loops shares its efforts out.  Of a
    mechanism with beams its mass [kg], by what its roots hold at rest.  Raises InputError where that says nothing.
    """
    if not mechanism.is_rigid:
        return Certificate(mass=_compute_mass(mechanism, case))
    tree = replace(mechanism, closures=(), springs=(), forces=())
    program = make_program(tree, make_rigid_settings(tree, tree.neutral))
    q = configurations(mechanism, case)
    ask = [Question(name, *_list_state(mechanism, one)) for name in ("gravity", "mass_matrix") for one in q]
    answers = program.ask(ask)
    matrices = [one.reshape(mechanism.nv, mechanism.nv) for one in answers[len(q) :]]
    damping, friction = _read_losses(program)
    return Certificate(
        mass_matrix=np.array(matrices),
        gravity=np.array(answers[: len(q)]),
        order=tuple(j.name for j in mechanism.joints if j.nv),
        damping=damping,
        friction=friction,
        springs=_read_springs(program),
    )


def _compute_mass(mechanism: Mechanism, case: Case) -> float:
    """Mass of what moves [kg]: the forces on the joints that carry it, in equilibrium, over gravity.

    Their mean over some steps: accelerations at one instant are what the last digit of stiff forces leaves, and their mean is how
    rates have changed in all this time.
    """
    size = float(np.linalg.norm(mechanism.gravity))
    if size == 0.0 or mechanism.springs or mechanism.forces or mechanism.closures:
        raise InputError("the library of a mechanism with beams is weighed, which takes gravity and an open tree alone")
    settings = replace(plan_case(mechanism, case).settings, initial="static")
    program = make_program(mechanism, settings)
    still = _list_state(mechanism, np.array(settings.start))
    held = {WORLD}
    roots = list[int]()
    for k, joint in enumerate(mechanism.joints):
        if joint.parent in held and joint.nv == 0:
            held.add(joint.child)
        elif joint.parent in held:
            roots.append(k)
    weigh = [Question("joint_wrench", *_list_state(mechanism, still[0], float(k))) for k in roots]
    answers = program.ask(WEIGHED_STEPS * [Question("step", *still), *weigh])
    held_by = np.array([answers[1 + k :: 1 + len(roots)] for k in range(len(roots))])[:, :, :3].mean(axis=1)
    return float(np.linalg.norm(held_by, axis=1).sum()) / size


def _list_state(mechanism: Mechanism, q: Array, rate: float = 0.0) -> tuple[Array, Array, Array]:
    return q, np.full(mechanism.nv, rate), np.zeros(mechanism.nv)


def _read_losses(program: Program) -> tuple[dict[str, float], dict[str, float]]:
    """Damping [N m s/rad], [N s/m] and dry friction [N m], [N] by joint, from efforts at two speeds."""
    m = program.mechanism
    once, twice = program.ask([Question("friction", *_list_state(m, m.neutral, rate)) for rate in (1.0, 2.0)])
    first = {j.name: m.v_slices[j.name].start for j in m.joints if j.nv}
    return (
        {name: float(twice[k] - once[k]) for name, k in first.items()},
        {name: float(2.0 * once[k] - twice[k]) for name, k in first.items()},
    )


def _read_springs(program: Program) -> dict[str, float]:
    """Stiffness [N m/rad], [N/m] and rest [rad], [m] of springs in joints, from efforts at two places."""
    m = program.mechanism
    springs = [j for j in m.joints if j.stiffness]
    places = [_make_place(m, joint, value) for joint in springs for value in (0.0, 1.0)]
    answers = program.ask([Question("springs", *_list_state(m, q)) for q in places])
    found: dict[str, float] = {}
    for joint, here, there in zip(springs, answers[::2], answers[1::2], strict=True):
        k = m.v_slices[joint.name].start
        stiffness = float(there[k] - here[k])
        found |= {f"{joint.name}: stiffness": stiffness, f"{joint.name}: rest": -float(here[k]) / stiffness}
    return found


def _make_place(mechanism: Mechanism, joint: Joint, value: float) -> Array:
    """Coordinates with one joint at a value [rad], [m]."""
    q = mechanism.neutral.copy()
    columns = mechanism.q_slices[joint.name]
    q[columns] = (np.cos(value), np.sin(value)) if KINDS[joint.kind].circle else value
    return q
