"""Joints with quaternions of a library that torques move: tables for the C file, which reads them off the poses of the march."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from flexinv.export.c_files import fill_template
from flexinv.export.memory_image import WORD, MemoryImage
from flexinv.export.names import format_numbers
from flexinv.kinematics.mesh import Mesh
from flexinv.model.joint_kinds import FREE, SPHERICAL


def format_rotations(image: MemoryImage, mesh: Mesh, places: Mapping[str, str]) -> dict[str, str]:
    """Return the functions of joints with quaternions [-], [m], as the template `forward` names them.

    places : of the poses of nodes in their parents, at_x and at_r
    """
    nodes = np.flatnonzero((mesh.kind == SPHERICAL) | (mesh.kind == FREE)).tolist()
    if not nodes:
        return {"rotation_functions": fill_template("no_rotations.c", {})}
    rows = [
        f"    {{{n}, {mesh.q_index[n]}, {mesh.v_index[n]}, {int(mesh.kind[n] == FREE)}, "
        f"{{{format_numbers(mesh.rotation[n].ravel())}}}, {{{format_numbers(mesh.offset[n])}}}}}"
        for n in nodes
    ]
    at = str(image.add_room(WORD * 4 * len(nodes)))
    values = {**places, "rotation_rows": ",\n".join(rows), "at_quaternions": at}
    return {"rotation_functions": fill_template("rotations.c", values)}
