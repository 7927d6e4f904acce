"""Small and large machines: what is exactly similar has exactly similar answers, from a micrometre to a kilometre.

Rounding is relative, so that nothing but a tolerance or a rank in metres, or metres and radians side by side without a scale, can
tell sizes apart.  Dry friction is left out: its slope is a rate, 1e-3 rad/s, whatever the size (`joint_law.FRICTION_RATE`).
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from similar import coordinates, efforts, similar

import flexinv
from flexinv.analysis.overview import resolve_start_configuration
from flexinv.constraints.continuation import compute_mobility
from flexinv.files.load_cases import Case, load_cases
from flexinv.kinematics.mesh import build
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "docs" / "studies"))
from rotating_beams import Mounting, swept  # noqa: E402

SIZES = (1e-6, 1e-3, 1e3)
# What the issue of a small machine may cost; most answers agree to 1e-10.
ALIKE = 1e-6
# Answers of an entrance, by name, seen in the original's lengths.
Answers = dict[str, Array]


@cache
def model(name: str) -> tuple[Mechanism, Case]:
    m = flexinv.load_mechanism(ROOT / "models" / name)
    case = next(iter(load_cases(ROOT / "models" / name, m).values()))
    m = case.meshed(m)
    return replace(m, joints=tuple(replace(joint, friction=0.0) for joint in m.joints)), case


@dataclass(frozen=True)
class Slower:
    """A motion in ``factor`` times the time, with slides that go ``factor`` times as far; what `solve` asks of a motion."""

    motion: flexinv.Motion
    factor: float

    @property
    def duration(self) -> float:
        return self.factor * self.motion.duration

    @property
    def jumps(self) -> tuple[float, ...]:
        return tuple(self.factor * t for t in self.motion.jumps)

    def joints(self, m: Mechanism) -> tuple[str, ...]:
        return self.motion.joints(m)

    def evaluate(self, m: Mechanism, time: Array, side: str = "right") -> tuple[Array, Array, Array]:
        s, parts = self.factor, self.motion.evaluate(m, np.asarray(time) / self.factor, side)  # type: ignore[arg-type]
        return tuple(coordinates(m, part, s) / s**k for k, part in enumerate(parts))  # type: ignore[return-value]


def table(m: Mechanism, values: Array, rates: bool = False) -> dict[str, Array]:
    slices = m.v_slices if rates else m.q_slices
    return {joint.name: values[slices[joint.name]] for joint in m.joints if joint.nv}


def start(m: Mechanism, case: Case, s: float) -> dict[str, Array]:
    q = coordinates(m, resolve_start_configuration(m, case), s)
    return {name: q[m.q_slices[name]] for name in case.start}


def solved(name: str, s: float, steps: int = 20) -> flexinv.Solution:
    m, case = model(name)
    options = {"end": steps * case.step * s, "start": start(m, case, s), "initial": case.initial}
    return flexinv.solve(similar(m, s), Slower(case.motion, s), case.step * s, **options)  # type: ignore[arg-type]


def solve(name: str, s: float) -> Answers:
    result, m = solved(name, s), model(name)[0]
    out = {"torque": efforts(m, result.torque_all, 1 / s), "q": coordinates(m, result.q, 1 / s)}
    return out | {f"deflection of {link}": bend / s for link, bend in result.deflection.items()}


def simulate(name: str, s: float) -> Answers:
    m, case = model(name)
    one = solved(name, 1.0)
    begin = table(m, coordinates(m, one.q[0], s)), table(m, coordinates(m, one.qd[0], s) / s, rates=True)
    torque = efforts(m, one.torque_all, s)[:, m.actuated]
    solution = flexinv.simulate(similar(m, s), s * one.time, torque, s * case.step, 0.8, case.initial, *begin)
    return {"q": coordinates(m, solution.q, 1 / s)}


def statics(name: str, s: float) -> Answers:
    m, case = model(name)
    load = flexinv.Load(
        m.beams[-1].name, force=s**2 * np.array([0.1, 0.2, 0.05]), moment=s**3 * np.array([1, 2, 1]) / 100
    )
    solution = flexinv.statics(similar(m, s), [load], q=coordinates(m, resolve_start_configuration(m, case), s))
    out = {"torque": efforts(m, solution.torque_all, 1 / s), "q": coordinates(m, solution.q, 1 / s)}
    return out | {f"deflection of {link}": bend / s for link, bend in solution.deflection.items()}


def natural_modes(name: str, s: float) -> Answers:
    m, case = model(name)
    modes = flexinv.natural_modes(similar(m, s), coordinates(m, resolve_start_configuration(m, case), s))
    return {"frequency": s * modes.frequency[:12], "fast": s * modes.frequency, "q": coordinates(m, modes.q, 1 / s)}


def free_modes(name: str, s: float) -> Answers:
    m, _ = model(name)
    modes = flexinv.natural_modes(similar(m, s), free=[joint.name for joint in m.joints])
    return {"frequency": s * modes.frequency[:12]}


def steady_modes(name: str, s: float) -> Answers:
    m, case = model(name)
    modes = flexinv.steady_modes(similar(m, s), coordinates(m, resolve_start_configuration(m, case), s))
    return {"frequency": s * modes.frequency[:12]}


def blade(name: str, s: float) -> Answers:
    """Swept, and so bent and twisted by its rotation; as a linear model with its hub's acceleration as the input, too."""
    m, rates = swept(float(name), Mounting()), {"hub": 78.5 / s}
    modes = flexinv.steady_modes(similar(m, s), rates=rates, count=6)
    model = flexinv.linear_model(similar(m, s), rates=rates, free=[], accelerated=["hub"], modes=4)
    roots = np.sort(np.abs(np.linalg.eigvals(model.A)))[2:]  # without the hub's own place and rate
    return {"frequency": s * modes.frequency, "place": modes.position / s, "roots": s * roots}


def follow(name: str, s: float) -> Answers:
    m, _ = model(name)
    arc = flexinv.Path.arc([0.3 * s, 0, 0], centre=[0.2 * s, 0, 0], angle=np.pi / 2, duration=0.2 * s)
    following = flexinv.follow(similar(m, s), arc, "link2", step=4e-3 * s, start={"joint1": -0.5, "joint2": 1.0})
    ways = {way: efforts(m, one.torque_all, 1 / s) for way, one in following.feed_forwards.items()}
    return {"q": following.solution.q, **ways}


def rigid(name: str, s: float) -> Answers:
    """Loops whose whole motion is given, at once and one by one; how many freedoms they have; what their closures exert."""
    m, case = model(name)
    one = flexinv.solve(m, case.motion, case.end / 20, start=case.start)
    small = similar(m, s)
    q, qd, qdd = (coordinates(m, part, s) / s**k for k, part in enumerate((one.q, one.qd, one.qdd)))
    function, now = flexinv.prepare(small), np.empty(m.nv)
    function.sample(q[3], qd[3], qdd[3], now)
    cycle = np.array(flexinv.Controller.of(small).step(q[3], qd[3], qdd[3]))
    out = {"sample": efforts(m, now, 1 / s), "cycle": efforts(m, cycle, 1 / s)}
    out["torque"] = efforts(m, flexinv.joint_torques(small, q, qd, qdd), 1 / s)
    if m.closures:
        mobility = compute_mobility(build(small), q[0])
        out["mobility"] = np.array([mobility.freedoms, mobility.redundant])
        loops = solved(name, s).loops
        assert loops is not None
        out["reaction"] = np.stack([w / s ** np.repeat([2.0, 3.0], 3) for w in loops.reaction.values()])
    return out


def controller(name: str, s: float) -> Answers:
    m, case = model(name)
    cycle = flexinv.Controller.of(similar(m, s), step=case.step * s)
    q, qd, qdd = Slower(case.motion, s).evaluate(m, case.step * s * np.arange(6))
    cycle.start(q[0], qd[0], qdd[0])
    return {
        "torque": efforts(m, np.array([cycle.step(*now).copy() for now in zip(q, qd, qdd, strict=True)][1:]), 1 / s)
    }


ENTRANCES: list[tuple[Callable[[str, float], Answers], str]] = [
    *((solve, name) for name in ("flex_two_link", "spatial_arm", "four_bar_flexible", "slider_crank_flexible")),
    *((solve, name) for name in ("geared_four_bar", "stewart_platform", "andrews_squeezer", "walker")),
    *((simulate, name) for name in ("flex_two_link", "four_bar_flexible", "stewart_platform", "walker")),
    *((statics, name) for name in ("flex_two_link", "spatial_arm", "four_bar_flexible", "slider_crank_flexible")),
    *((natural_modes, name) for name in ("spatial_arm", "four_bar_flexible", "slider_crank_flexible")),
    *((free_modes, name) for name in ("flex_two_link", "double_pendulum")),
    *((steady_modes, name) for name in ("spatial_arm", "four_bar_flexible")),
    *((blade, sweep) for sweep in ("15", "45")),
    (follow, "flex_two_link"),
    *((rigid, name) for name in ("ur5", "four_bar", "five_bar_redundant", "bricard", "stewart_platform")),
    *((controller, name) for name in ("flex_two_link", "spatial_arm")),
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("entrance", "name"), ENTRANCES, ids=[f"{e.__name__}-{n}" for e, n in ENTRANCES])
def test_similar_machines_have_similar_answers(entrance: Callable[[str, float], Answers], name: str) -> None:
    original = entrance(name, 1.0)
    for size in SIZES:
        for what, result in entrance(name, size).items():
            largest = np.abs(original[what]).max(initial=np.finfo(float).tiny)
            assert np.abs(result - original[what]).max(initial=0.0) <= ALIKE * largest, (what, size)


def test_a_small_blade_turns_like_a_large_one() -> None:
    original = blade("45", 1.0)
    result = blade("45", 5e-6)
    for what, values in original.items():
        np.testing.assert_allclose(result[what], values, rtol=ALIKE, atol=ALIKE * np.abs(values).max())
