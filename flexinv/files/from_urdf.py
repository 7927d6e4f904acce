"""A robot from its URDF: links, joints and inertias in the order that Pinocchio gives them."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ParseError

import numpy as np
from defusedxml.common import DefusedXmlException
from defusedxml.ElementTree import fromstring

from flexinv.errors import InputError, ModelWarning
from flexinv.files.bodies import impossible
from flexinv.files.joints import rotation_from_rpy, unit_axis
from flexinv.files.toml_tables import complaint, read_bytes
from flexinv.files.tree_order import check_ends, depth_first
from flexinv.files.values import LARGEST, LONGEST_NAME
from flexinv.model.mechanism import WORLD, Body, Inertia, Joint, Limits, Link, Mechanism, Placement
from flexinv.typing import Array
from flexinv.validation import floats, names, nearest, refuse, shown
from flexinv.validation import path as path_of

KINDS = {
    "fixed": "fixed",
    "revolute": "revolute",
    "continuous": "continuous",
    "prismatic": "prismatic",
    "floating": "free",
}
FLOATS = float(np.finfo(np.float64).max)  # some files write the largest number where they mean no limit
STANDARD_GRAVITY = (0.0, 0.0, -9.81)  # [m/s^2], as Pinocchio


def from_urdf(
    path: str | Path,
    packages: Sequence[str | Path] = (),
    base: str = "fixed",
    gravity: Sequence[float] = STANDARD_GRAVITY,
    lock: Sequence[str] = (),
) -> Mechanism:
    """Read a URDF into a mechanism whose coordinates stand in Pinocchio's order.

    path : the file; packages : folders for its ``package://`` paths (geometry is not read; engines may need them)
    base : "fixed" hangs the root link on the world, "free" gives it six freedoms without a drive
    gravity : (3,) [m/s^2]; lock : names of joints that are held at zero, that is made fixed
    Lengths [m], angles [rad], masses [kg], inertias [kg m^2] as in the file.  Children of a link come in
    alphabetical order of their joints (urdfdom keeps joints in a sorted map).  Joints that mimic others are
    coordinates of their own, as in ``pinocchio.buildModelFromUrdf``: ModelWarning and a note.
    An inertia that no body can have is kept, with ModelWarning and a note: files of real robots have them, and the
    torque of a rigid robot is defined with them.  Raises InputError.
    """
    file = Path(path_of("path", path, "a URDF file"))
    names("lock", lock, "joints")
    if isinstance(packages, str | PathLike) or not isinstance(packages, Iterable):
        refuse("packages", packages, "a list of folders", f"[{shown(packages)}]" * isinstance(packages, str | PathLike))
    folders = [path_of(f"packages[{k}]", folder, "a folder") for k, folder in enumerate(packages)]
    mechanism, warned = read_urdf(file, folders, base, gravity, lock)
    for text in warned.values():
        warnings.warn(f"{path}: {text}", ModelWarning, stacklevel=2)
    return mechanism


def read_urdf(
    path: Path, packages: Sequence[str | PathLike[str]], base: str, gravity: Sequence[float], lock: Sequence[str]
) -> tuple[Mechanism, dict[str, str]]:
    """Read as ``from_urdf`` [-]; also return what deserves a warning, by subject ("mimic", "inertia")."""
    if not isinstance(base, str) or base not in ("fixed", "free"):
        raise InputError(f'base = "{base}": expected "fixed" or "free"; write base="fixed"')
    pull = np.array(floats("gravity", gravity))
    if pull.shape != (3,) or not np.all(np.isfinite(pull)):
        raise InputError(
            f"gravity = {gravity}: expected three finite numbers [m/s^2]; write gravity={STANDARD_GRAVITY}"
        )
    robot = read_robot(path)
    inertias = _links(robot, path)
    joints = _locked(sorted(_joints(robot, path), key=lambda joint: joint.name), lock, path)

    def where(kind: str, name: str, key: str) -> str:
        return f'{path}: <{kind} name="{name}">' + (f", {key}" if key else "")

    check_ends(joints, inertias, inertias, where)
    inertias, joints = _based(inertias, joints, _root(inertias, joints, robot, path), base)
    ordered = depth_first(joints, inertias, where)
    own = {name: () if inertia is None else (Body(name, inertia),) for name, inertia in inertias.items()}
    links = tuple(Link(j.child, own[j.child]) for j in ordered)
    warned = _warned(robot, inertias, lock)
    mechanism = Mechanism(
        name=path.stem, links=links, joints=ordered, gravity=pull, title=f"{robot.get('name', path.stem)}",
        source=f"URDF {path.name}", urdf=path.resolve(), packages=tuple(Path(p).resolve() for p in packages),
        notes=(*warned.values(), *_notes(inertias, lock)),
    )  # fmt: skip
    return mechanism, warned


def _links(robot: Element, path: Path) -> dict[str, Inertia | None]:
    """Inertia of every link, None where it has no mass."""
    links: dict[str, Inertia | None] = {}
    for element in robot.findall("link"):
        name = name_of(element, path)
        if name in links:
            raise complaint(location(path, element), "this link twice", "each link once", "a name of its own")
        links[name] = _inertia(element, path)
    if not links:
        raise complaint(str(path), "a robot without links", "at least one <link>", '<link name="base">')
    if all(inertia is None for inertia in links.values()):
        advice = '<inertial><mass value="..."/><inertia ixx="..." .../></inertial> in the links'
        raise complaint(str(path), "no link with a mass [kg]", "inertia in at least one link", advice)
    return links


def _inertia(link: Element, path: Path) -> Inertia | None:
    """About the centre of mass along link axes: R I R^T with R from the rpy of the inertial's origin."""
    inertial = link.find("inertial")
    if inertial is None:
        return None
    mass = number(inertial.find("mass"), "value", 0.0, location(path, link, "mass"))
    if mass < 0:
        raise complaint(location(path, link, "mass"), f'value="{mass:g}"', "a mass >= 0 [kg]", f'value="{-mass:g}"')
    entry, where = inertial.find("inertia"), location(path, link, "inertia")
    xx, xy, xz, yy, yz, zz = (number(entry, name, 0.0, where) for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if mass == 0.0 and not tensor.any():
        return None
    origin = _origin(inertial, location(path, link, "inertial"))
    return Inertia(mass, origin.position, origin.rotation @ tensor @ origin.rotation.T)


def _origin(element: Element, where: str) -> Placement:
    origin = element.find("origin")
    xyz = numbers(origin, "xyz", 3, [0, 0, 0], f"{where}, origin")
    return Placement(xyz, rotation_from_rpy(numbers(origin, "rpy", 3, [0, 0, 0], f"{where}, origin")))


def _joints(robot: Element, path: Path) -> list[Joint]:
    joints: dict[str, Joint] = {}
    for element in robot.findall("joint"):
        name = name_of(element, path)
        if name in joints:
            raise complaint(location(path, element), "this joint twice", "each joint once", "a name of its own")
        joints[name] = _joint(element, name, path)
    return list(joints.values())


def _joint(element: Element, name: str, path: Path) -> Joint:
    kind, where = element.get("type", ""), location(path, element)
    if kind not in KINDS:
        near = "two prismatic and one revolute joint" if kind == "planar" else nearest(kind, KINDS) or "revolute"
        expected = f"one of {', '.join(KINDS)}" + ("; planar joints are not supported" if kind == "planar" else "")
        raise complaint(location(path, element, "type"), f'type="{kind[:60]}"', expected, near)
    ends = []
    for tag in ("parent", "child"):
        end = element.find(tag)
        link = end.get("link") if end is not None else None
        if not link:
            raise complaint(f"{where}, {tag}", "nothing", "the name of a link", f'<{tag} link="..."/>')
        ends.append(link)
    parts: dict[str, Any] = {"placement": _origin(element, where), "actuated": kind not in ("fixed", "floating")}
    if kind in ("revolute", "continuous", "prismatic"):
        axis = numbers(element.find("axis"), "xyz", 3, [1, 0, 0], f"{where}, axis")
        parts["axis"] = unit_axis(axis, f"{where}, axis", '<axis xyz="0 0 1"/>')
        parts |= {"limits": _limits(element, kind, f"{where}, limit"), **_dynamics(element, f"{where}, dynamics")}
    return Joint(name, KINDS[kind], ends[0], ends[1], **parts)


def _limits(element: Element, kind: str, where: str) -> Limits:
    """Effort and speed of 0 are how URDF writers say "not stated"; a continuous joint has no position limits."""
    limit = element.find("limit")
    if limit is None:
        return Limits()
    effort, velocity = (number(limit, name, 0.0, where, FLOATS) or np.inf for name in ("effort", "velocity"))
    if kind == "continuous":
        return Limits(abs(effort), abs(velocity))
    lower, upper = (number(limit, name, 0.0, where, FLOATS) for name in ("lower", "upper"))
    if lower > upper:
        given = f'lower="{lower:g}" upper="{upper:g}"'
        raise complaint(where, given, "lower <= upper", "the two exchanged, if so meant")
    return Limits(abs(effort), abs(velocity), lower, upper)


def _dynamics(element: Element, where: str) -> dict[str, float]:
    stated = {name: number(element.find("dynamics"), name, 0.0, where) for name in ("damping", "friction")}
    for name, value in stated.items():
        if value < 0:
            raise complaint(where, f'{name}="{value:g}"', f"a {name} >= 0", f'{name}="{-value:g}"')
    return stated


def _root(links: dict[str, Inertia | None], joints: list[Joint], robot: Element, path: Path) -> str:
    carried = {joint.child for joint in joints}
    roots = [name for name in links if name not in carried]
    if len(roots) == 1:
        return roots[0]
    given = (
        f"{len(roots)} links that no joint carries: {', '.join(roots[:5])}"
        if roots
        else "a joint carries every link: a cycle"
    )
    expected = "a tree with one root link; what closes a loop is a closure of a mechanism file"
    advice = (
        "a fixed joint between the separate parts"
        if roots
        else "the loop cut at one joint, and [closures.NAME] beside [urdf] for it"
    )
    raise complaint(location(path, robot), given, expected, advice)


def _based(
    links: dict[str, Inertia | None], joints: list[Joint], root: str, base: str
) -> tuple[dict[str, Inertia | None], list[Joint]]:
    """Hang the root on the world.  A fixed root named "world" is the world; a moving one gets another name."""
    if root == WORLD and base == "fixed":
        return {name: inertia for name, inertia in links.items() if name != WORLD}, joints
    names = {WORLD: _free_name("world_link", links)}
    links = {names.get(name, name): inertia for name, inertia in links.items()}
    joints = [
        replace(j, parent=names.get(j.parent, j.parent), child=names.get(j.child, j.child))
        if WORLD in (j.parent, j.child)
        else j
        for j in joints
    ]
    kind = "free" if base == "free" else "fixed"
    joint = Joint(
        _free_name("root_joint", [j.name for j in joints]), kind, WORLD, names.get(root, root), actuated=False
    )
    return links, [joint, *joints]


def _free_name(name: str, taken: Any) -> str:
    while name in taken:
        name += "_"
    return name


def _locked(joints: list[Joint], lock: Sequence[str], path: Path) -> list[Joint]:
    """Joints named in ``lock`` become fixed where they are at zero."""
    known = [joint.name for joint in joints if joint.nv]
    for name in lock:
        if name not in known:
            near = nearest(name, known) or (known[0] if known else "no joint")
            raise complaint(str(path), f'lock of joint "{name}"', "a joint of the robot that moves", f'"{near}"')
    return [
        Joint(j.name, "fixed", j.parent, j.child, j.placement, actuated=False) if j.name in lock else j for j in joints
    ]


def _warned(robot: Element, links: dict[str, Inertia | None], lock: Sequence[str]) -> dict[str, str]:
    mimics = [
        f"{joint.get('name')} (of {mimic.get('joint')})"
        for joint in robot.findall("joint")
        if (mimic := joint.find("mimic")) is not None and joint.get("type") != "fixed" and joint.get("name") not in lock
    ]
    odd = [name for name, inertia in links.items() if inertia is not None and impossible(inertia.tensor)]
    warned = {}
    if mimics:
        warned["mimic"] = f"mimic joints are coordinates of their own: {', '.join(mimics)}"
    if odd:
        warned["inertia"] = f"links with an inertia that no body can have, kept as it is: {', '.join(odd)}"
    return warned


def _notes(links: dict[str, Inertia | None], lock: Sequence[str]) -> list[str]:
    massless = [name for name, inertia in links.items() if inertia is None]
    notes = [f"links without mass: {', '.join(massless)}"] if massless else []
    return notes + ([f"joints locked at zero: {', '.join(lock)}"] if lock else [])


LARGEST_FILE = 16 << 20  # [byte]: the largest URDF of example-robot-data has 0.2 MB


def read_robot(path: Path) -> Element:
    """Parse the file and return its ``<robot>``, at most ``LARGEST_FILE`` [byte]; InputError says what is wrong."""
    root = read_xml(path)
    if root.tag != "robot":
        advice = "the URDF itself; a .xacro file is expanded first: xacro robot.urdf.xacro > robot.urdf"
        raise complaint(str(path), f"<{root.tag[:80]}>", '<robot name="...">', advice)
    return root


def read_xml(path: Path) -> Element:
    """Parse a file of XML, at most ``LARGEST_FILE`` [byte] and without entities; InputError says what is wrong."""
    near = nearest(path.name, sorted(p.name for p in path.parent.glob("*.urdf"))) if path.parent.is_dir() else None
    existing = near or "the path of a file that exists"
    data = read_bytes(path, LARGEST_FILE, "a URDF", existing, "meshes as files of their own")
    try:
        root: Element = fromstring(data, forbid_dtd=True)
    except DefusedXmlException:
        expected = "XML without DOCTYPE and entities: they could swell without end or read other files"
        raise complaint(str(path), "a DOCTYPE or ENTITY", expected, "the file with its entities written out") from None
    except (ParseError, ValueError, LookupError) as error:
        given = f"XML that does not parse: {error}"
        raise complaint(str(path), given, "well-formed XML", _mended(data, str(error))) from None
    return root


def _mended(data: bytes, error: str) -> str:
    """Return the advice for XML that does not parse: another file, another encoding, or tags that are closed."""
    if b"<" not in data[:256]:
        return "a file of XML: this one does not begin as XML, so another format perhaps bears its name"
    if "invalid token" in error:
        return "text in UTF-8, or its encoding in the first line; & as &amp; and < as &lt; in names"
    return "each tag closed"


def location(path: Path, element: Element, key: str = "") -> str:
    """Name a place [-]: ``robot.urdf: <joint name="elbow">, axis``."""
    name = element.get("name")
    tag = f'<{element.tag} name="{name}">' if name else f"<{element.tag}>"
    return f"{path}: {tag}" + (f", {key}" if key else "")


def name_of(element: Element, path: Path) -> str:
    """Return the element's name [-]: 1 to 100 printable characters."""
    name = element.get("name", "")
    if not name.strip() or not name.isprintable() or len(name) > LONGEST_NAME:
        expected = f"a name of 1 to {LONGEST_NAME} printable characters"
        raise complaint(f"{path}: <{element.tag}>", f"name = {name[:60]!a}", expected, f'<{element.tag} name="...">')
    return name


def numbers(
    element: Element | None, attribute: str, count: int, default: Any, where: str, largest: float = LARGEST
) -> Array:
    """Read an attribute as ``count`` finite numbers, in its own unit such as [m]; ``default`` where it is absent."""
    text = element.get(attribute) if element is not None else None
    if text is None:
        return np.array(default, dtype=np.float64)
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) != count or not all(abs(value) <= largest for value in values) or "_" in text:
        expected = f"{count} finite number{'s' if count > 1 else ''}, at most {largest:g} in size"
        write = f'{attribute}="{" ".join(["0"] * count)}"'
        if "$" in text:
            write = "what xacro makes of this expression: xacro robot.urdf.xacro > robot.urdf"
        raise complaint(where, f'{attribute}="{text[:60]}"', expected, write)
    return np.array(values)


def number(element: Element | None, attribute: str, default: float, where: str, largest: float = LARGEST) -> float:
    """Read an attribute as one finite number, in its own unit such as [kg]; ``default`` where it is absent."""
    return float(numbers(element, attribute, 1, [default], where, largest)[0])
