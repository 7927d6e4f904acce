"""Causes in mix-ups of bodies and tensors: what stands at another body, with another sign, or along another axis."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np

from crosscheck.causes.cause import Cause, check_fraction, list_bodies
from crosscheck.causes.model import Model
from crosscheck.causes.subject import Subject
from flexinv.model.mechanism import Inertia
from flexinv.typing import Array

TURN = "all joints moved quickly, each at a rhythm of its own, so that the body turns about all its axes"
MANY = 8  # bodies up to which every pair is tried; beyond, neighbours only
ARROW = " <-> "
AXES = "xyz"
ROWS_FIRST = ("xx", "xy", "xz", "yy", "yz", "zz")  # URDF
DIAGONAL_FIRST = ("xx", "yy", "zz", "xy", "xz", "yz")  # MJCF
LOWER = ("xx", "xy", "yy", "xz", "yz", "zz")  # Pinocchio
TURNED = ("xx", "yy", "zz", "yz", "xz", "xy")  # Voigt
ORDERS = {
    "rows for the diagonal first": (ROWS_FIRST, DIAGONAL_FIRST),
    "the diagonal first for rows": (DIAGONAL_FIRST, ROWS_FIRST),
    "rows for the lower triangle": (ROWS_FIRST, LOWER),
    "the lower triangle for rows": (LOWER, ROWS_FIRST),
    "the diagonal first for the lower triangle": (DIAGONAL_FIRST, LOWER),
    "the lower triangle for the diagonal first": (LOWER, DIAGONAL_FIRST),
    "Voigt's order for the diagonal first": (TURNED, DIAGONAL_FIRST),
}
ALIKE = 1e-6  # of the larger one: moments of inertia that differ by less are the same


def _list_body_pairs(model: Model) -> list[str]:
    names = list_bodies(model)
    pairs = combinations(names, 2) if len(names) <= MANY else pairwise(names)
    return [f"{a}{ARROW}{b}" for a, b in pairs]


def _replace_inertia_pair(subject: Subject, target: str, size: Array) -> Subject:
    a, b = target.split(ARROW)
    first = subject.find_body(a)[1].inertia
    second = subject.find_body(b)[1].inertia
    once = subject.replace_body(a, lambda one: replace(one, inertia=second))
    return once.replace_body(b, lambda one: replace(one, inertia=first))


def _list_bodies_with_products(model: Model) -> list[str]:
    """Return the bodies with products of inertia, and "" for all where there are two or more."""
    names = [n for n in list_bodies(model) if _has_products(model.base.bodies[n][1].inertia)]
    return [*names, *([""] if len(names) > 1 else [])]


def _has_products(inertia: Inertia) -> bool:
    off = inertia.tensor - np.diag(np.diag(inertia.tensor))
    return bool(np.abs(off).max() > ALIKE * np.abs(inertia.tensor).max())


def _turn_product_signs(inertia: Inertia) -> Inertia:
    return inertia.replace_unchecked(tensor=2.0 * np.diag(np.diag(inertia.tensor)) - inertia.tensor)


def _apply_product_signs(subject: Subject, target: str, size: Array) -> Subject:
    if target:
        return subject.replace_body(target, lambda b: replace(b, inertia=_turn_product_signs(b.inertia)))
    return subject.replace_links(
        lambda link: replace(
            link, bodies=tuple(replace(b, inertia=_turn_product_signs(b.inertia)) for b in link.bodies)
        )
    )


def _list_unequal_axes(model: Model) -> list[str]:
    """Return "body: xy" for every pair of axes along which a body's moments of inertia differ."""
    unequal_axes = []
    for name in list_bodies(model):
        moments = np.diag(model.base.bodies[name][1].inertia.tensor)
        pairs = combinations(range(3), 2)
        unequal_axes += [
            f"{name}: {AXES[i]}{AXES[j]}" for i, j in pairs if abs(moments[i] - moments[j]) > ALIKE * moments.max()
        ]
    return unequal_axes


def _replace_axis_order(subject: Subject, target: str, size: Array) -> Subject:
    name, pair = target.rsplit(": ", 1)
    order = list(range(3))
    i, j = (AXES.index(axis) for axis in pair)
    order[i] = j
    order[j] = i

    def update_inertia(inertia: Inertia) -> Inertia:
        return inertia.replace_unchecked(tensor=inertia.tensor[np.ix_(order, order)])

    return subject.replace_body(name, lambda b: replace(b, inertia=update_inertia(b.inertia)))


def _list_moments(model: Model) -> list[str]:
    tensors = {n: model.base.bodies[n][1].inertia.tensor for n in list_bodies(model)}
    return [f"{n}: {AXES[k] * 2}" for n, tensor in tensors.items() for k in range(3) if tensor[k, k] > 0.0]


def _scale_moment(subject: Subject, target: str, size: Array) -> Subject:
    name, pair = target.rsplit(": ", 1)
    k = AXES.index(pair[0])
    factor = 1.0 + check_fraction(size)

    def update_inertia(inertia: Inertia) -> Inertia:
        tensor = inertia.tensor.copy()
        tensor[k, k] *= factor
        return inertia.replace_unchecked(tensor=tensor)

    return subject.replace_body(name, lambda b: replace(b, inertia=update_inertia(b.inertia)))


def _list_com_coordinates(model: Model) -> list[str]:
    coms = {n: model.base.bodies[n][1].inertia.com for n in list_bodies(model)}
    return [f"{n}: {AXES[k]}" for n, com in coms.items() for k in range(3) if com[k]]


def _turn_com_sign(subject: Subject, target: str, size: Array) -> Subject:
    name, axis = target.rsplit(": ", 1)
    signs = np.where(np.arange(3) == AXES.index(axis), -1.0, 1.0)
    return subject.replace_body(
        name, lambda b: replace(b, inertia=b.inertia.replace_unchecked(com=b.inertia.com * signs))
    )


def _list_number_orders(model: Model) -> list[str]:
    tensors = {n: model.base.bodies[n][1].inertia.tensor for n in list_bodies(model)}
    return [f"{n}: {way}" for n, tensor in tensors.items() for way in ORDERS if tensor.any()]


def _replace_number_order(subject: Subject, target: str, size: Array) -> Subject:
    name, way = target.rsplit(": ", 1)
    written, read = ORDERS[way]

    def update_inertia(inertia: Inertia) -> Inertia:
        tensor = np.empty((3, 3))
        for place, number in zip(read, written, strict=True):
            value = inertia.tensor[AXES.index(number[0]), AXES.index(number[1])]
            i, j = (AXES.index(axis) for axis in place)
            tensor[i, j] = tensor[j, i] = value
        return inertia.replace_unchecked(tensor=tensor)

    return subject.replace_body(name, lambda b: replace(b, inertia=update_inertia(b.inertia)))


ROWS = (
    Cause(
        "bodies exchanged",
        "mass, centre of mass and inertia of two bodies are mixed up: {target}",
        _replace_inertia_pair,
        _list_body_pairs,
        0,
        shows=TURN,
    ),
    Cause(
        "sign of products of inertia",
        "the products of inertia of {target} have the other sign",
        _apply_product_signs,
        _list_bodies_with_products,
        0,
        shows=TURN,
    ),
    Cause(
        "moments of inertia exchanged",
        "two axes of the inertia tensor are mixed up: {target}",
        _replace_axis_order,
        _list_unequal_axes,
        0,
        shows=TURN,
    ),
    Cause(
        "order of the inertia's numbers",
        "the six numbers of an inertia tensor are read in another order: {target}",
        _replace_number_order,
        _list_number_orders,
        0,
        shows=TURN,
    ),
    Cause(
        "moment of inertia",
        "the moment of inertia {target} differs by the fraction {size}",
        _scale_moment,
        _list_moments,
        shows=TURN,
        fraction=True,
    ),
    Cause(
        "centre of mass mirrored",
        "a coordinate of the centre of mass has the other sign: {target}",
        _turn_com_sign,
        _list_com_coordinates,
        0,
        shows="holding still at several places (gravity alone)",
    ),
)
