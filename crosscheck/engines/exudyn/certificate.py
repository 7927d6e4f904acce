"""Certificate of Exudyn's models: the kinematic tree's mass matrix and forces, weights and static probes in time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crosscheck.engines.exudyn import rigid as exudyn_rigid
from crosscheck.engines.exudyn import static_probes as exudyn_probe
from crosscheck.engines.exudyn import weights as exudyn_weights
from crosscheck.engines.exudyn.ends import read_connector_ends
from crosscheck.engines.exudyn.integration import quiet
from crosscheck.engines.exudyn.models import meshes as exudyn_meshes
from crosscheck.engines.exudyn.run_in_time import ANCF, DAE, EXACT
from crosscheck.engines.shared.prescribed import collect_passive_elements, rotor_effort
from crosscheck.engines.shared.probe_states import Array, configurations
from crosscheck.measures.certificate import Certificate
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Mechanism


def certify(mechanism: Mechanism, case: Case, engine: str) -> Certificate:
    """Return masses [kg], moments [kg m], inertias [kg m^2]; of the tree mass matrix and gravity torque [N m], [N]; of beams
    mass and stiffness [N], [N m^2].  The models in time have redundant coordinates and no mass matrix of the joints'."""
    if engine in (ANCF, EXACT, DAE):
        with quiet():
            return _build_time_certificate(mechanism, case, engine)
    return _build_tree_certificate(mechanism, case)


def _build_time_certificate(mechanism: Mechanism, case: Case, engine: str) -> Certificate:
    passive = collect_passive_elements(mechanism)
    ends = read_connector_ends(mechanism, case, engine)
    weights = exudyn_weights.build_weight_certificate(mechanism, case, engine)
    certificate = replace(
        weights,
        damping=passive["damping"],
        friction=passive["friction"],
        springs={**passive["springs"], **ends.springs},  # those in joints are no connectors
        closure_points=ends.closure_points,
        closure_axes=ends.closure_axes,
    )
    if engine == DAE:
        return certificate
    parts = [exudyn_meshes.compute_properties(link.name, link.part) for link in mechanism.meshed if link.part]
    return replace(
        certificate,
        stiffness=exudyn_probe.compute_probe_stiffness(mechanism, case, engine),
        part_stiffness={key: value for found, _ in parts for key, value in found.items()},
        part_frequencies={key: value for _, found in parts for key, value in found.items()},
    )


def _build_tree_certificate(mechanism: Mechanism, case: Case) -> Certificate:
    gravity, matrix = _compute_gravity_and_mass_matrix(mechanism, configurations(mechanism, case))
    tree = exudyn_rigid.build(mechanism, wrench=False)
    mass = np.array([inertia[3, 3] for inertia in tree.inertias])
    last = {j.name: tree.link[j.child][0] for j in mechanism.joints if j.nv}
    # T66 of a joint's own frame into that of its child: inertias turn and move with it.
    seats = {j.name: exudyn_rigid.build_transform66(tree.link[j.child][1]) for j in mechanism.joints if j.nv}
    lumps = {n: np.linalg.inv(seats[n]).T @ tree.inertias[index] @ np.linalg.inv(seats[n]) for n, index in last.items()}
    return Certificate(
        mass=float(mass.sum()),
        masses={name: float(mass[index]) for name, index in last.items()},
        moments={name: np.array([lump[2, 4], lump[0, 5], lump[1, 3]]) for name, lump in lumps.items()},
        inertias={name: lump[:3, :3] for name, lump in lumps.items()},
        mass_matrix=matrix,
        gravity=gravity,
        order=tuple(sorted(last, key=lambda name: last[name])),
        **collect_passive_elements(mechanism),
    )


def _compute_gravity_and_mass_matrix(mechanism: Mechanism, q: Array) -> tuple[Array, Array]:
    """Gravity torque (configurations, nv) [N m], [N] and mass matrix (configurations, nv, nv) [kg m^2], [kg]."""
    rest = np.zeros((len(q), mechanism.nv))
    gravity = exudyn_rigid.compute_inverse_dynamics(mechanism, q, rest, rest, wrench=False).torque
    columns = [
        exudyn_rigid.compute_inverse_dynamics(mechanism, q, rest, rest + unit, wrench=False).torque
        - gravity
        + rotor_effort(mechanism, rest + unit)
        for unit in np.eye(mechanism.nv)
    ]
    return gravity, np.stack(columns, axis=2)
