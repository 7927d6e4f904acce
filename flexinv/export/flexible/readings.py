"""Readings of a mechanism with beams after each step: poses and tips of links, wrenches at joints, resultants of sections."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flexinv.analysis.controller import FlexibleState
from flexinv.analysis.evaluation import build_skeleton, list_section_points
from flexinv.export.memory_image import WORD, MemoryImage
from flexinv.export.names import format_numbers, format_string, make_words
from flexinv.kinematics.mesh import Mesh
from flexinv.model.mechanism import Mechanism


def format_readings(image: MemoryImage, state: FlexibleState, prefix: str) -> dict[str, str]:
    """Return places in the block and tables of nodes, as the templates `readings` name them [-]."""
    mesh = state.solver.mesh
    m = mesh.mechanism
    skeleton = build_skeleton(mesh)
    links = [joint.child for joint in m.joints]
    tips = dict(zip(links, zip(skeleton.tip.tolist(), skeleton.point, strict=True), strict=True))
    nodes = dict(zip(links, skeleton.joint.tolist(), strict=True))
    beams = zip(skeleton.root.tolist(), skeleton.end.tolist(), skeleton.straight, strict=True)
    return {
        "at_places": str(image.find_place(state.frames.x)), "at_turns": str(image.find_place(state.frames.r)),
        "at_line": str(image.find_place(state.instant.line)), "at_internal": str(image.find_place(state.solver.instant.internal)),
        "link_nodes": ", ".join(str(nodes[link.name]) for link in m.links),
        "tip_points": ",\n".join(f"    {{{n}, {{{format_numbers(point)}}}}}" for n, point in (tips[x.name] for x in m.links)),
        "joint_nodes_of_joints": ", ".join(map(str, skeleton.joint.tolist())),
        "beam_ends": ",\n".join(f"    {{{root}, {end}, {{{format_numbers(straight)}}}}}" for root, end, straight in beams),
        **_format_sections(mesh, state), **_format_names(m, prefix),
    }  # fmt: skip


def _format_sections(mesh: Mesh, state: FlexibleState) -> dict[str, str]:
    """Points of each beam: fraction of its length, offset among the stress resultants [bytes], and the first of each beam."""
    _, elements, points, _ = state.solver.instant.internal.shape
    offsets = WORD * 6 * np.arange(elements * points).reshape(elements, points)
    rows = list[str]()
    first = [0]
    for _, own, order, station in list_section_points(mesh):
        places = np.concatenate([offsets[k, :n] for k, n in zip(range(own.start, own.stop), order, strict=True)])
        rows += [f"    {{{float(at).hex()}, {place}}}" for at, place in zip(station, places.tolist(), strict=True)]
        first.append(len(rows))
    return {"section_points": ",\n".join(rows), "first_points": ", ".join(map(str, first))}


def _format_names(mechanism: Mechanism, prefix: str) -> dict[str, str]:
    """Members of enumerations for joints and beams, and names of joints as strings."""
    joints = [joint.name for joint in mechanism.joints]
    beams = [link.name for link in mechanism.beams]
    return {
        "joints_enum": _list_members(prefix, "JOINT", joints), "beams_enum": _list_members(prefix, "BEAM", beams),
        "joint_names": ", ".join(map(format_string, joints)), "joint_count": str(len(joints)), "beam_count": str(len(beams)),
    }  # fmt: skip


def _list_members(prefix: str, kind: str, names: list[str]) -> str:
    words: Iterator[str] = iter(make_words(f"{kind.lower()}s", names).values())
    return ",\n".join(f"    {prefix.upper()}_{kind}_{word} = {i}" for i, word in enumerate(words))
