"""Strains of beams at their sections, from the poses of their nodes (compiled): damping has no part in them."""

from __future__ import annotations

import numpy as np

from flexinv.elements.beam import Scratch, fill_relative_poses, make_point
from flexinv.kernels.jit import jit
from flexinv.kernels.vec3 import apply, mat, put, put_mat, put_pair, sub, vec
from flexinv.kinematics.mesh import Mesh
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.kinematics.tree import Frames
from flexinv.typing import Array


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


def compute_section_strains(mesh: Mesh, motion: NodalMotion) -> Array:
    """Return the strains (samples, elements, points, 6) of all sections along a motion [-], [1/m]."""
    elements = mesh.elements
    out = np.zeros((len(motion.x), *elements.weight.shape, 6))
    if not elements.nodes.size:
        return out
    scratch = Scratch.build_for(elements.nodes.shape[1])
    whole = motion.frames
    for sample, strains in enumerate(out):
        fill_section_strains(elements, Frames(*(part[sample] for part in whole)), scratch, strains)
    return out
