"""Meshed parts of links as frozen data: nodes, solid cells, materials, interfaces; or matrices that another program has made.

A part is the finite-element mesh of one link.  Everything here is primary data: stiffness and mass follow from it in
`flexinv.parts`, and in every engine that reads it by that engine's own code.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from flexinv.errors import InputError
from flexinv.model import rules
from flexinv.model.frozen import Frozen
from flexinv.typing import Array, Indices
from flexinv.validation import refuse

# Kind of cell, as meshio and VTK call it -> number of its nodes, in VTK's order.
CELL_KINDS = {"tetra": 4, "tetra10": 10, "hexahedron": 8, "hexahedron20": 20, "hexahedron27": 27, "wedge": 6}
# Kinds of which the shape functions are linear along each edge.
LINEAR_KINDS = ("tetra", "hexahedron", "wedge")

# How the nodes of an interface follow its frame: rigidly, or so that the frame moves as they do on average.
TIES = {"rigid": "RBE2", "average": "RBE3"}

STRAINS = ("xx", "yy", "zz", "yz", "xz", "xy")


def check_indices(name: str, value: Any) -> Indices:
    """Return whole numbers [-], 0 or more, as a read-only array; raises InputError for others."""
    given = np.asarray(value)
    if given.dtype.kind not in "iu" or (given.size and given.min() < 0):
        refuse(name, value, "whole numbers, 0 or more")
    held: Indices = given.astype(np.int64)
    held.flags.writeable = False
    return held


@dataclass(frozen=True, eq=False)
class Material(Frozen):
    """A linear elastic material: stress = stiffness strain, strains xx, yy, zz, yz, xz, xy, the shears as angles.

    stiffness : (6, 6) [Pa], symmetric and positive definite, along the axes of the mesh; density : [kg/m^3]
    """

    stiffness: Array
    density: float

    RULES: ClassVar[rules.Rules] = {
        "stiffness": rules.make_array_rule((6, 6), "Pa"),
        "density": rules.make_real_rule("kg/m^3", 0.0, above=True),
    }

    def _check(self, where: str) -> None:
        largest = float(np.abs(self.stiffness).max())
        uneven = float(np.abs(self.stiffness - self.stiffness.T).max())
        if uneven > 1e-9 * largest or np.linalg.eigvalsh(self.stiffness)[0] <= 0.0:
            expected = "a symmetric, positive definite matrix (6, 6) [Pa]"
            advice = "for an isotropic material 0 <= nu < 0.5; for an orthotropic one nu_xy^2 < E_x / E_y, and so on"
            raise InputError(f"{where}stiffness is none that a material can have: expected {expected}; write {advice}")

    @classmethod
    def build_isotropic(cls, young: float, poisson: float, density: float) -> Material:
        """Return the material of Young's modulus [Pa], Poisson's ratio [-] and density [kg/m^3]."""
        shear = young / (2.0 * (1.0 + poisson))
        return cls.build_orthotropic(np.full(3, young), np.full(3, poisson), np.full(3, shear), density)

    @classmethod
    def build_orthotropic(
        cls, young: Array, poisson: Array, shear: Array, density: float, rotation: Array = rules.IDENTITY
    ) -> Material:
        """Return the material of three moduli along its axes 1, 2, 3 [Pa], each pair in the order 12, 13, 23.

        young : E_1, E_2, E_3 [Pa]; poisson : nu_12, nu_13, nu_23 [-], strain along the second axis by stress along the first
        shear : G_12, G_13, G_23 [Pa]; density [kg/m^3]; rotation : (3, 3), the material's axes in those of the mesh [-]
        """
        compliance = np.diag([*(1.0 / np.asarray(young)), *(1.0 / np.asarray(shear)[::-1])])
        for (i, j), nu in zip(((0, 1), (0, 2), (1, 2)), poisson, strict=True):
            compliance[i, j] = compliance[j, i] = -nu / young[i]
        turn = _build_strain_turn(np.asarray(rotation))
        try:
            stiffness = turn.T @ np.linalg.inv(compliance) @ turn
        except np.linalg.LinAlgError:  # nu of one half: no volume can change
            stiffness = np.zeros((6, 6))
        return cls((stiffness + stiffness.T) / 2.0, density)


def _build_strain_turn(rotation: Array) -> Array:
    """Strains along the axes of a material (columns of ``rotation``) from those along the mesh's, (6, 6) [-]."""
    pairs = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
    turn = np.zeros((6, 6))
    for column, (i, j) in enumerate(pairs):
        strain = np.zeros((3, 3))
        strain[i, j] = strain[j, i] = 1.0 if i == j else 0.5
        turned = rotation.T @ strain @ rotation
        turn[:, column] = [turned[a, b] * (1.0 if a == b else 2.0) for a, b in pairs]
    return turn


@dataclass(frozen=True, eq=False)
class Cells(Frozen):
    """Cells of one kind and material.

    kind : a key of `CELL_KINDS`; nodes : (cells, nodes of a cell) numbers of points, in VTK's order; material of all of them
    name : of the set, for messages
    """

    kind: str
    nodes: Indices
    material: Material
    name: str = ""

    RULES: ClassVar[rules.Rules] = {
        "kind": rules.make_option_rule(CELL_KINDS),
        "nodes": check_indices,
        "material": rules.make_kind_rule(Material),
        "name": rules.check_text,
    }

    def _check(self, where: str) -> None:
        if self.nodes.ndim != 2 or self.nodes.shape[1] != CELL_KINDS[self.kind]:
            given = f"{where}nodes has shape {self.nodes.shape}"
            raise InputError(f"{given}: expected (cells, {CELL_KINDS[self.kind]}) numbers of points [-] of {self.kind}")


@dataclass(frozen=True, eq=False)
class SparseMatrix(Frozen):
    """A square matrix by its entries: of equal places the sum counts.

    size : rows [-]; row, column : (entries,) [-]; value : (entries,) [any unit]
    """

    size: int
    row: Indices
    column: Indices
    value: Array

    RULES: ClassVar[rules.Rules] = {
        "size": rules.count(1),
        "row": check_indices,
        "column": check_indices,
        "value": rules.make_array_rule((None,), "-"),
    }

    def _check(self, where: str) -> None:
        shapes = {self.row.shape, self.column.shape, self.value.shape}
        inside = max(self.row.max(initial=0), self.column.max(initial=0)) < self.size
        if len(shapes) > 1 or not inside:
            raise InputError(
                f"{where}expected as many rows, columns and values, the rows and columns below {self.size}"
            )


@dataclass(frozen=True, eq=False)
class PartInterface(Frozen):
    """A set of nodes that is tied to a frame, to which joints, closures, springs, payloads and forces attach.

    nodes : (n,) numbers of points, three or more and not on a line; origin : (3,) [m] of the frame, in the link frame,
    its axes are those of the link; tie : "rigid" (RBE2), the nodes follow the frame, or "average" (RBE3), the frame follows them
    """

    name: str
    nodes: Indices
    origin: Array
    tie: str = "rigid"

    RULES: ClassVar[rules.Rules] = {
        "name": rules.check_text,
        "nodes": check_indices,
        "origin": rules.make_array_rule((3,), "m"),
        "tie": rules.make_option_rule(TIES),
    }


# Two meshes of one curved part differ by what chords leave of arcs, in parts of its extent along each axis.
SAME_EXTENT = 0.05
# A set of nodes is on a line where its second largest extent is below this part of the largest.
ON_A_LINE = 1e-6


def _check_finer_part(name: str, value: Any) -> Any:
    """A meshed part, or None."""
    return rules.make_optional_rule(rules.make_kind_rule(MeshedPart))(name, value)


@dataclass(frozen=True, eq=False)
class MeshedPart(Frozen):
    """The mesh of a link: it is clamped in the link frame at its root interface, and deforms by few shapes.

    points : (n, 3) [m] in the link frame; cells : none where both matrices are given
    interfaces : two or more; root : the one that moves with the link frame; tip : the one whose motion is reported
    modes : vibration modes with all interfaces held, beside six static shapes for each interface but the root [-]
    frequency : in place of a number, all modes up to this one [Hz]; zero: none
    retardation : stress by rate of strain over stress by strain [s]; drag : force by velocity over mass [1/s], of the
        deformation alone (Rayleigh: D = drag M + retardation K)
    stiffening : displacements complete to second order in the amplitudes of the softest shapes, so that what pulls along a part
        stiffens it against bending (geometric stiffness); it needs cells
    lumped : mass of linear cells in their nodes alone, as Abaqus and CalculiX have it in explicit codes
    mass, stiffness : by the three coordinates of all points in turn [kg], [N/m], in place of cells
    finer : a finer mesh of the same part, with the same interfaces: error bars of a solution come from it
    source : the file, for messages
    """

    points: Array
    cells: tuple[Cells, ...]
    interfaces: tuple[PartInterface, ...]
    root: str
    tip: str
    modes: int = 8
    frequency: float = 0.0
    retardation: float = 0.0
    drag: float = 0.0
    lumped: bool = False
    stiffening: bool = True
    mass: SparseMatrix | None = None
    stiffness: SparseMatrix | None = None
    finer: MeshedPart | None = None
    source: str = field(default="", compare=False)

    RULES: ClassVar[rules.Rules] = {
        "points": rules.make_array_rule((None, 3), "m"),
        "cells": rules.make_list_rule(rules.make_kind_rule(Cells)),
        "interfaces": rules.make_list_rule(rules.make_kind_rule(PartInterface)),
        "root": rules.check_text,
        "tip": rules.check_text,
        "modes": rules.count(0),
        "frequency": rules.make_real_rule("Hz", 0.0),
        "retardation": rules.make_real_rule("s", 0.0),
        "drag": rules.make_real_rule("1/s", 0.0),
        "lumped": rules.check_truth,
        "stiffening": rules.check_truth,
        "mass": rules.make_optional_rule(rules.make_kind_rule(SparseMatrix)),
        "stiffness": rules.make_optional_rule(rules.make_kind_rule(SparseMatrix)),
        "finer": _check_finer_part,
        "source": rules.check_text,
    }

    def _describe_record(self) -> str:
        return f"{self.source}: " if self.source else "MeshedPart: "

    @property
    def interface_of(self) -> dict[str, PartInterface]:
        """Interfaces by name."""
        return {one.name: one for one in self.interfaces}

    @property
    def moved(self) -> tuple[PartInterface, ...]:
        """The interfaces that move against the link frame: all but the root, in order."""
        return tuple(one for one in self.interfaces if one.name != self.root)

    def _check(self, where: str) -> None:
        self._check_matter(where)
        names = [one.name for one in self.interfaces]
        known = ", ".join(names)
        if len(names) < 2 or len(set(names)) < len(names):
            expected = "two interfaces or more, each with a name of its own: one is clamped in the link frame"
            raise InputError(f"{where}interfaces: {known or 'none'}; expected {expected}")
        for key in ("root", "tip"):
            if getattr(self, key) not in names:
                raise InputError(f"{where}{key} = {getattr(self, key)!r}: expected the name of an interface: {known}")
        owner: dict[int, str] = {}
        for one in self.interfaces:
            self._check_interface(one, where)
            for node in one.nodes.tolist():
                if owner.setdefault(node, one.name) != one.name:
                    both = f"interfaces {owner[node]!r} and {one.name!r} share node {node + 1}"
                    raise InputError(
                        f"{where}{both}; expected interfaces apart: write a smaller tolerance or other sets"
                    )
        if self.finer is not None:
            self._check_same_part(self.finer, where)

    def _check_same_part(self, finer: MeshedPart, where: str) -> None:
        """Raise InputError for a finer mesh of another part, or one that is no finer."""
        said = f"{where}the finer mesh{f' {finer.source}' if finer.source else ''}"
        frames = [{one.name: (one.tie, one.origin.tolist()) for one in part.interfaces} for part in (self, finer)]
        if frames[0] != frames[1] or (self.root, self.tip) != (finer.root, finer.tip):
            expected = "the same interfaces, ties, origins, root and tip as of the coarse one"
            raise InputError(f"{said} has other interfaces: expected {expected}")
        if len(finer.points) <= len(self.points):
            count = f"{len(finer.points)} points, the coarse one {len(self.points)}"
            raise InputError(f"{said} has {count}: expected more; write the finer one as finer_file")
        sizes = [np.ptp(part.points, axis=0) for part in (self, finer)]
        if (np.abs(sizes[0] - sizes[1]) > SAME_EXTENT * sizes[0]).any():
            extents = " and ".join(str(size.round(6).tolist()) for size in sizes)
            raise InputError(f"{said} is another part: both reach over {extents} m; expected the same shape and unit")

    def _check_matter(self, where: str) -> None:
        """Raise InputError unless cells, or both matrices, say what the part is made of."""
        given = [part is not None for part in (self.mass, self.stiffness)]
        if bool(self.cells) == any(given) or any(given) != all(given):
            raise InputError(f"{where}expected cells with materials, or both mass and stiffness in their place")
        for cells in self.cells:
            if cells.nodes.size and cells.nodes.max() >= len(self.points):
                raise InputError(
                    f"{where}cells {cells.name!r} name point {cells.nodes.max()}: there are {len(self.points)}"
                )
        for name in ("mass", "stiffness"):
            matrix = getattr(self, name)
            if matrix is not None and matrix.size != 3 * len(self.points):
                said = f"{name} has {matrix.size} rows, the mesh {len(self.points)} nodes"
                raise InputError(
                    f"{where}{said}: expected {3 * len(self.points)} rows, three for each node, in their order; "
                    "write matrices of all nodes of this mesh, without rotations"
                )

    def _check_interface(self, one: PartInterface, where: str) -> None:
        """Raise InputError for a set of nodes that holds no frame."""
        name = f"{where}interface {one.name!r}"
        if len(one.nodes) < 3:
            expected = "three or more, not on a line: a frame needs them; write a larger tolerance or another set"
            raise InputError(f"{name} has {len(one.nodes)} nodes: expected {expected}")
        if one.nodes.max() >= len(self.points):
            raise InputError(f"{name} names point {one.nodes.max()}: there are {len(self.points)}")
        at = self.points[one.nodes]
        extent = np.linalg.svd(at - at.mean(axis=0), compute_uv=False)
        if extent[1] <= ON_A_LINE * max(extent[0], float(np.abs(at).max()) * ON_A_LINE):
            expected = "three or more that span a plane: nothing holds the frame's turn about a line"
            write = "a set, plane or cylinder that has nodes beside the line"
            raise InputError(f"{name} has {len(one.nodes)} nodes on a line: expected {expected}; write {write}")
