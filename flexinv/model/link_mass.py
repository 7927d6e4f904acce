"""The mass of a link with all that it carries."""

from __future__ import annotations

import numpy as np

from flexinv.model.links import Link


def compute_link_mass(link: Link) -> float:
    """Return the mass of a link with all that it carries [kg], of a meshed one without its mesh.

    `analysis.overview.compute_whole_mass` knows that, too.
    """
    bodies = sum(body.inertia.mass for body in link.bodies)
    if link.beam is None:
        return bodies
    section = link.beam.section
    stations = np.concatenate([[0.0], link.beam.section.stations, [1.0]])
    density = np.interp(stations, section.stations, section.mass_per_length)  # linear between, constant beyond
    return bodies + link.beam.length * float(np.trapezoid(density, stations))
