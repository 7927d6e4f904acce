"""Whether ``flexinv.solve(..., accuracy=)`` keeps what it promises: true errors and error bars of twelve mechanisms.

Below them stand two of which the finest accuracies are refused, in words: they say what would have to change.

    python docs/studies/accuracy.py [name ...]

Every mechanism is solved with accuracies of 1e-2 to 1e-5 and held against a reference of its own: the finest meshes of the ladder
and steps some times as short, both shown to have converged (column "reference").  Columns: the true error of the worst torque or
tip over its range; how many times better that is than asked; the part of all samples that the error bars cover; the time of the
call.
"""

from __future__ import annotations

import sys
import time as clock
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click
import numpy as np

import flexinv
from flexinv.analysis.accurate import solve_problem
from flexinv.analysis.extrapolation import weights
from flexinv.analysis.refinement import MESHES, Quantities, Refinement, mixed, ranges
from flexinv.analysis.task import Settings
from flexinv.model.mechanism import Mechanism, ModalDamping, with_retardation

MODELS = Path(__file__).resolve().parents[2] / "models"
ASKED = (1e-2, 1e-3, 1e-4, 1e-5)
Options = dict[str, Any]


@dataclass(frozen=True)
class Subject:
    """One mechanism of the campaign: its motion and the options of `flexinv.solve`; rungs of the reference [-]."""

    mechanism: Mechanism
    motion: flexinv.Motion
    options: Options
    finer: int = 96


def model(name: str, case: str, finer: int = 96, **law: Any) -> Callable[[], Subject]:
    """Return a case of models/, of which ``law`` may state another motion of the driven joints."""

    def made() -> Subject:
        mechanism = flexinv.load_mechanism(MODELS / name)
        own = flexinv.load_cases(MODELS / name, mechanism)[case]
        motion = flexinv.Motion.point_to_point(**law) if law else own.motion
        end = motion.duration if law else own.end
        return Subject(mechanism, motion, {"initial": own.initial, "start": own.start, "end": end}, finer)

    return made


def damped(made: Callable[[], Subject], ratio: float) -> Callable[[], Subject]:
    """Return the subject with a damping ratio [-] of its first mode."""

    def more() -> Subject:
        subject = made()
        return replace(subject, mechanism=replace(subject.mechanism, modal_damping=ModalDamping(ratio)))

    return more


def retarded(made: Callable[[], Subject], seconds: float) -> Callable[[], Subject]:
    """Return the subject with a retardation time [s] of all its beams."""

    def more() -> Subject:
        subject = made()
        return replace(subject, mechanism=with_retardation(subject.mechanism, seconds))

    return more


def by(made: Callable[[], Subject], law: str) -> Callable[[], Subject]:
    """Return the subject with another time law of the same moves."""

    def other() -> Subject:
        subject = made()
        tracks = tuple(replace(track, law=law) for track in subject.motion.tracks)
        return replace(subject, motion=flexinv.Motion(tracks, subject.motion.duration))

    return other


def move(law: str, start: dict[str, float], end: dict[str, float], duration: float, hold: float) -> Options:
    """Return the arguments of a move [s]."""
    return {"law": law, "start": start, "end": end, "duration": duration, "hold": hold}


TURN = ({"hub": 0.0}, {"hub": np.pi}, 0.2, 0.1)
TWO = ({"joint1": 0.0, "joint2": 0.0}, {"joint1": 0.5, "joint2": 1.0}, 0.2, 0.1)
SUBJECTS: dict[str, Callable[[], Subject]] = {
    "one link, nonic": model("flex_one_link", "cycloid", **move("nonic", *TURN)),
    "one link, cycloid (jerk jumps)": model("flex_one_link", "cycloid", 1536, **move("cycloid", *TURN)),
    "one link, damped, bang-bang": model("flex_one_link_damped", "cycloid", 384, **move("bang-bang", *TURN)),
    "one link, damped, trapezoid": model("flex_one_link_damped", "cycloid", 384, **move("trapezoid", *TURN)),
    "two links, nonic": model("flex_two_link", "cycloid", 192, **move("nonic", *TWO)),
    "two links, damped, quintic": damped(model("flex_two_link", "cycloid", 192, **move("quintic", *TWO)), 0.02),
    "arm in space, static, nonic": by(model("spatial_arm", "reach", 192), "nonic"),
    "arm in space, damped, cycloid": damped(by(model("spatial_arm", "reach", 384), "cycloid"), 0.02),
    "robot in space, static, damped": damped(by(model("ur5_flexible_forearm", "reach", 192), "septic"), 0.02),
    "flexible four-bar, static, nonic": by(model("four_bar_flexible", "turn", 384), "nonic"),
    "flexible slider-crank": damped(model("slider_crank_flexible", "turn", 384), 0.02),
    "elastic drives (springs)": model("elastic_drives", "swing"),
}
# What no steps reach in full, which is said: undamped jumps of the jerk in space, hands that stop at once what waves run from.
OUT_OF_REACH: dict[str, Callable[[], Subject]] = {
    "arm in space, undamped, quintic": by(model("spatial_arm", "reach", 1536), "quintic"),
    "two arms carry (impacts)": retarded(model("two_arms_flexible", "carry", 96), 2e-3),
}


@dataclass(frozen=True)
class Reference:
    """What is true: quantities at times [s], their ranges, and how far a rougher reference is from it (quantities,) [-]."""

    time: np.ndarray
    found: Quantities
    scale: Quantities
    apart: np.ndarray


def reference(subject: Subject) -> Reference:
    """Return a reference on a finer mesh than answers have, by steps that are ``finer`` times shorter than the coarsest."""
    settings = Settings(initial=subject.options["initial"])
    refinement = Refinement(solve_problem(subject.mechanism, subject.motion, 1e-3, settings, subject.options))
    made = []
    for mesh, finer in ((len(MESHES) - 2, subject.finer // 2), (len(MESHES) - 1, subject.finer)):
        first, second = (refinement.run_level(mesh, n) for n in (finer // 2, finer))
        if first is None or second is None:
            raise SystemExit(f"no reference: {refinement.failure}")
        found = mixed(
            [first.quantities, second.quantities.take_samples(second.samples_per_step // first.samples_per_step)],
            weights((finer // 2, finer)),
        )
        made.append((first.first.time, found, second.mesh))
    (_, rough, _), (time, fine, mesh) = made
    scale = ranges(mesh, fine)
    fine_there = fine.take_samples((len(fine.torque) - 1) // (len(rough.torque) - 1))
    return Reference(time, fine, scale, scale.compute_errors(fine_there, rough).max(axis=0))


def errors(known: Reference, found: flexinv.Solution) -> tuple[np.ndarray, np.ndarray]:
    """Return true errors and bars of efforts and tips (samples, quantities), in parts of their ranges [-]."""
    at = np.searchsorted(known.time, found.time - 1e-9 * known.time[-1])
    assert np.abs(known.time[at] - found.time).max() < 1e-8 * known.time[-1], (
        "samples of the reference are not those of the answer"
    )
    true = Quantities(*(part[at] for part in known.found))
    tips = np.stack(list(found.tip.values()), axis=1)
    own = Quantities(found.torque, tips, true.free)
    bars = np.hstack(
        [found.torque_error / known.scale.torque, np.stack(list(found.tip_error.values()), axis=1) / known.scale.tip]
    )
    return known.scale.compute_errors(own, true)[:, : bars.shape[1]], bars


def lines(name: str) -> Iterator[str]:
    """Yield the lines of one subject of the table."""
    subject = (SUBJECTS | OUT_OF_REACH)[name]()
    known = reference(subject)
    for asked in ASKED:
        start = clock.perf_counter()
        try:
            found = flexinv.solve(subject.mechanism, subject.motion, accuracy=asked, **subject.options)
        except flexinv.ConvergenceError as complaint:
            yield f"| {name} | {asked:.0e} | - | {known.apart.max():.1e} | - | - | {complaint} |"
            continue
        taken = clock.perf_counter() - start
        true, bars = errors(known, found)
        covered = (true <= bars).mean()
        how = ("extrapolated" if found.settings["extrapolated"] else "plain") + f", step {found.settings['step']:.2g}"
        beams = {(link.beam.elements, link.beam.order) for link in found.mechanism.links if link.beam}
        yield (
            f"| {name} | {asked:.0e} | {true.max():.1e} | {known.apart.max():.1e} | {asked / true.max():.1f} "
            f"| {covered:.3f} | {taken:.2f} s, {how}, {sorted(beams)} |"
        )


def main(names: list[str]) -> None:
    """Print the table."""
    click.echo("| mechanism | asked | true error | reference | times better | covered | how |")
    click.echo("|---|---|---|---|---|---|---|")
    for name in SUBJECTS | OUT_OF_REACH:
        if not names or any(word in name for word in names):
            for line in lines(name):
                click.echo(line)


if __name__ == "__main__":
    main(sys.argv[1:])
