"""Machines for campaigns: robots of example-robot-data, held or floating, and random trees of all kinds of joint."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from retelling import Dice, random_turn

from crosscheck.lifting.assembly import list_depth_first
from crosscheck.lifting.rigid import join_bodies
from crosscheck.lifting.urdf import lift_urdf
from flexinv.files.from_urdf import find_robots_folder
from flexinv.model.mechanism import WORLD, Attachment, Body, Closure, Inertia, Joint, Limits, Link, Mechanism, Placement

# What floats is told as "floating"; pairs of it are told from other roots, too.
HELD = (
    "panda_description/urdf/panda.urdf", "ur_description/urdf/ur5_robot.urdf", "ur_description/urdf/ur3_robot.urdf",
    "ur_description/urdf/ur10_robot.urdf", "kinova_description/robots/kinova.urdf", "xarm_description/urdf/xarm7.urdf",
    "z1_description/urdf/z1.urdf", "talos_data/robots/talos_left_arm.urdf", "so_arm_description/urdf/so100.urdf",
    "allegro_hand_description/urdf/allegro_left_hand.urdf", "baxter_description/urdf/baxter.urdf",
    "finger_edu_description/robots/finger_edu.urdf", "asr_twodof_description/urdf/TwoDofs.urdf",
    "double_pendulum_description/urdf/double_pendulum_continuous.urdf", "ur_description/urdf/ur5_gripper.urdf",
    "tiago_description/robots/tiago_no_hand.urdf",
)  # fmt: skip
FLOATING = (
    "solo_description/robots/solo12.urdf", "anymal_c_simple_description/urdf/anymal.urdf",
    "anymal_b_simple_description/robots/anymal-kinova.urdf", "hyq_description/robots/hyq_no_sensors.urdf",
    "a1_description/urdf/a1.urdf", "go2_description/urdf/go2.urdf", "b1_description/urdf/b1-z1.urdf",
    "bolt_description/robots/bolt.urdf", "g1_description/urdf/g1_29dof_rev_1_0.urdf", "solo_description/robots/solo.urdf",
    "talos_data/robots/talos_reduced.urdf", "romeo_description/urdf/romeo_small.urdf", "laikago_description/urdf/laikago.urdf",
    "simple_humanoid_description/urdf/simple_humanoid.urdf", "borinot_description/urdf/borinot_flying_arm_2.urdf",
    "hextilt_description/urdf/hextilt_flying_arm_5.urdf",
)  # fmt: skip
RANDOM = 28  # trees
SEED = 34
KINDS = ("revolute", "revolute", "revolute", "continuous", "prismatic", "fixed")
MORE = ("spherical", "helical", "universal")  # kinds that not every format has a word for
ROOT = "root_joint"


def names_of_machines() -> tuple[str, ...]:
    """Return the names of all machines of the campaign."""
    return (*HELD, *FLOATING, *(f"tree {k}" for k in range(RANDOM)))


def machine(name: str, seed: int = SEED) -> Mechanism:
    """Return a machine by its name [m, kg, rad]; seed : of random trees.  Raises FileNotFoundError for one not installed."""
    if name.startswith("tree "):
        return random_tree(int(name.removeprefix("tree ")), seed)
    file = find_robots_folder() / name
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        lifted = lift_urdf(file, "free" if name in FLOATING else "fixed").mechanism
    joints = tuple(_begun(j) if j.kind == "free" else j for j in lifted.joints)
    links = tuple(_one_body(link) for link in lifted.links)
    return replace(lifted, joints=joints, links=links, urdf=None, packages=(), name="robot", springs=(), forces=())


def _begun(joint: Joint) -> Joint:
    """A base that begins somewhere, so that a URDF says that it floats."""
    return replace(joint, placement=Placement(np.array([0.0, 0.0, 0.5]), joint.placement.rotation), damping=0.0)


def _one_body(link: Link) -> Link:
    body = join_bodies([b.inertia for b in link.bodies])
    return replace(link, bodies=(Body(link.name, body),) if body.mass else ())


def random_tree(number: int, seed: int = SEED) -> Mechanism:
    """Return a random tree [m, kg, rad]: held or floating, with links that are round about their joint's axis, and couplings."""
    dice = np.random.default_rng([seed, number])
    kinds = (*KINDS, MORE[number % 3]) if number % 2 else KINDS
    links: list[Link] = []
    joints: list[Joint] = []
    if number % 4 == 3:
        start = Placement(dice.uniform(-1, 1, 3), random_turn(dice))
        joints.append(Joint(ROOT, "free", WORLD, "link 0", start, actuated=False))
        links.append(Link("link 0", (Body("link 0", _body(dice)),)))
    for k in range(len(links), int(dice.integers(3, 12))):
        kind = str(dice.choice(kinds))
        parent = _parent(dice, links, joints)
        if kind == "universal" and parent == WORLD:
            kind = "revolute"
        joints.append(_joint(dice, k, kind, parent, number))
        links.append(Link(f"link {k}", tuple(_bodies(dice, k, joints[-1], number))))
    return Mechanism("tree", tuple(links), list_depth_first(joints), closures=tuple(_couplings(dice, joints, number)))


def _parent(dice: Dice, links: list[Link], joints: list[Joint]) -> str:
    """Mostly the last link, sometimes one before; of a machine that is held sometimes the world."""
    floats = bool(joints) and joints[0].kind == "free"
    if not links or (not floats and dice.random() < 0.1):
        return WORLD
    return links[-1].name if dice.random() < 0.7 else links[int(dice.integers(len(links)))].name


def _joint(dice: Dice, k: int, kind: str, parent: str, seed: int) -> Joint:
    # Every third tree is one as robots are: axes and frames along one another's.
    plain = seed % 3 == 0
    axes = np.vstack([np.eye(3), -np.eye(3)])
    axis = axes[int(dice.integers(6))] if plain else _unit(dice)
    rotation = np.eye(3) if plain else random_turn(dice)
    at = Placement(np.round(dice.uniform(-0.5, 0.5, 3), 2) if plain else dice.uniform(-0.5, 0.5, 3), rotation)
    own: dict[str, float] = {}
    if kind not in ("fixed", "spherical", "universal"):
        own = {"damping": float(dice.uniform(0.1, 1.0)), "friction": float(dice.uniform(0.0, 0.5))}
        own["rotor_inertia"] = float(dice.uniform(0.0, 0.1))
    limits = Limits()
    if kind in ("revolute", "prismatic") and dice.random() < 0.7:
        limits = Limits(80.0, 3.0, float(dice.uniform(-2.5, -0.5)), float(dice.uniform(0.5, 2.5)))
    if kind in ("revolute", "prismatic") and dice.random() < 0.3:
        own |= {"stiffness": float(dice.uniform(1.0, 5.0)), "rest": float(dice.uniform(-0.3, 0.3))}
    second = np.cross(axis, _unit(dice))
    second /= np.linalg.norm(second)
    pitch = float(dice.uniform(0.05, 0.2)) if kind == "helical" else 0.0
    return Joint(
        f"joint {k}", kind, parent, f"link {k}", at, axis=axis, second_axis=second, pitch=pitch, limits=limits,
        actuated=kind != "fixed", **own,
    )  # fmt: skip


def _bodies(dice: Dice, k: int, joint: Joint, seed: int) -> Iterator[Body]:
    """Yield the body of a link; of some none where it is fixed, of some one that is round about the joint's axis."""
    if joint.kind == "fixed" and dice.random() < 0.4:
        return
    body = _body(dice)
    if seed % 5 == 0 and dice.random() < 0.5:
        along = np.outer(joint.axis, joint.axis)
        moments = np.sort(np.linalg.eigvalsh(body.tensor))
        body = Inertia(body.mass, 0.1 * joint.axis, moments[1] * (np.eye(3) - along) + moments[0] * along)
    yield Body(f"link {k}", body)


def _body(dice: Dice) -> Inertia:
    arms = dice.normal(size=(4, 3)) * 0.1
    tensor = sum((a @ a * np.eye(3) - np.outer(a, a) for a in arms), np.zeros((3, 3)))
    return Inertia(float(dice.uniform(0.5, 4.0)), dice.uniform(-0.2, 0.2, 3), tensor)


def _unit(dice: Dice) -> np.ndarray:
    axis = dice.normal(size=3)
    return np.asarray(axis / np.linalg.norm(axis))


def _couplings(dice: Dice, joints: list[Joint], seed: int) -> Iterator[Closure]:
    hinges = [j.name for j in joints if j.kind in ("revolute", "prismatic")]
    if len(hinges) > 1 and seed % 7 == 2:
        one, other = dice.choice(hinges, 2, replace=False)
        here = Attachment(WORLD)
        factors = ((str(one), 1.0), (str(other), -float(dice.uniform(0.5, 2.0))))
        yield Closure(f"mimic {one}", "coupling", here, here, factors=factors, offset=float(dice.uniform(-0.2, 0.2)))
