"""Causes in beams: sections, their orientation, the distribution of mass, and settings of the time integration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from crosscheck.causes.cause import Cause, Change, Targets, check_fraction, list_beams, list_flexible_target
from crosscheck.causes.model import Model
from crosscheck.causes.subject import Subject
from flexinv.model.mechanism import Beam, Body, Inertia, Link
from flexinv.typing import Array

RING = "a stop and a rest long enough to ring: stiffness moves the frequency, mass moves the torque before it, too"
FINER = "the same run with another mesh and another step"
STIFFNESS = {"EA": (0,), "GJ": (3,), "EI_y": (4,), "EI_z": (5,)}
SHEAR = (1, 2)
BUSHELS = 4  # lumps per beam: as many as the mesh of low order that a user would take
AT = ": "


def _make_section_change(change: Callable[[Beam, float], Beam]) -> Change:
    def apply_change(subject: Subject, target: str, size: Array) -> Subject:
        return subject.replace_beam(target, lambda beam: change(beam, check_fraction(size)))

    return apply_change


def _scale_component(subject: Subject, target: str, size: Array) -> Subject:
    link, component = target.split(AT)
    return subject.replace_beam(link, lambda beam: _scale_stiffness(beam, STIFFNESS[component], check_fraction(size)))


def _scale_stiffness(beam: Beam, columns: tuple[int, ...], size: float) -> Beam:
    section = beam.section
    if section.has_coupled_strains:
        section.check_independent("causes: a change of some stiffnesses")
    stiffness = section.stiffness.copy()
    stiffness[:, list(columns)] *= 1.0 + size
    return replace(beam, section=replace(section, stiffness=stiffness))


def _scale_mass_per_length(beam: Beam, size: float) -> Beam:
    section = beam.section
    return replace(beam, section=replace(section, mass_per_length=section.mass_per_length * (1.0 + size)))


def _scale_rotary_inertia(beam: Beam, size: float) -> Beam:
    section = beam.section
    return replace(beam, section=replace(section, rotary_inertia=section.rotary_inertia * (1.0 + size)))


def _compute_rotary_scale(model: Model, target: str) -> float:
    """Return the part [-] of a section's rotary inertia that turns the beam as a tenth of its mass does, 1 at least.

    Of a thin strip that is a hundred times what it has, and more; whoever takes its width for its thickness is as far off.
    """
    beam = model.base.mechanism.link_of[target].beam
    assert beam is not None
    of_section = float(beam.section.rotary_inertia.max())
    of_length = float(beam.section.mass_per_length.mean()) * beam.length**2 / 12.0
    return max(1.0, 0.1 * of_length / of_section) if of_section > 0.0 else 0.0


def _add_kelvin_voigt_damping(beam: Beam, size: float) -> Beam:
    """Add size [s] times each stiffness to the damping: stress by the rate of strain (Kelvin-Voigt)."""
    section = beam.section
    if section.has_coupled_strains:
        damping = section.damping_matrices + size * section.stiffness_matrices
        return replace(beam, section=replace(section, damping=damping))
    before = 0.0 * section.stiffness if section.damping is None else section.damping
    return replace(beam, section=replace(section, damping=before + size * section.stiffness))


def _drop_damping(beam: Beam, size: float) -> Beam:
    return replace(beam, section=replace(beam.section, damping=None))


def _has_damping(beam: Beam) -> bool:
    return beam.section.damping is not None and bool(beam.section.damping.any())


def _compute_retardation_scale(model: Model, target: str) -> float:
    """Return a hundredth of the case's time [s]: what rings a few times in it is damped well by that."""
    return model.base.case.end / 100.0


def _turn_section(beam: Beam, size: float) -> Beam:
    """Exchange the section's y and z; a coupled section is turned by a quarter."""
    section = beam.section
    if section.is_coupled:
        return replace(beam, section=section.move_axis(0.0, 0.0, 0.5 * np.pi))
    swap = [0, 2, 1, 3, 5, 4]
    return replace(
        beam,
        section=replace(
            section, stiffness=section.stiffness[:, swap], rotary_inertia=section.rotary_inertia[:, [0, 2, 1]]
        ),
    )


def _scale_curvature(beam: Beam, size: float) -> Beam:
    return replace(beam, curvature=beam.curvature * (1.0 - size))


def _scale_length(beam: Beam, size: float) -> Beam:
    return replace(beam, length=beam.length * (1.0 + size))


def _move_mass_to_lumps(subject: Subject, target: str, size: Array) -> Subject:
    """Move a fraction of a beam's mass and rotary inertia to points, half a lump at either end."""
    part = float(size[0])

    def update_link(link: Link) -> Link:
        beam = link.beam
        assert beam is not None
        section = beam.section
        stations = np.linspace(0.0, 1.0, BUSHELS + 1)
        weights = np.array([0.5, *[1.0] * (BUSHELS - 1), 0.5]) / BUSHELS * beam.length * part
        there = [section.evaluate_inertia(float(s)) for s in stations]
        lumps = tuple(
            Body(f"lump {k}", Inertia(float(w * inertia.mass), inertia.com, w * inertia.tensor), float(s))
            for k, (s, w, inertia) in enumerate(zip(stations, weights, there, strict=True))
        )
        light = replace(
            section,
            mass_per_length=section.mass_per_length * (1.0 - part),
            rotary_inertia=section.rotary_inertia * (1.0 - part),
        )
        return replace(link, bodies=(*link.bodies, *lumps), beam=replace(beam, section=light))

    return subject.replace_link(target, update_link)


def _list_components(model: Model) -> list[str]:
    return [f"{name}{AT}{component}" for name in _list_independent(model) for component in STIFFNESS]


def _list_independent(model: Model) -> list[str]:
    """Return the beams whose stiffnesses can be changed one by one."""
    return list(_make_beam_targets(lambda beam: not beam.section.has_coupled_strains)(model))


def _make_beam_targets(test: Callable[[Beam], bool]) -> Targets:
    return lambda model: [link.name for link in model.base.mechanism.beams if link.beam is not None and test(link.beam)]


def _has_unequal_axes(beam: Beam) -> bool:
    if beam.section.is_coupled:
        return True
    s = beam.section.stiffness
    return not (np.allclose(s[:, 1], s[:, 2]) and np.allclose(s[:, 4], s[:, 5]))


def _compute_lump_scale(model: Model, target: str) -> float:
    return 5.0  # so that a tenth of it is half of the mass


def _find_long_step(subject: Subject) -> float:
    """Return a step [s] that is too long: two per sample, or one where the case itself takes hardly more."""
    case = subject.case
    return case.sample / 2 if case.step <= case.sample / 4 else case.sample


def _apply_long_step(subject: Subject, target: str, size: Array) -> Subject:
    """Take a long step of little numerical damping: waves come late, and hardly smaller."""
    return subject.update_options(spectral_radius=0.9, step=_find_long_step(subject))


def _apply_numerical_damping(subject: Subject, target: str, size: Array) -> Subject:
    """Take a spectral radius of 0.3, more damping than anybody's default, at a long step: short waves die."""
    return subject.update_options(spectral_radius=0.3, step=_find_long_step(subject))


def _apply_exudyn_step(subject: Subject, target: str, size: Array) -> Subject:
    """Give Exudyn the same long step, in the integrator that it takes anyway."""
    return subject.update_options(step=_find_long_step(subject))


ROWS = (
    Cause(
        "section stiffness",
        "{target} is larger by the fraction {size}",
        _scale_component,
        _list_components,
        fraction=True,
        shows=RING,
    ),
    Cause(
        "shear factor",
        "the shear stiffness of {target} is larger by the fraction {size}",
        _make_section_change(lambda beam, size: _scale_stiffness(beam, SHEAR, size)),
        _list_independent,
        fraction=True,
        shows="a short, thick beam, or quick motion: shear matters where bending waves are short",
    ),
    Cause(
        "beam mass",
        "the mass per length of {target} is larger by the fraction {size}",
        _make_section_change(_scale_mass_per_length),
        list_beams,
        fraction=True,
        shows=RING,
    ),
    Cause(
        "rotary inertia of the section",
        "the rotary inertia (rho I) of {target} differs by the fraction {size}",
        _make_section_change(_scale_rotary_inertia),
        list_beams,
        scale=_compute_rotary_scale,
        shows="quick motion: rotary inertia matters where bending waves are short",
    ),
    Cause(
        "beam damping",
        "the damping of {target} is larger by {size} times its stiffness (Kelvin-Voigt)",
        _make_section_change(_add_kelvin_voigt_damping),
        list_beams,
        scale=_compute_retardation_scale,
        unit="s",
        covers=("beam damping dropped",),
        shows="a stroke and a rest long enough to ring: damping takes the short waves first, and goes with no step",
    ),
    Cause(
        "beam damping dropped",
        "the damping of {target} stands in the model but is not applied",
        _make_section_change(_drop_damping),
        _make_beam_targets(_has_damping),
        0,
        shows="a stroke and a rest long enough to ring",
    ),
    Cause(
        "beam length",
        "{target} is longer by the fraction {size}",
        _make_section_change(_scale_length),
        list_beams,
        fraction=True,
        shows=RING,
    ),
    Cause(
        "section turned",
        "y and z of the section of {target} are exchanged",
        _make_section_change(_turn_section),
        _make_beam_targets(_has_unequal_axes),
        0,
        shows=RING,
    ),
    Cause(
        "curvature dropped",
        "the initial curvature of {target} is dropped by the fraction {size}",
        _make_section_change(_scale_curvature),
        _make_beam_targets(lambda beam: bool(beam.curvature.any())),
        shows="holding still at several places",
    ),
    Cause(
        "lumped mass",
        f"the fraction {{size}} of the mass of {{target}} stands in {BUSHELS} lumps",
        _move_mass_to_lumps,
        list_beams,
        scale=_compute_lump_scale,
        remeshes=True,
        shows=FINER,
    ),
    Cause(
        "time step",
        "the step is too long: {size} times what two steps per sample do (an error that falls with its square)",
        _apply_long_step,
        list_flexible_target,
        linear=True,
        shows=FINER,
        plant=_apply_exudyn_step,
    ),
    Cause(
        "numerical damping",
        "the integrator damps: {size} times what a spectral radius of 0.3 does at two steps per sample",
        _apply_numerical_damping,
        list_flexible_target,
        linear=True,
        shows="a jump of the acceleration and a long rest: numerical damping takes the short waves first",
    ),
)
