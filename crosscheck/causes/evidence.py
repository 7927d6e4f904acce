"""The certificate as evidence: a cause has to explain the engine's mass matrix and gravity torque as well.

At the certificate's configurations the efforts at rest, and those of a unit acceleration of each joint, are a motion that
no case has.  A cause in masses or inertia that the motion names, but that would change a mass matrix which is right (or
leave one which is wrong), is out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from crosscheck.causes.fit import IMPOSSIBLE, Fit
from crosscheck.causes.model import open_tree
from crosscheck.causes.subject import Array, States, Subject
from crosscheck.certificate import Certificate
from crosscheck.engines.probe import configurations
from flexinv.mechanism import Mechanism

AGREES = 0.1  # of what the certificates differ by, or of what the cause would change
EXACT = 1e-9  # of the largest entry: rounding


def consistent(base: Subject, fits: Sequence[Fit], theirs: Certificate, ours: Certificate) -> tuple[Fit, ...]:
    """Return the causes that the certificates bear out; all of them where there are none to ask."""
    if not base.mechanism.is_rigid or theirs.mass_matrix is None or ours.mass_matrix is None:
        return tuple(fits)
    measured = _column(theirs) - _column(ours)
    size = float(np.abs(_column(ours)).max(initial=0.0))
    left = tuple(f for f in fits if _agrees(base, f, measured, size))
    return left or tuple(fits)


def _agrees(base: Subject, fit: Fit, measured: Array, size: float) -> bool:
    try:
        predicted = _predicted(base, fit)
    except IMPOSSIBLE:
        return True
    scale = max(float(np.linalg.norm(measured)), float(np.linalg.norm(predicted)))
    return scale <= EXACT * size or float(np.linalg.norm(measured - predicted)) <= AGREES * scale


def _predicted(base: Subject, fit: Fit) -> Array:
    """Return what a cause does to mass matrix and gravity torque, as one column [kg m^2], [N m]."""
    harmed = fit.cause.change(base, fit.target, fit.size).mechanism
    q = configurations(base.mechanism, base.case)
    return _said(harmed, q) - _said(base.mechanism, q)


def _said(mechanism: Mechanism, q: Array) -> Array:
    """Mass matrix and gravity torque at configurations, as one column."""
    tree = replace(mechanism, closures=(), springs=(), forces=())
    bare = replace(tree, joints=tuple(replace(j, damping=0.0, friction=0.0, stiffness=0.0) for j in tree.joints))
    time, rest = np.zeros(len(q)), np.zeros((len(q), bare.nv))
    gravity = open_tree(bare, States(time, q, rest, rest))
    columns = [open_tree(bare, States(time, q, rest, rest + unit)) - gravity for unit in np.eye(bare.nv)]
    return np.concatenate([np.stack(columns, axis=2).ravel(), gravity.ravel()])


def _column(certificate: Certificate) -> Array:
    return np.concatenate([np.asarray(certificate.mass_matrix).ravel(), np.asarray(certificate.gravity).ravel()])
