"""Mistakes with beams: sections, material, how they are clamped, how long they are, and how finely they are meshed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from campaigns.beyond import edits
from campaigns.beyond.fault import ALL, CorrectAnswer, Fault, FaultScenario, RecipeTopic, draw_one
from flexinv.model.mechanism import Link, Section

CHAPTER = RecipeTopic("beams")
UNSEEN = {"GJ": 0.8, "EI_y": 0.8}  # how often not in a plane, where neither of them shows
NAMES = ("EA", "GA_y", "GA_z", "GJ", "EI_y", "EI_z")
DEGREE = np.pi / 180.0


def _draw_beam(scenario: FaultScenario, rng: np.random.Generator) -> Link | None:
    link: Link | None = draw_one(rng, scenario.mechanism.beams)
    return link


def _list_place_names(scenario: FaultScenario, link: Link) -> tuple[str, ...]:
    return edits.list_body_names(scenario.mechanism, link.name)


def _make_section_fault(
    scenario: FaultScenario, link: Link, words: str, kinds: tuple[str, ...], change: Callable[[Section], Section]
) -> Fault:
    """A fault in the section of one beam."""
    near = tuple(k for k in (*NAMES, "stiffness", "beam mass", "rho I", "section size", "E") if k not in kinds)
    at = _list_place_names(scenario, link)
    weight = CorrectAnswer(("beam mass", "mass"), at)
    springs = CorrectAnswer(("stiffness", "E", *NAMES), at)
    return Fault(
        f"{words} of {link.name}",
        ((CorrectAnswer(kinds, at),),),
        (CorrectAnswer(near, at),),
        lambda m: edits.replace_section(m, link.name, change),
        same=((weight,), (springs,)) if "section size" in kinds else (),
    )


def _is_planar(scenario: FaultScenario) -> bool:
    """Return True if hinges are parallel to the world's z axis and gravity normal to it: bending in the plane only."""
    joints = [j for j in scenario.mechanism.joints if j.nv]
    return all(j.kind == "prismatic" or abs(j.axis[2]) == 1.0 for j in joints) and not scenario.mechanism.gravity[2]


def _scale_stiffness(section: Section, *factors: float) -> Section:
    damping = None if section.damping is None else section.damping * np.array(factors)
    return replace(section, stiffness=section.stiffness * np.array(factors), damping=damping)


def _make_stiffness_recipe(name: str) -> Callable[[FaultScenario, np.random.Generator, float], Fault | None]:
    """A recipe: one of the six stiffnesses is so many times as large."""

    def draw(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
        if (link := _draw_beam(scenario, rng)) is None or (
            name in UNSEEN and _is_planar(scenario) and rng.random() < UNSEEN[name]
        ):
            return None
        factors = [size if n == name else 1.0 for n in NAMES]
        return _make_section_fault(
            scenario, link, f"{name} x{size:.5g}", (name,), lambda s: _scale_stiffness(s, *factors)
        )

    return draw


CHAPTER("EI_z", 1.0002, 1.02, 1.1, 16.0)(_make_stiffness_recipe("EI_z"))
CHAPTER("EI_y", 1.0002, 1.02, 1.1, 0.5)(_make_stiffness_recipe("EI_y"))
CHAPTER("GJ", 1.0002, 1.05, 0.385)(_make_stiffness_recipe("GJ"))
CHAPTER("EA", 1.05, 1e-3)(_make_stiffness_recipe("EA"))


@CHAPTER("modulus", 1.0002, 1.05, 0.95, 1.12, 0.1)
def make_modulus_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """Young's modulus, and with it the shear modulus, is another one."""
    if (link := _draw_beam(scenario, rng)) is None:
        return None
    kinds = ("E", "stiffness", "EI_z", "EI_y")
    return _make_section_fault(
        scenario, link, f"E and G x{size:.5g}", kinds, lambda s: _scale_stiffness(s, *[size] * 6)
    )


@CHAPTER("shear correction", 1.2, 100.0, 0.01)
def make_shear_stiffness_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The shear stiffness without its correction, or rigid, or far too soft."""
    if (link := _draw_beam(scenario, rng)) is None:
        return None
    kinds = ("GA", "GA_y", "GA_z")
    return _make_section_fault(
        scenario, link, f"GA x{size:.5g}", kinds, lambda s: _scale_stiffness(s, 1.0, size, size, 1.0, 1.0, 1.0)
    )


@CHAPTER("density of a beam", 1.0002, 1.01, 1.05, 0.453592)
def make_density_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The density of a beam's material is another one."""
    if (link := _draw_beam(scenario, rng)) is None:
        return None
    return _make_section_fault(
        scenario,
        link,
        f"density x{size:.5g}",
        ("beam mass", "mass"),
        lambda s: replace(s, mass_per_length=s.mass_per_length * size, rotary_inertia=s.rotary_inertia * size),
    )


@CHAPTER("mass per length", 1.0002, 1.02, 1.1)
def make_linear_density_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The mass per length of a beam is another one, its rotary inertia is not."""
    if (link := _draw_beam(scenario, rng)) is None:
        return None
    return _make_section_fault(
        scenario,
        link,
        f"mass per length x{size:.5g}",
        ("beam mass", "mass"),
        lambda s: replace(s, mass_per_length=s.mass_per_length * size),
    )


@CHAPTER("rotary inertia of a section", 0.0, 2.0, 100.0)
def make_rotary_inertia_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The rotary inertia of the section is left out or too large."""
    if (link := _draw_beam(scenario, rng)) is None:
        return None
    return _make_section_fault(
        scenario,
        link,
        f"rotary inertia x{size:.5g}",
        ("rho I",),
        lambda s: replace(s, rotary_inertia=s.rotary_inertia * max(size, 1e-6)),
    )


@CHAPTER("width of a strip", 1.0002, 1.02, 1.1)
def make_width_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """A strip is wider: along z, so that it bends in its x-y plane with the same thickness."""
    if (link := _draw_beam(scenario, rng)) is None:
        return None

    def update_section(section: Section) -> Section:
        y = section.rotary_inertia[:, 1] * size**3
        z = section.rotary_inertia[:, 2] * size
        wider = _scale_stiffness(section, size, size, size, size, size**3, size)
        return replace(
            wider, mass_per_length=section.mass_per_length * size, rotary_inertia=np.stack([y + z, y, z], axis=1)
        )

    return _make_section_fault(scenario, link, f"width x{size:.5g}", ("section size",), update_section)


@CHAPTER("thickness of a strip", 1.0002, 1.02, 1.1)
def make_thickness_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """A strip is thicker: along y, so that it bends in its x-y plane with the cube of it."""
    if (link := _draw_beam(scenario, rng)) is None:
        return None

    def update_section(section: Section) -> Section:
        y = section.rotary_inertia[:, 1] * size
        z = section.rotary_inertia[:, 2] * size**3
        thicker = _scale_stiffness(section, size, size, size, size**3, size, size**3)
        return replace(
            thicker, mass_per_length=section.mass_per_length * size, rotary_inertia=np.stack([y + z, y, z], axis=1)
        )

    return _make_section_fault(scenario, link, f"thickness x{size:.5g}", ("section size",), update_section)


@CHAPTER("wall of a tube", 1.0002, 1.02, 1.1)
def make_wall_thickness_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """A thin tube has a thicker wall: everything per length grows with it."""
    if (link := _draw_beam(scenario, rng)) is None:
        return None

    def update_section(section: Section) -> Section:
        return replace(
            _scale_stiffness(section, *[size] * 6),
            mass_per_length=section.mass_per_length * size,
            rotary_inertia=section.rotary_inertia * size,
        )

    return _make_section_fault(scenario, link, f"wall x{size:.5g}", ("section size",), update_section)


@CHAPTER("diameter", 1.0002, 1.01, 2.0)
def make_diameter_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """All dimensions of the section are larger: radius for diameter, or a rounded drawing."""
    if (link := _draw_beam(scenario, rng)) is None:
        return None

    def update_section(section: Section) -> Section:
        square = size**2
        fourth = size**4
        return replace(
            _scale_stiffness(section, square, square, square, fourth, fourth, fourth),
            mass_per_length=section.mass_per_length * square,
            rotary_inertia=section.rotary_inertia * fourth,
        )

    return _make_section_fault(scenario, link, f"diameter x{size:.5g}", ("section size",), update_section)


@CHAPTER("width for height", 1.0)
def make_exchanged_sides_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The section lies on its side: width and height are exchanged."""
    if (link := _draw_beam(scenario, rng)) is None:
        return None

    def update_section(section: Section) -> Section:
        stiff = [0, 2, 1, 3, 5, 4]
        inertia = [0, 2, 1]
        damping = None if section.damping is None else section.damping[:, stiff]
        return replace(
            section,
            stiffness=section.stiffness[:, stiff],
            rotary_inertia=section.rotary_inertia[:, inertia],
            damping=damping,
        )

    return _make_section_fault(scenario, link, "width and height exchanged", ("section turned",), update_section)


@CHAPTER("length of a beam", 1.0002, 1.01, 1.05)
def make_beam_length_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """A beam is longer; what hangs at its end moves out."""
    if (link := _draw_beam(scenario, rng)) is None:
        return None
    return Fault(
        f"length of {link.name} x{size:.5g}",
        ((CorrectAnswer(("beam length", "length"), _list_place_names(scenario, link)),),),
        (CorrectAnswer(("beam mass", "placement", "EI_z", "stiffness"), _list_place_names(scenario, link)),),
        lambda m: edits.replace_beam(m, link.name, lambda b: replace(b, length=b.length * size)),
    )


@CHAPTER("clamp off the axis", 1e-6, 1e-3, 4e-3, 2e-2)
def make_clamp_position_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The root of a beam is clamped beside the axis, in the plane of its section or along the beam."""
    if (link := _draw_beam(scenario, rng)) is None:
        return None
    way = np.array(draw_one(rng, [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    return Fault(
        f"clamp of {link.name} off by {(size * way).tolist()} m",
        ((CorrectAnswer(("clamp", "placement", "length"), _list_place_names(scenario, link)),),),
        (CorrectAnswer(("beam length", "com", "angle offset"), _list_place_names(scenario, link)),),
        lambda m: edits.replace_beam(
            m,
            link.name,
            lambda b: replace(b, placement=edits.move_placement(b.placement, size * b.placement.rotation @ way)),
        ),
    )


@CHAPTER("clamp turned", 1e-5, 0.5 * DEGREE, 3 * DEGREE)
def make_clamp_angle_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """A beam is clamped at an angle; about its own axis the section turns."""
    if (link := _draw_beam(scenario, rng)) is None:
        return None
    axis = np.array(draw_one(rng, [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
    return Fault(
        f"clamp of {link.name} turned by {size / DEGREE:.3g} degrees about {axis.tolist()}",
        (
            (
                CorrectAnswer(
                    ("clamp", "angle offset", "orientation", "section angle"), _list_place_names(scenario, link)
                ),
            ),
        ),
        (CorrectAnswer(("axis tilt", "section turned", "placement"), _list_place_names(scenario, link)),),
        lambda m: edits.replace_beam(
            m, link.name, lambda b: replace(b, placement=edits.turn_placement(b.placement, axis, size))
        ),
    )


@CHAPTER("bent at rest", 1e-4, 0.02, 0.2)
def make_curvature_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """A beam that should be straight is bowed: by so many radians over its length."""
    if (link := _draw_beam(scenario, rng)) is None or link.beam is None:
        return None
    way = np.array([0.0, 0.0, size / link.beam.length])
    return Fault(
        f"{link.name} bowed by {size:.3g} rad",
        ((CorrectAnswer(("curvature",), _list_place_names(scenario, link)),),),
        (
            CorrectAnswer(
                ("clamp", "angle offset"),
                (*_list_place_names(scenario, link), *edits.list_child_joints(scenario.mechanism, link.name)),
            ),
        ),
        lambda m: edits.replace_beam(m, link.name, lambda b: replace(b, curvature=b.curvature + way)),
    )


@CHAPTER("damping of a beam", 1e-5, 1e-3, 1e-2)
def make_added_damping_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """A beam has damping that the other model has not: so many times the time of a bending wave along it."""
    if (link := _draw_beam(scenario, rng)) is None or link.beam is None:
        return None
    section = link.beam.section
    length = link.beam.length
    period = length**2 * float(np.sqrt(section.mass_per_length[0] / section.stiffness[0, 5]))

    def update_section(section: Section) -> Section:
        old = 0.0 if section.damping is None else section.damping
        return replace(section, damping=old + size * period * section.stiffness)

    return _make_section_fault(scenario, link, f"damping of {size * period:.3g} s", ("beam damping",), update_section)


@CHAPTER("damping of a beam lost", 0.0, 2.0)
def make_missing_damping_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """The damping of a beam is left out, or is taken for twice what it is (ratio for loss factor)."""
    known = [b for b in scenario.mechanism.beams if b.beam is not None and b.beam.section.damping is not None]
    if (link := draw_one(rng, known)) is None:
        return None

    def update_section(section: Section) -> Section:
        return replace(section, damping=section.damping * size if size and section.damping is not None else None)

    fault = _make_section_fault(scenario, link, f"damping x{size:.3g}", ("beam damping",), update_section)
    alone = (ALL,) if len(known) == 1 else ()
    return replace(fault, parts=((CorrectAnswer(("beam damping",), (*_list_place_names(scenario, link), *alone)),),))


@CHAPTER("mesh", 1, 2, 4)
def make_coarse_mesh_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """Too few elements in the other engine; its own refinement says so."""
    if scenario.rigid or not scenario.engine.startswith("exudyn"):
        return None
    return Fault(
        f"{int(size)} elements per beam",
        ((CorrectAnswer(("mesh",)),),),
        (CorrectAnswer(("lumped mass", "stiffness", "step")),),
        options={"elements": int(size)},
        bars=True,
    )


@CHAPTER("step", 20.0, 100.0)
def make_long_step_fault(scenario: FaultScenario, rng: np.random.Generator, size: float) -> Fault | None:
    """Far too long a step in the other engine; its own refinement says so."""
    if scenario.rigid or not scenario.engine.startswith("exudyn"):
        return None
    return Fault(
        f"{int(size)} times as long a step",
        ((CorrectAnswer(("step", "numerical damping")),),),
        (CorrectAnswer(("mesh",)),),
        options={"step": size * scenario.case.end / 8000.0},
        bars=True,
    )
