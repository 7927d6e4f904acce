"""Closed loops and springs as tests of derivatives take them: shortened motions, links replaced by beams."""

from __future__ import annotations

from dataclasses import replace

import loop_examples
import numpy as np

import flexinv
from flexinv.model.links import Link, Placement


def soften(root, example, names, order=3):
    """Return the example with beams in place of the named links; what was tied to these is tied to their ends."""
    mechanism, case = example
    strip = flexinv.load_mechanism(root / "models" / "four_bar_flexible").link_of["coupler"].beam
    assert strip is not None
    links = tuple(
        Link(link.name, beam=replace(strip, length=float(link.tip[0]), order=order)) if link.name in names else link
        for link in mechanism.links
    )

    def move(end):
        return replace(end, placement=Placement(), station=1.0) if end.link in names else end

    closures = tuple(replace(one, first=move(one.first), second=move(one.second)) for one in mechanism.closures)
    springs = tuple(replace(one, first=move(one.first), second=move(one.second)) for one in mechanism.springs)
    return replace(mechanism, links=links, closures=closures, springs=springs, forces=()), case


def shorten(example, steps):
    """Return the mechanism, the first third of its motion as a smooth one, its start and a step."""
    mechanism, case = example
    whole = case.motion
    at = np.array([0.0, 0.35 * whole.duration])
    q, _, _ = whole.evaluate(mechanism, at)
    names = list(whole.joints(mechanism))
    first, last = ({name: part[mechanism.q_slices[name]] for name in names} for part in q)
    motion = flexinv.Motion.point_to_point(first, last, duration=0.3, law="nonic")
    return mechanism, motion, case.start, 0.3 / steps


# Example, number, and the change of the differences in its own unit; of beams also the links that they replace.
EXAMPLES = {
    "friction where the drive is": (loop_examples.four_bar, "joints.A.friction", 1e-3),
    "drives that are more than the freedoms": (lambda: loop_examples.five_bar(3), "motion.A[1]", 2e-2),
    "a length of these": (lambda: loop_examples.five_bar(3), "joints.D.placement.position[0]", 1e-3),
    "weight of a drive": (lambda: loop_examples.five_bar(3), "joints.B.weight", 1e-2),
    "friction of a joint without a drive": (lambda: loop_examples.slider_crank("pin"), "joints.S.friction", 1e-3),
    "a slide as closure": (lambda: loop_examples.slider_crank("prismatic"), "motion.A[1]", 2e-2),
    "a point on a line": (lambda: loop_examples.slider_crank("point-on-line"), "joints.B.placement.position[0]", 1e-3),
    "in space": (loop_examples.spatial, "motion.A[1]", 1e-2),
    "a coupling": (loop_examples.rack_and_pinion, "closures.gear.offset", 1e-2),
    "springs and forces in a loop": (loop_examples.loaded, "motion.A[1]", 1e-2),
    "damper of a spring": (loop_examples.loaded, "springs.spring.damping", 1e-2),
    "a spring beside a tree": (loop_examples.loaded_tree, "motion.K[1]", 1e-2),
    "place of a spring": (loop_examples.loaded_tree, "springs.spring.first.placement.position[0]", 1e-3),
}
SOFT = {
    "two beams in a loop": (lambda: loop_examples.five_bar(2), ("far left", "far right"), "motion.A[1]", 1e-2),
    "a beam and a slider": (
        lambda: loop_examples.slider_crank("pin"),
        ("rod",),
        "closures.C.second.placement.position[1]",
        1e-2,
    ),
    "a beam in space": (loop_examples.spatial, ("coupler",), "motion.A[1]", 2e-3),
    "a beam, a spring and joint springs": (loop_examples.loaded, ("coupler",), "joints.A.placement.position[0]", 1e-3),
    "the damper of this spring": (loop_examples.loaded, ("coupler",), "springs.spring.damping", 0.3),
}
