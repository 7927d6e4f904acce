"""Figures and moving pictures of a solution: efforts and deflections over time, the mechanism in motion."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from flexinv.analysis.solution import Solution, list_effort_units
from flexinv.analysis.views.solution_card import list_instants, list_shown_coordinates
from flexinv.display.animation import Animation, ColouredNet, draw_animation
from flexinv.display.figures import Band, Panel, draw_panels
from flexinv.display.words import format_number
from flexinv.errors import InputError
from flexinv.inverse.part_forces import compute_part_motion
from flexinv.kinematics.nodal_motion import NodalMotion
from flexinv.parts.surface_net import build_surface_net
from flexinv.typing import Array, Indices

if TYPE_CHECKING:
    from flexinv.display.figures import Figure

# Seconds that a moving picture takes where nothing is said, whatever the motion does.
SHORTEST_SHOW = 3.0
LONGEST_SHOW = 20.0
FEWEST_FRAMES = 60
MOST_FRAMES = 200
# Of the net of a meshed link.
MOST_KNOTS = 90


def draw_solution(solution: Solution, title: str) -> Figure:
    """Return a matplotlib Figure: efforts of the actuators [N m], [N] over time [s], and deflections [m] where links bend."""
    m = solution.mechanism
    shown = list_shown_coordinates(m)
    units = list_effort_units(m)
    panels = []
    for unit, word in (("N m", "torque"), ("N", "force")):
        numbers = [k for k in range(m.nv) if shown[k] and units[k] == unit]
        bands = [Band(m.velocity_names[k], solution.torque_all[:, k], _find_error(solution, k)) for k in numbers]
        if bands:
            panels.append(Panel(f"{word} [{unit}]", solution.time, bands))
    bent = [
        Band(f"{link} {axis}", values[:, k])
        for link, values in solution.deflection.items()
        for k, axis in enumerate("xyz")
        if values[:, k].any()
    ]
    if bent:
        panels.append(Panel("deflection of the tip [m]", solution.time, bent))
    return draw_panels(panels, title)


def _find_error(solution: Solution, k: int) -> Array | None:
    if solution.torque_error is None or not solution.mechanism.actuated[k]:
        return None
    return solution.torque_error[:, int(solution.mechanism.actuated[:k].sum())]


def draw_moving_solution(solution: Solution, seconds: float | None = None) -> Animation:
    """Return the mechanism in motion as a moving picture that takes ``seconds`` [s]; None: as long as the motion, 3 to 20 s.

    Meshed links are nets, coloured by von Mises's stress.
    """
    time = solution.time
    if len(time) < 2:
        raise InputError("animate: a solution of one sample does not move; expected two samples or more")
    start = float(time[0])
    end = float(time[-1])
    taken = float(np.clip(end - start, SHORTEST_SHOW, LONGEST_SHOW)) if seconds is None else seconds
    count = int(np.clip(round(10 * taken), FEWEST_FRAMES, MOST_FRAMES))
    samples = np.rint(np.interp(np.linspace(start, end, count), time, np.arange(len(time)))).astype(int)
    frames = list_instants(solution, samples.tolist())
    if not frames[0]:
        raise InputError(
            f"animate: '{solution.mechanism.name}' has no line to draw: all its nodes and tips are in one point"
        )
    most = max((float(stress.largest.max()) for stress in solution.stress.values()), default=0.0)
    nets = [build_stress_net(solution, link, samples, most) for link in solution.stress]
    moving = draw_animation(frames, (start, end), taken, solution.mechanism.name, nets)
    if not nets:
        return moving
    return replace(moving, words=f"{moving.words}; blue to red: von Mises stress, 0 to {format_number(most)} Pa")


def build_stress_net(solution: Solution, link: str, samples: Indices, most: float) -> ColouredNet:
    """Return the net of a meshed link at some samples, its levels stress over the largest one, ``most`` [Pa]."""
    part = solution.mesh.mechanism.link_of[link].part
    assert part is not None
    net = build_surface_net(part, MOST_KNOTS)
    some = NodalMotion(*(history[samples] for history in solution.nodes.parts))
    moved = compute_part_motion(solution.mesh, some, link)
    knots = np.searchsorted(moved.reduced.used, net.knots)
    turn = moved.frame.rotation[:, 0]
    places = moved.frame.x + np.einsum("sij,skj->ski", turn, moved.places[:, knots])
    stress = solution.stress[link].compute(samples)[:, knots]
    level = stress[:, net.edges].mean(axis=2) / (most or 1.0)
    return ColouredNet(places[:, net.edges], level)
