"""Numbers of a body as kernels read them: the columns of `body_table.Bodies.numbers` by their meaning (compiled)."""

from __future__ import annotations

from flexinv.elements.joint_law import JointLaw
from flexinv.kernels.jit import jit_lanes


@jit_lanes
def numbers_at(numbers, first):
    """Return three numbers [any unit] from the ``first`` on."""
    return numbers[first], numbers[first + 1], numbers[first + 2]


@jit_lanes
def placement(body):
    """Return R (rows) before tilt and joint, and p of the joint, in the parent's frame [-], [m]."""
    return (numbers_at(body, 0), numbers_at(body, 3), numbers_at(body, 6)), numbers_at(body, 9)


@jit_lanes
def tilt(body):
    """Return cosine and sine [-] of the tilt about x, and of the angle about z at which the coordinate is zero."""
    return (body[27], body[28]), (body[29], body[30])


@jit_lanes
def onward_place(body):
    """Return p of the last child's joint in this body's frame [m]."""
    return numbers_at(body, 31)


@jit_lanes
def lead_of(body):
    """Return the way of a helical joint along its axis per radian about it [m/rad], 0 of other joints."""
    return body[37]


@jit_lanes
def inertia_of(body):
    """Return m [kg], h [kg m] and Sigma [kg m^2]: (xx, yy, zz), (xy, xz, yz)."""
    return body[12], numbers_at(body, 13), numbers_at(body, 16), numbers_at(body, 19)


@jit_lanes
def law_of(body):
    """Return the law of the joint: rotor inertia, damping, friction, stiffness and rest [kg m^2], [N m]."""
    return JointLaw(body[22], body[23], body[24], body[25], body[26])
