"""Readings of a block after a call: poses and tips of links, wrenches at joints, deflections and resultants of beams."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flexinv.analysis.evaluation import build_skeleton
from flexinv.dynamics.section_strains import fill_section_strains, list_section_points
from flexinv.elements.beam import Scratch
from flexinv.export.machine_code import KernelCall
from flexinv.export.memory_image import WORD, MemoryImage
from flexinv.export.names import format_numbers, make_words
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.tree import Frames
from flexinv.typing import Array


def format_poses(image: MemoryImage, mesh: Mesh, frames: Frames, found: str) -> dict[str, str]:
    """Return places in the block and tables of nodes, as the templates `links` and `poses` name them [-].

    found : a sentence that says when what is read was found
    """
    skeleton = build_skeleton(mesh)
    links = [joint.child for joint in mesh.mechanism.joints]
    tips = dict(zip(links, zip(skeleton.tip.tolist(), skeleton.point, strict=True), strict=True))
    nodes = dict(zip(links, skeleton.joint.tolist(), strict=True))
    in_order = [link.name for link in mesh.mechanism.links]
    points = [tips[name] for name in in_order]
    return {
        "at_places": str(image.find_place(frames.x)), "at_turns": str(image.find_place(frames.r)), "found": found,
        "link_nodes": ", ".join(str(nodes[name]) for name in in_order),
        "tip_points": ",\n".join(f"    {{{n}, {{{format_numbers(point)}}}}}" for n, point in points),
    }  # fmt: skip


def format_wrenches(image: MemoryImage, mesh: Mesh, line: Array, prefix: str) -> dict[str, str]:
    """Return the place of sums of forces, line (nodes, 6), and the nodes of joints, as the template `wrenches` names them [-]."""
    joints = [joint.name for joint in mesh.mechanism.joints]
    return {
        "at_line": str(image.find_place(line)),
        "joint_nodes_of_joints": ", ".join(map(str, build_skeleton(mesh).joint.tolist())),
        "joints_enum": _list_members(prefix, "JOINT", joints),
    }


def format_beams(image: MemoryImage, mesh: Mesh, internal: Array, prefix: str) -> dict[str, str]:
    """Return ends of beams, and where the resultants of their sections are, as the template `beams` names them [-].

    internal : (1, elements, points, 6) stress resultants [N], [N m]
    """
    skeleton = build_skeleton(mesh)
    beams = zip(skeleton.root.tolist(), skeleton.end.tolist(), skeleton.straight, strict=True)
    _, elements, points, _ = internal.shape
    offsets = WORD * 6 * np.arange(elements * points).reshape(elements, points)
    rows = list[str]()
    first = [0]
    for _, span, order, station in list_section_points(mesh):
        places = np.concatenate([offsets[k, :n] for k, n in zip(range(span.start, span.stop), order, strict=True)])
        rows += [f"    {{{float(at).hex()}, {place}}}" for at, place in zip(station, places.tolist(), strict=True)]
        first.append(len(rows))
    return {
        "at_internal": str(image.find_place(internal)),
        "beam_ends": ",\n".join(f"    {{{root}, {end}, {{{format_numbers(straight)}}}}}" for root, end, straight in beams),
        "section_points": ",\n".join(rows), "first_points": ", ".join(map(str, first)),
        "beams_enum": _list_members(prefix, "BEAM", [link.name for link in mesh.mechanism.beams]),
    }  # fmt: skip


def make_strain_call(mesh: Mesh, frames: Frames, scratch: Scratch, name: str) -> KernelCall:
    """Return the call that finds the strains of all sections [-], [1/m] where the nodes of a block are, ``frames``."""
    elements, points = mesh.elements.weight.shape
    return KernelCall(name, fill_section_strains, (mesh.elements, frames, scratch, np.zeros((elements, points, 6))))


def _list_members(prefix: str, kind: str, names: list[str]) -> str:
    words: Iterator[str] = iter(make_words(f"{kind.lower()}s", names).values())
    return ",\n".join(f"    {prefix.upper()}_{kind}_{word} = {i}" for i, word in enumerate(words))
