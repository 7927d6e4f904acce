"""Causes in what sections are made of: moduli, density, area, width and height, walls; of one beam or of all.

A section states stiffness and inertia per length only.  What it is like is read off them: its sizes if it were a rectangle,
y = sqrt(12 EI_z / EA) and z = sqrt(12 EI_y / EA), and whether its torsion is that of one; of a tube its radii.  Stretching a
section along y by f multiplies its area by f, I_y = int z^2 dA by f, I_z = int y^2 dA by f^3, whatever its shape.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from crosscheck.causes.cause import Cause, Change, Targets, check_fraction, list_beams
from crosscheck.causes.model import Model
from crosscheck.causes.subject import Subject
from flexinv.errors import InputError
from flexinv.files.sections import compute_rectangle_torsion
from flexinv.model.mechanism import Beam, Section
from flexinv.typing import Array

RING = "a stop and a rest long enough to ring: stiffness moves the frequency, mass moves the torque before it, too"
EA, GA_Y, GA_Z, GJ, EI_Y, EI_Z = range(6)
SAME_G = " (G unchanged)"
# Of the torsion of a rectangle with the same area and moments: shear factors are known to some per cent, an ellipse of the
# same moments has 6 % more.
RECTANGLE = 0.05
Part = Callable[[Section, float], Section]


def _make_section_change(change: Part) -> Change:
    """Return the change of the section of one beam, or with target "" of all, by a fraction."""

    def apply_change(subject: Subject, target: str, size: Array) -> Subject:
        factor = 1.0 + check_fraction(size)

        def update_beam(beam: Beam) -> Beam:
            return replace(beam, section=change(beam.section, factor))

        for name in [target.removesuffix(SAME_G)] if target.removesuffix(SAME_G) else _list_all_beams(subject):
            subject = subject.replace_beam(name, update_beam)
        return subject

    return apply_change


def _list_all_beams(subject: Subject) -> list[str]:
    return [link.name for link in subject.mechanism.beams]


def _has_independent_numbers(section: Section) -> bool:
    """Return True if six stiffnesses and three rotary inertias can be changed one by one: the section is not coupled."""
    return not section.is_coupled


def _make_section_targets(test: Callable[[Section], bool] = _has_independent_numbers) -> Targets:
    """Return the beams whose section passes a test, and "" for all where all of two or more do."""

    def list_targets(model: Model) -> list[str]:
        names = [n for n in list_beams(model) if test(_find_section(model, n))]
        return [*names, *([""] if len(names) > 1 and names == list_beams(model) else [])]

    return list_targets


def _find_section(model: Model, name: str) -> Section:
    beam = model.base.mechanism.link_of[name].beam
    assert beam is not None
    return beam.section


def _scale_section(section: Section, stiffness: Array, mass: float, rotary: Array) -> Section:
    """Return a section with stiffness (6,) or (n, 6), mass and rotary inertia (3,) or (n, 3) multiplied [-].

    Raises InputError where a coupled section would need more than one factor for all its stiffness or all its inertia.
    """
    if section.is_coupled:
        if np.ptp(stiffness) or np.ptp(rotary):
            section.check_independent("causes: a change of some numbers of a section")
        stiffness = np.full(1, stiffness.flat[0])
        rotary = np.full(1, rotary.flat[0])
    damping = None if section.damping is None else section.damping * stiffness
    return replace(
        section,
        stiffness=section.stiffness * stiffness,
        mass_per_length=section.mass_per_length * mass,
        rotary_inertia=section.rotary_inertia * rotary,
        damping=damping,
    )


def _make_stiffness_change(columns: tuple[int, ...]) -> Part:
    """Return the change of some stiffnesses; retardation times are as they were, so damping changes alike."""

    def update_section(section: Section, factor: float) -> Section:
        factors = np.ones(6)
        factors[list(columns)] = factor
        return _scale_section(section, factors, 1.0, np.ones(3))

    return update_section


def _scale_modulus(subject: Subject, target: str, size: Array) -> Subject:
    """Change E; G goes with it (the same number of Poisson), or stays."""
    columns = (EA, EI_Y, EI_Z) if target.endswith(SAME_G) else (EA, GA_Y, GA_Z, GJ, EI_Y, EI_Z)
    return _make_section_change(_make_stiffness_change(columns))(subject, target, size)


def _list_material_targets(model: Model) -> list[str]:
    alone = _make_section_targets()(model)
    return [
        target + more
        for target in _make_section_targets(lambda section: True)(model)
        for more in ("", *([SAME_G] if target in alone else []))
    ]


def _scale_density(section: Section, factor: float) -> Section:
    return _scale_section(section, np.ones(6), factor, np.full(3, factor))


def _scale_area(section: Section, factor: float) -> Section:
    return _scale_section(section, np.array([factor, factor, factor, 1.0, 1.0, 1.0]), factor, np.ones(3))


def _make_size_change(along: int) -> Part:
    """Return the change of a section's size along y (0) or z (1)."""

    def update_section(section: Section, factor: float) -> Section:
        y, z = _compute_rectangle_sides(section)
        before = np.array([compute_rectangle_torsion(a, b) for a, b in zip(y, z, strict=True)])
        fy, fz = (factor, 1.0) if along == 0 else (1.0, factor)
        after = np.array([compute_rectangle_torsion(a * fy, b * fz) for a, b in zip(y, z, strict=True)])
        bending = (factor, factor**3) if along == 0 else (factor**3, factor)  # EI_y, EI_z
        stiffness = np.tile([factor, factor, factor, 1.0, *bending], (len(y), 1))
        stiffness[:, GJ] = after / before
        about = section.rotary_inertia[:, 1:] * bending
        whole = section.rotary_inertia[:, 1:].sum(axis=1)
        polar = np.where(whole > 0.0, about.sum(axis=1) / np.where(whole > 0.0, whole, 1.0), factor)
        rotary = np.column_stack([polar, np.full(len(y), bending[0]), np.full(len(y), bending[1])])
        return _scale_section(section, stiffness, factor, rotary)

    return update_section


def _compute_rectangle_sides(section: Section) -> tuple[Array, Array]:
    s = section.stiffness
    return np.sqrt(12.0 * s[:, EI_Z] / s[:, EA]), np.sqrt(12.0 * s[:, EI_Y] / s[:, EA])


def _is_rectangle(section: Section) -> bool:
    """Return True if torsion is that of a rectangle with these sizes, G from the shear of Cowper's factor."""
    if section.is_coupled:
        return False
    s = section.stiffness
    y, z = _compute_rectangle_sides(section)
    for row, a, b in zip(s, y, z, strict=True):
        shear = 0.0
        factor = 5.0 / 6.0
        for _ in range(5):  # the factor depends on Poisson's number, hardly
            shear = row[GA_Y] / (factor * a * b)
            poisson = min(max(row[EA] / (a * b) / (2.0 * shear) - 1.0, 0.0), 0.5)
            factor = 10.0 * (1.0 + poisson) / (12.0 + 11.0 * poisson)
        if abs(row[GJ] / (shear * compute_rectangle_torsion(float(a), float(b))) - 1.0) > RECTANGLE:
            return False
    return True


def _scale_all_dimensions(section: Section, factor: float) -> Section:
    """Scale width, height and walls alike: areas by the square, moments by the fourth power."""
    square = factor**2
    return _scale_section(section, np.array([square] * 3 + [square**2] * 3), square, np.full(3, square**2))


def _is_tube(section: Section) -> bool:
    """Return True if a section is a round tube: equal EI_y and EI_z, no rectangle, less shear than a full circle's."""
    if section.is_coupled:
        return False
    s = section.stiffness
    if not np.allclose(s[:, EI_Y], s[:, EI_Z], rtol=1e-6):
        return False
    return not _is_rectangle(section) and bool((_compute_radius_ratio(section) > 0.0).all())


def _compute_radius_ratio(section: Section) -> Array:
    """Return inner over outer radius m [-] of round sections from Cowper's shear factor, 0 where it is that of a full circle.

    GJ / EI = 2 G / E, GA / EA = k(nu, m) G / E:  k = 2 (GA / EA) (EI / GJ), falling in m
    """
    s = section.stiffness
    ratio = s[:, GJ] / (2.0 * s[:, EI_Y])  # G / E
    poisson = np.clip(1.0 / (2.0 * ratio) - 1.0, 0.0, 0.5)
    wanted = s[:, GA_Y] / s[:, EA] / ratio
    grid = np.linspace(0.0, 0.999, 2000)
    square = (1.0 + grid**2) ** 2
    found = []
    for nu, k in zip(poisson, wanted, strict=True):
        factors = 6 * (1 + nu) * square / ((7 + 6 * nu) * square + (20 + 12 * nu) * grid**2)
        found.append(float(np.interp(-k, -factors, grid)))
    return np.array(found)


def _scale_wall_thickness(section: Section, factor: float) -> Section:
    """Make the wall of a tube thicker, the outside as it is.  Raises InputError where it fills the tube."""
    before = _compute_radius_ratio(section)
    after = 1.0 - (1.0 - before) * factor
    if (after < 0.0).any():
        raise InputError(
            f"a wall {factor:g} times as thick fills the tube: expected less than {1.0 / (1.0 - before.max()):g}"
        )
    area = (1.0 - after**2) / (1.0 - before**2)
    second = (1.0 - after**4) / (1.0 - before**4)
    stiffness = np.column_stack([area, area, area, second, second, second])
    made = _scale_section(section, stiffness, 1.0, second[:, None] * np.ones(3))
    return replace(made, mass_per_length=section.mass_per_length * area)


ROWS = (
    Cause(
        "modulus of elasticity",
        "the modulus of elasticity (E) of {target} is larger by the fraction {size}",
        _scale_modulus,
        _list_material_targets,
        shows=RING,
        fraction=True,
    ),
    Cause(
        "shear modulus",
        "the shear modulus (G) of {target} is larger by the fraction {size}",
        _make_section_change(_make_stiffness_change((GA_Y, GA_Z, GJ))),
        _make_section_targets(),
        covers=("shear factor",),
        shows=RING,
        fraction=True,
    ),
    Cause(
        "density",
        "the density of {target} is larger by the fraction {size}",
        _make_section_change(_scale_density),
        _make_section_targets(lambda section: True),
        shows=RING,
        fraction=True,
    ),
    Cause(
        "cross-section area",
        "the area of the section of {target} is larger by the fraction {size}, its second moments are not",
        _make_section_change(_scale_area),
        _make_section_targets(),
        shows=RING,
        fraction=True,
    ),
    Cause(
        "section width",
        "the section of {target} is wider (along y) by the fraction {size}",
        _make_section_change(_make_size_change(0)),
        _make_section_targets(_is_rectangle),
        shows=RING,
        fraction=True,
    ),
    Cause(
        "section height",
        "the section of {target} is higher (along z) by the fraction {size}",
        _make_section_change(_make_size_change(1)),
        _make_section_targets(_is_rectangle),
        shows=RING,
        fraction=True,
    ),
    Cause(
        "section size",
        "all sizes of the section of {target} are larger by the fraction {size} (a diameter)",
        _make_section_change(_scale_all_dimensions),
        _make_section_targets(),
        shows=RING,
        fraction=True,
    ),
    Cause(
        "wall thickness",
        "the wall of {target} is thicker by the fraction {size}",
        _make_section_change(_scale_wall_thickness),
        _make_section_targets(_is_tube),
        shows=RING,
        fraction=True,
    ),
)
