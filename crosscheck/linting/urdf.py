"""Findings in a URDF's text: what no reader understands alike, read without refusing what other readers would refuse."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Container, Iterator
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from crosscheck.findings.bodies import check_bodies
from crosscheck.findings.finding import Finding, make_error, make_warning
from crosscheck.findings.sides import check_sides
from crosscheck.findings.statements import LinkStatements, Mounting
from crosscheck.linting.mesh_files import find_mesh_file, list_mesh_findings, read_meshes
from crosscheck.linting.meshes import check_meshes
from crosscheck.linting.numbers import check_numbers
from crosscheck.linting.shapes import check_shapes
from flexinv.files.joints import compute_rpy_rotation
from flexinv.model.mechanism import Array, Inertia, Placement

INERTIAS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
MOVING = ("revolute", "continuous", "prismatic", "floating", "planar")
KINDS = (*MOVING, "fixed")
TURNS = 4 * np.pi  # [rad]: a limit beyond two turns looks like degrees
# [m] of a joint's origin, and of a sliding joint's limits: looks like mm
FAR = 20.0
LONG = 10.0
STRONG = 1e5  # [N m], [N]


def check_urdf(robot: Element, path: Path, meshes: bool = True) -> Iterator[Finding]:
    """Yield findings of a URDF [m, kg, rad]; meshes : look at the shapes of links, too."""
    read = read_meshes(robot, path) if meshes else {}
    yield from _check_names(robot)
    yield from _check_tree(robot)
    links = _read_links(robot)
    yield from check_numbers(robot)
    yield from check_bodies(links, _compute_machine_size(robot))
    yield from check_sides(links, _read_mountings(robot))
    yield from _check_massless_links(robot, links)
    yield from check_shapes(robot, read)
    for joint in robot.findall("joint"):
        yield from _check_joint(joint)
    yield from _check_mimics(robot)
    yield from _check_transmissions(robot)
    yield from _check_mesh_files(robot, path)
    if meshes:
        yield from list_mesh_findings(read)
        yield from check_meshes(robot, read, links, _compute_machine_size(robot))


def read_values(element: Element | None, key: str, default: tuple[float, ...]) -> Array | None:
    """Return an attribute's numbers in its own unit [any unit]; None where they are none, NaN, or too few."""
    text = None if element is None else element.get(key)
    if text is None:
        return np.array(default)
    try:
        found = [float(word) for word in text.split()]
    except ValueError:
        return None
    return np.array(found) if len(found) == len(default) and all(map(math.isfinite, found)) else None


def _check_names(robot: Element) -> Iterator[Finding]:
    for tag in ("link", "joint"):
        counted = Counter(element.get("name", "") for element in robot.findall(tag))
        for name, times in counted.items():
            if times > 1 or not name:
                why = "readers keep one of them, or refuse the file" if name else "it has no name"
                yield make_error("name", f"{tag} {name!r}", f"{times} times", why, "a name of its own for each")


def _check_tree(robot: Element) -> Iterator[Finding]:
    links = {link.get("name", "") for link in robot.findall("link")}
    carried: Counter[str] = Counter()
    for joint in robot.findall("joint"):
        for tag in ("parent", "child"):
            end = joint.find(tag)
            name = "" if end is None else end.get("link", "")
            if name not in links:
                yield make_error(
                    "tree",
                    f"joint {joint.get('name')}",
                    f"<{tag} link={name!r}>",
                    "there is no such link",
                    "a link of the file",
                )
            elif tag == "child":
                carried[name] += 1
    for name, times in carried.items():
        if times > 1:
            yield make_error(
                "tree",
                f"link {name}",
                f"the child of {times} joints",
                "a URDF is a tree: loops cannot be said",
                "one joint; close loops in SDF, MJCF or mechanism.toml",
            )
    roots = links - set(carried)
    if links and len(roots) != 1:
        given = f"{len(roots)} links without a joint that carries them: {', '.join(sorted(roots)[:5])}"
        yield make_error("tree", "robot", given, "a URDF is one tree", "one root link")


def _read_links(robot: Element) -> dict[str, LinkStatements]:
    moved = {
        j.find("child").get("link", "")  # type: ignore[union-attr]
        for j in robot.findall("joint")
        if j.get("type") in MOVING and j.find("child") is not None
    }
    links = {}
    for link in robot.findall("link"):
        name = link.get("name", "")
        inertial = link.find("inertial")
        found = None if inertial is None else _read_inertia(inertial)
        body = found or Inertia(0.0)
        links[name] = LinkStatements(name, body, name in moved, inertial is not None and found is not None)
    return links


def _read_inertia(inertial: Element) -> Inertia | None:
    mass = read_values(inertial.find("mass"), "value", (0.0,))
    entry = inertial.find("inertia")
    numbers = [read_values(entry, key, (0.0,)) for key in INERTIAS]
    com, rpy = (read_values(inertial.find("origin"), key, (0.0, 0.0, 0.0)) for key in ("xyz", "rpy"))
    if mass is None or com is None or rpy is None or any(x is None for x in numbers):
        return None
    xx, xy, xz, yy, yz, zz = (float(x[0]) for x in numbers if x is not None)
    turn = compute_rpy_rotation(rpy)
    return Inertia.build_unchecked(
        float(mass[0]), com, turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
    )


def _read_mountings(robot: Element) -> Iterator[Mounting]:
    """Yield how joints carry links; those whose places are no numbers are left out."""
    for joint in robot.findall("joint"):
        parent = joint.find("parent")
        child = joint.find("child")
        xyz, rpy = (read_values(joint.find("origin"), key, (0.0, 0.0, 0.0)) for key in ("xyz", "rpy"))
        if parent is not None and child is not None and xyz is not None and rpy is not None:
            place = Placement(xyz, compute_rpy_rotation(rpy))
            yield Mounting(parent.get("link", ""), child.get("link", ""), place)


def _compute_machine_size(robot: Element) -> float:
    """Sum of the longest ways from joint to joint [m]: how far the machine can extend."""
    lengths = []
    for joint in robot.findall("joint"):
        xyz = read_values(joint.find("origin"), "xyz", (0.0, 0.0, 0.0))
        if xyz is not None:
            lengths.append(float(np.linalg.norm(xyz)))
    return float(sum(sorted(lengths)[-6:])) or 1.0


def _check_massless_links(robot: Element, links: dict[str, LinkStatements]) -> Iterator[Finding]:
    """Links that a joint moves, and at whose end there is no mass at all."""
    children: dict[str, list[Element]] = {}
    for joint in robot.findall("joint"):
        end = joint.find("parent")
        children.setdefault("" if end is None else end.get("link", ""), []).append(joint)
    for joint in robot.findall("joint"):
        child = joint.find("child")
        name = "" if child is None else child.get("link", "")
        if joint.get("type") in MOVING and name in links and not _has_mass(name, links, children, 0):
            why = "its joint moves nothing that has mass: forward dynamics is singular, and DART and MuJoCo make up a mass"
            yield make_warning(
                "link without inertia",
                f"link {name}",
                f"moved by joint {joint.get('name')}",
                why,
                "<inertial> with mass and tensor",
            )


def _has_mass(name: str, links: dict[str, LinkStatements], children: dict[str, list[Element]], depth: int) -> bool:
    """Return True if a link, or what is fixed to it or carried by it, has mass."""
    link = links.get(name)
    if link is None or link.inertia.mass > 0 or depth > len(links):
        return link is not None and depth <= len(links)
    ends = [joint.find("child") for joint in children.get(name, [])]
    return any(_has_mass(end.get("link", ""), links, children, depth + 1) for end in ends if end is not None)


def _check_joint(joint: Element) -> Iterator[Finding]:
    name = f"joint {joint.get('name')}"
    kind = joint.get("type", "")
    if kind not in KINDS:
        yield make_error("kind of joint", name, kind or "none", "no reader knows it", f"one of {', '.join(KINDS)}")
        return
    yield from _check_origin(joint, name)
    if kind in ("revolute", "continuous", "prismatic"):
        yield from _check_axis(joint, name)
        yield from _check_limits(joint, name, kind)
        yield from _check_dynamics(joint, name)


def _check_origin(joint: Element, name: str) -> Iterator[Finding]:
    for key, most, words in (("xyz", FAR, "mm"), ("rpy", 2 * np.pi + 1e-3, "degrees")):
        values = read_values(joint.find("origin"), key, (0.0, 0.0, 0.0))
        if values is None:
            yield make_error(
                "number",
                name,
                f'{key}="{_read_text(joint, "origin", key)}"'[:80],
                "three finite numbers are expected",
                f'{key}="0 0 0"',
            )
        elif np.abs(values).max() > most:
            write = "metres" if key == "xyz" else "radians"
            yield make_warning(
                "units", name, f'{key}="{" ".join(f"{x:g}" for x in values)}"', f"looks like {words}", write
            )


def _check_axis(joint: Element, name: str) -> Iterator[Finding]:
    axis = read_values(joint.find("axis"), "xyz", (1.0, 0.0, 0.0))
    if axis is None or not axis.any():
        yield make_error("axis", name, "zero, or no three numbers", "an axis has a direction", '<axis xyz="0 0 1"/>')
        return
    length = float(np.linalg.norm(axis))
    if abs(length - 1.0) > 1e-3:
        unit = " ".join(f"{x:.9g}" for x in axis / length)
        yield make_warning(
            "axis",
            name,
            f"length {length:.4g}",
            "readers normalise it, or scale the coordinate",
            f'<axis xyz="{unit}"/>',
        )


def _check_limits(joint: Element, name: str, kind: str) -> Iterator[Finding]:
    limit = joint.find("limit")
    if limit is None:
        if kind != "continuous":
            yield make_error(
                "limit",
                name,
                "none",
                "a revolute or sliding joint has to state it; readers take 0 or none",
                '<limit lower="" upper="" effort="" velocity=""/>',
            )
        return
    stated = {key: read_values(limit, key, (0.0,)) for key in ("lower", "upper", "effort", "velocity")}
    if any(value is None for value in stated.values()):
        yield make_error(
            "limit",
            name,
            str(dict(limit.attrib))[:80],
            "finite numbers are expected",
            '<limit lower="-3" upper="3" effort="10" velocity="2"/>',
        )
        return
    low, high, effort, speed = (float(value[0]) for value in stated.values() if value is not None)
    if kind != "continuous":
        yield from _check_range(name, kind, low, high)
    for key, value, unit in (("effort", effort, "N m, N"), ("velocity", speed, "rad/s, m/s")):
        if value < 0 or (value == 0 and low < high):
            why = "some readers take 0 as a drive that can do nothing, others as none stated"
            yield make_warning("limit", name, f"{key} {value:g} {unit}", why, f'{key}="..." of the drive')


def _check_range(name: str, kind: str, low: float, high: float) -> Iterator[Finding]:
    given = f"lower {low:g}, upper {high:g}"
    if low > high:
        yield make_error(
            "limit", name, given, "lower is above upper: nothing is allowed", f'lower="{high:g}" upper="{low:g}"'
        )
    elif low == high:
        yield make_warning(
            "limit",
            name,
            given,
            "it cannot move: readers hold it, or take it as unlimited",
            'its range, or type="fixed"',
        )
    elif kind == "revolute" and max(-low, high) > TURNS and max(-low, high) < 1e4:
        yield make_warning(
            "units",
            name,
            given,
            "beyond two turns: looks like degrees",
            f'lower="{math.radians(low):.6g}" upper="{math.radians(high):.6g}", or type="continuous"',
        )
    elif kind == "prismatic" and LONG < max(-low, high) < 1e5:
        yield make_warning("units", name, given, "looks like mm", f'lower="{low / 1000:g}" upper="{high / 1000:g}"')


def _check_dynamics(joint: Element, name: str) -> Iterator[Finding]:
    for key in ("damping", "friction"):
        values = read_values(joint.find("dynamics"), key, (0.0,))
        if values is None or values[0] < 0:
            yield make_error(
                "dynamics",
                name,
                f"{key} {_read_text(joint, 'dynamics', key)}"[:80],
                "a number >= 0 is expected",
                f'{key}="0"',
            )


def _read_text(joint: Element, tag: str, key: str) -> str:
    """The text of an attribute of a joint's part, "" where there is none."""
    part = joint.find(tag)
    return "" if part is None else part.get(key, "")


def _check_mimics(robot: Element) -> Iterator[Finding]:
    kinds = {joint.get("name", ""): joint.get("type", "") for joint in robot.findall("joint")}
    names = []
    for joint in robot.findall("joint"):
        mimic = joint.find("mimic")
        if mimic is None:
            continue
        name = joint.get("name", "")
        other = mimic.get("joint", "")
        if other not in kinds or other == name:
            yield make_error(
                "mimic", f"joint {name}", f"mimics {other!r}", "there is no such other joint", "a joint of the file"
            )
        elif "fixed" in (kinds[name], kinds[other]):
            yield make_error(
                "mimic",
                f"joint {name}",
                f"mimics {other}",
                "one of them is fixed: Drake and Newton refuse the file",
                "no <mimic>",
            )
        else:
            names.append(name)
    if names:
        why = "Pinocchio leaves them independent unless asked, DART's inverse dynamics too, MuJoCo makes equalities"
        yield make_warning(
            "mimic",
            f"joint {', '.join(names[:8])}",
            f"{len(names)} mimic joints",
            why,
            "the coupling in each engine's own words; compare with --readers all",
        )


def _check_transmissions(robot: Element) -> Iterator[Finding]:
    joints = {joint.get("name", "") for joint in robot.findall("joint")}
    for element in robot.findall("transmission"):
        yield from _check_transmission(element, joints)


def _check_transmission(element: Element, joints: Container[str]) -> Iterator[Finding]:
    place = f"transmission {element.get('name')}"
    named = [joint.get("name", "") for joint in element.findall("joint")]
    for name in named:
        if name not in joints:
            yield make_error("transmission", place, f"joint {name!r}", "there is no such joint", "a joint of the file")
    for part in element.iter("mechanicalReduction"):
        text = (part.text or "").strip()
        if read_values(Element("x", value=text), "value", (1.0,)) is None:
            given = f"mechanicalReduction {text[:60]!r}"
            yield make_error("transmission", place, given, "readers take 1, or refuse the file", "the gear as a number")
    kind = (element.findtext("type") or element.get("type") or "").strip()
    if len(named) > 1 or (kind and "Simple" not in kind):
        why = "readers other than its controller drop it, with its gear"
        write = "SimpleTransmission for each joint, or the coupling in the engine's words"
        yield make_warning("transmission", place, kind or f"{len(named)} joints", why, write)


def _check_mesh_files(robot: Element, path: Path) -> Iterator[Finding]:
    for mesh in robot.iter("mesh"):
        if read_values(mesh, "scale", (1.0, 1.0, 1.0)) is None:
            given = f'scale="{mesh.get("scale", "")}"'[:80]
            place = f"mesh {mesh.get('filename', '')[:100]}"
            yield make_error("number", place, given, "three finite numbers are expected", 'scale="1 1 1"')
    lost = sorted(
        {
            name
            for mesh in robot.iter("mesh")
            if (name := mesh.get("filename", "")) and find_mesh_file(name, path) is None
        }
    )
    if lost:
        given = f"{len(lost)} meshes, such as {lost[0][:100]}"
        yield make_warning(
            "mesh",
            "robot",
            given,
            "not found beside the file: DART and MuJoCo refuse it then",
            "paths that lead from the file, or the package's folder given to the reader",
        )
