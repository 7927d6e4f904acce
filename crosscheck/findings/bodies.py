"""Findings in bodies: tensors that no body has, masses and sizes that look like other units, defaults."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from crosscheck.findings.finding import Finding, make_error, make_warning
from crosscheck.findings.statements import LinkStatements, describe_moments
from flexinv.model.links import describe_impossible_inertia
from flexinv.model.mechanism import Array

# [kg]: heavier links look like grams, lighter ones like placeholders; round numbers, beyond any link of a robot
HEAVY = 1000.0
LIGHT = 1e-6
FAR = 10.0  # [m]: a centre of mass that far from its joint looks like mm; a round number
WIDE = 10.0  # radius of gyration over the size of the machine from which on a tensor looks like g mm^2, or like a typing error
NOISE = 1e-12  # [m^2]: moments over the mass, the square of a micrometre, are a program's rounding
DEFAULTS = (1.0, 0.1, 0.01, 1e-3)  # [kg m^2]: round numbers that tools and authors put in where nothing is known
COPIES = 3  # links with one tensor and different masses


def check_bodies(links: Mapping[str, LinkStatements], size: float) -> Iterator[Finding]:
    """Yield findings in the inertias of links [kg, m, kg m^2]; size : of the machine [m]."""
    for link in links.values():
        if link.written:
            yield from _check_body(link, size)
    yield from _check_default_tensors(links)


def _check_body(link: LinkStatements, size: float) -> Iterator[Finding]:
    place = f"link {link.name}"
    body = link.inertia
    if not all(np.all(np.isfinite(part)) for part in (body.mass, body.com, body.tensor)):
        yield make_error(
            "number", place, "NaN or infinite", "an inertia of numbers", "the measured or computed numbers"
        )
        return
    if body.mass < 0:
        yield make_error(
            "mass", place, f"{body.mass:g} kg", "no body has a negative mass", f'<mass value="{-body.mass:g}"/>'
        )
    none = bool(np.abs(body.tensor).max() <= NOISE * body.mass)
    if not none and (reason := describe_impossible_inertia(body.tensor)):
        advice = (
            "the tensor about the centre of mass: principal moments p1 + p2 >= p3; some readers replace such a tensor"
        )
        yield make_error("tensor", place, describe_moments(body), f"no body has it: {reason}", advice)
    if body.mass == 0 and body.tensor.any():
        why = "a body without mass has no inertia; MuJoCo drops it, Drake makes it 1 kg"
        yield make_error("tensor without mass", place, describe_moments(body), why, "a mass, or a tensor of zeros")
    if body.mass > 0 and none:
        why = "a mass without moments of inertia is a point: forward dynamics of a joint through it has no inertia"
        yield make_warning(
            "mass without tensor", place, f"{body.mass:g} kg", why, "the moments of the shape about its centre of mass"
        )
    yield from _check_units(link, size)


def _check_units(link: LinkStatements, size: float) -> Iterator[Finding]:
    place = f"link {link.name}"
    body = link.inertia
    if body.mass > HEAVY:
        yield make_warning(
            "mass", place, f"{body.mass:g} kg", "looks like grams", f'<mass value="{body.mass / 1000:g}"/>'
        )
    elif 0 < body.mass < LIGHT and body.tensor.max() > body.mass * size**2:
        yield make_warning("mass", place, f"{body.mass:g} kg", "looks like a placeholder", "the mass of the link")
    far = float(np.linalg.norm(body.com))
    if far > FAR:
        yield make_warning("com", place, f"{far:g} m from its frame", "looks like mm", f"{far / 1000:g} m")
    elif size and far > 3 * size:
        yield make_warning(
            "com",
            place,
            f"{far:g} m from its frame",
            f"the machine extends {size:.3g} m",
            "the centre of mass in the link's frame, m",
        )
    if body.mass > 0:
        radius = float(np.sqrt(max(np.trace(body.tensor), 0.0) / 2 / body.mass))
        if size and radius > WIDE * size and _find_placeholder(body.tensor) is None:
            why = f"its radius of gyration is {radius:.3g} m, the machine extends {size:.3g} m: looks like g mm^2"
            yield make_warning("tensor", place, describe_moments(body), why, "kg m^2, about the centre of mass")


def _check_default_tensors(links: Mapping[str, LinkStatements]) -> Iterator[Finding]:
    """Tensors that a tool or an author puts in where nothing is known."""
    groups: dict[tuple[float, ...], list[LinkStatements]] = {}
    for link in links.values():
        if link.written and link.inertia.mass > 0 and link.inertia.tensor.any():
            groups.setdefault(tuple(link.inertia.tensor.ravel()), []).append(link)
    for key, same in groups.items():
        moment = _find_placeholder(np.array(key).reshape(3, 3))
        masses = {link.inertia.mass for link in same}
        given = f"one tensor for {len(same)} links of {len(masses)} masses"
        for link in same:  # findings that say the same are put together where they are shown
            if moment is not None:
                shown = f"{moment:g} kg m^2 about every axis"
                yield make_warning(
                    "default tensor", f"link {link.name}", shown, "looks like a placeholder", "the moments of the shape"
                )
            elif len(same) >= COPIES and len(masses) >= COPIES:
                yield make_warning(
                    "default tensor", f"link {link.name}", given, "looks like a copy", "the moments of each shape"
                )


def _find_placeholder(tensor: Array) -> float | None:
    """The moment [kg m^2] of a tensor that is the same power of ten about every axis; None for any other."""
    moment = float(f"{tensor[0, 0]:.9g}")  # a turned unit tensor is one to rounding
    equal = bool(np.abs(tensor - moment * np.eye(3)).max() <= 1e-9 * abs(moment))
    return moment if equal and moment in DEFAULTS else None
