"""A robot from its URDF: links, joints and inertias in the order that Pinocchio gives them."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, distribution
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar
from xml.etree.ElementTree import Element, ParseError

import numpy as np
from defusedxml.common import DefusedXmlException

from flexinv.errors import InputError, ModelWarning
from flexinv.files.bounded_xml import XmlBoundExceeded, parse_bounded
from flexinv.files.joints import check_ends, compute_rpy_rotation, list_depth_first, scale_to_unit_axis
from flexinv.files.lenient_xml import replace_invalid_xml
from flexinv.files.regular_files import describe_kind
from flexinv.files.schema import UrdfTable
from flexinv.files.toml_tables import Location, make_input_error, read_bytes
from flexinv.files.values import LARGEST_NUMBER, LONGEST_NAME
from flexinv.model.links import describe_impossible_inertia
from flexinv.model.mechanism import WORLD, Body, Inertia, Joint, Limits, Link, Mechanism, Placement
from flexinv.typing import Array
from flexinv.validation import check_names, convert_to_floats, find_nearest_word, refuse, shown
from flexinv.validation import check_path as path_of

URDF_KINDS = {kind: kind for kind in ("fixed", "revolute", "continuous", "prismatic")} | {"floating": "free"}
NO_LIMIT = float(np.finfo(np.float64).max)  # some files write the largest number where they mean no limit
# A number with a point or a decimal comma, perhaps with a unit behind it, or a unit alone.
MEANT = re.compile(r"([+-]?[0-9]+(?:[.,][0-9]*)?(?:[eE][+-]?[0-9]+)?)?[a-zA-Z^/*0-9]*")
T = TypeVar("T")
LARGEST_FILE = 16 << 20  # [byte]: the largest URDF of example-robot-data has 0.2 MB
ROBOTS = "cmeel.prefix/share/example-robot-data/robots"  # where the wheel of example-robot-data puts its robots
STANDARD_GRAVITY = (0.0, 0.0, -9.81)  # [m/s^2], as Pinocchio


def from_urdf(
    path: str | Path, packages: Sequence[str | Path] = (), base: str = "fixed",
    gravity: Sequence[float] = STANDARD_GRAVITY, lock: Sequence[str] = (),
) -> Mechanism:  # fmt: skip
    """Read a URDF into a mechanism whose coordinates stand in Pinocchio's order.

    path : the file; packages : folders for its ``package://`` paths (geometry is not read; engines may need them)
    base : "fixed" hangs the root link on the world, "free" gives it six freedoms without a drive
    gravity : (3,) [m/s^2]; lock : names of joints that are held at zero, that is made fixed
    Lengths [m], angles [rad], masses [kg], inertias [kg m^2] as in the file.  Children of a link come in alphabetical order of
    their joints (urdfdom keeps joints in a sorted map).  Joints that mimic others are coordinates of their own, as in
    ``pinocchio.buildModelFromUrdf``, and an inertia that no body can have is kept (files of real robots have them, and the torque
    of a rigid robot is defined with them): each with ModelWarning and a note.  Raises InputError.
    """
    file = Path(path_of("path", path, "a URDF file"))
    lock = check_names("lock", lock, "joints")
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
    pull = np.array(convert_to_floats("gravity", gravity))
    if pull.shape != (3,) or not np.all(np.isfinite(pull)):
        expected = f"expected three finite numbers [m/s^2]; write gravity={STANDARD_GRAVITY}"
        raise InputError(f"gravity = {gravity}: {expected}")
    robot = read_robot(path)
    inertias = _read_inertias(robot, path)
    stated = _replace_locked(_read_by_name(robot, "joint", path, _read_joint), lock, path)
    joints = [stated[name] for name in sorted(stated)]

    def describe_place(kind: str, name: str, key: str) -> str:
        return f'{path}: <{kind} name="{name}">' + (f", {key}" if key else "")

    check_ends(joints, inertias, inertias, describe_place)
    inertias, joints = _add_base(inertias, joints, base, describe_location(path, robot))
    ordered = list_depth_first(joints, inertias, describe_place)
    bodies = {name: () if inertia is None else (Body(name, inertia),) for name, inertia in inertias.items()}
    warned = _list_warnings(robot, inertias, lock)
    mechanism = Mechanism(
        name=path.stem, links=tuple(Link(j.child, bodies[j.child]) for j in ordered), joints=ordered, gravity=pull,
        title=f"{robot.get('name', path.stem)}", source=f"URDF {path.name}", urdf=path.resolve(),
        packages=tuple(Path(p).resolve() for p in packages),
        notes=(*warned.values(), *_list_notes(inertias, lock)),
    )  # fmt: skip
    return mechanism, warned


def find_robots_folder() -> Path:
    """Return the folder of the robots of the PyPI package example-robot-data [-]; InputError without it."""
    advice = "pip install 'flexinv[robots]'"
    try:
        folder = Path(str(distribution("example-robot-data").locate_file(ROBOTS)))
    except PackageNotFoundError:
        given = "it is not installed"
        expected = "the PyPI package example-robot-data (models only, 131 MB)"
        raise make_input_error("package example-robot-data", given, expected, advice) from None
    if not folder.is_dir():
        raise make_input_error("package example-robot-data", f"no folder {folder}", "its robots there", advice)
    return folder.resolve()


def find_urdf(table: UrdfTable, where: Location) -> tuple[Path, tuple[Path, ...]]:
    """Return the URDF and the folders for its ``package://`` paths [-].

    With a package inside its robots, else beside the mechanism file, never outside the folder that holds the mechanism's folder.
    """
    start = where.file.resolve().parent if table.package is None else find_robots_folder()
    limit, packages = (start.parent, (start,)) if table.package is None else (start, (start, start.parent.parent))
    path = (start / table.path).resolve()
    if Path(table.path).is_absolute() or not path.is_relative_to(limit):
        expected = f"a relative path that stays inside {'the package' if table.package else 'the models folder'}"
        raise where.make_error("path", f'path = "{table.path}"', expected, f'path = "{Path(table.path).name}"')
    if words := describe_kind(path):
        known = sorted(str(p.relative_to(start)) for p in start.rglob("*.urdf")) if start.is_dir() else []
        near = find_nearest_word(table.path, known)
        write = f'path = "{near}"' if near else "the path of a URDF that exists"
        raise where.make_error("path", f'path = "{table.path}", {words}', f"a URDF in {start}", write)
    return path, packages


def _read_by_name(robot: Element, tag: str, path: Path, read: Callable[[Element, Path], T]) -> dict[str, T]:
    """The robot's elements of a tag as they are read, by their names, each of which stands there once."""
    result: dict[str, T] = {}
    for element in robot.findall(tag):
        name = element.get("name", "")
        if not name.strip() or not name.isprintable() or len(name) > LONGEST_NAME:
            expected = f"a name of 1 to {LONGEST_NAME} printable characters"
            raise make_input_error(f"{path}: <{tag}>", f"name = {name[:60]!a}", expected, f'<{tag} name="...">')
        if name in result:
            raise make_input_error(
                describe_location(path, element), f"this {tag} twice", f"each {tag} once", "a name of its own"
            )
        result[name] = read(element, path)
    return result


def _read_inertia(link: Element, path: Path) -> Inertia | None:
    """About the centre of mass along link axes: R I R^T with R from the rpy of the inertial's origin."""
    inertial = link.find("inertial")
    if inertial is None:
        return None
    mass = read_number(inertial.find("mass"), "value", 0.0, describe_location(path, link, "mass"))
    if mass < 0:
        raise make_input_error(
            describe_location(path, link, "mass"), f'value="{mass:g}"', "a mass >= 0 [kg]", f'value="{-mass:g}"'
        )
    entry = inertial.find("inertia")
    where = describe_location(path, link, "inertia")
    xx, xy, xz, yy, yz, zz = (
        read_number(entry, name, 0.0, where) for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if mass == 0.0 and not tensor.any():
        return None
    origin = _read_origin(inertial, describe_location(path, link, "inertial"))
    return Inertia.build_unchecked(mass, origin.position, origin.rotation @ tensor @ origin.rotation.T)


def _read_origin(element: Element, where: str) -> Placement:
    origin = element.find("origin")
    xyz = read_numbers(origin, "xyz", 3, [0, 0, 0], f"{where}, origin")
    return Placement(xyz, compute_rpy_rotation(read_numbers(origin, "rpy", 3, [0, 0, 0], f"{where}, origin")))


def _read_inertias(robot: Element, path: Path) -> dict[str, Inertia | None]:
    """Link -> its inertia, None where it has none; there is at least one."""
    inertias = _read_by_name(robot, "link", path, _read_inertia)
    if not inertias:
        raise make_input_error(str(path), "a robot without links", "at least one <link>", '<link name="base">')
    if all(inertia is None for inertia in inertias.values()):
        advice = '<inertial><mass value="..."/><inertia ixx="..." .../></inertial> in the links'
        raise make_input_error(str(path), "no link with a mass [kg]", "inertia in at least one link", advice)
    return inertias


def _replace_locked(stated: dict[str, Joint], lock: Sequence[str], path: Path) -> dict[str, Joint]:
    """The joints by name, some of them fixed where they are at zero."""
    known = [name for name in sorted(stated) if stated[name].nv]
    joints = dict(stated)
    for name in lock:
        if name not in known:
            near = find_nearest_word(name, known) or (known[0] if known else "no joint")
            raise make_input_error(str(path), f'lock of joint "{name}"', "a joint of the robot that moves", f'"{near}"')
        j = stated[name]
        joints[name] = Joint(name, "fixed", j.parent, j.child, j.placement, actuated=False)
    return joints


def _list_warnings(robot: Element, inertias: dict[str, Inertia | None], lock: Sequence[str]) -> dict[str, str]:
    """Texts that deserve a warning, by subject."""
    moving = [j for j in robot.findall("joint") if j.get("type") != "fixed" and j.get("name") not in lock]
    mimics = [f"{j.get('name')} (of {one.get('joint')})" for j in moving for one in j.findall("mimic")[:1]]
    stated = {name: inertia for name, inertia in inertias.items() if inertia is not None}
    odd = [name for name, inertia in stated.items() if describe_impossible_inertia(inertia.tensor)]
    warned = {}
    if mimics:
        warned["mimic"] = f"mimic joints are coordinates of their own: {', '.join(mimics)}"
    if odd:
        warned["inertia"] = f"links with an inertia that no body can have, kept as it is: {', '.join(odd)}"
    return warned


def _list_notes(inertias: dict[str, Inertia | None], lock: Sequence[str]) -> list[str]:
    """Notes that a reader of results must know, and nobody is warned of."""
    massless = [name for name, inertia in inertias.items() if inertia is None]
    subjects = ("links without mass", massless), ("joints locked at zero", lock)
    return [f"{text}: {', '.join(which)}" for text, which in subjects if which]


def _read_joint(element: Element, path: Path) -> Joint:
    kind = _read_kind(element, path)
    where = describe_location(path, element)
    ends = [_read_link_name(element, tag, where) for tag in ("parent", "child")]
    placement = _read_origin(element, where)
    if kind in ("fixed", "floating"):
        return Joint(element.get("name", ""), URDF_KINDS[kind], ends[0], ends[1], placement, actuated=False)
    numbers = read_numbers(element.find("axis"), "xyz", 3, [1, 0, 0], f"{where}, axis")
    axis = scale_to_unit_axis(numbers, f"{where}, axis", '<axis xyz="0 0 1"/>')
    losses: dict[str, Any] = {loss: _read_loss(element, loss, where) for loss in ("damping", "friction")}
    limits = _read_limits(element.find("limit"), kind, f"{where}, limit")
    return Joint(element.get("name", ""), kind, ends[0], ends[1], placement, axis=axis, limits=limits, **losses)


def _read_kind(element: Element, path: Path) -> str:
    """The type of a joint, one of `URDF_KINDS`."""
    kind = element.get("type", "")
    if kind in URDF_KINDS:
        return kind
    expected = f"one of {', '.join(URDF_KINDS)}"
    near = find_nearest_word(kind, URDF_KINDS) or "revolute"
    if kind == "planar":
        expected += "; planar joints are not supported"
        near = "two prismatic and one revolute joint"
    raise make_input_error(describe_location(path, element, "type"), f'type="{kind[:60]}"', expected, near)


def _read_link_name(joint: Element, tag: str, where: str) -> str:
    """The link at an end of a joint."""
    end = joint.find(tag)
    name = "" if end is None else end.get("link", "")
    if not name:
        raise make_input_error(f"{where}, {tag}", "nothing", "the name of a link", f'<{tag} link="..."/>')
    return name


def _read_loss(joint: Element, loss: str, where: str) -> float:
    """Damping or friction of a joint."""
    value = read_number(joint.find("dynamics"), loss, 0.0, f"{where}, dynamics")
    if value < 0:
        raise make_input_error(f"{where}, dynamics", f'{loss}="{value:g}"', f"a {loss} >= 0", f'{loss}="{-value:g}"')
    return value


def _read_limits(limit: Element | None, kind: str, where: str) -> Limits:
    """The limits of a joint: 0 is how URDF writers say "not stated"; a continuous joint has no position limits."""
    if limit is None:
        return Limits()
    effort, velocity = (abs(read_number(limit, k, 0.0, where, NO_LIMIT)) or np.inf for k in ("effort", "velocity"))
    if kind == "continuous":
        return Limits(effort, velocity)
    lower, upper = (read_number(limit, k, 0.0, where, NO_LIMIT) for k in ("lower", "upper"))
    if lower > upper:
        given = f'lower="{lower:g}" upper="{upper:g}"'
        raise make_input_error(where, given, "lower <= upper", "the two exchanged, if so meant")
    return Limits(effort, velocity, lower=lower, upper=upper)


def _add_base(
    links: dict[str, Inertia | None], joints: list[Joint], base: str, where: str
) -> tuple[dict[str, Inertia | None], list[Joint]]:
    """Hang the root on the world.  A fixed root named "world" is the world; a moving one gets another name."""
    root = _find_root(links, joints, where)
    if root == WORLD and base == "fixed":
        return {name: inertia for name, inertia in links.items() if name != WORLD}, joints
    moved = _find_free_name("world_link", links)
    links = {moved if name == WORLD else name: inertia for name, inertia in links.items()}
    joints = [replace(j, parent=moved) if j.parent == WORLD else j for j in joints]
    joints = [replace(j, child=moved) if j.child == WORLD else j for j in joints]
    name = _find_free_name("root_joint", [j.name for j in joints])
    return links, [Joint(name, base, WORLD, moved if root == WORLD else root, actuated=False), *joints]


def _find_root(links: Iterable[str], joints: list[Joint], where: str) -> str:
    """The link that no joint carries."""
    carried = {joint.child for joint in joints}
    roots = [name for name in links if name not in carried]
    if len(roots) == 1:
        return roots[0]
    expected = "a tree with one root link; what closes a loop is a closure of a mechanism file"
    given = "a joint carries every link: a cycle"
    advice = "the loop cut at one joint, and [closures.NAME] beside [urdf] for it"
    if roots:
        given = f"{len(roots)} links that no joint carries: {', '.join(roots[:5])}"
        advice = "a fixed joint between the separate parts"
    raise make_input_error(where, given, expected, advice)


def _find_free_name(name: str, used_names: Collection[str]) -> str:
    while name in used_names:
        name += "_"
    return name


def read_robot(path: Path) -> Element:
    """Parse the file and return its ``<robot>``, at most ``LARGEST_FILE`` [byte]; InputError says what is wrong."""
    root = read_xml(path)
    if root.tag != "robot":
        advice = "the URDF itself; a .xacro file is expanded first: xacro robot.urdf.xacro > robot.urdf"
        raise make_input_error(str(path), f"<{root.tag[:80]}>", '<robot name="...">', advice)
    return root


def read_xml(path: Path, expected: str = "a URDF") -> Element:
    """Parse a file of XML: at most ``LARGEST_FILE`` [byte], `bounded_xml`'s levels and elements, no entities.

    expected : what the file should be, in words; InputError says what is wrong.
    """
    near = (
        find_nearest_word(path.name, sorted(p.name for p in path.parent.glob(f"*{path.suffix}")))
        if path.parent.is_dir()
        else None
    )
    existing = near or "the path of a file that exists"
    data = read_bytes(path, LARGEST_FILE, expected, existing, "meshes as files of their own")
    try:
        root: Element = _parse_xml(data)
    except DefusedXmlException:
        safe = "XML without DOCTYPE and entities: they could swell without end or read other files"
        raise make_input_error(
            str(path), "a DOCTYPE or ENTITY", safe, "the file with its entities written out"
        ) from None
    except XmlBoundExceeded as error:
        raise make_input_error(str(path), error.given, error.expected, error.write) from None
    except (ParseError, ValueError, LookupError) as error:
        given = f"XML that does not parse: {error}"
        write = "each tag closed"
        if b"<" not in data[:256]:
            write = "a file of XML: this one does not begin as XML, so another format perhaps bears its name"
        elif "invalid token" in str(error):
            write = "text in UTF-8, or its encoding in the first line; & as &amp; and < as &lt; in names"
        raise make_input_error(str(path), given, "well-formed XML", write) from None
    return root


def list_xml_repairs(path: Path) -> list[str]:
    """Return the repairs of `read_xml` in a file [-], a line each: the standard forbids it as it is, and others read it."""
    data = read_bytes(path, LARGEST_FILE, "a URDF", "the path of a file that exists", "meshes as files of their own")
    try:
        parse_bounded(data)
    except (ParseError, ValueError, LookupError):
        return replace_invalid_xml(data)[1]
    return []


def _parse_xml(data: bytes) -> Element:
    """The root of a text; of one that the standard forbids and others read, as they do.  Raises ParseError."""
    try:
        return parse_bounded(data)
    except ParseError as error:
        text, repairs = replace_invalid_xml(data)
        if not repairs:
            raise
        try:
            return parse_bounded(text)
        except ParseError:
            raise error from None


def describe_location(path: Path, element: Element, key: str = "") -> str:
    """Name a place [-]: ``robot.urdf: <joint name="elbow">, axis``."""
    name = element.get("name")
    tag = f'<{element.tag} name="{name}">' if name else f"<{element.tag}>"
    return f"{path}: {tag}" + (f", {key}" if key else "")


def read_numbers(
    element: Element | None, attribute: str, count: int, default: Any, where: str, largest: float = LARGEST_NUMBER
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
        xacro = "what xacro makes of this expression: xacro robot.urdf.xacro > robot.urdf"
        write = xacro if "$" in text else f'{attribute}="{_find_meant_numbers(text, count)}"'
        raise make_input_error(where, f'{attribute}="{text[:60]}"', expected, write)
    return np.array(values)


def _find_meant_numbers(text: str, count: int) -> str:
    """The numbers that a text seems to mean: decimal commas as points, units left away; else so many places for numbers."""
    parts = [MEANT.fullmatch(word) for word in text.split()]
    words = [part.group(1).replace(",", ".") for part in parts if part is not None and part.group(1)]
    known = len(words) == count and all(abs(float(word)) <= LARGEST_NUMBER for word in words)
    return " ".join(words if known else ["..."] * count)


def read_number(
    element: Element | None, attribute: str, default: float, where: str, largest: float = LARGEST_NUMBER
) -> float:
    """Read an attribute as one finite number, in its own unit such as [kg]; ``default`` where it is absent."""
    return float(read_numbers(element, attribute, 1, [default], where, largest)[0])
