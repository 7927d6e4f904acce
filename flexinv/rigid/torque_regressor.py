"""Inertial parameters of rigid mechanisms: the regressor Y with tau = Y pi, and the combinations that torques determine.

The order of pi is: for every link of the mechanism, in the order of ``mechanism.links``, about the origin of its link frame,

    m, h_x, h_y, h_z, I_xx, I_xy, I_yy, I_xz, I_yz, I_zz          (h = m c; Pinocchio's order)

and with ``drives`` for every joint that moves: rotor_inertia, damping, friction, and where its coordinate is one number
stiffness and stiffness times rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

import numpy as np
import scipy  # its parts are loaded when they are asked for
from numpy.typing import ArrayLike

from flexinv.elements.joint_law import compute_law_derivatives
from flexinv.errors import InputError
from flexinv.kinematics.configuration import build_nodes
from flexinv.kinematics.mesh import build
from flexinv.kinematics.nodal_motion import compute_rigid_motion, read_scalar_coordinate
from flexinv.model.by_value import ByValue
from flexinv.model.joint_kinds import KINDS
from flexinv.model.mechanism import Joint, Link, Mechanism
from flexinv.model.parallel_axis import compute_parallel_axis_term
from flexinv.rigid.joint_arrays import convert_to_states
from flexinv.rigid.regressor_kernel import PARAMETERS, fill_regressor
from flexinv.typing import Array, Indices
from flexinv.validation import check_flag, check_kind, check_whole_number

INERTIAL = ("m", "hx", "hy", "hz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
INERTIAL_UNITS = ("kg", *3 * ("kg m",), *6 * ("kg m^2",))
# A column that is this part of the others' span short of independence is dependent: rounding leaves 1e-15 of it.
DEPENDENT = 1e-9
# Coefficients of dependent parameters below this are rounding, not printed.
UNPRINTED = 1e-9


@dataclass(frozen=True, eq=False)
class Regressor(ByValue):
    """tau = matrix @ values of a rigid mechanism.

    matrix : (samples, nv, parameters), torque per unit of each parameter; names, units : (parameters,)
    values : (parameters,) what they are in the mechanism
    """

    matrix: Array
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array

    def stacked(self) -> Array:
        """Return the matrix (samples nv, parameters) [any unit] for least squares against ``torque.ravel()``."""
        return self.matrix.reshape(-1, len(self.names))


@dataclass(frozen=True, eq=False)
class BaseParameters(ByValue):
    """The combinations of parameters that a regressor can tell: Y pi = Y[:, columns] @ (combination @ pi).

    columns : (base,) parameters that stand for the combinations; combination : (base, parameters) [any unit]
    names : (parameters,) of all; values : (base,) of the combinations in the mechanism
    unseen : names of parameters that no torque shows
    """

    columns: Indices
    combination: Array
    names: tuple[str, ...]
    values: Array
    unseen: tuple[str, ...]

    @property
    def expressions(self) -> tuple[str, ...]:
        """(base,) the combinations in words: "arm.Izz + 0.25 hand.m" [-]."""
        out = []
        for row in self.combination:
            terms = list[str]()
            for factor, name in zip(row, self.names, strict=True):
                if abs(factor) > UNPRINTED:
                    size = "" if abs(abs(factor) - 1) < UNPRINTED else f"{abs(factor):.6g} "
                    first, sign = ("-", "- ") if factor < 0 else ("", "+ ")
                    terms.append(f"{sign if terms else first}{size}{name}")
            out.append(" ".join(terms))
        return tuple(out)


def compute_link_parameters(link: Link) -> Array:
    """Return m, h, I (10,) of a rigid link and all that it carries [kg], [kg m], [kg m^2], about its frame's origin."""
    out = np.zeros(PARAMETERS)
    for body in link.bodies:
        m = body.inertia.mass
        c = body.inertia.com
        tensor = body.inertia.tensor
        about = tensor + compute_parallel_axis_term(m, c)
        out += np.concatenate([[m], m * c, about[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]])
    return out


def torque_regressor(
    mechanism: Mechanism, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, drives: bool = False
) -> Regressor:
    """Return Y with tau = Y pi [N m], [N]: torques of a rigid tree as a linear function of its inertial parameters.

    q : (samples, nq) [rad], [m]; qd, qdd : (samples, nv); one sample may be a plain vector
    drives : with the joints' rotor inertia, damping, dry friction and springs as parameters, so that Y pi is `joint_torques`;
        without, ``joint_torques(..., passive=False)`` less rotors, which is Pinocchio's ``computeJointTorqueRegressor``
        (springs between points and given forces are in neither: their torque does not depend on these parameters)

    Raises InputError for a flexible mechanism, closures, wrong shapes, values that are not finite.
    Source of the form: Atkeson, An, Hollerbach, *Estimation of inertial parameters*, IJRR 5(3), 1986.
    """
    check_kind("mechanism", mechanism, Mechanism)
    if not mechanism.is_rigid:
        beams = ", ".join(link.name for link in mechanism.flexible)
        raise InputError(
            f"mechanism '{mechanism.name}' has links that bend ({beams}), and ten parameters for each link are those of "
            'rigid ones; write kind = "rigid" for them to see what torques tell of the rigid mechanism'
        )
    states = convert_to_states(mechanism, q, qd, qdd)
    drives = check_flag("drives", drives)
    mesh = build(mechanism)
    matrix = np.zeros((len(states[0]), mechanism.nv, PARAMETERS * len(mechanism.links)))
    frame_of = {j.child: mesh.joint_node[j.name] for j in mechanism.joints}
    nodes = np.array([frame_of[link.name] for link in mechanism.links], dtype=np.int64)
    gravity = np.array(mechanism.gravity, dtype=float)
    fill_regressor(build_nodes(mesh), nodes, gravity, compute_rigid_motion(mesh, *states).frames, matrix)
    names = [f"{link.name}.{p}" for link in mechanism.links for p in INERTIAL]
    values = np.concatenate([compute_link_parameters(link) for link in mechanism.links])
    parts = [(matrix, names, INERTIAL_UNITS * len(mechanism.links), values)]
    if drives:
        parts += [_build_drive_columns(mechanism, joint, *states) for joint in mechanism.moving_joints]
    columns, named, units, numbers = zip(*parts, strict=True)
    whole_matrix = np.concatenate(columns, axis=2)
    values = np.concatenate(numbers)
    return Regressor(whole_matrix, tuple(chain(*named)), tuple(chain(*units)), values)


def _build_drive_columns(
    mechanism: Mechanism, joint: Joint, *states: Array
) -> tuple[Array, list[str], tuple[str, ...], Array]:
    """Columns, names, units and values of what a joint's drive takes."""
    q, qd, qdd = states
    rows = mechanism.v_slices[joint.name]
    turns = KINDS[joint.kind].units != ("m",)
    place = np.zeros_like(qd[:, rows])
    if joint.nv == 1:
        place[:, 0] = read_scalar_coordinate(joint, q[:, mechanism.q_slices[joint.name]], history=False)
    columns = compute_law_derivatives(place, qd[:, rows], qdd[:, rows], np.sign(qd[:, rows]))
    keys = ["rotor_inertia", "damping", "friction", "stiffness", "stiffness_rest"]
    units = ("kg m^2", "N m s", "N m", "N m/rad", "N m") if turns else ("kg", "N s/m", "N", "N/m", "N")
    values = np.array([*(getattr(joint, key) for key in keys[:4]), joint.stiffness * joint.rest])
    count = 5 if joint.nv == 1 else 3  # springs stand in joints of one coordinate
    matrix = np.zeros((len(q), mechanism.nv, count))
    for k, column in enumerate(columns[:count]):
        matrix[:, rows, k] = column
    return matrix, [f"{joint.name}.{key}" for key in keys[:count]], units[:count], values[:count]


def base_parameters(regressor: Regressor) -> BaseParameters:
    """Return the combinations of parameters that the motion of a regressor can tell, by QR [any unit].

    Parameters are taken in their order: one whose column depends on those before it joins their combinations.  With states
    from `sample_states` these are the mechanism's base parameters (minimal set); with a measured motion what it identifies.
    Source: Gautier, *Numerical calculation of the base inertial parameters*, J. Robotic Systems 8(4), 1991.
    """
    y = check_kind("regressor", regressor, Regressor).stacked()
    size = np.linalg.norm(y, axis=0)
    if not size.any():
        raise InputError("base parameters: the regressor is zero; give a motion that moves the mechanism")
    seen = np.flatnonzero(size > DEPENDENT * size.max())
    scaled = y[:, seen] / size[seen]
    kept = list[int]()
    basis = np.zeros((len(y), 0))
    for k, column in enumerate(scaled.T):  # those that do not depend on the ones before them
        left = column - basis @ (basis.T @ column)
        left -= basis @ (basis.T @ left)  # once more: orthogonal to rounding
        length = np.linalg.norm(left)
        if length > DEPENDENT:
            kept.append(k)
            basis = np.column_stack([basis, left / length])
    chosen = seen[kept]
    rest = np.setdiff1d(seen, chosen)
    factor, r = scipy.linalg.qr(y[:, chosen] / size[chosen], mode="economic")
    combination = np.zeros((len(chosen), len(size)))
    combination[np.arange(len(chosen)), chosen] = 1.0
    by = scipy.linalg.solve_triangular(r, factor.T @ (y[:, rest] / size[rest]))
    combination[:, rest] = by * size[rest] / size[chosen][:, None]
    combination[np.abs(combination) < UNPRINTED] = 0.0
    unseen = tuple(name for k, name in enumerate(regressor.names) if k not in set(seen.tolist()))
    return BaseParameters(chosen, combination, regressor.names, combination @ regressor.values, unseen)


def sample_states(mechanism: Mechanism, samples: int, seed: int = 0) -> tuple[Array, Array, Array]:
    """Return q (samples, nq), qd, qdd (samples, nv) [rad], [m], [1/s] that move everything, in all directions."""
    check_kind("mechanism", mechanism, Mechanism)
    samples = check_whole_number("samples", samples, 0)
    random = np.random.default_rng(check_whole_number("seed", seed, 0))
    q = random.uniform(-1.0, 1.0, (samples, mechanism.nq))
    for joint in mechanism.joints:
        part = mechanism.q_slices[joint.name]
        kind = KINDS[joint.kind]
        if kind.circle or kind.has_quaternion:
            unit = slice(part.stop - (2 if kind.circle else 4), part.stop)
            turn = random.normal(size=(samples, unit.stop - unit.start))
            q[:, unit] = turn / np.linalg.norm(turn, axis=1, keepdims=True)
        elif not any(kind.translations):
            q[:, part] *= np.pi
    return q, random.normal(size=(samples, mechanism.nv)), random.normal(size=(samples, mechanism.nv))
