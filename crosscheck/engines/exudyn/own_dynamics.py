"""Exudyn's own inverse dynamics of a kinematic tree, in the coordinates of the mechanism that was lifted from it.

    KinematicTree66     tau = M(q) qdd + f(q, qd), as its ComputeMassMatrixAndForceTerms gives M and f
    the others          tau = M(q) qdd - rhs(q, qd)  of a system of its own with that one object, as Exudyn's solver computes
                        them; a robot is written there by its own CreateKinematicTree

Source: exudyn 1.13.6, kinematicTree.py, MainSolverImplicitSecondOrder.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, TypedDict

import exudyn as exu
import numpy as np
from exudyn.itemInterface import NodeGenericODE2
from exudyn.kinematicTree import KinematicTree66
from exudyn.robotics import Robot

from crosscheck.lifting.reader_dynamics import FunctionDynamics
from flexinv.errors import InputError
from flexinv.model.mechanism import Array, Mechanism


class TreeData(TypedDict, total=False):
    """The keys of an ``ObjectKinematicTree`` that are read; lists of vectors and matrices are of Exudyn's own types."""

    objectType: str
    gravity: Any
    baseOffset: Any
    jointTypes: Any
    linkParents: Any
    linkMasses: Any
    linkCOMs: Any
    linkInertiasCOM: Any
    jointHTs: Any
    jointOffsets: Any
    jointTransformations: Any


def build_dynamics(source: Any, told: TreeData | None, mechanism: Mechanism) -> FunctionDynamics:
    """Return the dynamics of a tree in the coordinates of its mechanism.

    told : the dictionary of an object of a system, None for a ``KinematicTree66`` and a ``Robot``
    Raises InputError where Exudyn does not take the object into a system of its own.
    """
    order = _find_joint_order(mechanism)
    if isinstance(source, KinematicTree66):
        return FunctionDynamics(f"Exudyn {exu.__version__}", _make_tree66_inverse(source, order))
    system = exu.SystemContainer().AddSystem()
    try:
        if isinstance(source, Robot):
            source.CreateKinematicTree(system)
        else:
            _add(system, told or {})
        system.Assemble()
    except (ValueError, RuntimeError, KeyError) as error:
        raise InputError(f"Exudyn: {' '.join(str(error).split())[:300]}") from None
    return FunctionDynamics(f"Exudyn {exu.__version__}", _make_system_inverse(system, order))


def _find_joint_order(mechanism: Mechanism) -> Array:
    """Number of the tree's joint by coordinate of the mechanism: joint K is called "joint K"."""
    return np.array([int(joint.name.split()[-1]) for joint in mechanism.joints if joint.nv])


def _add(system: Any, data: TreeData) -> None:
    """Add the object of a dictionary to a system, on a node of its own."""
    count = len(data["jointTypes"])
    zero = [0.0] * count
    node = NodeGenericODE2(
        referenceCoordinates=zero, initialCoordinates=zero, initialCoordinates_t=zero, numberOfODE2Coordinates=count
    )
    system.AddObject({**data, "nodeNumber": system.AddNode(node)})


def _make_tree66_inverse(tree: Any, order: Array) -> Any:
    stated = np.array(tree.gravity, dtype=float)

    def compute_efforts(q: Array, qd: Array, qdd: Array, gravity: Array | None, without: Collection[str]) -> Array:
        place, rate, push = (np.empty(len(order)) for _ in range(3))
        place[order] = q
        rate[order] = qd
        push[order] = qdd
        tree.gravity = stated if gravity is None else np.asarray(gravity)
        try:
            mass, force = tree.ComputeMassMatrixAndForceTerms(place, rate)
        finally:
            tree.gravity = stated  # a tree in memory stays what it was
        efforts: Array = (mass @ push + force)[order]
        return efforts

    return compute_efforts


def _make_system_inverse(system: Any, order: Array) -> Any:
    settings = exu.SimulationSettings()
    settings.solution.file.write = False

    def compute_efforts(q: Array, qd: Array, qdd: Array, gravity: Array | None, without: Collection[str]) -> Array:
        place, rate, push = (np.empty(len(order)) for _ in range(3))
        place[order] = q
        rate[order] = qd
        push[order] = qdd
        start = exu.ConfigurationType.Initial
        reference = np.array(system.systemData.GetODE2Coordinates(exu.ConfigurationType.Reference))
        system.systemData.SetODE2Coordinates(place - reference, configuration=start)
        system.systemData.SetODE2Coordinates_t(rate, configuration=start)
        solver: Any = exu.MainSolverImplicitSecondOrder()
        settings.timeIntegration.generalizedAlpha.computeInitialAccelerations = False
        solver.InitializeSolver(system, settings)
        solver.ComputeMassMatrix(system, 1.0)
        solver.ComputeODE2RHS(system)
        mass = np.array(solver.GetSystemMassMatrix())
        pull = np.array(solver.GetSystemResidual())[: len(order)]
        solver.FinalizeSolver(system, settings)
        efforts: Array = (mass @ push - pull)[order]
        return efforts

    return compute_efforts
