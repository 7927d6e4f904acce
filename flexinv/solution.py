"""Solution: what inverse dynamics gives, as NumPy arrays with names and units, and as pandas frames."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from flexinv.arguments import index
from flexinv.balance import Balance
from flexinv.impacts import Impact
from flexinv.inverse import Factors, NodalForces, factors
from flexinv.mechanism import Array, Mechanism
from flexinv.mesh import Mesh
from flexinv.nodal import NodalMotion

WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")


@dataclass(frozen=True)
class LoopForces:
    """What acts in the closures of a mechanism, and how its drives share the work.

    reaction : closure -> (samples, 6) force [N] and moment [N m] on the second link, at the closure, in the second frame (of a
        closure to the world as its second link: at and in the first frame)
    preload : (samples, nv, k) efforts that only stress the mechanism [-]: the null space of redundant drives (k = 0 with beams,
        where redundant drives are refused)
    condition : (samples,) of the drives' authority over the motions that the closures allow [-]: 1 where drives turn as the
        mechanism does, large where they hardly move it; with beams not computed (nan)
    left : (samples, nv) efforts that neither drives nor closures carry [N m], [N]: rounding where the drives suffice
    impacts : what happens at once where closures with impact = "plastic" begin to act
    """

    reaction: dict[str, Array]
    preload: Array
    condition: Array
    left: Array
    impacts: tuple[Impact, ...] = ()


@dataclass(frozen=True)
class Solution:
    """Joint torques, the motion they belong to, and their balances.

    time : (samples,) [s]; q : (samples, nq), qd, qdd : (samples, nv) [rad or m, s]
    torque_all : (samples, nv) effort of every velocity coordinate [N m] or [N]
    reaction : (samples, nv) the same from the elastic side (roots of the beams), an independent check [N m] or [N]
    nodes : NodalMotion; forces : NodalForces P; mesh : node numbers by joint and link
    tip : link -> (samples, 3) position in the world [m]
    deflection : beam -> (samples, 3) tip in the root (hub) frame less its undeformed place [m]
    wrench : joint -> (samples, 6) force [N] and moment [N m] on the child, at the joint, in the child's link frame
    internal : beam -> (samples, points, 6) axial, shear_y, shear_z [N], twist, bending_y, bending_z [N m]
    internal_stations : beam -> (points,) fraction of the length [-]
    balance : energies [J], power [W] and momentum [N] residuals
    torque_error, tip_error : error bars from refinement, None unless asked for; (samples, actuated) [N m]; link -> (samples,) [m]
    iterations : (samples,) of Newton; settings : what was used
    loops : forces in closures and the sharing among drives; None without closures
    """

    mechanism: Mechanism
    mesh: Mesh
    time: Array
    q: Array
    qd: Array
    qdd: Array
    torque_all: Array
    reaction: Array
    nodes: NodalMotion
    forces: NodalForces
    tip: dict[str, Array]
    deflection: dict[str, Array]
    wrench: dict[str, Array]
    internal: dict[str, Array]
    internal_stations: dict[str, Array]
    balance: Balance
    iterations: NDArray[np.int64]
    settings: dict[str, float | int | str | bool]
    torque_error: Array | None = None
    tip_error: dict[str, Array] | None = None
    notes: tuple[str, ...] = field(default_factory=tuple)
    loops: LoopForces | None = None

    @property
    def torque(self) -> Array:
        """(samples, actuated) effort of the actuators [N m] or [N], columns as in ``torque_names``."""
        return self.torque_all[:, self.mechanism.actuated]

    @property
    def torque_names(self) -> tuple[str, ...]:
        """Names of the actuated coordinates."""
        return tuple(n for n, a in zip(self.mechanism.velocity_names, self.mechanism.actuated, strict=True) if a)

    @property
    def unactuated(self) -> Array:
        """(samples, nv - actuated) effort [N m], [N] along coordinates without actuator: what a base would have to give."""
        return self.torque_all[:, ~self.mechanism.actuated]

    @property
    def unactuated_names(self) -> tuple[str, ...]:
        """Names of the coordinates without actuator."""
        return tuple(n for n, a in zip(self.mechanism.velocity_names, self.mechanism.actuated, strict=True) if not a)

    @property
    def power_residual(self) -> Array:
        """(samples,) residual of the instantaneous power balance [W]."""
        return self.balance.power

    @property
    def momentum_residual(self) -> Array:
        """(samples, 6) residual of the momentum balance [N], [N m]."""
        return self.balance.momentum

    def factors(self, sample: int) -> Factors:
        """Return L [m], T [-], P [N] of one sample; ``L @ T @ P`` is the torque before rotor inertia, damping, friction.

        sample : its number, from 0, or from the end below 0 [-].  Raises InputError where there is none.
        """
        return factors(self.mesh, self.nodes, self.forces, index("sample", sample, len(self.time)))

    def frame(self) -> pd.DataFrame:
        """Return joint motion and torque over time [s], one column per coordinate with its unit in the header."""
        m = self.mechanism
        columns: dict[str, Array] = {}
        for label, values, derivative in (
            ("position", self._scalar_q(), 0),
            ("rate", self.qd, 1),
            ("acceleration", self.qdd, 2),
        ):
            for name, unit, column in zip(m.velocity_names, _motion_units(m, derivative), values.T, strict=True):
                if np.isfinite(column).all():
                    columns[f"{label} {name} [{unit}]"] = column
        for name, unit, column in zip(m.velocity_names, effort_units(m), self.torque_all.T, strict=True):
            columns[f"{'torque' if unit == 'N m' else 'force'} {name} [{unit}]"] = column
        return pd.DataFrame(columns, index=pd.Index(self.time, name="time [s]"))

    def _scalar_q(self) -> Array:
        """(samples, nv) coordinates as angles or lengths; nan where a joint has none (rotations in space)."""
        out = np.full_like(self.qd, np.nan)
        for joint in self.mechanism.joints:
            own, at = self.q[:, self.mechanism.q_slices[joint.name]], self.mechanism.v_slices[joint.name]
            if joint.kind == "continuous":
                out[:, at] = np.unwrap(np.arctan2(own[:, 1], own[:, 0]))[:, None]
            elif joint.nq == joint.nv:
                out[:, at] = own
        return out

    def tip_frame(self) -> pd.DataFrame:
        """Return tip positions [m] and deflections [m] of the links over time [s]."""
        columns = {f"tip {k} {c} [m]": v[:, i] for k, v in self.tip.items() for i, c in enumerate("xyz")}
        columns |= {f"deflection {k} {c} [m]": v[:, i] for k, v in self.deflection.items() for i, c in enumerate("xyz")}
        return pd.DataFrame(columns, index=pd.Index(self.time, name="time [s]"))

    def wrench_frame(self) -> pd.DataFrame:
        """Return the wrench of every joint over time [s], in the child's link frame [N], [N m]."""
        columns = {
            f"{c} {joint} [{'N' if c[0] == 'f' else 'N m'}]": w[:, i]
            for joint, w in self.wrench.items()
            for i, c in enumerate(WRENCH)
        }
        return pd.DataFrame(columns, index=pd.Index(self.time, name="time [s]"))

    def summary(self) -> pd.DataFrame:
        """Return peak and RMS torque, speed and power of each coordinate against its limits, a row per coordinate.

        Columns: peak effort, rms effort [N m] or [N], peak speed [rad/s] or [m/s], peak power [W], and the parts of the
        effort and speed limits that are used [-] (nan where no limit is stated).
        """
        m = self.mechanism
        joints = [j for j in m.joints for _ in range(j.nv)]
        effort, speed = np.abs(self.torque_all).max(axis=0), np.abs(self.qd).max(axis=0)
        limit_effort, limit_speed = (np.array([getattr(j.limits, k) for j in joints]) for k in ("effort", "velocity"))
        rows = {
            "unit": effort_units(m),
            "peak effort": effort,
            "rms effort": np.sqrt((self.torque_all**2).mean(axis=0)),
            "peak speed": speed,
            "peak power [W]": np.abs(self.torque_all * self.qd).max(axis=0),
            "effort / limit [-]": np.where(np.isfinite(limit_effort), effort / limit_effort, np.nan),
            "speed / limit [-]": np.where(np.isfinite(limit_speed), speed / limit_speed, np.nan),
        }
        return pd.DataFrame(rows, index=pd.Index(m.velocity_names, name="coordinate"))


def _is_force(mechanism: Mechanism) -> list[bool]:
    """Which velocity coordinates are translations."""
    out = []
    for joint in mechanism.joints:
        out += [joint.kind == "prismatic" or (joint.kind == "free" and k < 3) for k in range(joint.nv)]
    return out


def effort_units(mechanism: Mechanism) -> list[str]:
    """Return "N" or "N m" for every velocity coordinate, the unit of its effort [N], [N m]."""
    return ["N" if force else "N m" for force in _is_force(mechanism)]


def _motion_units(mechanism: Mechanism, derivative: int) -> list[str]:
    per = ("", "/s", "/s^2")[derivative]
    return [("m" if force else "rad") + per for force in _is_force(mechanism)]
