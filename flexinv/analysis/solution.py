"""Solution: what inverse dynamics gives, as NumPy arrays with names and units, and as pandas frames."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import compress
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from flexinv.constraints.reactions import Impact
from flexinv.display.card import Card, Shown
from flexinv.dynamics.section_strains import compute_section_strains
from flexinv.errors import ConvergenceError
from flexinv.inverse.balance import Balance
from flexinv.inverse.inverse_dynamics import Factors, NodalForces, compute_torque_factors
from flexinv.inverse.part_results import PartStress, build_part_stress, compute_interface_wrenches
from flexinv.kinematics.mesh import Mesh, find_outboard_nodes
from flexinv.kinematics.nodal_motion import NodalMotion, collect_scalar_places
from flexinv.model.by_value import ByValue
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Link, Mechanism
from flexinv.typing import Array, Indices
from flexinv.validation import check_names, check_seconds, resolve_index

if TYPE_CHECKING:
    import pandas as pd

    from flexinv.display.animation import Animation
    from flexinv.display.figures import Figure
    from flexinv.linearized.residual_vibration import ResidualVibration

# What the steps of a march may lose or make of the energy exchanged: torques are off by as much.  Cases of models/: < 0.001.
MOST_LOST = 0.01
# An effort, an impact or what damping takes after it jumps at few samples of a run; where power jumps at more, it is nonsense.
JUMPS = 16
# Times the median bend of the power, which no jump makes: a motion sampled at ten points of a wave bends by two medians.
STANDS_OUT = 4.0
# A mechanism that moves by less than this part of its length in the whole run stands still: its energies are rounding.
STANDING = 1e-5
# Motion that goes on by itself exchanges nothing: of the energy that is there, the steps may lose or make this much.
DRIFT = 1e-5
# Where no joint is driven there is no torque to be off: rates are, by half of the part of the energy that is lost or made.
UNDRIVEN_DRIFT = MOST_LOST / 10

WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")
RESULTANTS = ("axial", "shear_y", "shear_z", "twist", "bending_y", "bending_z")


@dataclass(frozen=True, eq=False)
class LoopForces(ByValue):
    """Reactions of the closures of a mechanism, and the allocation of efforts to its actuators.

    reaction : closure -> (samples, 6) force [N] and moment [N m] on the second link, at the closure, in the second frame (in the
        first, and there, where the second link is the world)
    preload : (samples, nv, k) efforts that only stress the mechanism [-], null space of redundant drives (k = 0 with beams)
    condition : (samples,) of the drives' authority over the motions that the closures allow [-]: 1 where drives turn as the
        mechanism does, large where they hardly move it; with beams not computed (nan)
    left : (samples, nv) efforts that neither drives nor closures carry [N m], [N]: rounding where the drives suffice
    impacts : at the instants at which closures with impact = "plastic" begin to act
    """

    reaction: dict[str, Array]
    preload: Array
    condition: Array
    left: Array
    impacts: tuple[Impact, ...] = ()


@dataclass(frozen=True, eq=False, repr=False)
class Solution(Shown, ByValue):
    """Joint torques, the motion they belong to, and their balances.

    time : (samples,) [s]; q : (samples, nq), qd, qdd : (samples, nv) [rad or m, s]
    torque_all : (samples, nv) effort of every velocity coordinate [N m] or [N]
    reaction : (samples, nv) the same from the elastic side (roots of the beams), an independent check [N m] or [N]
    nodes : NodalMotion; forces : NodalForces P; mesh : node numbers by joint and link
    tip : link -> (samples, 3) position in the world [m]
    deflection : beam -> (samples, 3) tip in the root (hub) frame less its undeformed place [m]
    wrench : joint -> (samples, 6) force [N] and moment [N m] on the child, at the joint, in the child's link frame
    internal : beam -> (samples, points, 6) axial, shear_y, shear_z [N], twist, bending_y, bending_z [N m], at the Gauss points,
        none of which is the root (``root``) or the tip
    internal_stations : beam -> (points,) where these points are, fraction of the length [-]
    stable : of statics, whether the equilibrium is one that a structure stays in; None where it was not looked at
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
    iterations: Indices
    settings: dict[str, float | int | str | bool]
    torque_error: Array | None = None
    tip_error: dict[str, Array] | None = None
    notes: tuple[str, ...] = field(default_factory=tuple)
    loops: LoopForces | None = None
    stable: bool | None = None

    def _make_card(self) -> Card:
        from flexinv.analysis.views.solution_card import make_solution_card

        return make_solution_card(self)

    @property
    def torque(self) -> Array:
        """(samples, actuated) effort of the actuators [N m] or [N], columns as in ``torque_names``."""
        return self.torque_all[:, self.mechanism.actuated]

    @property
    def torque_names(self) -> tuple[str, ...]:
        """Names of the actuated coordinates."""
        return tuple(compress(self.mechanism.velocity_names, self.mechanism.actuated))

    @property
    def unactuated(self) -> Array:
        """(samples, nv - actuated) effort [N m], [N] along coordinates without actuator: what a base would have to give."""
        return self.torque_all[:, ~self.mechanism.actuated]

    @property
    def unactuated_names(self) -> tuple[str, ...]:
        """Names of the coordinates without actuator."""
        return tuple(compress(self.mechanism.velocity_names, ~self.mechanism.actuated))

    @cached_property
    def root(self) -> dict[str, Array]:
        """Beam -> (samples, 6) axial, shear_y, shear_z [N], twist, bending_y, bending_z [N m] at its root section."""
        return {
            link.name: compute_root_resultants(self.mesh, link, self.nodes, self.forces)
            for link in self.mesh.mechanism.beams
        }

    @cached_property
    def strain(self) -> dict[str, Array]:
        """Beam -> (samples, points, 6) axial, shear_y, shear_z [-], twist, bending_y, bending_z [1/m] at ``internal_stations``.

        Beside the shape without stress; damping has no part in them.
        """
        return compute_section_strains(self.mesh, self.nodes)

    @cached_property
    def stress(self) -> dict[str, PartStress]:
        """Meshed link -> von Mises's stress at the nodes of its mesh [Pa]; links of ready matrices have none."""
        links = [link.name for link in self.mesh.mechanism.meshed if link.part is not None and link.part.cells]
        return {link: build_part_stress(self.mesh, self.nodes, link) for link in links}

    @cached_property
    def interface_wrench(self) -> dict[tuple[str, str], Array]:
        """(Link, interface) -> (samples, 6) force [N] and moment [N m] that a meshed link gives to what is attached there.

        About the origin of the interface's frame and along its axes; of all interfaces but the root.
        """
        return compute_interface_wrenches(self.mesh, self.nodes, self.forces)

    @property
    def power_residual(self) -> Array:
        """(samples,) residual of the instantaneous power balance [W]."""
        return self.balance.power

    @property
    def momentum_residual(self) -> Array:
        """(samples, 6) residual of the momentum balance [N], [N m]."""
        return self.balance.momentum

    @property
    def marched(self) -> bool:
        """Return True if the motion was found by time integration, not given as a whole [-]."""
        return bool(self.iterations.any()) and len(self.time) > 1

    @property
    def energy_exchanged(self) -> float:
        """Return the energy exchanged [J], the scale of `energy_error`: work put in and taken out, the widest change of one."""
        b = self.balance
        power = np.abs(self.torque_all * self.qd).sum(axis=1)
        widest = max(float(np.ptp(energy)) for energy in (b.kinetic, b.potential, b.elastic))
        return float(np.trapezoid(power, self.time)) + widest

    @property
    def energy_error(self) -> float:
        """Return the defect of the energy balance [J]: the energy that the time integration has lost or made.

        The largest ``balance.work`` less `energy_summed`.  Where nothing was marched (rigid links whose motion is given) the
        spacing of the samples says nothing of the torques: there it is the integral of what the power balance leaves.
        """
        if not self.marched:
            return float(np.trapezoid(np.abs(self.balance.power), self.time))
        return max(float(np.abs(self.balance.work).max()) - self.energy_summed, 0.0)

    @property
    def energy_summed(self) -> float:
        """Return the error of the trapezoidal sum in ``balance.work`` [J]: where power jumps, at `JUMPS` samples at most.

        A jump stands out from the bends of the power at other samples (`STANDS_OUT` times their median): where all are as large,
        the samples are too far apart for what moves, which is an error of the steps.
        """
        power = (self.torque_all * self.qd).sum(axis=1) - self.balance.dissipated
        if len(power) < 3:
            return 0.0
        bends = np.sort(np.abs(np.diff(power, 2)))
        jumps = bends[bends > STANDS_OUT * np.median(bends)][-JUMPS:]
        return float(jumps.sum() * (self.time[1] - self.time[0]) / 4)

    def check_energy(self) -> None:
        """Raise ConvergenceError where the steps lose or make more than `MOST_LOST` of the energy exchanged [J]."""
        if not self.marched:
            return
        duration = float(self.time[-1] - self.time[0])
        mesh = self.mesh
        slow = 0.5 * float(mesh.mass.sum()) * (STANDING * mesh.length / duration) ** 2
        is_driven = any(joint.actuated for joint in self.mechanism.joints)
        held = (DRIFT if is_driven else UNDRIVEN_DRIFT) * float(self.balance.kinetic.max())
        if float(np.abs(self.balance.work).max()) <= MOST_LOST * float(np.ptp(self.balance.kinetic)) + slow + held:
            return  # less than what the sums below would allow
        error = self.energy_error
        exchanged = self.energy_exchanged
        step = float(self.settings["step"])
        if error <= MOST_LOST * exchanged + slow + held:
            return
        first = float(self.time[int(np.argmax(np.abs(self.balance.work) > 0.5 * error))])
        wanted = step / 2 ** max(1, int(np.ceil(np.log2(error / (MOST_LOST * exchanged)) / 2)))
        raise ConvergenceError(
            f"mechanism '{self.mechanism.name}', around t = {first:g} s (step {step:g} s): the steps lose or make {error:.3g} J "
            f"of the {exchanged:.3g} J that are exchanged, more than {MOST_LOST:.0%}: something moves faster than they see; "
            f"write step = {wanted:.3g} or smaller, damping (retardation_s of a section), or initial = 'static'"
        )

    def find_residual_vibration(self, free: Collection[str] | None = None) -> ResidualVibration:
        """Return the vibration that goes on after the last sample: energy [J], reach of the tips [m], by mode, in closed form.

        free : names of joints that go on moving; by default those without a drive.  Dry friction is left out.
        Raises InputError where no link bends, where a joint still moves that is held from then on, where closures switch, and for
        what `linearized.residual_vibration` cannot have; ConvergenceError where there is no rest position.
        """
        from flexinv.linearized.residual_vibration import compute_residual_vibration

        m = self.mesh.mechanism
        undriven = m.undriven_names
        moving = undriven if free is None else check_names("free", free, "joints")
        return compute_residual_vibration(self.mesh, (self.q, self.qd, self.qdd), tuple(moving), self.nodes, self.tip)

    def factors(self, sample: int) -> Factors:
        """Return L [m], T [-], P [N] of one sample; ``L @ T @ P`` is the torque before rotor inertia, damping, friction.

        sample : its number, from 0, or from the end below 0 [-].  Raises InputError where there is none.
        """
        return compute_torque_factors(
            self.mesh, self.nodes, self.forces, resolve_index("sample", sample, len(self.time))
        )

    def frame(self) -> pd.DataFrame:
        """Return joint motion and torque over time [s], one column per coordinate with its unit in the header.

        Of meshed links also the largest von Mises stress [Pa] and the wrenches at interfaces [N], [N m].
        """
        m = self.mechanism
        columns = dict[str, Array]()
        series = (
            ("position", "", collect_scalar_places(m, self.q)),
            ("rate", "/s", self.qd),
            ("acceleration", "/s^2", self.qdd),
        )
        for label, per, values in series:
            units = (unit for joint in m.joints for unit in KINDS[joint.kind].units)
            for name, unit, column in zip(m.velocity_names, units, values.T, strict=True):
                if np.isfinite(column).all():
                    columns[f"{label} {name} [{unit}{per}]"] = column
        columns |= dict(zip(list_effort_labels(m), self.torque_all.T, strict=True))
        columns |= {f"largest stress {link} [Pa]": stress.largest for link, stress in self.stress.items()}
        named = {f"{link} {interface}": wrench for (link, interface), wrench in self.interface_wrench.items()}
        columns |= _collect_wrench_columns(named)
        return _build_frame(columns, self.time)

    def tip_frame(self) -> pd.DataFrame:
        """Return tip positions [m] and deflections [m] of the links over time [s]."""
        columns = {f"tip {k} {c} [m]": v[:, i] for k, v in self.tip.items() for i, c in enumerate("xyz")}
        columns |= {f"deflection {k} {c} [m]": v[:, i] for k, v in self.deflection.items() for i, c in enumerate("xyz")}
        return _build_frame(columns, self.time)

    def internal_frame(self) -> pd.DataFrame:
        """Return the resultants of the beams over time [s], at their roots and Gauss points, by station [N], [N m]."""
        columns: dict[str, Array] = {}
        for link, values in self.internal.items():
            points = [(f"{station:.6f}", values[:, k]) for k, station in enumerate(self.internal_stations[link])]
            for station, resultants in [("root", self.root[link]), *points]:
                for name, unit, column in zip(RESULTANTS, 3 * ("N",) + 3 * ("N m",), resultants.T, strict=True):
                    columns[f"{name} {link} at {station} [{unit}]"] = column
        return _build_frame(columns, self.time)

    def plot(self) -> Figure:
        """Return a matplotlib Figure: efforts of the actuators [N m], [N], error bars where there are some, deflections [m].

        `whole_frame` has its numbers.  Raises InputError where matplotlib is not installed.
        """
        from flexinv.analysis.views.solution_figures import draw_solution
        from flexinv.display.figures import check_matplotlib

        check_matplotlib("solution.plot()")
        return draw_solution(self, self.mechanism.name)

    def animate(self, seconds: float | None = None) -> Animation:
        """Return the mechanism in motion as a moving picture, which a notebook shows and ``save`` writes (.html, .svg).

        seconds : that it takes [s]; None: as long as the motion, 3 s at least and 20 s at most
        Raises InputError for a time that is none, and for a solution that has one sample.
        """
        from flexinv.analysis.views.solution_figures import draw_moving_solution

        taken = None if seconds is None else check_seconds("seconds", seconds, "a time above 0 [s], or None")
        return draw_moving_solution(self, taken)

    def whole_frame(self) -> pd.DataFrame:
        """Return `frame` and `tip_frame` over time [s] side by side, and the error bars where there are some [N m], [N], [m]."""
        m = self.mechanism
        bars = dict[str, Array]()
        if self.torque_error is not None:
            labels = compress(list_effort_labels(m), m.actuated)
            bars = {f"error of {label}": column for label, column in zip(labels, self.torque_error.T, strict=True)}
        bars |= {f"error of tip {link} [m]": column for link, column in (self.tip_error or {}).items()}
        import pandas

        return pandas.concat([self.frame(), self.tip_frame(), _build_frame(bars, self.time)], axis=1)

    def wrench_frame(self) -> pd.DataFrame:
        """Return the wrench of every joint over time [s], in the child's link frame [N], [N m]."""
        return _build_frame(_collect_wrench_columns(self.wrench), self.time)

    def summary(self) -> pd.DataFrame:
        """Return peak and RMS torque, speed and power of each coordinate against its limits, a row per coordinate.

        Columns: peak effort, rms effort [N m] or [N], peak speed [rad/s] or [m/s], peak power [W], and the parts of the
        effort and speed limits that are used [-] (nan where no limit is stated).
        """
        m = self.mechanism
        joints = [j for j in m.joints for _ in range(j.nv)]
        effort = np.abs(self.torque_all).max(axis=0)
        speed = np.abs(self.qd).max(axis=0)
        limit_effort, limit_speed = (np.array([getattr(j.limits, k) for j in joints]) for k in ("effort", "velocity"))
        rows = {
            "unit": list_effort_units(m), "peak effort": effort, "rms effort": np.sqrt((self.torque_all**2).mean(axis=0)),
            "peak speed": speed, "peak power [W]": np.abs(self.torque_all * self.qd).max(axis=0),
            "effort / limit [-]": np.where(np.isfinite(limit_effort), effort / limit_effort, np.nan),
            "speed / limit [-]": np.where(np.isfinite(limit_speed), speed / limit_speed, np.nan),
        }  # fmt: skip
        return _build_frame(rows, m.velocity_names, "coordinate")


def _collect_wrench_columns(wrenches: Mapping[str, Array]) -> dict[str, Array]:
    """Columns of wrenches (samples, 6) by what they act on, with their units."""
    labels = [f"{c} {name} [{'N' if c[0] == 'f' else 'N m'}]" for name in wrenches for c in WRENCH]
    return dict(zip(labels, (column for wrench in wrenches.values() for column in wrench.T), strict=True))


def _build_frame(columns: Mapping[str, ArrayLike], rows: ArrayLike, name: str = "time [s]") -> pd.DataFrame:
    import pandas  # whoever wants no table does not wait for it

    return pandas.DataFrame(columns, index=pandas.Index(rows, name=name))


def list_effort_units(mechanism: Mechanism) -> list[str]:
    """Return "N" or "N m" for every velocity coordinate, the unit of its effort [N], [N m]."""
    return ["N" if force else "N m" for joint in mechanism.joints for force in KINDS[joint.kind].translations]


def list_effort_labels(mechanism: Mechanism) -> list[str]:
    """Return "torque NAME [N m]" or "force NAME [N]" for every velocity coordinate, the column of its effort [N m], [N]."""
    units = zip(mechanism.velocity_names, list_effort_units(mechanism), strict=True)
    return [f"{'torque' if unit == 'N m' else 'force'} {name} [{unit}]" for name, unit in units]


def compute_root_resultants(mesh: Mesh, link: Link, motion: NodalMotion, forces: NodalForces) -> Array:
    """Return the resultants (samples, 6) at a beam's root [N], [N m]: minus the sum of P over all nodes beyond it, and of its own
    share of mass there alone.
    """
    root = mesh.section_nodes[link.name][0]
    outer = find_outboard_nodes(mesh, int(mesh.section_nodes[link.name][1]))
    arm = motion.x[:, outer] - motion.x[:, [root]]
    mass = mesh.mass[root]
    inertia = mesh.inertia[root].copy()
    for body in (one for one in link.bodies if mesh.body_node[(link.name, one.name)] == root):
        mass = mass - body.inertia.mass
        inertia = inertia - body.inertia.tensor
    w = motion.omega[:, root]
    al = motion.alpha[:, root]
    r = motion.rotation[:, root]
    force = forces.force[:, outer].sum(axis=1) + mass * (motion.a[:, root] - mesh.mechanism.gravity)
    moment = (forces.moment[:, outer] + np.cross(arm, forces.force[:, outer])).sum(axis=1)
    force, moment = (np.einsum("sji,sj->si", r, part) for part in (force, moment))
    return -np.hstack([force, moment + al @ inertia.T + np.cross(w, w @ inertia.T)])
