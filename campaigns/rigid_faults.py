"""Faults of a rigid program: what it forgets or misreads.  Each changes the robot of ``rigid.py`` before it answers.

robot : a ``rigid.Robot``; size : what the fault's docstring says
"""

from __future__ import annotations

import numpy as np


def bodies(robot, which):
    """Return the bodies of a link by its number in the tree; of all links where it is negative."""
    links = list(robot.links.values())
    chosen = links if which < 0 else [links[which]]
    return [body for link in chosen for body in link["bodies"]]


def mass(robot, size, which):
    """Masses 1 + size times, inertias as they were."""
    for body in bodies(robot, which):
        body["mass"] *= 1.0 + size


def density(robot, size, which):
    """Masses and inertias 1 + size times."""
    for body in bodies(robot, which):
        body["mass"] *= 1.0 + size
        body["inertia"] = (np.array(body["inertia"]) * (1.0 + size)).tolist()


def centre(robot, size, which):
    """Centres of mass size [m] farther along the link."""
    for body in bodies(robot, which):
        body["com"][0] += size


def mirrored(robot, size, which):
    """Centres of mass on the other side along z, and along x the fraction size nearer."""
    for body in bodies(robot, which):
        body["com"] = [body["com"][0] * (1.0 - size), body["com"][1], -body["com"][2]]


def no_inertia(robot, size, which):
    """Point masses: no inertia about the centre of mass."""
    for body in bodies(robot, which):
        body["inertia"] = np.zeros((3, 3)).tolist()


def inertia_twice(robot, size, which):
    """The inertia about the joint used as the one about the centre of mass."""
    for body in bodies(robot, which):
        c = np.array(body["com"])
        body["inertia"] = (np.array(body["inertia"]) + body["mass"] * (c @ c * np.eye(3) - np.outer(c, c))).tolist()


def last_body(robot, size, which):
    """The last body of a link is forgotten (its payload)."""
    list(robot.links.values())[which]["bodies"].pop()


def gravity(robot, size, which):
    """Gravity 1 + size times: 9.8 in place of 9.81, none, upwards."""
    robot.gravity = robot.gravity * (1.0 + size)


def gravity_turned(robot, size, which):
    """Gravity turned by size [rad] in the plane of the motion."""
    axis = np.array([0.0, 0.0, 1.0]) if abs(robot.gravity[1]) > 1 else np.array([0.0, 1.0, 0.0])
    robot.gravity = robot.gravity * np.cos(size) + np.cross(axis, robot.gravity) * np.sin(size)


def drive(robot, size, which, key):
    """One value of a drive 1 + size times."""
    moving = [joint for joint in robot.joints if joint["v"]]
    for joint in moving if which < 0 else [moving[which]]:
        joint[key] *= 1.0 + size


def rotor(robot, size, which):
    """Rotor inertia 1 + size times."""
    drive(robot, size, which, "rotor_inertia")


def damping(robot, size, which):
    """Damping 1 + size times."""
    drive(robot, size, which, "damping")


def stiffness(robot, size, which):
    """Stiffness 1 + size times."""
    drive(robot, size, which, "stiffness")


def rest(robot, size, which):
    """The spring at rest at size [rad]."""
    robot.joints[which]["rest"] += size


def length(robot, size, which):
    """A joint's place size [m] farther along its parent."""
    robot.joints[which]["frame"]["position"][0] += size


def tilt(robot, size, which):
    """A joint's axis tilted by size [rad]."""
    axis = np.array(robot.joints[which]["axis"])
    other = np.roll(axis, 1)
    robot.joints[which]["axis"] = (axis * np.cos(size) + other * np.sin(size)).tolist()


def closing(robot, size, which):
    """The point where the loop closes size [m] off on the first link."""
    robot.closures[0]["first"]["frame"]["position"][0] += size


def with_rates(robot, change):
    """Let a robot compute efforts with other positions, rates and accelerations."""
    honest = robot.torque
    robot.torque = lambda q, v, a: honest(*change(q, v, a))


def no_coriolis(robot, size, which):
    """A part size of the velocity products: 0 forgets them, 0.5 halves them."""
    honest = robot.torque

    def effort(q, v, a):
        still = honest(q, 0 * v, a)
        drives = sum(
            (np.eye(len(v))[robot.names.index(j["v"][0])] * j["damping"] for j in robot.joints if j["v"]), 0 * v
        )
        return still + drives * v + size * (honest(q, v, a) - still - drives * v)

    robot.torque = effort


def static(robot, size, which):
    """Accelerations 1 + size times: -1 forgets them."""
    with_rates(robot, lambda q, v, a: (q, v, a * (1.0 + size)))


def rates_scaled(robot, size, which):
    """Rates 1 + size times."""
    with_rates(robot, lambda q, v, a: (q, v * (1.0 + size), a))


def zero_moved(robot, size, which):
    """The zero of one joint moved by size [rad]."""
    with_rates(robot, lambda q, v, a: (q + size * np.eye(len(q))[which], v, a))


def relative(robot, size, which):
    """Angles of the second joint told from the world, taken as told from its parent."""
    lower = np.tril(np.ones((len(robot.names),) * 2)) if size > 0 else np.eye(len(robot.names))
    with_rates(robot, lambda q, v, a: (lower @ q, lower @ v, lower @ a))


def coulomb(robot, size, which):
    """Dry friction of size [N m] that nobody asked for."""
    for joint in robot.joints:
        joint["friction"] += size


def diagonal(robot, size, which):
    """Joints without coupling: each alone accelerates, gravity as it is."""
    honest = robot.torque

    def effort(q, v, a):
        rest = honest(q, v, 0 * a)
        return rest + np.array([(honest(q, v, a[k] * one) - rest)[k] for k, one in enumerate(np.eye(len(a)))])

    robot.torque = effort


def open_loop(robot, size, which):
    """The loop is closed for the motion and cut for the forces."""
    robot.cut = True


MODELS = {
    one.__name__: one
    for one in (
        mass, density, centre, mirrored, no_inertia, inertia_twice, last_body, gravity, gravity_turned, rotor, damping,
        stiffness, rest, length, tilt, closing, no_coriolis, static, rates_scaled, zero_moved, relative, coulomb, diagonal,
        open_loop,
    )
}  # fmt: skip
