"""Sections of beams: where they are, and their strains from the poses of nodes (compiled), in which damping has no part."""

from __future__ import annotations

import numpy as np

from flexinv.elements.beam import Scratch, fill_relative_poses, make_point
from flexinv.kernels.jit import jit
from flexinv.kernels.vec3 import apply, mat, put, put_mat, put_pair, sub, vec
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.kinematics.tree import Frames
from flexinv.model.owned_cache import make_owner_cache
from flexinv.typing import Array, Indices


@jit
def fill_section_strains(elements, frames, scratch, out):
    """Set what each section is strained by, beside its shape without stress, out (elements, points, 6) [-], [1/m].

    elements : `beam_element.Elements`; frames : of all nodes at one instant; scratch : `beam.Scratch` of an element
    """
    for k in range(len(elements.order)):
        count = elements.order[k] + 1
        for i in range(count):
            put(scratch.x[i], vec(frames.x[elements.nodes[k, i]]))
            put_mat(scratch.r[i], mat(frames.r[elements.nodes[k, i]]))
        fill_relative_poses(count, scratch)
        for g in range(count - 1):
            point = make_point(count, elements.shape[k, g], elements.slope[k, g], scratch)
            put_pair(
                out[k, g],
                sub(point.stretch, vec(elements.gamma0[k, g])),
                sub(apply(point.h, point.dpsi), vec(elements.kappa0[k, g])),
            )


def compute_section_strains(mesh: Mesh, motion: NodalMotion) -> dict[str, Array]:
    """Return the strains (samples, points, 6) of the sections of each beam along a motion [-], [1/m]."""
    elements = mesh.elements
    out = np.zeros((len(motion.x), *elements.weight.shape, 6))
    if not elements.nodes.size:
        return {}
    scratch = Scratch.build_for(elements.nodes.shape[1])
    whole = motion.frames
    for sample, strains in enumerate(out):
        fill_section_strains(elements, Frames(*(part[sample] for part in whole)), scratch, strains)
    return split_by_beam(mesh, out)[0]


def split_by_beam(mesh: Mesh, resultants: Array) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return a quantity (samples, points, 6) [any unit] of each beam, from that of all elements, and where its points are [-]."""
    internal = dict[str, Array]()
    stations = dict[str, Array]()
    for name, points, order, station in list_section_points(mesh):
        part = resultants[:, points]
        stations[name] = station.copy()
        if (order == part.shape[2]).all():  # not copied where they stand so in memory
            internal[name] = part.reshape(len(part), -1, 6)
        else:
            internal[name] = np.concatenate([part[:, k, :n] for k, n in enumerate(order)], axis=1)
    return internal, stations


@make_owner_cache()
def list_section_points(mesh: Mesh) -> list[tuple[str, slice, Indices, Array]]:
    """Return for each beam its name, which elements are its own, their orders, and where their points are, of its length [-]."""
    e = mesh.elements
    out = []
    for index, link in enumerate(mesh.mechanism.links):
        elements = np.flatnonzero(e.link == index)
        if link.beam is not None and len(elements):
            station = np.concatenate([e.station[k, : e.order[k]] for k in elements])
            out.append((link.name, slice(int(elements[0]), int(elements[-1]) + 1), e.order[elements], station))
    return out
