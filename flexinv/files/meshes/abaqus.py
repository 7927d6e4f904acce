"""Read nodes, solid elements and sets of Abaqus's and CalculiX's input files (.inp); materials, loads and steps are passed over.

Cards are read as both programs read them: in any case, over several lines, in several blocks, with names of sets among numbers,
GENERATE and *INCLUDE.  Parts of assemblies that move nodes are refused.  Numbers of nodes and elements need no order.
Source: *Abaqus Keywords Reference Guide*; Dhondt, *CalculiX CrunchiX User's Manual* 2.20, 7.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from flexinv.errors import InputError
from flexinv.files.toml_tables import make_input_error
from flexinv.typing import Indices
from flexinv.validation import find_nearest_word

# Element -> kind of cell, whose nodes have the same order.
SOLIDS = {"C3D4": "tetra", "C3D6": "wedge", "C3D8": "hexahedron", "C3D10": "tetra10", "C3D20": "hexahedron20"}
COUNTS = {"tetra": 4, "wedge": 6, "hexahedron": 8, "tetra10": 10, "hexahedron20": 20}
# Letters at the end of solid elements that are read as another formulation, and what differs.
READ_AS = {
    "R": "reduced integration, linear ones with hourglass control: here all points",
    "I": "incompatible modes: here none, so that it is stiffer in bending",
    "M": "a modified formulation: here the plain quadratic one",
    "H": "pressure as an unknown: here displacements alone",
}
# Elements of surfaces and lines, and their nodes, as gmsh writes them beside the solid for its groups; elsewhere they carry.
GMSH_BOUNDARIES = {"CPS3": 3, "CPS4": 4, "CPS6": 6, "CPS8": 8, "T3D2": 2, "T3D3": 3}
GMSH_COMMENT = "******* E L E M E N T S"
GMSH = "GMSH"  # the card that stands for the comment
# Corners of the faces S1, S2, ... of a solid.
_TETRAHEDRON_FACES = ("012", "031", "132", "230")
_BRICK_FACES = ("0123", "4765", "0451", "1562", "2673", "3740")
CARD_FACES = {
    "tetra": _TETRAHEDRON_FACES,
    "tetra10": _TETRAHEDRON_FACES,
    "wedge": ("012", "354", "0341", "1452", "2530"),
    "hexahedron": _BRICK_FACES,
    "hexahedron20": _BRICK_FACES,
}
# Corners of the edges in the middle of which a quadratic solid has its other nodes, in their order.
EDGE_CORNERS = {"tetra10": "01 12 20 03 13 23", "hexahedron20": "01 12 23 30 45 56 67 74 04 15 26 37"}
# Numbers of a row of *NODE beyond its number and place, of which seven are a normal: coordinates with decimal commas.
MORE_THAN_PLACE = (5, 6)
GENERATED = ("NGEN", "ELGEN", "NFILL", "SYSTEM", "NCOPY", "ELCOPY", "NMAP")
OWN_AXES = "nodes and elements as lists, in the part's own axes"
DEEPEST_INCLUDE = 8  # files that include one another


@dataclass(frozen=True)
class InputCard:
    """A keyword with its parameters, upper case but for their values, and its rows of data.

    place : file and line, for messages; rows : (line, fields without blanks)
    """

    keyword: str
    parameters: dict[str, str]
    rows: list[tuple[int, list[str]]]
    file: Path
    line: int

    def make_error(self, given: str, expected: str, write: str, line: int | None = None) -> InputError:
        """Return the error about a row or about the whole card."""
        return make_input_error(f"{self.file}, line {line or self.line}, *{self.keyword}", given, expected, write)


@dataclass
class InputMesh:
    """Content of a file while it is read: nodes by number, elements by number as (kind, nodes), sets by name in upper case.

    surfaces : nodes of gmsh's elements of surfaces and lines; spelling : of the names of sets as the file has them first
    notes : for the reader of results, each once; parts : cards *PART and *INSTANCE so far
    """

    nodes: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    elements: dict[int, tuple[str, list[int]]] = field(default_factory=dict)
    node_sets: dict[str, list[int]] = field(default_factory=dict)
    element_sets: dict[str, list[int]] = field(default_factory=dict)
    spelling: dict[str, str] = field(default_factory=dict)
    surfaces: dict[int, list[int]] = field(default_factory=dict)
    notes: dict[str, None] = field(default_factory=dict)
    parts: dict[str, int] = field(default_factory=dict)


def read_abaqus(path: Path, read: Callable[[Path], bytes]) -> tuple[Any, tuple[str, ...]]:
    """Return the mesh of a file as meshio has one [unit of the file], and notes for the reader of results.

    read : gives the bytes of a file, or raises InputError.  Raises InputError: file, line, card, what to write.
    """
    found = InputMesh()
    for card in _list_cards(path, read, path.resolve().parent, 0):
        if reader := _READERS.get(card.keyword):
            reader(card, found)
        elif card.keyword in GENERATED:
            raise card.make_error(f"a card *{card.keyword}", OWN_AXES, "the flat export of nodes and elements")
    _check_content(path, found)
    if not read(path).endswith((b"\n", b"\r")):
        found.notes["the last line has no end: see whether the file is whole"] = None
    return _convert_to_meshio(found), tuple(f"{path.name}: {note}" for note in found.notes)


def _convert_to_meshio(found: InputMesh) -> Any:
    """The mesh with nodes and elements counted from zero, a block of cells for each kind."""
    import meshio

    number = {node: k for k, node in enumerate(found.nodes)}
    blocks: dict[str, list[int]] = {}
    for element, (kind, _) in found.elements.items():
        blocks.setdefault(kind, []).append(element)
    cells = [
        (kind, np.array([[number[node] for node in found.elements[one][1]] for one in elements], dtype=np.int64))
        for kind, elements in blocks.items()
    ]
    row_of = {element: (k, row) for k, elements in enumerate(blocks.values()) for row, element in enumerate(elements)}
    cell_sets = {
        found.spelling[name]: _split_by_block(elements, row_of, len(cells))
        for name, elements in found.element_sets.items()
    }
    point_sets = {
        found.spelling[name]: np.array(sorted({number[node] for node in nodes}), dtype=np.int64)
        for name, nodes in _list_node_sets(found).items()
    }
    return meshio.Mesh(np.array(list(found.nodes.values())), cells, point_sets=point_sets, cell_sets=cell_sets)


def _list_node_sets(found: InputMesh) -> dict[str, list[int]]:
    """Nodes by set: of sets of nodes, and of those elements of surfaces that are in sets of elements."""
    out = {name: list(nodes) for name, nodes in found.node_sets.items()}
    for name, elements in found.element_sets.items():
        nodes = [node for one in elements for node in found.surfaces.get(one, ())]
        if nodes:
            out.setdefault(name, []).extend(nodes)
    for name, nodes in out.items():
        if missed := [node for node in nodes if node not in found.nodes]:
            found.notes[f"set {found.spelling[name]} names node {missed[0]}, which is not there: left out"] = None
            out[name] = [node for node in nodes if node in found.nodes]
    return {name: nodes for name, nodes in out.items() if nodes}


def _split_by_block(elements: list[int], row_of: dict[int, tuple[int, int]], blocks: int) -> list[Indices]:
    """Rows of a set of elements in each block of cells; elements of surfaces are in none."""
    rows: list[list[int]] = [[] for _ in range(blocks)]
    for element in dict.fromkeys(elements):
        if element in row_of:
            block, row = row_of[element]
            rows[block].append(row)
    return [np.array(sorted(part), dtype=np.int64) for part in rows]


def _list_cards(path: Path, read: Callable[[Path], bytes], root: Path, depth: int) -> Iterator[InputCard]:
    """Yield the cards of a file and of what it includes, comments left out."""
    card: InputCard | None = None
    unended = ""  # the keyword line so far, where a comma ends it
    for count, line in _list_lines(path, read):
        if line.startswith("*") or unended:
            if card is not None and not unended:
                yield from _list_included_cards(card, read, root, depth)
            whole = unended + line
            card = _make_card(whole, path, count)
            unended = whole if whole.endswith(",") else ""
        elif card is not None:
            card.rows.append((count, [part.strip() for part in line.split(",")]))
    if card is not None:
        yield from _list_included_cards(card, read, root, depth)


def _list_lines(path: Path, read: Callable[[Path], bytes]) -> Iterator[tuple[int, str]]:
    """Yield the lines of a file with their numbers, without comments but gmsh's, which becomes a card."""
    for count, raw in enumerate(read(path).decode("utf-8", errors="replace").splitlines(), start=1):
        line = raw.strip()
        if line.startswith(GMSH_COMMENT):
            yield count, f"*{GMSH}"
        elif line and not line.startswith("**"):
            yield count, line


def _make_card(line: str, path: Path, count: int) -> InputCard:
    """The card of a line of keyword and parameters."""
    first, *others = [part.strip() for part in line.lstrip("*").split(",")]
    pairs = [part.partition("=") for part in others if part]
    parameters = {key.strip().upper(): value.strip().strip("\"'") for key, _, value in pairs}
    return InputCard(" ".join(first.upper().split()), parameters, [], path, count)


def _list_included_cards(card: InputCard, read: Callable[[Path], bytes], root: Path, depth: int) -> Iterator[InputCard]:
    """Yield a card, or those of the file that it includes."""
    if card.keyword != "INCLUDE":
        yield card
        return
    name = card.parameters.get("INPUT", "")
    file = card.file.parent / name
    if not name or not file.resolve().is_relative_to(root):
        expected = "the name of a file in the folder of the mesh, or below it"
        raise card.make_error(f"INPUT={name or 'nothing'}", expected, "*INCLUDE, INPUT=nodes.inp")
    if depth >= DEEPEST_INCLUDE:
        raise card.make_error("files that include one another", "each file once", "the cards themselves")
    yield from _list_cards(file, read, root, depth + 1)


def _take_gmsh(card: InputCard, found: InputMesh) -> None:
    found.parts[GMSH] = 1


def _read_nodes(card: InputCard, found: InputMesh) -> None:
    """Nodes by number; a coordinate that is left out is zero."""
    if card.parameters.get("SYSTEM", "R").upper() != "R":
        raise card.make_error(f"SYSTEM={card.parameters['SYSTEM']}", OWN_AXES, "Cartesian coordinates")
    numbers = []
    for line, fields in card.rows:
        node = _read_number(card, line, fields[0], "the number of a node")
        if sum(map(bool, fields)) in MORE_THAN_PLACE:
            given = f"{len(fields)} numbers, {', '.join(fields)}"
            raise card.make_error(given, "its number and three coordinates", "decimal points, and commas between", line)
        x, y, z = (*(_read_coordinate(card, line, part) for part in fields[1:4]), 0.0, 0.0, 0.0)[:3]
        if found.nodes.setdefault(node, (x, y, z)) != (x, y, z):
            given = f"node {node} at ({x:g}, {y:g}, {z:g}), which stands at {found.nodes[node]} already"
            raise card.make_error(given, "each node once", "another number, or one of both", line)
        numbers.append(node)
    _add_to_set(card.parameters.get("NSET"), numbers, found.node_sets, found)


def _read_elements(card: InputCard, found: InputMesh) -> None:
    """Elements of one type, each over as many lines as it needs."""
    stated = card.parameters.get("TYPE", "").upper()
    is_surface = GMSH in found.parts and stated in GMSH_BOUNDARIES
    kind = "" if is_surface else _find_kind(card, stated, found)
    count = GMSH_BOUNDARIES[stated] if is_surface else COUNTS[kind]
    values = [_read_number(card, line, part, "a whole number") for line, fields in card.rows for part in fields if part]
    if len(values) % (count + 1):
        expected = f"{count + 1} for each element of this type: its number and {count} nodes"
        raise card.make_error(f"{len(values)} numbers", expected, "all nodes of every element")
    numbers = []
    for first in range(0, len(values), count + 1):
        element, *nodes = values[first : first + count + 1]
        if is_surface:
            found.surfaces[element] = nodes
        elif found.elements.setdefault(element, (kind, nodes)) != (kind, nodes):
            raise card.make_error(f"element {element} twice", "each element once", "another number, or one of both")
        numbers.append(element)
    _add_to_set(card.parameters.get("ELSET"), numbers, found.element_sets, found)


def _find_kind(card: InputCard, stated: str, found: InputMesh) -> str:
    """The kind of cell of a type of element; InputError for one that is no solid, a note for one that is read as another."""
    plain = stated.rstrip("".join(READ_AS))
    if plain not in SOLIDS:
        expected = f"solid elements: {', '.join(SOLIDS)}"
        raise card.make_error(f"*ELEMENT, TYPE={stated}", expected, "a mesh of these; shells and beams are no solid")
    for letter in stated.removeprefix(plain):
        found.notes[f"{stated} has {READ_AS[letter]}"] = None
    return SOLIDS[plain]


def _read_node_set(card: InputCard, found: InputMesh) -> None:
    """A set of nodes, by numbers, names of sets of nodes, or the nodes of a set of elements."""
    members = _list_members(card, found.node_sets, "NSET")
    if "ELSET" in card.parameters:
        elements = _find_set(card, card.parameters["ELSET"], found.element_sets, card.line)
        members += [node for one in elements if one in found.elements for node in found.elements[one][1]]
    _add_to_set(_take_name(card, "NSET"), members, found.node_sets, found)


def _read_element_set(card: InputCard, found: InputMesh) -> None:
    members = _list_members(card, found.element_sets, "ELSET")
    _add_to_set(_take_name(card, "ELSET"), members, found.element_sets, found)


def _take_name(card: InputCard, key: str) -> str:
    if not card.parameters.get(key):
        raise card.make_error("no name", f"the name of the set: {key}=", f"*{card.keyword}, {key}=HUB")
    return card.parameters[key]


def _list_members(card: InputCard, known: dict[str, list[int]], what: str) -> list[int]:
    """Numbers of a set: each by itself, by the name of a set, or first, last and step of rows that are generated."""
    out: list[int] = []
    for line, fields in card.rows:
        given = [part for part in fields if part]
        if "GENERATE" in card.parameters:
            first, last, *step = [_read_number(card, line, part, "a whole number") for part in given] + [1] * (
                2 - min(len(given), 2)
            )
            if len(given) not in (2, 3) or (step and step[0] < 1) or last < first:
                expected = "first and last number and, above 0, the step"
                raise card.make_error(", ".join(given), expected, "1, 100, 1", line)
            out += range(first, last + 1, *step)
            continue
        for part in given:
            if re.fullmatch(r"[+-]?\d+", part):
                out.append(int(part))
            else:
                out += _find_set(card, part, known, line)
    return out


def _find_set(card: InputCard, name: str, known: dict[str, list[int]], line: int) -> list[int]:
    plain = name.strip("\"'").upper()
    if plain not in known:
        near = find_nearest_word(plain, list(known))
        expected = (
            f"a number, or the name of a set that stands before: {', '.join(list(known)[:20]) or 'there is none'}"
        )
        raise card.make_error(name, expected, near or "the numbers", line)
    return known[plain]


def _read_surface(card: InputCard, found: InputMesh) -> None:
    """A surface as the set of its nodes: faces of elements or of sets of them, or nodes."""
    name = card.parameters.get("NAME")
    members: list[int] = []
    by_node = card.parameters.get("TYPE", "ELEMENT").upper() == "NODE"
    for line, fields in card.rows:
        if by_node:
            members += [int(fields[0])] if fields[0].isdigit() else _find_set(card, fields[0], found.node_sets, line)
            continue
        face = fields[1].upper() if len(fields) > 1 else ""
        elements = [int(fields[0])] if fields[0].isdigit() else _find_set(card, fields[0], found.element_sets, line)
        if not re.fullmatch(r"S[1-6]", face):
            continue  # faces of shells, edges, or free surfaces without a number: no interface of a solid is made of them
        members += [node for one in elements for node in _list_face(found, one, int(face[1]) - 1)]
    if members:
        _add_to_set(name, members, found.node_sets, found)


def _list_face(found: InputMesh, element: int, face: int) -> list[int]:
    """Nodes of a face of an element, the middles of its edges among them; none where the element has no such face."""
    kind, nodes = found.elements.get(element, ("", []))
    if face >= len(CARD_FACES.get(kind, ())):
        return []
    corners = {int(corner) for corner in CARD_FACES[kind][face]}
    first = len(nodes) - len(EDGE_CORNERS.get(kind, "").split())
    middles = [
        first + k
        for k, edge in enumerate(EDGE_CORNERS.get(kind, "").split())
        if {int(corner) for corner in edge} <= corners
    ]
    return [nodes[k] for k in (*sorted(corners), *middles)]


def _count_part(card: InputCard, found: InputMesh) -> None:
    """Refuse a second part, and one that is moved."""
    found.parts[card.keyword] = found.parts.get(card.keyword, 0) + 1
    if found.parts[card.keyword] > 1:
        given = f"{found.parts[card.keyword]} cards *{card.keyword}"
        raise card.make_error(given, "one part, nodes in its own axes", "one file for each part: a link is one")
    if card.keyword == "INSTANCE" and card.rows:
        raise card.make_error("a part that is moved or turned", OWN_AXES, "the part alone, and placement in the link")


def _add_to_set(name: str | None, members: list[int], sets: dict[str, list[int]], found: InputMesh) -> None:
    if name:
        found.spelling.setdefault(name.upper(), name)
        sets.setdefault(name.upper(), []).extend(members)


def _read_number(card: InputCard, line: int, text: str, what: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise card.make_error(text or "nothing", what, "whole numbers between commas", line) from None


def _read_coordinate(card: InputCard, line: int, text: str) -> float:
    try:
        return float(text.upper().replace("D", "E")) if text else 0.0
    except ValueError:
        raise card.make_error(text, "a coordinate", "numbers between commas", line) from None


def _check_content(path: Path, found: InputMesh) -> None:
    """Raise InputError for nodes that are not there, coordinates that are no numbers, and a file without a mesh."""
    if not found.nodes or not found.elements:
        missing = "nodes" if not found.nodes else "solid elements"
        expected = f"cards *NODE and *ELEMENT with solid elements: {', '.join(SOLIDS)}"
        raise make_input_error(str(path), f"no {missing}", expected, "the whole export of the part")
    if not np.isfinite(np.array(list(found.nodes.values()))).all():
        raise make_input_error(str(path), "coordinates that are no numbers", "finite numbers", "the mesh anew")
    for number, (_, nodes) in found.elements.items():
        if any(node not in found.nodes for node in nodes):
            missed = next(node for node in nodes if node not in found.nodes)
            given = f"element {number} with node {missed}, which is not there"
            raise make_input_error(str(path), given, "nodes of cards *NODE", "the whole export of the part")


_READERS: dict[str, Callable[[InputCard, InputMesh], None]] = {
    GMSH: _take_gmsh,
    "NODE": _read_nodes,
    "ELEMENT": _read_elements,
    "NSET": _read_node_set,
    "ELSET": _read_element_set,
    "SURFACE": _read_surface,
    "PART": _count_part,
    "INSTANCE": _count_part,
}
