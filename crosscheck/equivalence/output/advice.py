"""Advice: what to write in which of two files so that a difference is gone, in the words of that file's format."""

from __future__ import annotations

from collections.abc import Iterator

from crosscheck.equivalence.difference import Difference
from crosscheck.equivalence.judge import Judged
from crosscheck.lifting.description import Description

INERTIAS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
URDF = {
    "mass": '<inertial> <mass value="{}"/>',
    "centre of mass": '<inertial> <origin xyz="{}" .../>',
    "joint axis": '<axis xyz="{}"/>',
    "position of joint": '<origin xyz="{}" .../>',
    "damping": '<dynamics damping="{}" .../>',
    "dry friction": '<dynamics friction="{}" .../>',
    "rotor inertia": '<transmission> <actuator> <drake:rotor_inertia value="{}"/>',
    "gear": "<transmission> <joint> <mechanicalReduction>{}</mechanicalReduction>",
    "kind of joint": '<joint type="{}">',
    "lower limit": '<limit lower="{}" .../>',
    "upper limit": '<limit upper="{}" .../>',
    "effort limit": '<limit effort="{}" .../>',
    "velocity limit": '<limit velocity="{}" .../>',
}
MJCF = {
    "mass": '<inertial mass="{}" .../>',
    "centre of mass": '<inertial pos="{}" .../>, in the frame of the body',
    "inertia tensor": '<inertial fullinertia="{}" .../> (order xx yy zz xy xz yz)',
    "joint axis": '<joint axis="{}"/>',
    "position of joint": '<body pos="{}">',
    "damping": '<joint damping="{}"/>',
    "dry friction": '<joint frictionloss="{}"/>',
    "rotor inertia": '<joint armature="{}"/>',
    "spring stiffness": '<joint stiffness="{}"/>',
    "gear": '<motor gear="{}"/>',
    "gravity": '<option gravity="{}"/>',
    "lower limit": '<joint range="{} ..."/>',
    "upper limit": '<joint range="... {}"/>',
}


def advice(judged: Judged, first: Description, second: Description) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Return by difference what to write in A to have B's machine, and in B to have A's."""
    found = []
    for difference in (*judged.causes, *judged.conventions, *judged.limits):
        lines = [
            *_line("A", first, difference, difference.second),
            *_line("B", second, difference, difference.first),
        ]
        if lines:
            found.append((f"{difference.cause} of {difference.place}", tuple(lines)))
    return tuple(found)


def _line(side: str, description: Description, difference: Difference, value: str) -> Iterator[str]:
    text = written(description.format, difference.cause, value)
    if text:
        other = "B" if side == "A" else "A"
        yield f"to make {side} ({description.label}) like {other}, in {difference.place}: {text}"


def written(kind: str, cause: str, value: str) -> str:
    """Return a format's words for a quantity [any unit]; "" where it has none."""
    if not value or value == "none":
        return ""
    if cause == "inertia tensor":
        numbers = value.split()
        if kind == "urdf":
            entries = " ".join(f'{name}="{x}"' for name, x in zip(INERTIAS, numbers, strict=True))
            return f"<inertial> <inertia {entries}/>, along the axes of the link (origin rpy 0 0 0)"
        numbers = [numbers[k] for k in (0, 3, 5, 1, 2, 4)]
        return MJCF[cause].format(" ".join(numbers)) if kind == "mjcf" else ""
    if cause == "orientation of joint":
        return f'<origin rpy="{value.removesuffix(" rpy")}" .../>' if kind == "urdf" else ""
    if cause == "sign of coordinate":
        return (
            '<axis xyz="..."/> with the opposite sign (and limits exchanged with it)'
            if kind in ("urdf", "mjcf")
            else ""
        )
    words = {"urdf": URDF, "mjcf": MJCF}.get(kind, {}).get(cause, "")
    return words.format(value) if words else ""
