"""Damping of beams by a ratio that one natural mode is to have.

Kelvin-Voigt damping with one retardation time eta for all strains, D = eta C (`elements.beam`), damps a mode of frequency omega
with the ratio zeta = eta omega / 2: it grows with frequency, so that one target ratio at one mode fixes it for all others.
"""

from __future__ import annotations

from dataclasses import replace

from flexinv.errors import InputError
from flexinv.linearized.modes import Modes, compute_modes, resolve_setup
from flexinv.model.mechanism import Mechanism, with_retardation
from flexinv.model.owned_cache import make_owner_cache
from flexinv.validation import check_kind

# So many modes are named in the note that says what a ratio at one of them makes of the others.
NAMED = 4


def resolve_damping_ratio(mechanism: Mechanism) -> Mechanism:
    """Return `apply_stated_ratio` of what is checked to be a mechanism [N s], [N m^2 s]; `kinematics.mesh.build` asks for that.

    Raises InputError for what is no mechanism, and as `apply_damping_ratio`.
    """
    check_kind("mechanism", mechanism, Mechanism)
    return apply_stated_ratio(mechanism)


@make_owner_cache()
def apply_stated_ratio(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism with the damping that its stated ratio makes of its beams [N s], [N m^2 s], and a note of it.

    A mechanism that states none, or for which that was computed before, is returned itself.  Raises InputError as
    `apply_damping_ratio`.
    """
    stated = mechanism.modal_damping
    if stated is None or stated.seconds is not None:
        return mechanism
    made, seconds, found = apply_damping_ratio(mechanism, stated.ratio, stated.mode)
    pairs = zip(found.frequency[:NAMED], found.ratio[:NAMED], strict=True)
    ratios = ", ".join(f"{k} at {frequency:.4g} Hz {ratio:.3g}" for k, (frequency, ratio) in enumerate(pairs, 1))
    computed = replace(stated, seconds=seconds)
    note = f"damping of beams: {computed}, computed by flexinv; ratios of modes: {ratios}"
    return replace(made, modal_damping=computed, notes=(*made.notes, note))


def apply_damping_ratio(mechanism: Mechanism, ratio: float, mode: int = 1) -> tuple[Mechanism, float, Modes]:
    """Return the mechanism with all beams so damped that one natural mode has a given ratio [-], the time [s], and the modes.

    eta = ratio / (ratio of that mode at eta = 1 s)

    ratio : of critical damping, 0 to 1; mode : its number, 1 the lowest, all joints held at zero [rad], [m]
    Raises InputError for a ratio outside 0 to 1, without beams, and for a mode that does not oscillate or strain them.
    """
    if not mechanism.beams:
        raise InputError(
            f"damping ratio: '{mechanism.name}' has no beam that could be damped; give its joints a damping"
        )
    if not 0.0 <= ratio < 1.0:
        raise InputError(f"damping ratio {ratio:g}: expected 0 to 1 [-], for example 0.01")
    modes = compute_modes(*resolve_setup(with_retardation(mechanism, 1.0), None, None, None), None)
    if not 1 <= mode <= len(modes.squared):
        raise InputError(f"damping ratio: mode {mode}, expected 1 to {len(modes.squared)}, the modes that are found")
    computed = float(modes.ratio[mode - 1])
    if not computed > 0.0:
        raise InputError(f"damping ratio: mode {mode} does not oscillate; take another, `flexinv modes` lists them")
    seconds = ratio / computed
    return with_retardation(mechanism, seconds), seconds, replace(modes, friction=seconds * modes.friction)
