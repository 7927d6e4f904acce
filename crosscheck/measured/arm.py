"""The measured arm: expected readings of its sensors, from the measured motion of its two motors.

Torque of a drive, at the joint:  current * K = rotor qdd + viscous qd + coulomb tanh(qd / STILL) + offset + tau(mechanism),
K = torque constant * gear * efficiency.  A gauge at the root of a beam reads  gain * M L / (3 EI) + zero + slope q1, the
tip deflection over the length under a force there; the rig filters it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from crosscheck.measured.filters import lag, low_pass
from crosscheck.measured.fit import Parameter
from crosscheck.measured.recording import Recording
from flexinv.analysis.solve import solve
from flexinv.model.mechanism import Joint, Mechanism
from flexinv.model.motion import Motion

Array = NDArray[np.float64]
COLUMNS = ("shoulder_deg", "elbow_deg", "gauge1_deg", "gauge2_deg", "current1_A", "current2_A")
CHANNELS = (
    ("torque of the shoulder", "N m"),
    ("torque of the elbow", "N m"),
    ("gauge of link 1", "rad"),
    ("gauge of link 2", "rad"),
)
TORQUES = 2  # of the channels, the first ones
DRIVES, CLAMPS, BEAMS = ("shoulder", "elbow"), ("clamp1", "clamp2"), ("link1", "link2")
# config_2dslf.m: 0.75 * 0.119 N m/A * 100 and 0.75 * 0.0232 N m/A * 50.
NM_PER_A = (8.925, 0.870)
# q_2dsfl_pos_cntrl.slx, Filter3: [wcfa^2] / [1 2*zetaf*wcfa wcfa^2] with wcfa = 2 pi 2 rad/s, zetaf = 0.9 (setup_2dsfl.m).
GAUGE_HZ, GAUGE_DAMPING = 2.0, 0.9
# Slower than this [rad/s] a joint counts as standing: its dry friction then balances whatever the drive does, up to its limit.
STILL = 0.02
# Of the motion [Hz]: eight times the first natural frequency; the drives' own vibration at 22 to 33 Hz is left away.
BANDWIDTH = 15.0


@dataclass(frozen=True)
class Sensed:
    """A part of the record, made ready: the motion to follow and what was measured under it.

    motion : of the drives, low-passed; q, qd, qdd : (samples, 2) [rad, s]; sliding : (samples, 2) joint is not standing
    measured, raw : (samples, 4) torques [N m] low-passed, and as recorded; gauges [rad] as recorded
    """

    part: Recording
    motion: Motion
    q: Array
    qd: Array
    qdd: Array
    sliding: NDArray[np.bool_]
    measured: Array
    raw: Array

    @property
    def used(self) -> NDArray[np.bool_]:
        """(samples, 4) what counts in the identification: torques of joints that slide, gauges always."""
        return np.column_stack([self.sliding, np.ones_like(self.sliding)])


def sense(part: Recording, mechanism: Mechanism, bandwidth: float = BANDWIDTH) -> Sensed:
    """Return a part of the record with its motion differentiated inside it, at the bandwidth [Hz]."""
    signals, h = part.signals, part.spacing
    angles = [np.radians(low_pass(signals[name], h, bandwidth)) for name in COLUMNS[:2]]
    motion = Motion.from_samples(part.time, dict(zip(DRIVES, angles, strict=True)))
    rows = [mechanism.v_slices[name].start for name in DRIVES]
    q, qd, qdd = (a[:, rows] for a in motion.evaluate(mechanism, part.time))
    torque = np.column_stack([k * signals[name] for k, name in zip(NM_PER_A, COLUMNS[4:], strict=True)])
    gauge = np.radians(np.column_stack([signals[name] for name in COLUMNS[2:4]]))
    smooth = np.column_stack([low_pass(column, h, bandwidth) for column in torque.T])
    moving = np.abs(qd) > STILL
    return Sensed(part, motion, q, qd, qdd, moving, np.hstack([smooth, gauge]), np.hstack([torque, gauge]))


# ------------------------------------------------------------------------------------------------ what is left open


def mechanical(flexible: bool) -> tuple[Parameter, ...]:
    """Return the parameters of the mechanism that the sheet leaves open; only the flexible one has clamps that yield."""
    reach = Parameter("reach 2", "m", 0.02, 0.02, 0.0)  # from the elbow's axis to the root of the second beam
    if not flexible:
        return (reach,)
    return (
        Parameter("stiffness 1", "N m/rad", 50.0, 10.0, 1.0),
        Parameter("damping 1", "N m s/rad", 0.3, 0.1, 0.0),
        Parameter("stiffness 2", "N m/rad", 30.0, 10.0, 0.5),
        Parameter("damping 2", "N m s/rad", 0.1, 0.05, 0.0),
        reach,
    )


def of_sensors() -> tuple[Parameter, ...]:
    """Return the parameters of drives and gauges that the sheet leaves open: units by name, begun with its values."""
    sheet = {1: (0.0635, 4.0, 1.0), 2: (0.0030, 1.5, 0.1)}  # J11, B11; J21, B21
    drives = [
        p
        for k, (rotor, viscous, coulomb) in sheet.items()
        for p in (
            Parameter(f"rotor {k}", "kg m^2", rotor, rotor, 0.0),
            Parameter(f"viscous {k}", "N m s/rad", viscous, viscous, 0.0),
            Parameter(f"coulomb {k}", "N m", coulomb, coulomb, 0.0),
            Parameter(f"offset {k}", "N m", 0.0, coulomb),
        )
    ]
    gauges = [
        p
        for k in (1, 2)
        for p in (
            Parameter(f"gain {k}", "-", 1.0, 1.0, 0.0),
            Parameter(f"zero {k}", "rad", 0.0, 1e-3),
            Parameter(f"slope {k}", "rad/rad", 0.0, 1e-3),
        )
    ]
    return (*drives, *gauges)


def with_values(mechanism: Mechanism, value: Mapping[str, float]) -> Mechanism:
    """Return the arm with clamps [N m/rad], [N m s/rad] and reach [m] as identified, its drives left to `readings`."""

    def changed(joint: Joint) -> Joint:
        if joint.name in DRIVES:
            return replace(joint, rotor_inertia=0.0, damping=0.0, friction=0.0)
        if joint.name not in CLAMPS:
            return joint
        k = CLAMPS.index(joint.name) + 1
        if f"stiffness {k}" in value:
            joint = replace(joint, stiffness=value[f"stiffness {k}"], damping=value[f"damping {k}"])
        place = joint.placement
        return (
            replace(joint, placement=replace(place, position=np.array([value["reach 2"], 0, 0]))) if k == 2 else joint
        )

    return replace(mechanism, joints=tuple(changed(j) for j in mechanism.joints))


# ----------------------------------------------------------------------------------------------------- prediction


@dataclass(frozen=True)
class Response:
    """Response of the mechanism alone to the measured motion.

    torque : (samples, 2) of the drives [N m]; moment : (samples, 2) at the roots of the links [N m], as it bends them
        towards positive deflection
    """

    torque: Array
    moment: Array


def respond(mechanism: Mechanism, sensed: Sensed, step: float = 0.0) -> Response:
    """Return torques and root moments [N m] under the measured motion; step : [s], the spacing of the samples by default."""
    spacing = sensed.part.spacing
    every = round(spacing / step) if step else 1
    solution = solve(mechanism, sensed.motion, spacing / every, every=every)
    rows = [mechanism.v_slices[name].start for name in DRIVES]
    moment = np.column_stack([-solution.wrench[name][:, 5] for name in CLAMPS])
    return Response(solution.torque_all[:, rows], moment)


def flexibilities(arm: Mechanism) -> Array:
    """Return ``L / (3 EI)`` of the two beams of the flexible arm [rad/(N m)]: what the rig makes of a moment."""
    beams = [link.beam for link in arm.beams]
    return np.array([b.length / (3.0 * b.section.stiffness[0, 5]) for b in beams if b is not None])


def readings(response: Response, sensed: Sensed, flexibility: Array, value: Mapping[str, float]) -> Array:
    """Return the expected readings of the sensors, (samples, 4): torques [N m], gauges [rad] filtered as on the rig."""
    columns = []
    for k in range(TORQUES):
        rotor, viscous, coulomb, offset = (value[f"{n} {k + 1}"] for n in ("rotor", "viscous", "coulomb", "offset"))
        qd = sensed.qd[:, k]
        own = rotor * sensed.qdd[:, k] + viscous * qd + coulomb * np.tanh(qd / STILL) + offset
        columns.append(response.torque[:, k] + own)
    for k in range(len(BEAMS)):
        gain, zero, slope = (value[f"{n} {k + 1}"] for n in ("gain", "zero", "slope"))
        bent = gain * flexibility[k] * response.moment[:, k] + zero + slope * sensed.q[:, 0]
        columns.append(lag(bent, sensed.part.spacing, GAUGE_HZ, GAUGE_DAMPING))
    return np.column_stack(columns)


def predictor(
    mechanism: Mechanism, parts: tuple[Sensed, ...], flexibility: Array, step: float = 0.0
) -> Callable[[Mapping[str, float]], Array]:
    """Return the readings (samples of all parts, 4) [N m], [rad] as a function of the parameters' values.

    The mechanism is solved anew only where its own parameters change: those of the sensors cost nothing.

    step : of the time integration [s], the spacing of the samples by default
    """
    names = [p.name for p in mechanical(not mechanism.is_rigid)]

    @lru_cache(maxsize=2)
    def solved(values: tuple[float, ...]) -> tuple[Response, ...]:
        changed = with_values(mechanism, dict(zip(names, values, strict=True)))
        return tuple(respond(changed, part, step) for part in parts)

    def predict(value: Mapping[str, float]) -> Array:
        responses = solved(tuple(value[name] for name in names))
        return np.vstack([readings(r, s, flexibility, value) for r, s in zip(responses, parts, strict=True)])

    return predict
