"""Causes: a change of a subject, its size, and the targets that it can have."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from crosscheck.causes.model import Model, is_tree
from crosscheck.causes.subject import Subject
from flexinv.errors import InputError
from flexinv.typing import Array

# Of what there is: units that are mistaken (g for kg) leave a thousandth; less is nothing, which other causes are for.
LEAST = 1e-4

Change = Callable[[Subject, str, Array], Subject]
Targets = Callable[[Model], Sequence[str]]
Scale = Callable[[Model, str], float]
Guess = Callable[[Model, str, Array], Sequence[Array]]


def list_global_target(model: Model) -> list[str]:
    """Return the one target of a cause that concerns everything."""
    return [""]


def compute_unit_scale(model: Model, target: str) -> float:
    """Return 1: the size is a fraction, or as it stands [-]."""
    return 1.0


@dataclass(frozen=True)
class Cause:
    """One row of the dictionary.

    name : what the report calls it; words : the sentence, with {target} and {size}
    change : the subject with the cause in it, at a size (parameters,) [unit]; size 0 is the subject itself
    targets : where it can sit: joints, bodies, beams, or "" for everything
    parameters : how many numbers a fit may choose; 0: it is there (size 1) or not
    scale : a size [unit] that matters: of sizes that are a fraction, 1
    linear : only the amplitude of its effect is fitted (the effect of size 1 is all that is known)
    remeshes : it puts nodes at other places, which has an effect of its own that is taken off
    turns : an angle whose effect may begin with its square: fits start from several sizes
    covers : causes that are special cases of this one; where one of them explains as much, it is named instead
    shows : the motion that shows it best, in words
    plant : how to put it into an engine's model, where that is not ``change`` (a size) or cannot be (None)
    guess : sizes [unit] that the engine's own efforts (samples, nv) [N m], [N] suggest: what jumps cannot be fitted
    fraction : the size is a part of what there is: one that no user means is no alternative (`sensible`)
    unsaid : lines of the certificate and quantities in which it need not show, though its change says so: what stands in
        the model and is not applied
    """

    name: str
    words: str
    change: Change
    targets: Targets = list_global_target
    parameters: int = 1
    scale: Scale = compute_unit_scale
    unit: str = ""
    linear: bool = False
    remeshes: bool = False
    turns: bool = False
    covers: tuple[str, ...] = ()
    shows: str = ""
    plant: Change | None = None
    guess: Guess | None = None
    fraction: bool = False
    unsaid: tuple[str, ...] = ()

    @property
    def sized(self) -> bool:
        """Return True if the cause comes in sizes."""
        return self.parameters > 0


# ---------------------------------------------------------------------------------------------------------- targets


def list_moving_joints(model: Model) -> list[str]:
    """Return the joints that move."""
    return [j.name for j in model.base.mechanism.joints if j.nv]


def list_driven_joints(model: Model) -> list[str]:
    """Return the joints that move and have a drive."""
    return [j.name for j in model.base.mechanism.joints if j.nv and j.actuated]


def list_scalar_joints(model: Model) -> list[str]:
    """Return the joints with one coordinate and an axis."""
    return [j.name for j in model.base.mechanism.joints if j.nv == 1]


def list_bodies(model: Model) -> list[str]:
    """Return all bodies with mass."""
    return [name for name, (_, body) in model.base.bodies.items() if body.inertia.mass > 0.0]


def list_beams(model: Model) -> list[str]:
    """Return the links that bend."""
    return [link.name for link in model.base.mechanism.beams]


def list_flexible_target(model: Model) -> list[str]:
    """Return the one target where something bends."""
    return [""] if model.base.mechanism.beams else []


def list_closed_target(model: Model) -> list[str]:
    """Return the one target of a rigid mechanism with closures."""
    mechanism = model.base.mechanism
    return [""] if mechanism.closures and mechanism.is_rigid and not any(c.active for c in mechanism.closures) else []


def list_moving_tree_target(model: Model) -> list[str]:
    """Return the one target of an open tree that moves."""
    return [""] if is_tree(model.base) and model.states.qd.any() else []


def list_gravity_target(model: Model) -> list[str]:
    """Return the one target where there is gravity."""
    return [""] if model.base.mechanism.gravity.any() else []


# ----------------------------------------------------------------------------------------------------------- scales


def _find_columns(model: Model, target: str) -> slice:
    return model.base.mechanism.v_slices[target]


def compute_effort_range(model: Model, target: str) -> float:
    """Return the range of the efforts of a joint's unit [N m], [N]."""
    return float(model.scale[_find_columns(model, target)].max())


def compute_damping_scale(model: Model, target: str) -> float:
    """Return the range of the efforts over the largest speed of a joint [N m s/rad], [N s/m]; 0 at rest."""
    return _compute_range_ratio(
        compute_effort_range(model, target), float(np.abs(model.states.qd[:, _find_columns(model, target)]).max())
    )


def compute_inertia_scale(model: Model, target: str) -> float:
    """Return the range of the efforts over the largest acceleration of a joint [kg m^2], [kg]; 0 at rest."""
    return _compute_range_ratio(
        compute_effort_range(model, target), float(np.abs(model.states.qdd[:, _find_columns(model, target)]).max())
    )


def compute_stiffness_scale(model: Model, target: str) -> float:
    """Return the range of the efforts over a radian, or over the travel of a slide [N m/rad], [N/m]."""
    joint = model.base.mechanism.joint_of[target]
    if joint.kind != "prismatic":
        return compute_effort_range(model, target)
    return _compute_range_ratio(
        compute_effort_range(model, target), float(np.ptp(model.states.q[:, model.base.mechanism.q_slices[target]]))
    )


def compute_typical_length(model: Model, target: str = "") -> float:
    """Return the length of a typical link [m]: the mean distance from joint to joint, tip or centre of mass."""
    mechanism = model.base.mechanism
    lengths = [float(np.linalg.norm(j.placement.position)) for j in mechanism.joints]
    lengths += [link.beam.length if link.beam else float(np.linalg.norm(link.tip)) for link in mechanism.links]
    lengths += [float(np.linalg.norm(body.inertia.com)) for _, body in model.base.bodies.values()]
    return float(np.mean([length for length in lengths if length > 0.0] or [1.0]))


def compute_coordinate_scale(model: Model, target: str) -> float:
    """Return a size of a joint's coordinate: 1 rad, or the typical length [m] of a slide."""
    return compute_typical_length(model) if model.base.mechanism.joint_of[target].kind == "prismatic" else 1.0


def compute_mean_mass(model: Model, target: str = "") -> float:
    """Return the mean mass of the moving links [kg]."""
    mechanism = model.base.mechanism
    total = sum(body.inertia.mass for _, body in model.base.bodies.values())
    total += sum(
        float(np.mean(b.section.mass_per_length)) * b.length for b in (link.beam for link in mechanism.beams) if b
    )
    return total / max(1, len([j for j in mechanism.joints if j.nv]))


def compute_gravity_scale(model: Model, target: str = "") -> float:
    """Return the size of gravity, 9.81 where there is none [m/s^2]."""
    return float(np.linalg.norm(model.base.mechanism.gravity)) or 9.81


def _compute_range_ratio(effort: float, motion: float) -> float:
    return effort / motion if motion else 0.0


def check_fraction(size: Array) -> float:
    """Return a fraction [-] that leaves something of what it is added to; raises InputError."""
    if not size[0] > LEAST - 1.0:
        raise InputError(f"a fraction of {size[0]:g} leaves next to nothing: expected more than {LEAST - 1:g}")
    return float(size[0])
