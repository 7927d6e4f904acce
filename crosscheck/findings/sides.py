"""Left and right: links that a name pairs, and numbers in which they are no mirror images where their structure is one.

A plane  n . x = d  is taken for one of symmetry if it mirrors the origins of two pairs of frames at least, all joints at zero.
With S = 1 - 2 n n^T  a point x goes to  S x + 2 d n, and a tensor I to  S I S.  A link may also be the same part as its partner;
then its numbers are equal in its own frame, and so are the places of what it carries.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from crosscheck.findings.finding import Finding, make_warning
from crosscheck.findings.statements import LinkStatements, Mounting, describe_moments
from flexinv.model.mechanism import Array, Placement

SIDE = 0.02  # relative: how much moments and masses of left and right may differ
APART = 0.1  # relative: how much centres and tensors in axes may; a tensor turns with its frame
NEAR = 1e-3  # [m]: mirrored origins of frames, as rounded in files
SUPPORT = 2  # pairs that a plane of symmetry mirrors, at least: one pair alone has such a plane always
ENTRIES = ((0, 0, "ixx"), (0, 1, "ixy"), (0, 2, "ixz"), (1, 1, "iyy"), (1, 2, "iyz"), (2, 2, "izz"))
# Words for sides: a name with the first has a partner with the second.
SIDES = (("left", "right"), ("Left", "Right"), ("LEFT", "RIGHT"), ("l", "r"), ("L", "R"), ("FL", "FR"), ("RL", "RR"),
         ("HL", "HR"), ("LF", "RF"), ("LH", "RH"), ("lf", "rf"), ("lh", "rh"), ("fl", "fr"), ("hl", "hr"))  # fmt: skip


def check_sides(links: Mapping[str, LinkStatements], mountings: Iterable[Mounting]) -> Iterator[Finding]:
    """Yield pairs of links whose masses, moments or centres differ, or are no mirror images [kg, m, kg m^2]."""
    pairs = list(_list_pairs(links))
    known = tuple(mountings)
    poses = _find_poses(known)
    planes = _find_planes(pairs, poses)
    for left, right in pairs:
        if not (links[left].written and links[right].written):
            continue
        found = list(_compare_sides(links[left], links[right]))
        yield from found
        if not found and (left, right) in planes:
            image = _Image.build(planes[left, right], poses[left], poses[right])
            carried = _list_carried_pairs(left, right, pairs, known)
            yield from _check_image(links[left], links[right], image, carried)


@dataclass(frozen=True)
class _Plane:
    """The points x with n . x = d [m]."""

    normal: Array
    distance: float

    def compute_image(self, point: Array) -> Array:
        """Return the image of a point [m]."""
        image: Array = point + 2.0 * (self.distance - self.normal @ point) * self.normal
        return image


@dataclass(frozen=True)
class _Image:
    """The reflection from the frame of a left link into that of its partner: x goes to ``turn @ x + shift`` [m]."""

    turn: Array
    shift: Array

    @classmethod
    def build(cls, plane: _Plane, left: Placement, right: Placement) -> _Image:
        """Return the reflection for two frames [m]."""
        reflection = np.eye(3) - 2.0 * np.outer(plane.normal, plane.normal)
        shift = right.rotation.T @ (plane.compute_image(left.position) - right.position)
        return cls(right.rotation.T @ reflection @ left.rotation, shift)

    @property
    def plain(self) -> bool:
        """Return True if it only exchanges axes or their signs: zeros of joints, which need not be alike, give other angles."""
        return bool(np.abs(np.abs(self.turn) - np.abs(self.turn).round()).max() < 1e-2)

    def compute_image(self, point: Array) -> Array:
        """Return the image of a point [m]."""
        image: Array = self.turn @ point + self.shift
        return image


def _find_poses(mountings: Iterable[Mounting]) -> dict[str, Placement]:
    """Return the frames of links where all joints are at zero, in that of what carries them all [m]."""
    carriers = {one.child: one for one in mountings}
    poses: dict[str, Placement] = {}
    for name in carriers:
        way: list[Mounting] = []
        while name in carriers and name not in poses and len(way) <= len(carriers):
            way.append(carriers[name])
            name = carriers[name].parent
        for one in reversed(way):
            above = poses.get(one.parent) or Placement()
            place = one.placement
            turned = above.rotation @ place.rotation
            poses[one.child] = Placement(above.position + above.rotation @ place.position, turned)
    return poses


def _find_planes(pairs: Iterable[tuple[str, str]], poses: Mapping[str, Placement]) -> dict[tuple[str, str], _Plane]:
    """Return the plane of symmetry of each pair that has one with others; the one that mirrors most pairs first."""
    left = {pair: poses[pair[0]].position for pair in pairs if pair[0] in poses and pair[1] in poses}
    right = {pair: poses[pair[1]].position for pair in left}
    result: dict[tuple[str, str], _Plane] = {}
    open_pairs = set(left)
    while open_pairs:
        best: list[tuple[str, str]] = []
        for pair in sorted(open_pairs):
            across = left[pair] - right[pair]
            length = float(np.linalg.norm(across))
            if length < NEAR:
                continue
            normal = across / length
            plane = _Plane(normal, float(normal @ (left[pair] + right[pair]) / 2))
            same = [
                one for one in sorted(open_pairs) if np.abs(plane.compute_image(left[one]) - right[one]).max() < NEAR
            ]
            if len(same) > len(best):
                best = same
                chosen = plane
        places = {tuple(np.round(left[one] / NEAR)) for one in best}
        if len(places) < SUPPORT:
            break
        result.update(dict.fromkeys(best, chosen))
        open_pairs -= set(best)
    return result


def _list_carried_pairs(
    left: str, right: str, pairs: Iterable[tuple[str, str]], mountings: Iterable[Mounting]
) -> list[tuple[Array, Array]]:
    """Return the places of what a link and its partner carry, by pairs, each in its carrier's frame [m]."""
    carried = {one.child: one for one in mountings}
    return [
        (carried[a].placement.position, carried[b].placement.position)
        for a, b in pairs
        if a in carried and b in carried and (carried[a].parent, carried[b].parent) == (left, right)
    ]


def _check_image(
    left: LinkStatements, right: LinkStatements, image: _Image, carried: list[tuple[Array, Array]]
) -> Iterator[Finding]:
    """Yield a centre and a tensor that are neither the partner's mirror image nor, of a part that is mounted twice, its own."""
    if not image.plain or left.inertia.mass == 0:
        return
    a = left.inertia
    b = right.inertia
    near = APART * max(float(np.linalg.norm(a.com)), 0.01)
    com = image.compute_image(a.com)
    tensor = image.turn @ a.tensor @ image.turn.T
    repeated = all(np.abs(one - other).max() < NEAR for one, other in carried) and _is_equal(a.com, b.com, near)
    if not _is_equal(com, b.com, near) and not repeated:
        yield _make_centre_finding(left, right, com)
    least = APART * float(np.abs(np.linalg.eigvalsh((a.tensor + a.tensor.T) / 2)).max())
    if not _is_equal(tensor, b.tensor, least) and not (repeated and _is_equal(a.tensor, b.tensor, least)):
        yield _make_tensor_finding(left, right, tensor, least)


def _is_equal(one: Array, other: Array, near: float) -> bool:
    return bool(np.abs(one - other).max() <= near)


def _make_centre_finding(left: LinkStatements, right: LinkStatements, com: Array) -> Finding:
    given = f"centres {_format(left.inertia.com)} and {_format(right.inertia.com)} m"
    signs = [
        axis
        for axis, one, other in zip("xyz", com, right.inertia.com, strict=True)
        if abs(one + other) < APART * abs(one)
    ]
    why = f"the structure is mirrored, and the image of {left.name}'s centre is at {_format(com)} m of {right.name}"
    if signs:
        why += f": {' and '.join(signs)} with the other sign"
    place = f"links {left.name}, {right.name}"
    write = f'xyz="{_format(com)}" there, or the image of it in {left.name}, if they are alike'
    return make_warning("left and right", place, given, why, write)


def _make_tensor_finding(left: LinkStatements, right: LinkStatements, tensor: Array, near: float) -> Finding:
    other = right.inertia.tensor
    wrong = [(name, other[i, j], tensor[i, j]) for i, j, name in ENTRIES if abs(other[i, j] - tensor[i, j]) > near]
    given = ", ".join(f"{name} {value:.4g}" for name, value, _ in wrong) + f" kg m^2 of {right.name}"
    image = ", ".join(f"{name} {value:.4g}" for name, _, value in wrong)
    why = f"the structure is mirrored, and the image of {left.name} has {image}"
    write = f"these entries there, or their images in {left.name}, if they are alike"
    return make_warning("left and right", f"links {left.name}, {right.name}", given, why, write)


def _format(vector: Array) -> str:
    return " ".join(f"{x:.4g}" for x in np.where(np.abs(vector) < 1e-9, 0.0, vector))


def _list_pairs(links: Mapping[str, LinkStatements]) -> Iterator[tuple[str, str]]:
    for name in links:
        for other in _list_partner_names(name):
            if other in links:
                yield name, other
                break


def _list_partner_names(name: str) -> Iterator[str]:
    words = re.split(r"([_\-. /]|(?<=[a-z])(?=[A-Z0-9])|(?<=^[LR])(?=[A-Z][a-z]))", name)
    for left, right in SIDES:
        if left in words:
            yield "".join(right if word == left else word for word in words)
        elif len(left) > 2 and left in name:
            yield name.replace(left, right)


def _compare_sides(left: LinkStatements, right: LinkStatements) -> Iterator[Finding]:
    a = left.inertia
    b = right.inertia
    place = f"links {left.name}, {right.name}"
    if abs(a.mass - b.mass) > SIDE * max(a.mass, b.mass):
        yield make_warning(
            "left and right",
            place,
            f"{a.mass:g} and {b.mass:g} kg",
            "their masses differ",
            "one mass for both, if they are alike",
        )
        return
    moments = [np.linalg.eigvalsh((body.tensor + body.tensor.T) / 2) for body in (a, b)]
    if np.abs(moments[0] - moments[1]).max() > SIDE * max(np.abs(moments[0]).max(), np.abs(moments[1]).max()):
        yield make_warning(
            "left and right",
            place,
            f"{describe_moments(a)}; {describe_moments(b)}",
            "their moments differ",
            "mirrored tensors, if they are alike",
        )
    far = [float(np.linalg.norm(body.com)) for body in (a, b)]
    if abs(far[0] - far[1]) > 5 * SIDE * max(*far, 0.01):
        yield make_warning(
            "left and right", place, f"centres {far[0]:.4g} and {far[1]:.4g} m from their frames",
            "their centres of mass are no mirror images", "mirrored centres, if they are alike",
        )  # fmt: skip
