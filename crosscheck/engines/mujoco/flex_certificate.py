"""Certificate of MuJoCo's model of a rod: body_mass, and the passive forces of its points in two given shapes.

    stretched by e      force on the last point along the rod     = -EA e
    bent into an arc    force on the last point across the rod    = -EI theta / l^2      (theta between edges of length l)

Bending acts on the last point through one angle only: E = EI theta^2 / (2 l), d theta / d y = 1 / l.
"""

from __future__ import annotations

import mujoco
import numpy as np

from crosscheck.engines.mujoco.flex import ELEMENTS, plan_steps
from crosscheck.engines.mujoco.joints import BuiltModel
from crosscheck.engines.mujoco.rod import Rod, build_flexible_model, build_rod
from crosscheck.engines.shared.probe_states import Array
from crosscheck.measures.certificate import Certificate
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism

# [-]; [rad] between edges: what is not linear is a thousandth of that
STRAIN = 1e-4
TURN = 1e-4


def certify(mechanism: Mechanism, case: Case, engine: str) -> Certificate:
    """Return mass of all [kg] and of the rod, its first moment [kg m] and its stiffness EA [N], EI [N m^2]."""
    rod = build_rod(mechanism, ELEMENTS)
    flexible_model = build_flexible_model(mechanism, rod, plan_steps(case, rod)[0])
    model = flexible_model.model
    points = [model.body(rod.format_point_name(k)) for k in range(1, rod.elements + 1)]
    masses = np.array([float(body.mass[0]) for body in points])
    masses[-1] -= rod.tip
    places: Array = np.arange(1.0, rod.elements + 1.0) * rod.edge
    link = mechanism.link_of[rod.link]
    carried = sum(body.inertia.mass for body in link.bodies if body.station in (None, 0.0))
    fixed = model.body_weldid == model.body_weldid[flexible_model.body[rod.link]]
    half = float(model.body_mass[fixed].sum()) - carried
    bending = "EI_z" if rod.bent == 1 else "EI_y"
    return Certificate(
        mass=float(model.body_mass[model.body_weldid != 0].sum()),
        beam_masses={rod.link: float(masses.sum()) + half},
        beam_moments={rod.link: float(masses @ places)},
        stiffness={
            f"{rod.link}: EA": -_compute_elastic_force(flexible_model, rod, *_compute_stretch(rod), "x") / STRAIN,
            f"{rod.link}: {bending}": -_compute_elastic_force(flexible_model, rod, *_compute_arc(rod), "xyz"[rod.bent])
            * rod.edge**2
            / TURN,
        },
    )


def _compute_stretch(rod: Rod) -> tuple[Array, Array]:
    """Return the displacements of the points from a rod at rest (elements,) [m] where it is longer by STRAIN."""
    along: Array = STRAIN * rod.edge * np.arange(1.0, rod.elements + 1.0)
    return along, np.zeros(rod.elements)


def _compute_arc(rod: Rod) -> tuple[Array, Array]:
    """Return the displacements from a straight rod (elements,) [m] where every edge turns by TURN more than the last."""
    angles = TURN * np.arange(rod.elements)
    along: Array = rod.edge * np.cumsum(np.cos(angles) - 1.0)
    across: Array = rod.edge * np.cumsum(np.sin(angles))
    return along, across


def _compute_elastic_force(built_model: BuiltModel, rod: Rod, along: Array, across: Array, axis: str) -> float:
    """Return the elastic force on the last point along an axis of the section [N] with all points moved."""
    model = built_model.model
    data = mujoco.MjData(model)
    for k, shift in enumerate(np.stack([along, across], axis=1), 1):
        for name, value in zip(("x", "xyz"[rod.bent]), shift, strict=True):
            data.qpos[model.joint(f"{rod.format_point_name(k)}/{name}").qposadr[0]] = value
    mujoco.mj_forward(model, data)
    return float(data.qfrc_passive[model.joint(f"{rod.format_point_name(rod.elements)}/{axis}").dofadr[0]])
