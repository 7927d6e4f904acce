"""Where faults are planted: mechanisms and motions that between them show every cause, each in one engine."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from crosscheck.causes.separate import TRIALS
from crosscheck.causes.subject import Subject
from flexinv.files.case import Case
from flexinv.mechanism import Mechanism
from flexinv.motion import Motion

Moved = Callable[[Mechanism, Case], Case]


@dataclass(frozen=True)
class Bench:
    """A case of a mechanism, the engine that gets the faults, and what it is told.

    causes : only these; steps : of a march, per sample; motion : in the place of the case's own, and its name
    """

    mechanism: str
    case: str
    engine: str
    options: Mapping[str, Any] | None = None
    causes: tuple[str, ...] = ()
    steps: int = 2
    motion: tuple[str, Moved] | None = None

    @property
    def label(self) -> str:
        """Mechanism, motion and engine."""
        return f"{self.mechanism}/{self.motion[0] if self.motion else self.case} in {self.engine}"


def _quick(mechanism: Mechanism, case: Case) -> Case:
    """All joints quickly, each at a rhythm of its own: the trial motion that the report proposes to tell inertias apart."""
    trial = TRIALS["all joints moved quickly, each at a rhythm of its own"]
    return Subject(mechanism, case).with_states(lambda harmed, given: trial(harmed, given.time)).case


def _flick(mechanism: Mechanism, case: Case) -> Case:
    """A turn by 0.1 rad in 0.02 s, then rest: a stroke that leaves the second and the third bending mode ringing."""
    joints = [joint.name for joint in mechanism.joints if joint.nv]
    motion = Motion.point_to_point(
        dict.fromkeys(joints, 0.0), dict.fromkeys(joints, 0.1), 0.02, hold=0.13, law="quintic"
    )
    return replace(case, motion=motion, end=motion.duration, step=2.5e-5, sample=5e-4)


QUICK, FLICK = ("quick", _quick), ("flick", _flick)
# Flexible ones at half their usual fineness: hundreds of runs, and error bars that know of it.
COARSE = {"elements": 8, "error": False}
OF_THE_BASE = ("base acceleration convention", "base acceleration convention (spatial)")
OF_INERTIA = (
    "inertial frame rotated",
    "inertia about the origin",
    "inertia about the wrong point",
    "rotary inertia dropped",
    "fixed joint fused wrongly",
    "centre of mass shifted",
)
OF_WAVES = (
    "time step",
    "numerical damping",
    "lumped mass",
    "section stiffness",
    "shear factor",
    "rotary inertia of the section",
)
BENCHES = (
    Bench("double_pendulum", "swing", "pinocchio"),
    Bench("rigid_3r", "quintic", "exudyn"),
    Bench("ur5", "reach", "mujoco"),
    Bench("ur5", "reach", "pinocchio", causes=OF_INERTIA, motion=QUICK),
    Bench("panda", "pick", "mujoco"),
    Bench("panda", "pick", "exudyn", causes=OF_INERTIA, motion=QUICK),
    Bench("talos_arm", "wave", "pinocchio"),
    Bench("talos", "squat", "pinocchio", causes=OF_THE_BASE),
    Bench("four_bar", "turn", "mujoco"),
    Bench("five_bar", "reach", "pinocchio"),
    Bench("bricard", "fold", "pinocchio"),
    Bench("flex_one_link", "cycloid", "exudyn-ge", COARSE, steps=8),
    Bench("flex_one_link", "bang_bang", "exudyn-ge", {"elements": 16, "error": False}, OF_WAVES, steps=20, motion=FLICK),
    Bench("flex_two_link", "cycloid", "exudyn-ancf", COARSE, steps=8),
    Bench("spatial_arm", "reach", "exudyn-ge", COARSE),
)
