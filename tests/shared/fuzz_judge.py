"""What the fuzz does with a case: the call, and whether what comes back can be true.

An account of energy of its own: what the joints' efforts, the forces and the dampers bring and take, summed over time, beside the
energies of masses, springs and beams.  It reads nodes, efforts and rates of a solution and the mechanism's data, not the balance
that the solution brings along (but for the strain energy of the beams).
"""

from __future__ import annotations

import re
import tempfile
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from fuzz_grammar import Example

import flexinv
from flexinv.elements.joint_law import FRICTION_RATE
from flexinv.inverse.inverse_dynamics import compute_applied_forces, compute_spring_efforts
from flexinv.typing import Array

# Rounding over some hundred steps with forces, over the largest term of a sum.
ROUNDING = 1e-7
# What a bar may be of the energy exchanged; above it an error should have been raised.
LARGEST = 0.01
# Two ways to the same numbers: Newton's last increment (1e-9 of the largest), not bit for bit.
SAME = 1e-6


# Forces [N], moments [N m] and powers [W] that are rounding: 1e-16 of the axial stiffness of these beams (up to 1e9 N).
WEIGHTLESS = 1e-7
# Of the mechanism's length: a tenth of the increment at which Newton's method stops.
INCREMENT = 1e-10


# After a sudden start a controller makes steps in parts, and knows the motion between two calls by its ends only.
BETWEEN = 0.02
# An effort, an impact or what damping takes after it jumps at few samples: there a sum over time is off by half a step.
JUMPS = 16
# A mechanism that moves by less than this part of its length in the whole run stands still.
STANDING = 1e-5


class Wrong(AssertionError):
    """What came back cannot be true."""


@dataclass(frozen=True)
class Verdict:
    """What became of a case: "answer", "refused" (a FlexinvError) or "failure"; why, by kind; the whole message."""

    outcome: str
    reason: str = ""
    message: str = ""
    ratio: float = 0.0


def judged(case: Example) -> Verdict:
    """Return what becomes of a case."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", flexinv.ModelWarning)
        (Path(folder) / "mechanism.toml").write_text(case.mechanism, encoding="utf-8")
        (Path(folder) / "cases.toml").write_text(case.cases, encoding="utf-8")
        try:
            return Verdict("answer", ratio=_called(case, Path(folder)))
        except flexinv.FlexinvError as error:
            return Verdict("refused", f"{type(error).__name__}: {_kind(str(error))}", str(error))
        except Wrong as error:
            return Verdict("failure", str(error).split(":")[0], str(error))
        except Exception as error:
            return Verdict("failure", _place(error), f"{type(error).__name__}: {error}")


def _kind(message: str) -> str:
    """What a message says beside names and numbers."""
    text = re.sub(r"'[^']*'|\"[^\"]*\"|\S*/\S*toml,?", "~", message)
    text = re.sub(r"[-+]?\d[\d.]*(e[-+]?\d+)?", "#", text)
    return text[:110]


def _place(error: BaseException) -> str:
    trace = error.__traceback__
    where = "?"
    while trace is not None:
        if "flexinv" in trace.tb_frame.f_code.co_filename:
            where = f"{Path(trace.tb_frame.f_code.co_filename).name}:{trace.tb_lineno}"
        trace = trace.tb_next
    return f"{type(error).__name__} at {where}"


# --- calls -----------------------------------------------------------------------------------------------------------


def _called(case: Example, folder: Path) -> float:
    """Call what the case asks for; return the bar of its energy over what was exchanged [-]."""
    mechanism = flexinv.load_mechanism(folder)
    task = flexinv.load_cases(folder, mechanism)["only"]
    call = dict(case.call)
    return float(CALLS[call.pop("entrance")](mechanism, task, call) or 0.0)


def _options(task: flexinv.Case, call: dict[str, Any]) -> dict[str, Any]:
    own = {key: call[key] for key in ("initial", "spectral_radius") if key in call}
    return {"end": task.end, "start": task.start} | own


def _solve(m: flexinv.Mechanism, task: flexinv.Case, call: dict[str, Any]) -> float:
    return closes(flexinv.solve(m, task.motion, task.step, **_options(task, call)))


def _error(m: flexinv.Mechanism, task: flexinv.Case, call: dict[str, Any]) -> float:
    s = flexinv.solve(m, task.motion, task.step, error=True, **_options(task, call))
    assert s.torque_error is not None
    _finite("error bars", s.torque_error, *(s.tip_error or {}).values())
    return closes(s)


def _simulate(m: flexinv.Mechanism, task: flexinv.Case, call: dict[str, Any]) -> float:
    drives, end = int(m.actuated.sum()), task.end
    effort = np.array([call["effort"].get(j.name, 0.0) for j in m.joints for _ in range(j.nv)])[m.actuated]
    steps = round(end / task.step)
    shapes = {
        "zero": (np.array([0.0, end]), np.zeros((2, drives))),
        "steps": (np.array([0.0, 0.25, 0.25, 0.6, 0.6, 1.0]), np.outer([1, 1, -1, -1, 0, 0], effort)),
    }
    if call["shape"] == "smooth":
        time = np.linspace(0.0, end, 101)
        torque = np.sin(np.outer(time, 2 * np.pi * call["count"] / end * np.ones(drives)) + np.arange(drives)) * effort
    else:
        time, torque = shapes[call["shape"]]
        time = time if call["shape"] == "zero" else task.step * np.round(time * steps)
    start = dict(task.start)
    places = task.motion.evaluate(m, np.zeros(1))[0][0]
    start |= {name: places[m.q_slices[name]] for name in task.motion.joints(m)}
    own = {key: call[key] for key in ("initial", "spectral_radius") if key in call}
    return closes(flexinv.simulate(m, time, torque, task.step, start=start, **own))


def _statics(m: flexinv.Mechanism, task: flexinv.Case, call: dict[str, Any]) -> None:
    s = flexinv.statics(m, q=_place_of(m, task))
    _finite("statics", s.torque_all, s.nodes.x, *s.wrench.values(), s.balance.momentum)
    _balanced(s)


def _parts(m: flexinv.Mechanism, task: flexinv.Case, call: dict[str, Any]) -> float:
    options = _options(task, call)
    parts = list(flexinv.solve_in_parts(m, task.motion, task.step, part=call["part"], **options))
    whole = flexinv.solve(m, task.motion, task.step, **options)
    joined = np.concatenate([parts[0].torque_all[:1], *(part.torque_all[1:] for part in parts)])
    _same("parts and whole", joined, whole.torque_all)
    return closes(whole)


def _many(m: flexinv.Mechanism, task: flexinv.Case, call: dict[str, Any]) -> float:
    options = _options(task, call)
    batch = flexinv.solve_many(m, [task.motion] * 2, task.step, threads=1, **options)
    alone = flexinv.solve(m, task.motion, task.step, **options)
    for s in batch.all():
        if not np.array_equal(s.torque_all, alone.torque_all):
            raise Wrong("solve_many differs from solve")
    return closes(alone)


def _controller(m: flexinv.Mechanism, task: flexinv.Case, call: dict[str, Any]) -> float:
    controller = flexinv.Controller.of(m, step=task.step)
    options = {"initial": call.get("initial", "consistent")}
    s = flexinv.solve(m, task.motion, task.step, end=task.end, start=task.start, **options)
    with np.errstate(invalid="ignore"):
        q, qd, qdd = s.q, s.qd, s.qdd
    rows = [controller.start(q[0], qd[0], qdd[0], **options).copy()]
    rows += [
        controller.step(*(np.ascontiguousarray(part[k]) for part in (q, qd, qdd))).copy() for k in range(1, len(q))
    ]
    result = np.array(rows)
    _finite("controller", result)
    # where the samples are too far apart for what rings, the motion between two calls is not known by its ends
    if not task.motion.jumps and account(s)[1] <= LARGEST * s.energy_exchanged:
        _same("controller and solve", result[:, m.actuated], s.torque, BETWEEN)
    return closes(s)


def _natural(m: flexinv.Mechanism, task: flexinv.Case, call: dict[str, Any]) -> None:
    modes = flexinv.natural_modes(m, q=_place_of(m, task), count=6)
    _finite("natural modes", modes.squared, modes.displacement)
    rest = flexinv.steady_modes(m, q=_place_of(m, task), count=6)
    _finite("steady modes", rest.frequency)


def _steady(m: flexinv.Mechanism, task: flexinv.Case, call: dict[str, Any]) -> None:
    modes = flexinv.steady_modes(m, q=_place_of(m, task), rates=_rates(m, call), count=6)
    _finite("steady modes", modes.frequency, modes.damping if hasattr(modes, "damping") else np.zeros(1))


def _linear(m: flexinv.Mechanism, task: flexinv.Case, call: dict[str, Any]) -> None:
    model = flexinv.linear_model(m, q=_place_of(m, task), rates=_rates(m, call), modes=4)
    _finite("linear model", *model.matrices, model.bias)


def _torques(m: flexinv.Mechanism, task: flexinv.Case, call: dict[str, Any]) -> float:
    s = flexinv.solve(m, task.motion, task.step, **_options(task, call))
    if m.is_rigid and not s.marched:
        # a sample that stands for itself knows no whole turns, by which springs of continuous joints are wound
        alone = s.torque_all - compute_spring_efforts(m, s.q) + compute_spring_efforts(m, s.q, history=False)
        _same("prepare and solve", flexinv.prepare(m).torques(s.q, s.qd, s.qdd), alone)
        _same("joint_torques and solve", flexinv.joint_torques(m, s.q, s.qd, s.qdd), alone)
    return closes(s)


CALLS = {
    "solve": _solve, "error": _error, "simulate": _simulate, "statics": _statics, "parts": _parts, "many": _many,
    "controller": _controller, "natural": _natural, "steady": _steady, "linear": _linear, "torques": _torques,
}  # fmt: skip


def _rates(m: flexinv.Mechanism, call: dict[str, Any]) -> dict[str, float]:
    turning = next((j.name for j in m.joints if j.kind in ("revolute", "continuous")), None)
    return {} if turning is None or "rate" not in call else {turning: float(call["rate"])}


def _place_of(m: flexinv.Mechanism, task: flexinv.Case) -> Array:
    """Where the case begins (nq,) [rad], [m]."""
    q = np.array(task.motion.evaluate(m, np.zeros(1))[0][0])
    for name, value in task.start.items():
        q[m.q_slices[name]] = value
    return q


def _finite(what: str, *values: Array) -> None:
    if not all(np.isfinite(value).all() for value in values):
        raise Wrong(f"{what}: numbers that are not finite")


def _same(what: str, one: Array, other: Array, part: float = SAME) -> None:
    size = np.abs(other).max(initial=0.0)
    if one.shape != other.shape or np.abs(one - other).max(initial=0.0) > part * size + 1e-12:
        raise Wrong(f"{what} differ: by {np.abs(one - other).max():.3g} of {size:.3g}")


# --- the account -----------------------------------------------------------------------------------------------------


def closes(s: flexinv.Solution) -> float:
    """Hold a solution to its balances; return the bar of its energy over what was exchanged [-].  Raises Wrong."""
    _finite("solution", s.torque_all, s.qd, s.nodes.x, s.nodes.v, s.nodes.a, s.balance.work, *s.wrench.values())
    _finite("solution", *s.internal.values(), s.balance.momentum)
    _balanced(s)
    power = np.abs(s.torque_all * s.qd).sum(axis=1).max() + _moved(s)
    fastest = float(np.linalg.norm(s.nodes.v, axis=2).max(initial=0.0))
    if np.abs(s.balance.power).max() > ROUNDING * power + WEIGHTLESS + _last_increment(s) * fastest:
        raise Wrong(f"power balance: {np.abs(s.balance.power).max():.3g} W of {power:.3g} W are left")
    slow = 0.5 * s.mesh.mass.sum() * (STANDING * s.mesh.length / max(np.ptp(s.time), s.time[-1] * 1e-9 + 1e-12)) ** 2
    floor = ROUNDING * (np.abs(s.balance.kinetic).max() + np.ptp(s.balance.potential) + _weight(s)) + slow
    bar, exchanged = s.energy_error, s.energy_exchanged
    if not (np.isfinite(bar) and np.isfinite(exchanged)):
        raise Wrong("energy error: not finite")
    if s.marched:
        left, quadrature = account(s)
        if left > bar + s.energy_summed + 2 * quadrature + floor:  # the bar is of the sum without its own error
            raise Wrong(
                f"account of energy: {left:.3g} J are left, the bar is {bar:.3g} J of {exchanged:.3g} J, "
                f"sums over time are {quadrature:.3g} J off"
            )
    if bar > LARGEST * exchanged + floor:
        raise Wrong(f"bar of energy above 1 %: {bar:.3g} J of {exchanged:.3g} J")
    return bar / exchanged if exchanged > floor else 0.0


def _weight(s: flexinv.Solution) -> float:
    """Weights times the mechanism's length, a size of energy [J]."""
    return float(s.mesh.mass.sum() * np.linalg.norm(s.mechanism.gravity) * s.mesh.length)


def _moved(s: flexinv.Solution) -> float:
    """The largest power of forces on nodes [W]."""
    return float(np.abs(np.einsum("snc,snc->sn", s.forces.force, s.nodes.v)).sum(axis=1).max())


def _balanced(s: flexinv.Solution) -> None:
    push = np.abs(s.forces.force).sum(axis=(1, 2)).max() + sum(np.abs(w[:, :3]).max() for w in s.wrench.values())
    beams = max((float(np.abs(part[..., :3]).max(initial=0.0)) for part in s.internal.values()), default=0.0)
    size = push + beams
    arms = size * (s.mesh.length + np.abs(s.nodes.x).max()) + max(
        (float(np.abs(w[:, 3:]).max()) for w in s.wrench.values()), default=0.0
    )
    force, moment = (np.abs(part).max() for part in (s.balance.momentum[:, :3], s.balance.momentum[:, 3:]))
    least = WEIGHTLESS + _last_increment(s)
    if force > ROUNDING * size + least or moment > ROUNDING * arms + least * max(1.0, s.mesh.length):
        raise Wrong(f"momentum balance: {force:.3g} N of {size:.3g} N, {moment:.3g} N m of {arms:.3g} N m are left")


def _last_increment(s: flexinv.Solution) -> float:
    """Return the force that Newton's method may leave in a beam [N]: places are known to INCREMENT of the length.

    A step of the march stops at increments of 1e-9 of the length, each of which is at most a tenth of the one before.
    """
    stiffness = s.mesh.elements.stiffness
    if not stiffness.size:
        return 0.0
    stretch = stiffness[..., 0].max(axis=-1) / s.mesh.elements.weight.sum(axis=-1)
    return float(INCREMENT * s.mesh.length * stretch.max())


def account(s: flexinv.Solution) -> tuple[float, float]:
    """Return what the fuzz's own account of energy leaves open at most, and the error of its sums over time [J]."""
    m, mesh, n = s.mechanism, s.mesh, s.nodes
    given = s.torque_all - _losses(s)
    power = (given * s.qd).sum(axis=1) - s.balance.dissipated
    spin = np.einsum("snc,nck,snk->s", n.omega, mesh.inertia, n.omega)
    energy = 0.5 * (np.einsum("n,snc,snc->s", mesh.mass, n.v, n.v) + spin) + s.balance.elastic
    energy = energy - np.einsum("n,snc,c->s", mesh.mass, n.x, m.gravity)
    if m.springs or m.forces:
        pushed = compute_applied_forces(mesh, n, s.time)
        assert pushed is not None
        turned = np.einsum("snij,snj->sni", n.rotation, n.omega)
        power = power + np.einsum("snc,snc->s", pushed.force, n.v) + np.einsum("snc,snc->s", pushed.moment, turned)
    middle = 0.5 * (power[1:] + power[:-1]) * np.diff(s.time)
    for impact in s.loops.impacts if s.loops is not None else ():  # damping ends long before the step does
        k = int(np.argmin(np.abs(s.time - impact.time)))
        step, lost = float(s.time[1] - s.time[0]), s.balance.dissipated
        for at, end in ((k - 1, k - 1), (k, k + 1)):
            if at < len(middle):
                middle[at] += 0.5 * step * (lost[k] - lost[end])
    brought = np.zeros(len(s.time))
    for impact in s.loops.impacts if s.loops is not None else ():
        brought[int(np.argmin(np.abs(s.time - impact.time))) :] += impact.work - impact.energy
    work = np.concatenate([[0.0], np.cumsum(middle)]) + brought
    even = len(power) - (len(power) + 1) % 2
    coarse = np.trapezoid(power[:even:2], s.time[:even:2])
    jumps = np.sort(np.abs(np.diff((s.torque_all * s.qd).sum(axis=1) - s.balance.dissipated, 2)))[-JUMPS:].sum() / 4
    return float(np.abs(energy - energy[0] - work).max()), abs(float(middle[: even - 1].sum() - coarse)) / 3 + float(
        jumps * (s.time[1] - s.time[0]) / 2
    )


def _losses(s: flexinv.Solution) -> Array:
    """What joints take by rotors, damping, friction and springs (samples, nv) [N m], [N]."""
    m, out = s.mechanism, np.zeros_like(s.torque_all)
    for joint in m.joints:
        own = m.v_slices[joint.name]
        if not joint.nv or joint.kind == "free":
            continue
        rate, q = s.qd[:, own], s.q[:, m.q_slices[joint.name]]
        still = np.tanh(rate / FRICTION_RATE) if not joint.actuated else np.sign(rate)
        out[:, own] = joint.rotor_inertia * s.qdd[:, own] + joint.damping * rate + joint.friction * still
        if joint.stiffness:
            place = np.unwrap(np.arctan2(q[:, 1], q[:, 0]))[:, None] if joint.kind == "continuous" else q
            out[:, own] += joint.stiffness * (place - joint.rest)
    return out
