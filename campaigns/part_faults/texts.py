"""Faults of mesh files as text: torn, of another program, with numbers and cards that are none."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np

from campaigns.part_faults.draft import Draft, make_draft
from campaigns.part_faults.table import fault

GIGABYTE = 10**9


def _edit(draw: random.Random, old: str, new: str, kind: str = "tetra10") -> Draft:
    draft = make_draft(draw, kind)
    draft.edit(old, new)
    return draft


def _cut(draw: random.Random, card: str, lines: int) -> Draft:
    """A file that ends within a line, so many lines after a card."""
    draft = make_draft(draw)

    def cut(text: str) -> str:
        start = text.index(card)
        for _ in range(lines):
            start = text.index("\n", start) + 1
        return text[: start + 1].rstrip("\n")

    draft.edits.append(cut)
    return draft


EDITS = {
    "coordinate_not_a_number": ("*NODE\n1, 0", "*NODE\n1, nan", "nan|number"),
    "coordinate_infinite": ("*NODE\n1, 0", "*NODE\n1, 1e999", "inf|number|1e999"),
    "coordinate_of_words": ("*NODE\n1, 0", "*NODE\n1, zero", "zero|number"),
    "decimal_comma": ("*NODE\n1, 0", "*NODE\n1, 0,5", "three coordinates"),
    "unknown_element": ("C3D10", "C3D99", "C3D99"),
    "shell_element": ("C3D10", "STRI65", "STRI65"),
    "beam_beside": ("*NSET", "*ELEMENT, TYPE=B31, ELSET=BOLT\n9001, 1, 2\n*NSET", "B31"),
    "pyramid": ("C3D10", "C3D5", "C3D5"),
    "missing_node": ("*ELEMENT, TYPE=C3D10, ELSET=BODY\n1, ", "*ELEMENT, TYPE=C3D10, ELSET=BODY\n1, 99999, ", "node|numbers"),
    "generated_by_steps": ("*NSET, NSET=HUB\n", "*NSET, NSET=HUB, GENERATE\n1, 100, 0\n", "GENERATE|step|NSET"),
    "node_twice": ("*ELEMENT", "1, 5, 5, 5\n*ELEMENT", "twice|node 1"),
    "element_twice": ("*NSET", "*ELEMENT, TYPE=C3D10, ELSET=MORE\n1, 1, 2, 3, 5, 4, 6, 7, 8, 9, 10\n*NSET", "twice|element 1"),
    "include_not_there": ("*NODE\n", "*INCLUDE, INPUT=nodes.inp\n*NODE\n", "nodes.inp"),
    "include_of_itself": ("*NODE\n", "*INCLUDE, INPUT=arm.inp\n*NODE\n", "arm.inp"),
    "element_without_a_type": ("TYPE=C3D10, ", "", "TYPE"),
    "no_elements": ("*ELEMENT", "** *ELEMENT", "ELEMENT|solid|element|line"),
    "nodes_without_card": ("*NODE\n", "", "NODE|card"),
}  # fmt: skip
for name, (old, new, words) in EDITS.items():
    fault(words, name)(lambda draw, old=old, new=new: _edit(draw, old, new))
for name, card, lines in (("torn_nodes", "*NODE", 9), ("torn_elements", "*ELEMENT", 5), ("torn_set", "*NSET", 4)):
    fault("whole|end|node|line|solid|element", name)(lambda draw, card=card, lines=lines: _cut(draw, card, lines))


@fault("node|element")
def drop_a_node_of_a_cell(draw: random.Random) -> Draft:
    """A row of an element has a node too few."""
    draft = make_draft(draw)
    draft.edits.append(lambda text: text.replace("\n2, ", "\n2, ", 1))
    first = "*ELEMENT, TYPE=C3D10, ELSET=BODY\n"

    def shorten(text: str) -> str:
        start = text.index(first) + len(first)
        end = text.index("\n", start)
        return text[:start] + text[start:end].rpartition(",")[0] + text[end:]

    draft.edits.append(shorten)
    return draft


@fault("node")
def number_with_a_hole_and_an_old_name(draw: random.Random) -> Draft:
    """Nodes were numbered anew with a hole, and the set has the old numbers: some are not there."""
    draft = make_draft(draw)
    draft.numbers = np.where(draft.numbers > 3, draft.numbers + 1000, draft.numbers)
    return draft


@fault("takes the part whole|share")
def number_anew_and_hold_other_nodes(draw: random.Random) -> Draft:
    """Nodes were numbered anew, and the set has the old numbers: other nodes, all over the part."""
    draft = make_draft(draw)
    order = list(range(len(draft.numbers)))
    draw.shuffle(order)
    draft.numbers = draft.numbers[np.array(order)]
    return draft


@fault("solid|element|NODE|node")
def empty_file(draw: random.Random) -> Draft:
    """The export stopped before it began."""
    draft = make_draft(draw)
    draft.edits.append(lambda text: "")
    return draft


@fault("GB|bytes|large|MB")
def write_a_gigabyte(draw: random.Random) -> Draft:
    """A result file of 1 GB in place of the mesh."""
    draft = make_draft(draw)

    def write(folder: Path) -> None:
        with (folder / "arm.inp").open("r+b") as stream:
            stream.truncate(GIGABYTE)

    draft.written.append(write)
    return draft


@fault("arm.inp")
def write_compressed(draw: random.Random) -> Draft:
    """A compressed file under the mesh's name."""
    draft = make_draft(draw)
    packed = b"\x1f\x8b\x08\x00" + draw.randbytes(4000)
    draft.written.append(lambda folder: _write_bytes(folder / "arm.inp", packed))
    return draft


@fault("arm.inp")
def write_in_wide_characters(draw: random.Random) -> Draft:
    """UTF-16, as some editors of Windows write."""
    draft = make_draft(draw)
    draft.written.append(lambda folder: _write_again(folder / "arm.inp", "utf-16"))
    return draft


def _write_bytes(path: Path, content: bytes) -> None:
    path.write_bytes(content)


def _write_again(path: Path, encoding: str) -> None:
    path.write_bytes(path.read_bytes().decode().encode(encoding))


def _make_nastran(draw: random.Random, wrong: str, right: str = "") -> Draft:
    """Four linear tetrahedra and more as free-field bulk data, of which a text is replaced."""
    draft = make_draft(draw, "tetra")
    draft.swap("arm.inp", "arm.bdf")
    draft.swap('set = "HUB"', "plane = { point_m = [0, 0, 0], normal = [1, 0, 0] }")
    rows = ["BEGIN BULK"]
    rows += [f"GRID,{k},,{x:.6g},{y:.6g},{z:.6g}" for k, (x, y, z) in zip(draft.numbers, draft.points, strict=True)]
    rows += [f"CTETRA,{k + 1},1," + ",".join(map(str, draft.numbers[cell])) for k, cell in enumerate(draft.cells)]
    text = "\n".join([*rows, "ENDDATA"]) + "\n"
    if right not in text:
        raise ValueError(f"{right!r} is not in the file")
    draft.files["arm.bdf"] = text.replace(right, wrong).encode() if right else text.encode()
    return draft


CARDS = {
    "nastran_shells": ("CQUAD4", "CTETRA", "arm.bdf"),
    "nastran_other_axes": ("GRID,1,7,", "GRID,1,,", "CP = 7"),
    "nastran_unknown_card": ("CFOUR", "CTETRA", "arm.bdf"),
    "nastran_missing_node": ("CTETRA,1,1,99999,", "CTETRA,1,1,1,", "arm.bdf"),
    "nastran_grids_left_out": ("$RID", "GRID", "arm.bdf"),
    "nastran_grid_twice": ("GRID,1,,1,1,1\nGRID,1,,", "GRID,1,,", "line 3, GRID 1"),
}
for name, (new, old, words) in CARDS.items():
    fault(words, name)(lambda draw, new=new, old=old: _make_nastran(draw, new, old))


@fault("set")
def name_set_of_nastran(draw: random.Random) -> Draft:
    """A set of a Nastran file, which names none."""
    draft = _make_nastran(draw, "")
    draft.swap("plane = { point_m = [0, 0, 0], normal = [1, 0, 0] }", 'set = "HUB"')
    return draft
