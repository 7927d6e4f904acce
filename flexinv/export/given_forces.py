"""Given forces of a library: constant ones as the mechanism has them, and all of them changed by the program that calls it.

A force that depends on time begins as it is at first; a program that knows the time gives it anew before each call.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from flexinv.export.memory_image import MemoryImage
from flexinv.export.names import format_numbers, make_words
from flexinv.kinematics.mesh import Mesh, find_attachment_node
from flexinv.model.mechanism import Force, Mechanism
from flexinv.typing import Array


def replace_changing_forces(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism whose given forces [N], [N m] stay what they are at first."""
    if all(len(force.time) == 1 for force in mechanism.forces):
        return mechanism
    held = tuple(replace(one, wrench=one.wrench[:1], time=one.time[:1]) for one in mechanism.forces)
    return replace(mechanism, forces=held)


def list_moved_forces(mesh: Mesh) -> list[Force]:
    """Return the given forces [N], [N m] on links, in their order in a library; those on the world do nothing."""
    return [force for force in mesh.mechanism.forces if find_attachment_node(mesh, force.at) >= 0]


def format_forces(image: MemoryImage, mesh: Mesh, tables: Sequence[Array], prefix: str) -> dict[str, str]:
    """Return names of forces, axes of those that follow, and places of their wrenches, for the templates `forces` [-].

    tables : (forces, 6) arrays of kernels that hold wrenches [N], [N m]
    """
    forces = list_moved_forces(mesh)
    words = make_words("forces", [force.name for force in forces]).values()
    turns = [force.at.placement.rotation.ravel() if force.follower else (1, 0, 0, 0, 1, 0, 0, 0, 1) for force in forces]
    return {
        "forces_enum": ",\n".join(f"    {prefix.upper()}_FORCE_{word} = {i}" for i, word in enumerate(words)),
        "force_turns": ",\n".join(f"    {{{format_numbers(turn)}}}" for turn in turns),
        "force_places": ", ".join(str(image.find_place(table)) for table in tables),
    }
