"""Overview of a mechanism as lines and tables of text: the output of ``flexinv info``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from flexinv.constraints.continuation import compute_mobility, find_closed_near
from flexinv.constraints.loop_starts import find_closed_anywhere, list_closed_nearby
from flexinv.files.load_cases import Case
from flexinv.kinematics.mesh import build
from flexinv.linearized.modal_damping import apply_stated_ratio
from flexinv.model.link_mass import compute_link_mass
from flexinv.model.links import Link
from flexinv.model.mechanism import CLOSURES, Mechanism, Section
from flexinv.model.mechanism_card import describe_carrier
from flexinv.model.motion import resolve_start_coordinates
from flexinv.model.section_matrices import COMPONENTS, UPPER, scale_to_unit_strengths
from flexinv.parts.reductions import find_reduction
from flexinv.typing import Array

if TYPE_CHECKING:
    import pandas

OverviewColumns = dict[str, Sequence[object]]  # title with unit -> a value for every row
SEEN = 1e-3  # of the geometric mean of two stiffnesses: a smaller coupling of theirs is not named


def resolve_start_configuration(mechanism: Mechanism, case: Case | None) -> Array:
    """Return the configuration (nq,) [rad], [m] at which a case starts, joints that it leaves out as well; zero without one."""
    q = mechanism.neutral
    if case is not None:
        q = case.motion.evaluate(mechanism, [0.0])[0][0]
        for name, place in resolve_start_coordinates(mechanism, set(case.start), case.start)[0].items():
            q[mechanism.q_slices[name]] = place
    return q


def describe_mobility(mechanism: Mechanism, case: Case | None) -> str:
    """Return a line: freedoms, constraints, redundant constraints and drives [-], wherever the mechanism can get from its start.

    It starts where the case does, without a case near its zero if it closes there; a singular start the line names.
    Raises ConvergenceError where the loops stay open.
    """
    mesh = build(apply_stated_ratio(mechanism))
    start = resolve_start_configuration(mechanism, case)
    at = find_closed_anywhere(mesh, start) if case is None else find_closed_near(mesh, start)
    here = compute_mobility(mesh, at)
    found = min(
        [here, *(compute_mobility(mesh, q) for q in list_closed_nearby(mesh, at))], key=lambda one: one.freedoms
    )
    drives = int(mechanism.actuated.sum())
    when = " at the start" if any(c.active for c in mechanism.closures) else ""
    spare = f" (redundant by {drives - found.freedoms})" if drives > found.freedoms else ""
    where = "where the case starts" if case is not None else "near its zero"
    singular = f"; singular {where}: {_count(here.freedoms, 'freedom')} there" if here != found else ""
    return (
        f"mobility{when}: {_count(found.freedoms, 'freedom')} = {_count(mechanism.nv, 'joint coordinate')} - "
        f"{_count(found.constraints - found.redundant, 'independent constraint')}; "
        f"{_count(found.constraints, 'constraint')}, {found.redundant} redundant; {_count(drives, 'drive')}{spare}{singular}"
    )


def _count(number: int, word: str) -> str:
    return f"{number} {word}" if number == 1 else f"{number} {word}s"


def build_overview_tables(mechanism: Mechanism) -> dict[str, pandas.DataFrame]:
    """Return tables with one row per joint that moves, closure, link and beam, by title; columns have units, such as [N m].

    Drives that are not zero stand with their joints, when closures act [s] with these; stiffness and mass of a beam: at its root.
    """
    import pandas  # whoever wants no table does not wait for it

    columns = {
        "joints": _build_joint_columns(mechanism),
        "closures": _build_closure_columns(mechanism),
        "links": _build_link_columns(mechanism),
        "beams": _build_beam_columns(mechanism),
        "meshes": _build_mesh_columns(mechanism),
    }
    return {title: pandas.DataFrame(found) for title, found in columns.items()}


def compute_whole_mass(link: Link) -> float:
    """Return the mass of a link with all that it carries [kg], of a meshed one with its mesh."""
    return compute_link_mass(link) + (0.0 if link.part is None else float(find_reduction(link.part).mass.sum()))


def _build_mesh_columns(mechanism: Mechanism) -> OverviewColumns:
    """Meshes and what is kept of them: frequencies held at the root with all other interfaces free, and the first left out."""
    parts = [(link.name, link.part, find_reduction(link.part)) for link in mechanism.meshed if link.part is not None]
    columns: OverviewColumns = {
        "mesh": [name for name, _, _ in parts],
        "nodes": [len(reduced.points) for _, _, reduced in parts],
        "interfaces (root first)": [", ".join([part.root, *(one.name for one in part.moved)]) for _, part, _ in parts],
        "shapes": [f"{6 * len(part.moved)} static, {len(reduced.fixed)} modes" for _, part, reduced in parts],
        "held at the root [Hz]": [", ".join(f"{f:.5g}" for f in reduced.frequency[:4]) for _, _, reduced in parts],
        "fixed interfaces [Hz]": [", ".join(f"{f:.5g}" for f in reduced.fixed[:4]) or "-" for _, _, reduced in parts],
        "left out from [Hz]": [f"{reduced.left_out:.5g}" for _, _, reduced in parts],
    }
    return columns


def _build_joint_columns(mechanism: Mechanism) -> OverviewColumns:
    moving = mechanism.moving_joints
    columns: OverviewColumns = {
        "joint": [j.name for j in moving],
        "kind": [j.kind for j in moving],
        "parent": [describe_carrier(j) for j in moving],
        "child": [j.child for j in moving],
        "q": [" ".join(mechanism.coordinate_names[mechanism.q_slices[j.name]]) for j in moving],
        "actuated": ["yes" if j.actuated else "no" for j in moving],
    }
    for key, unit in (("rotor_inertia", "kg m^2, kg"), ("damping", "N m s, N s/m"), ("friction", "N m, N")):
        if any(values := [getattr(j, key) for j in moving]):
            columns[f"{key.replace('_', ' ')} [{unit}]"] = values
    return columns


def _build_closure_columns(mechanism: Mechanism) -> OverviewColumns:
    closures = mechanism.closures
    columns: OverviewColumns = {
        "closure": [c.name for c in closures],
        "kind": [c.kind for c in closures],
        "first": [c.first.link for c in closures],
        "second": [c.second.link for c in closures],
        "constraints": [CLOSURES[c.kind] for c in closures],
        "acts [s]": [" and ".join(f"{a:g} to {b:g}" for a, b in c.active) or "always" for c in closures],
    }
    return columns


def _build_link_columns(mechanism: Mechanism) -> OverviewColumns:
    links = mechanism.links
    columns: OverviewColumns = {
        "link": [link.name for link in links],
        "kind": ["beam" if link.beam else "mesh" if link.part else "rigid" for link in links],
        "mass [kg]": [compute_whole_mass(link) for link in links],
        "bodies": [", ".join(body.name for body in link.bodies) or "-" for link in links],
    }
    return columns


def _describe_couplings(section: Section) -> str:
    """The strains that are coupled at the root, the largest part of the geometric mean first, and where the mass centre is."""
    unit = scale_to_unit_strengths(section.stiffness_matrices[0])
    upper = [(int(i), int(j)) for i, j in zip(*UPPER, strict=True)]
    pairs = sorted(upper, key=lambda pair: -abs(float(unit[pair])))
    words = [f"{COMPONENTS[i]} with {COMPONENTS[j]} {unit[i, j]:+.2g}" for i, j in pairs if abs(unit[i, j]) >= SEEN][:3]
    if section.mass_centre is not None:
        y, z = section.mass_centre[0]
        words.append(f"mass centre {y:g}, {z:g} m")
    return ", ".join(words) or ("a little" if section.is_coupled else "no")


def _build_beam_columns(mechanism: Mechanism) -> OverviewColumns:
    beams = [link.beam for link in mechanism.links if link.beam is not None]
    columns: OverviewColumns = {
        "beam": [link.name for link in mechanism.links if link.beam is not None],
        "length [m]": [beam.length for beam in beams],
        "mesh": [f"{beam.elements} x order {beam.order}" for beam in beams],
    }
    for k, label in ((0, "EA [N]"), (3, "GJ [N m^2]"), (4, "EI_y [N m^2]"), (5, "EI_z [N m^2]")):
        columns[label] = [beam.section.stiffness_matrices[0, k, k] for beam in beams]
    columns["mass [kg/m]"] = [beam.section.mass_per_length[0] for beam in beams]
    if any(beam.section.is_coupled for beam in beams):
        columns["coupled"] = [_describe_couplings(beam.section) for beam in beams]
    return columns
