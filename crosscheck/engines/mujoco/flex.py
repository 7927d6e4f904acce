"""MuJoCo's own flexible element, as far as version 4.0.0 carries a beam: in a plane, at the end of the tree.

The joints are prescribed: at every step their places and speeds are the given ones, and the points of the rod
(`rod`) follow by MuJoCo's semi-implicit Euler, explicit in the elastic forces: the step is set by the fastest
frequency.  The effort is mj_rne, M a + bias without armature, at the accelerations that MuJoCo finds; elastic forces
act between points that are carried by the hub and have no part in it.

The error falls with l^2: two meshes give the extrapolated series (4 fine - coarse) / 3; a third, coarser, its bar.
"""

from __future__ import annotations

import time as clock

import mujoco
import numpy as np
from numpy.typing import NDArray

from crosscheck.engines.base import Options, beside, sample_times
from crosscheck.engines.mujoco.adapter import (
    RawArrays,
    collect_warnings,
    compute_body_wrench,
    compute_point_position,
    fill_sample,
    make_empty_raw,
    version,
)
from crosscheck.engines.mujoco.joints import BuiltModel
from crosscheck.engines.mujoco.rod import (
    DRIVE,
    NO_FRAME,
    Rod,
    build_flexible_model,
    build_rod,
    describe_spatial_bending,
    find_bending_axis,
)
from crosscheck.engines.shared.prescribed import (
    describe_coupled_sections,
    describe_nontree_parts,
    missing_motion,
    passive_effort,
    rotor_effort,
)
from crosscheck.measures.budget import Family, add_error_bars, compute_richardson_limit
from crosscheck.measures.mechanisms import check_resolved
from crosscheck.measures.record import Record, Series, make_wrench_series, series, torque_series, vector_series
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Link, Mechanism

__all__ = ["abilities", "certify", "export", "run", "unsupported", "version"]

Array = NDArray[np.float64]
ELEMENTS = 32  # of the fine mesh
STABLE = 0.8  # of the largest stable step 2 / omega of a linear oscillator: bent rods have slightly higher frequencies


# What this adapter offers beside (`crosscheck.engines.base`).
certify = beside("crosscheck.engines.mujoco.flex_certificate", "certify")
export = beside("crosscheck.engines.mujoco.flex_export", "export")


def abilities() -> str:
    """Return one sentence: what MuJoCo's flexible elements can do here."""
    return (
        "One uniform, straight beam at the end of a planar tree by MuJoCo's flex of dimension 1 "
        "(stretch and bending; no shear, twist or rotary inertia; no joint on the beam)."
    )


def unsupported(mechanism: Mechanism, case: Case, engine: str) -> str | None:
    """Return the reason why MuJoCo's flex cannot do this case, or None."""
    if mechanism.is_rigid:
        return "no link is a beam: see mujoco"
    reason = describe_nontree_parts(mechanism) or missing_motion(mechanism, case)
    if (reason := reason or describe_coupled_sections(mechanism, "a flex of dimension 1")) is not None:
        return reason
    for link in mechanism.beams:
        if (reason := _describe_refusal(mechanism, link)) is not None:
            return reason
    if len(mechanism.beams) > 1:
        return f"one beam only; here: {', '.join(link.name for link in mechanism.beams)}"
    if case.initial == "static":
        return "this adapter starts from the undeformed beam; the case starts in static equilibrium"
    return None


def _describe_refusal(mechanism: Mechanism, link: Link) -> str | None:
    carried = [j.name for j in mechanism.joints if j.parent == link.name]
    if carried:
        return f"{NO_FRAME}: no joint can hang on {link.name}; here: {', '.join(carried)}"
    for body in link.bodies:
        point = not (body.inertia.com.any() or body.inertia.tensor.any())
        if body.station not in (None, 0.0) and not (body.station == 1.0 and point):
            return f"{NO_FRAME}: {link.name} carries a point mass at its end at most, not {body.name!r}"
    assert link.beam is not None
    if len(link.beam.section.stations) > 1 or link.beam.curvature.any():
        return f"a flex of dimension 1 has one section, and is straight here; {link.name} varies or is curved"
    if link.beam.section.damping is not None and link.beam.section.damping.any():
        return f"this adapter gives a flex no damping; {link.name} is damped"
    if find_bending_axis(mechanism, link) is None:
        return describe_spatial_bending(link)
    return None


def run(mechanism: Mechanism, case: Case, engine: str, options: Options) -> Record:
    """Return torque, wrench [N m], [N], tip, deflection [m], axial force [N], each with its bar, on the sample times.

    options : "elements", edges of the finest mesh (a multiple of 4), doubled "refinement" times; "error" False leaves out the
    coarsest of three
    """
    check_resolved(mechanism)
    elements = int(options.get("elements", ELEMENTS)) * 2 ** int(options.get("refinement", 0))
    meshes = [elements // 4, elements // 2, elements] if options.get("error", True) else [elements // 2, elements]
    start = clock.perf_counter()
    with collect_warnings() as words:
        runs = [run_mesh(mechanism, case, build_rod(mechanism, n)) for n in meshes]
    values, budget = add_error_bars(compute_richardson_limit(runs), [Family("mesh", runs, "limit")])
    return Record(
        engine=engine,
        version=version(),
        message="; ".join(dict.fromkeys(words)),
        settings={
            "element": "flex of dimension 1, circular section (no shear, no rotary inertia)",
            "elements": meshes,
            "step_s": plan_steps(case, build_rod(mechanism, elements))[0],
            "integrator": "semi-implicit Euler",
            "extrapolation": "(4 fine - coarse) / 3: the error is of order l^2",
        },
        time=sample_times(case),
        series=values,
        budget=budget,
        wall_time=clock.perf_counter() - start,
    )


def plan_steps(case: Case, rod: Rod) -> tuple[float, int]:
    """Return the step [s], stable with a margin, and how many of them make one sample."""
    count = int(np.ceil(case.sample / (STABLE * 2 / rod.fastest)))
    return case.sample / count, count


def run_mesh(mechanism: Mechanism, case: Case, rod: Rod) -> dict[str, Series]:
    """Return every series of one mesh: [N], [N m], [m]."""
    step, stride = plan_steps(case, rod)
    flexible_model = build_flexible_model(mechanism, rod, step)
    steps = (len(sample_times(case)) - 1) * stride
    q, qd, qdd = case.motion.evaluate(mechanism, np.arange(steps + 1) * step)
    raw = _integrate_points(mechanism, flexible_model, (convert_to_angles(mechanism, q), qd, qdd), stride)
    order = [flexible_model.v_at[j.name] for j in mechanism.joints if j.nv]
    torque = raw.effort[:, order] + passive_effort(mechanism, qd[::stride])
    torque += rotor_effort(mechanism, qdd[::stride])
    return _collect_series(mechanism, flexible_model, rod, raw, torque)


def convert_to_angles(mechanism: Mechanism, q: Array) -> Array:
    """Return one number per joint [rad], [m]: of a continuous joint the angle instead of its cosine and sine."""
    columns = [q[:, mechanism.q_slices[j.name]] for j in mechanism.joints if j.nv]
    return np.column_stack([np.arctan2(c[:, 1], c[:, 0]) if c.shape[1] == 2 else c[:, 0] for c in columns])


def _integrate_points(
    mechanism: Mechanism, built_model: BuiltModel, hub: tuple[Array, Array, Array], stride: int
) -> RawArrays:
    """Integrate the points while the joints move as given; hub: places, speeds, accelerations (steps, joints)."""
    model = built_model.model
    data = mujoco.MjData(built_model.model)
    names = [j.name for j in mechanism.joints if j.nv]
    at_q, at_v = (_make_slice([where[name] for name in names]) for where in (built_model.q_at, built_model.v_at))
    raw = make_empty_raw(model, (len(hub[0]) - 1) // stride + 1)
    effort = np.empty(model.nv)
    # hundreds of thousands of steps: looked up once
    qpos = data.qpos
    qvel = data.qvel
    applied = data.qfrc_applied
    steps = zip(hub[0], hub[1], DRIVE * hub[2], strict=True)
    for k, (place, speed, drive) in enumerate(steps):
        qpos[at_q] = place
        qvel[at_v] = speed
        applied[at_v] = drive
        mujoco.mj_forward(model, data)
        if k % stride == 0:
            mujoco.mj_rne(model, data, 1, effort)
            fill_sample(model, data, raw, k // stride, effort)
        mujoco.mj_Euler(model, data)
    return raw


def _make_slice(places: list[int]) -> slice | list[int]:
    """Return the slice of places that follow one another: numpy fills it in a third of the time of a list."""
    first = places[0] if places else 0
    return slice(first, first + len(places)) if places == list(range(first, first + len(places))) else places


def _collect_series(
    mechanism: Mechanism, built_model: BuiltModel, rod: Rod, raw: RawArrays, torque: Array
) -> dict[str, Series]:
    made = torque_series(mechanism, torque)
    for joint in mechanism.joints:
        body = built_model.body[joint.child]
        wrench = compute_body_wrench(built_model.model, raw, body)
        made |= make_wrench_series(joint.name, wrench)
        if joint.child == rod.link:
            made |= series(f"axial/{rod.link}", "N", wrench[:, 0])
        else:
            made |= vector_series(
                f"tip/{joint.child}", "m", compute_point_position(raw, body, mechanism.link_of[joint.child].tip)
            )
    end = built_model.model.body(rod.format_point_name(rod.elements)).id
    tip = raw.xpos[:, end]
    root = compute_point_position(raw, built_model.body[rod.link], rod.beam.placement.position)
    seen = np.einsum("sji,sj->si", raw.xmat[:, end], tip - root)  # (sample, xyz of the root section)
    made |= vector_series(f"tip/{rod.link}", "m", tip)
    return made | vector_series(f"deflection/{rod.link}", "m", seen - np.array([rod.beam.length, 0.0, 0.0]))
