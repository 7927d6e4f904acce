"""The reader's own compiled model, asked for efforts; and features: what it does that no mechanism can say.

A lifted mechanism is held against the model that it was lifted from (`crosscheck.equivalence.proof`).  That model answers in the
coordinates of the mechanism, with contacts, limits and equality constraints switched off:

    tau = M(q) qdd + h(q, qd)        all that an actuator has to give: springs, dampers, armature, dry friction of moving joints

Features are switched off by name.  With all of them off the model has to have the efforts of the mechanism; what they add is
compared between two readers.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from flexinv.typing import Array

Parameter = float | tuple[float, ...] | str


@dataclass(frozen=True)
class Feature:
    """Something of a reader's model that no mechanism can say.

    name : of its kind, one word, as ``--ignore`` takes it ("gravcomp")
    place : "joint NAME", "link NAME", "tendon NAME", "the world"
    parameters : its numbers by name, in SI units, with those of other places by their names
    felt : efforts of the reader's own model feel it; False for what ties joints, or for what only simulations do
    joints : joints that it is about, where its parameters hold only together with them
    """

    name: str
    place: str
    parameters: Mapping[str, Parameter] = field(default_factory=dict)
    felt: bool = True
    joints: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """Return the numbers of the feature in a line [any unit]."""
        return ", ".join(f"{name} {_format_value(value)}" for name, value in self.parameters.items())


def _format_value(value: Parameter) -> str:
    if isinstance(value, str):
        return value
    return " ".join(f"{number:.9g}" for number in (value if isinstance(value, tuple) else (value,)))


class ReaderDynamics(Protocol):
    """The reader's own compiled model, in the coordinates of the mechanism that was lifted from it.

    reader : what answers, with its version; precision : relative rounding of its arithmetic [-], 0 for double precision
    """

    @property
    def reader(self) -> str:
        """Return the engine with its version: "MuJoCo 4.0.0"."""

    @property
    def precision(self) -> float:
        """Return the relative rounding of its arithmetic [-]; 0 for double precision."""

    def efforts(
        self, q: Array, qd: Array, qdd: Array, gravity: Array | None = None, without: Collection[str] = ()
    ) -> Array:
        """Return efforts (samples, nv) [N m], [N] of q (samples, nq), qd, qdd (samples, nv) in the mechanism's order.

        q, qd, qdd : in Pinocchio's layout, as `flexinv.rigid.joint_torques.joint_torques` takes them; no rate is zero
        gravity : (3,) [m/s^2] instead of what the source states, where it states none
        without : names of features that are switched off
        """

    @property
    def start(self) -> Array | None:
        """Return the reader's own reference configuration (nq,) [rad], [m], near which loops close; None: all joints at zero."""

    def closing(self, q: Array, without: Collection[str] = ()) -> tuple[Array, Array] | None:
        """Return residual (rows,) [m], [rad] and Jacobian (rows, nv) of what ties the tree at q (nq,).

        without : names of features that are left out.  None: the model has no equations of the kind.
        """


@dataclass(frozen=True)
class FunctionDynamics:
    """`ReaderDynamics` made of functions, for readers that need no class of their own.

    inverse : of q, qd, qdd (one sample each), gravity (3,) or None, names that are switched off; the efforts (nv,) [N m], [N]
    ties : of q and names that are left out, residual and Jacobian of what closes loops
    start : the reader's own reference configuration (nq,) [rad], [m]
    """

    reader: str
    inverse: Callable[[Array, Array, Array, Array | None, Collection[str]], Array]
    precision: float = 0.0
    ties: Callable[[Array, Collection[str]], tuple[Array, Array]] | None = None
    start: Array | None = None

    def efforts(
        self, q: Array, qd: Array, qdd: Array, gravity: Array | None = None, without: Collection[str] = ()
    ) -> Array:
        """Return the efforts (samples, nv) [N m], [N] sample by sample."""
        rows = [self.inverse(one, rate, push, gravity, without) for one, rate, push in zip(q, qd, qdd, strict=True)]
        return np.array(rows, dtype=np.float64).reshape(qd.shape)

    def closing(self, q: Array, without: Collection[str] = ()) -> tuple[Array, Array] | None:
        """Return residual (rows,) [m], [rad] and Jacobian (rows, nv); None where nothing ties the tree."""
        return self.ties(q, without) if self.ties is not None else None
