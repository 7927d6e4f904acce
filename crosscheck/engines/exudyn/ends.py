"""Attachments of Exudyn's closures to links, and its springs: read from the connectors and markers of its own models.

In space a marker stands in the frame of its body, moved to the centre of mass.  In the plane bodies start without rotation,
so that a marker stands along the plane's axes; what is normal to the plane is in no marker and is taken from the mechanism.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from crosscheck.engines.exudyn import loops as exudyn_loops
from crosscheck.engines.exudyn.models import planar as exudyn_planar
from crosscheck.engines.exudyn.models import spatial as exudyn_spatial
from crosscheck.engines.exudyn.models.frames import Array
from crosscheck.engines.exudyn.models.layout import find_attachment_frame
from crosscheck.engines.exudyn.run_in_time import ANCF
from crosscheck.engines.shared.loop_closure import AssemblyError
from flexinv.files.load_cases import Case
from flexinv.model.mechanism import Attachment, Mechanism, Placement

ELEMENTS = 2  # per beam: none of them matters here
Drawing = exudyn_planar.Drawing | exudyn_spatial.Drawing
# Closures whose markers in space have x along the axis of the closure, at both ends.
TURNING = ("revolute", "prismatic", "cylindrical")


@dataclass(frozen=True)
class ConnectorEnds:
    """Parts of a certificate that connectors of the engine state: closures and springs between points (see there)."""

    closure_points: Mapping[str, Array] = field(default_factory=dict)
    closure_axes: Mapping[str, Array] = field(default_factory=dict)
    springs: Mapping[str, float] = field(default_factory=dict)


def read_connector_ends(mechanism: Mechanism, case: Case, engine: str) -> ConnectorEnds:
    """Return closure points [m], closure axes [-], and springs between points [N/m], [m], [N s/m]; those that it has."""
    if not (mechanism.closures or mechanism.springs) or any(c.active for c in mechanism.closures):
        return ConnectorEnds()
    try:
        d = _build_model(mechanism, case, engine)
    except AssemblyError:  # the run itself says that the loops do not close
        return ConnectorEnds()
    points: dict[str, Array] = {}
    axes: dict[str, Array] = {}
    for closure in (c for c in mechanism.closures if c.name in d.model.closure):
        numbers = d.model.mbs.GetObject(d.model.closure[closure.name])["markerNumbers"]
        for end, at, number in zip(("first", "second"), (closure.first, closure.second), numbers, strict=True):
            points[f"{closure.name}: {end}"] = _read_marker_point(d, at, d.model.mbs.GetMarker(number))
            if isinstance(d, exudyn_spatial.Drawing) and closure.kind in TURNING:
                axes[f"{closure.name}: {end}"] = _read_marker_axis(d, at, d.model.mbs.GetMarker(number))
    return ConnectorEnds(points, axes, _read_springs(d))


def _build_model(mechanism: Mechanism, case: Case, engine: str) -> Drawing:
    """Return the engine's model as a run builds it."""
    model = exudyn_loops.build_model(mechanism, case, engine)
    if model.plane is None:
        held = model.held
        free = frozenset(model.free)
        return exudyn_spatial.build(mechanism, model.layout, engine == ANCF, ELEMENTS, free, held)
    return exudyn_planar.build(mechanism, model.layout, model.plane, engine == ANCF, ELEMENTS, model.free)


def _read_marker_point(drawing: Drawing, at: Attachment, marker: Any) -> Array:
    """Return the position of a marker in the frame of the link (or section) that carries an attachment, (3,) [m]."""
    attachment_frame = find_attachment_frame(drawing.layout, Attachment(at.link, Placement(), at.station))
    local = np.array(marker["localPosition"])
    group = drawing.layout.groups[attachment_frame.group]
    centre = group.inertia.com if attachment_frame.group else np.zeros(3)
    if isinstance(drawing, exudyn_spatial.Drawing):
        return np.asarray(
            attachment_frame.placement.rotation.T @ (local + centre - attachment_frame.placement.position)
        )
    start = group.start
    here = (
        drawing.plane.T @ (start.position + start.rotation @ centre) * (1, 1, 0)
        if attachment_frame.group
        else np.zeros(3)
    )
    height = drawing.plane[:, 2] @ drawing.layout.compute_start_pose(find_attachment_frame(drawing.layout, at)).position
    link = drawing.layout.compute_start_pose(attachment_frame)
    return np.asarray(link.rotation.T @ (drawing.plane @ (local + here + np.array([0.0, 0.0, height])) - link.position))


def _read_marker_axis(drawing: Drawing, at: Attachment, marker: Any) -> Array:
    """Return the x axis of a marker of the space in the frame of the link that carries an attachment, (3,) [-]."""
    attachment_frame = find_attachment_frame(drawing.layout, Attachment(at.link, Placement(), at.station))
    return np.asarray(attachment_frame.placement.rotation.T @ np.array(marker["localHT"])[:3, 0])


def _read_springs(drawing: Drawing) -> dict[str, float]:
    springs: dict[str, float] = {}
    for name, number in drawing.model.spring.items():
        made = drawing.model.mbs.GetObject(number)
        keys = {"stiffness": "stiffness", "rest": "referenceLength", "damping": "damping"}
        springs |= {f"{name}: {ours}": float(made[theirs]) for ours, theirs in keys.items()}
    return springs
