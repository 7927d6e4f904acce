"""Links of a mechanism file that are meshes: the file, its unit, materials, interfaces, damping, and how many modes."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from flexinv.errors import InputError, ModelWarning
from flexinv.files.joints import read_placement
from flexinv.files.meshes.matrix_files import read_matrix_file
from flexinv.files.meshes.mesh_files import FileMesh, read_mesh_file
from flexinv.files.schema import (
    PLACEMENT,
    SOURCE,
    PayloadTable,
    PlacementTable,
    read_finite_number,
    read_payloads,
)
from flexinv.files.toml_tables import Location, Table, check_table, format_toml, make_key, make_optional_key
from flexinv.files.values import Name, NotNegative, Number, Positive, Text, Vector
from flexinv.model.joints import Joint
from flexinv.model.links import Link, Placement
from flexinv.model.part import Cells, Material, MeshedPart, PartInterface, SparseMatrix
from flexinv.typing import Array, Indices
from flexinv.validation import find_nearest_word

# Beyond these a number is in another system of units, as a rule mm, t and s.
DENSITIES = (1.0, 3e4)
MODULI = (1e6, 3e12)
# Nodes this far from a plane or a cylinder, over the part's extent, are on it unless a tolerance is stated.
ON_IT = 1e-4


class SolidTable(Table):
    """An elastic material, isotropic by E and nu, orthotropic by three of E, nu and G along axes 1, 2, 3."""

    E_Pa: Positive | list[Positive] = make_key("Young's modulus, or [E_1, E_2, E_3], numbers > 0 [Pa]", "70e9")
    nu: Number | list[Number] = make_key("Poisson's ratio, or [nu_12, nu_13, nu_23] [-]", "0.33")
    G_Pa: list[Positive] | None = make_optional_key("orthotropic: [G_12, G_13, G_23] [Pa]", "[5e9, 5e9, 4e9]")
    rho_kg_per_m3: Positive = make_key("density, a number > 0 [kg/m^3]", "2700")
    axes: PlacementTable | None = make_optional_key(
        "axes 1, 2, 3 of the material in those of the mesh: a table with one of rpy_deg, rpy_rad, rotation",
        "{ rpy_deg = [0, 0, 45] }",
    )
    source: Text = SOURCE


class PlaneTable(Table):
    """Nodes on a plane."""

    point_m: Vector = make_key("a point of the plane in the link frame, three numbers [m]", "[0.4, 0, 0]")
    normal: Vector = make_key("its normal, three numbers [-]", "[1, 0, 0]")


class CylinderSetTable(Table):
    """Nodes on a cylinder: a bore, a pin."""

    point_m: Vector = make_key("a point of the axis in the link frame, three numbers [m]", "[0.4, 0, 0]")
    axis: Vector = make_key("its direction, three numbers [-]", "[0, 0, 1]")
    radius_m: Positive = make_key("the radius, a number > 0 [m]", "0.01")
    length_m: Positive | None = make_optional_key("its length about the point, a number > 0 [m]", "0.02")


class BoxSetTable(Table):
    """Nodes in a box along the axes of the link frame."""

    from_m: Vector = make_key("the corner with the smallest coordinates, three numbers [m]", "[0.39, -0.1, -0.1]")
    to_m: Vector = make_key("the corner with the largest, three numbers [m]", "[0.41, 0.1, 0.1]")


class InterfaceTable(Table):
    """A set of nodes that is tied to a frame with the axes of the link."""

    set: Name | None = make_optional_key("the name of a set of nodes or cells of the file", '"HUB"')
    plane: PlaneTable | None = make_optional_key(
        "a table: point_m, normal", "{ point_m = [0.4, 0, 0], normal = [1, 0, 0] }"
    )
    cylinder: CylinderSetTable | None = make_optional_key(
        "a table: point_m, axis, radius_m", "{ point_m = [0, 0, 0], axis = [0, 0, 1], radius_m = 0.01 }"
    )
    box: BoxSetTable | None = make_optional_key(
        "a table: from_m, to_m", "{ from_m = [0, 0, 0], to_m = [0.01, 0.1, 0.1] }"
    )
    tolerance_m: Positive | None = make_optional_key("how far nodes may be off a plane, cylinder or box [m]", "1e-5")
    tie: Literal["rigid", "average"] = make_key(
        '"rigid" (RBE2): the nodes follow the frame, "average" (RBE3): the frame follows the nodes', '"rigid"', "rigid"
    )
    origin_m: Vector | None = make_optional_key(
        "the frame's origin in the link frame [m]; the mean of the nodes when absent", "[0.4, 0, 0]"
    )


class PartTable(Table):
    """A part of any shape: its finite-element mesh, reduced to few shapes."""

    file: Text = make_key("the mesh, a path from this file's folder", '"forearm.inp"')
    finer_file: Text | None = make_optional_key(
        "a finer mesh of the same part, a path: error bars come from it", '"forearm_fine.inp"'
    )
    unit_m: Positive = make_key("the mesh's unit of length, a number > 0 [m]", "0.001", 1.0)
    unit_kg: Positive = make_key("the unit of mass of ready matrices, a number > 0 [kg]; t-mm-s has 1000", "1000", 1.0)
    material: SolidTable | None = make_optional_key(
        "a table: E_Pa, nu, rho_kg_per_m3", "{ E_Pa = 70e9, nu = 0.33, rho_kg_per_m3 = 2700 }"
    )
    materials: dict[str, Any] = make_key(
        "tables [links.NAME.materials.SET] of sets of cells", "[links.NAME.materials.SET]", {}
    )
    mass: Text | None = make_optional_key("a ready mass matrix, a path from this file's folder", '"forearm_MASS.mtx"')
    stiffness: Text | None = make_optional_key("a ready stiffness matrix, a path", '"forearm_STIF.mtx"')
    stiffening: bool = make_key(
        "false: loads along the link do not stiffen it against bending (no displacements of second order)",
        "false",
        True,
    )
    lumped: bool = make_key("true: mass of linear cells in their nodes alone", "true", False)
    placement: PlacementTable | None = make_optional_key(
        f"of the mesh in the link frame, {PLACEMENT}", "{ xyz_m = [0, 0, 0.1] }"
    )
    interfaces: dict[str, Any] = make_key(
        "tables [links.NAME.interfaces.NAME], two or more", "[links.NAME.interfaces.hub]", {}
    )
    root: Name = make_key("the interface that moves with the link frame", '"hub"')
    tip: Name | None = make_optional_key("the interface whose motion is reported; the last one when absent", '"flange"')
    modes: Annotated[int, Field(ge=0, le=200)] | None = make_optional_key(
        "how many vibration modes are kept beside the static shapes, 0..200 [-]; 8 when absent", "8"
    )
    modes_up_to_Hz: Positive | None = make_optional_key(
        "in place of a number: all modes up to a frequency [Hz]", "2000"
    )
    retardation_s: NotNegative = make_key("stress by rate of strain over stress by strain, >= 0 [s]", "1e-4", 0.0)
    drag_per_s: NotNegative = make_key("force by velocity of the deformation over mass, >= 0 [1/s]", "0.5", 0.0)
    source: Text = SOURCE


class MeshLinkTable(PartTable):
    """A link of any shape."""

    kind: Literal["mesh"] = make_key('"rigid", "beam" or "mesh"', '"mesh"')
    payload: list[PayloadTable] = make_key("tables [[links.NAME.payload]]", "[[links.NAME.payload]]", [])


class OverlayMeshTable(PartTable):
    """A link of the URDF made a mesh, whose interfaces carry the joints of the link."""

    joints: dict[str, Name] = make_key(
        "the interface of each joint whose parent is this link", '{ wrist_1_joint = "flange" }'
    )
    own_inertia: Literal["replaced", "at_root"] = make_key(
        '"replaced" by the mesh\'s mass, or "at_root": kept as a rigid body in the link frame', '"replaced"'
    )


# Extents of links of machines [m]: beyond them the unit of a mesh is as a rule another one.
LINK_SIZES = (5e-3, 20.0)


def read_meshed_link(data: Any, name: str, where: Location) -> Link:
    """Read a link that is a mesh [m, kg, Pa], and what it carries.  Raises InputError: file, table, key, and what to write."""
    table = check_table(MeshLinkTable, data, where)
    part = read_meshed_part(table, where)
    return Link(name, read_payloads(table.payload, False, name, where, tuple(part.interface_of)), part=part)


def make_link_meshed(
    link: Link, joints: Mapping[str, Joint], data: Any, where: Location
) -> tuple[Link, dict[str, Joint], str]:
    """Return a link of a URDF as a mesh [m, kg, Pa], its joints placed on their interfaces, and a note.

    joints : of the whole mechanism, by name.  Raises InputError: file, table, key, and what to write.
    """
    table = check_table(OverlayMeshTable, data, where)
    part = read_meshed_part(table, where)
    outward = {name: joint for name, joint in joints.items() if joint.parent == link.name}
    if sorted(outward) != sorted(table.joints):
        expected = f"an interface for each joint whose parent is {link.name}: {', '.join(outward) or 'it has none'}"
        write = "joints = { " + ", ".join(f'{name} = "{part.tip}"' for name in outward) + " }"
        raise where.make_error("joints", f"interfaces of {', '.join(table.joints) or 'none'}", expected, write)
    for name, interface in table.joints.items():
        if interface not in part.interface_of:
            known = list(part.interface_of)
            write = f'{name} = "{find_nearest_word(interface, known) or part.tip}"'
            expected = f"an interface of the mesh: {', '.join(known)}"
            raise where.make_inner_location("joints").make_error(name, f'{name} = "{interface}"', expected, write)
    placed = {name: _move_to_interface(outward[name], part.interface_of[one]) for name, one in table.joints.items()}
    kept = table.own_inertia == "at_root"
    stated_mass = sum(body.inertia.mass for body in link.bodies)
    what = "kept as a rigid body in its frame" if kept else "replaced"
    note = f"{link.name} is the mesh {table.file}; its URDF inertia ({stated_mass:.6g} kg) is {what}"
    return Link(link.name, link.bodies if kept else (), part=part), placed, note


def _move_to_interface(joint: Joint, interface: PartInterface) -> Joint:
    """The same place, in the frame of an interface, whose axes are those of the link."""
    placement = replace(joint.placement, position=joint.placement.position - interface.origin)
    return replace(joint, interface=interface.name, placement=placement)


def read_meshed_part(table: PartTable, where: Location) -> MeshedPart:
    """Read the mesh of a part [m, kg, Pa].  Raises InputError: file, table, key, and what to write."""
    part = _read_part(table, table.file, where)
    if table.finer_file is None:
        return part
    if not part.cells:
        expected = "no finer mesh beside ready matrices, which are those of one mesh"
        raise where.make_error("finer_file", f'finer_file = "{table.finer_file}"', expected, "no finer_file")
    finer = _read_part(table, table.finer_file, where, part.interface_of)
    try:
        return replace(part, finer=finer)
    except InputError as error:
        raise InputError(f"{where.describe_key('finer_file')}: {error}") from error


def _read_part(
    table: PartTable, name: str, where: Location, known: Mapping[str, PartInterface] | None = None
) -> MeshedPart:
    """The part of one mesh file; ``known`` : interfaces of another mesh of it, where their frames are."""
    mesh = read_mesh_file(where.file.parent / name)
    for note in mesh.notes:
        warnings.warn(note, ModelWarning, stacklevel=6)
    place = read_placement(table.placement, where.make_inner_location("placement"))
    points = place.position + table.unit_m * mesh.points @ place.rotation.T
    interfaces = [
        _read_interface(data, name, mesh, points, where.make_inner_location(f"interfaces.{name}"))
        for name, data in table.interfaces.items()
    ]
    if known is not None:
        interfaces = [replace(one, origin=known[one.name].origin) for one in interfaces]
    _check_ends(table, where)
    tip = table.tip or next((name for name in reversed(table.interfaces) if name != table.root), table.root)
    matter = _read_matter(table, mesh, place, where)
    _warn_of_odd_size(points, table, where)
    try:
        return MeshedPart(
            points, matter[0], tuple(interfaces), table.root, tip, 8 if table.modes is None else table.modes,
            frequency=table.modes_up_to_Hz or 0.0, retardation=table.retardation_s, drag=table.drag_per_s, lumped=table.lumped,
            stiffening=table.stiffening, mass=matter[1], stiffness=matter[2], source=str(where.file.parent / name),
        )  # fmt: skip
    except InputError as error:
        raise InputError(f"{where.describe_key()}: {error}") from error


def _warn_of_odd_size(points: Array, table: PartTable, where: Location) -> None:
    """Warn where a mesh is so long or so short [m] that its unit is as a rule another one."""
    extent = float(np.ptp(points, axis=0).max())
    if not LINK_SIZES[0] <= extent <= LINK_SIZES[1]:
        said = f"{where.describe_key('unit_m')}: with {table.unit_m:g} the mesh is {extent:.4g} m long; "
        warnings.warn(
            said + "write unit_m = 0.001 for a mesh in millimetres, 1 for one in metres", ModelWarning, stacklevel=7
        )


def _check_ends(table: PartTable, where: Location) -> None:
    """Raise InputError for a root or a tip that is no interface, and for modes that are stated twice."""
    names = list(table.interfaces)
    for key, given in (("root", table.root), ("tip", table.tip or table.root)):
        if given not in names:
            write = f'{key} = "{find_nearest_word(given, names) or (names[0] if names else "hub")}"'
            expected = f"the name of one of its interfaces: {', '.join(names) or 'there are none'}"
            raise where.make_error(key, f'{key} = "{given}"', expected, write)
    if table.modes is not None and table.modes_up_to_Hz is not None:
        raise where.make_error("modes", "modes and modes_up_to_Hz", "one of both", "modes = 8")


Matter = tuple[tuple[Cells, ...], SparseMatrix | None, SparseMatrix | None]


def _read_matter(table: PartTable, mesh: FileMesh, place: Placement, where: Location) -> Matter:
    """Cells with their materials, or mass and stiffness."""
    if table.mass or table.stiffness:
        return (), *_read_matrices(table, place, where)
    used = {name for _, _, names in mesh.cells for name in names}
    for name in table.materials:
        if name not in used:
            write = f"[links.NAME.materials.{find_nearest_word(name, list(used)) or 'SET'}]"
            known = f"a set of solid cells of the file: {', '.join(sorted(used)) or 'it has none'}"
            raise where.make_inner_location(f"materials.{name}").make_error("", f'a set "{name}"', known, write)
    locations = {name: where.make_inner_location(f"materials.{name}") for name in table.materials}
    materials = {
        name: _read_material(check_table(SolidTable, table.materials[name], inner), place, inner)
        for name, inner in locations.items()
    }
    inner = where.make_inner_location("material")
    general = None if table.material is None else _read_material(table.material, place, inner)
    return tuple(_choose_material(block, materials, general, where) for block in mesh.cells), None, None


def _read_matrices(table: PartTable, place: Placement, where: Location) -> tuple[SparseMatrix, SparseMatrix]:
    """Mass [kg] and stiffness [N/m] that another program has made."""
    if not (table.mass and table.stiffness) or table.material is not None or table.materials:
        expected = "both mass and stiffness, without a material: the matrices hold it"
        given = "one of them, or a material beside"
        raise where.make_error("mass", given, expected, "mass, stiffness, and no material")
    if not np.array_equal(place.rotation, np.eye(3)):
        expected = "no turn: ready matrices are along the axes of the mesh; turn the joint's placement in its stead"
        raise where.make_inner_location("placement").make_error("rotation", "a turned mesh", expected, "xyz_m alone")
    folder = where.file.parent
    mass = _scale(read_matrix_file(folder / table.mass, "mass"), table.unit_kg)
    return mass, _scale(read_matrix_file(folder / table.stiffness, "stiffness"), table.unit_kg)


def _choose_material(
    block: tuple[str, Indices, tuple[str, ...]],
    materials: Mapping[str, Material],
    general: Material | None,
    where: Location,
) -> Cells:
    """The cells of a block with the material of their set, or that of all."""
    kind, nodes, names = block
    own = [name for name in names if name in materials]
    if len(own) > 1:
        raise where.make_error("materials", f"cells in {' and '.join(own)}", "one material for each cell", "sets apart")
    material = materials[own[0]] if own else general
    if material is None:
        given = f"{len(nodes)} cells of {kind} without a material"
        write = "material = { E_Pa = 70e9, nu = 0.33, rho_kg_per_m3 = 2700 }"
        raise where.make_error("material", given, "a material for all cells, or tables [materials.SET]", write)
    return Cells(kind, nodes, material, own[0] if own else "")


def _scale(matrix: SparseMatrix, unit: float) -> SparseMatrix:
    return SparseMatrix(matrix.size, matrix.row, matrix.column, unit * matrix.value)


def _read_material(table: SolidTable, place: Placement, where: Location) -> Material:
    """The material along the axes of the link frame [Pa], [kg/m^3]; InputError for one in other units."""
    for key, value, (least, most), write in (
        ("rho_kg_per_m3", [table.rho_kg_per_m3], DENSITIES, "7850   (steel; 7.85e-9 t/mm3 is the same)"),
        ("E_Pa", np.ravel(table.E_Pa).tolist(), MODULI, "2.1e11   (steel; 2.1e5 MPa is the same)"),
    ):
        if not all(least <= number <= most for number in value):
            expected = f"numbers from {least:g} to {most:g} in SI units, whatever the unit of the mesh"
            raise where.make_error(key, f"{key} = {format_toml(value)}", expected, f"{key} = {write}")
    several = isinstance(table.E_Pa, list) or isinstance(table.nu, list) or table.G_Pa is not None
    turn = np.eye(3) if table.axes is None else read_placement(table.axes, where.make_inner_location("axes")).rotation
    try:
        if not several:
            return Material.build_isotropic(
                float(np.ravel(table.E_Pa)[0]), float(np.ravel(table.nu)[0]), table.rho_kg_per_m3
            )
        numbers = table.E_Pa, table.nu, table.G_Pa
        if not all(isinstance(part, list) and len(part) == 3 for part in numbers):
            write = "E_Pa = [...], nu = [...], G_Pa = [...], three numbers each"
            raise where.make_error(
                "E_Pa", "some of them once, some three times", "three of each, or one E_Pa and nu", write
            )
        young, poisson, shear = (np.array(part, dtype=float) for part in numbers)
        return Material.build_orthotropic(young, poisson, shear, table.rho_kg_per_m3, place.rotation @ turn)
    except InputError as error:
        raise InputError(f"{where.describe_key()}: {error}") from error


def _read_interface(data: Any, name: str, mesh: FileMesh, points: Array, where: Location) -> PartInterface:
    """The nodes that a table catches, and their frame [m]."""
    table = check_table(InterfaceTable, data, where)
    stated = [key for key in ("set", "plane", "cylinder", "box") if getattr(table, key) is not None]
    if len(stated) != 1:
        expected = "exactly one of set, plane, cylinder, box"
        raise where.make_error("set", " and ".join(stated) or "nothing", expected, 'set = "HUB"')
    if table.set is not None:
        nodes = _find_set(table.set, mesh, where)
    else:
        near = table.tolerance_m or ON_IT * float(np.ptp(points, axis=0).max())
        nodes = np.flatnonzero(_compute_distances(table, points, where) <= near)
    used = np.unique(np.concatenate([cells.ravel() for _, cells, _ in mesh.cells]))
    nodes = np.intersect1d(nodes, used)
    if len(nodes) < 3:
        box = f"{points[used].min(axis=0).round(6).tolist()} to {points[used].max(axis=0).round(6).tolist()} m"
        expected = f"three or more, not on a line; the part reaches from {box} in the link frame"
        write = "another place or set, a larger tolerance_m, or the right unit_m of the mesh"
        raise where.make_error(stated[0], f"{len(nodes)} nodes are caught", expected, write)
    origin = points[nodes].mean(axis=0) if table.origin_m is None else np.array(table.origin_m, dtype=float)
    return PartInterface(name, nodes, origin, table.tie)


def _find_set(stated: str, mesh: FileMesh, where: Location) -> Indices:
    """The nodes of a set of the file, whose name is taken in any case."""
    known = {key.lower(): key for key in mesh.sets}
    if stated.lower() not in known:
        names = list(mesh.sets)
        near = find_nearest_word(stated, names) or next(iter(names), "")
        write = f'set = "{near}", or plane, cylinder or box' if near else "a plane, cylinder or box"
        expected = f"a set of the file: {', '.join(names[:20]) or 'it has none'}"
        raise where.make_error("set", f'set = "{stated}"', expected, write)
    return mesh.sets[known[stated.lower()]]


def _compute_distances(table: InterfaceTable, points: Array, where: Location) -> Array:
    """Distances of points (n, 3) [m] from a plane, a cylinder or a box [m]."""
    if table.plane is not None:
        normal = _read_direction(table.plane.normal, "normal", where.make_inner_location("plane"))
        return np.asarray(np.abs((points - np.array(table.plane.point_m)) @ normal))
    if table.cylinder is not None:
        axis = _read_direction(table.cylinder.axis, "axis", where.make_inner_location("cylinder"))
        arm = points - np.array(table.cylinder.point_m)
        along = arm @ axis
        off = np.abs(np.linalg.norm(arm - np.outer(along, axis), axis=1) - table.cylinder.radius_m)
        beyond = np.zeros(len(points))
        if table.cylinder.length_m is not None:
            beyond = np.maximum(np.abs(along) - table.cylinder.length_m / 2.0, 0.0)
        return np.asarray(np.maximum(off, beyond))
    assert table.box is not None
    low, high = (np.array(corner) for corner in (table.box.from_m, table.box.to_m))
    return np.asarray(np.maximum(low - points, points - high).max(axis=1).clip(0.0))


def _read_direction(vector: Any, key: str, where: Location) -> Array:
    given = np.array([read_finite_number(part) for part in vector])
    length = float(np.linalg.norm(given))
    if length == 0.0:
        raise where.make_error(
            key, f"{key} = {format_toml(list(vector))}", "a direction other than zero [-]", f"{key} = [1, 0, 0]"
        )
    return given / length
