"""Compile an FMU from a case kit, with a C compiler and the headers that FMPy ships.

    crosscheck kit ur5 --case reach --out kit --blind
    python make_fmu.py kit ur5.fmu                     inverse dynamics: q, qd, qdd in, tau out
    python make_fmu.py kit ur5-forward.fmu --forward   forward dynamics: tau in, q out
    python make_fmu.py --models models fmus            one FMU for each mechanism that can be compiled

Rigid mechanisms of revolute and prismatic joints, with rotors, damping, dry friction and springs in joints: trees, and for
inverse dynamics loops closed by revolute and spherical joints and couplings; other kits are refused.
"""

from __future__ import annotations

import argparse
import csv
import importlib.util
import json
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

SOURCE = Path(__file__).with_name("tree.c")
KINDS = ("ModelExchange", "CoSimulation")
# Columns of tree.csv by what tree.c calls them, in its order.
NUMBERS = (
    ("place", ("px", "py", "pz")),
    ("turn", tuple(f"R{a}{b}" for a in "xyz" for b in "xyz")),
    ("axis", ("axis x", "axis y", "axis z")),
    *((name, (column,)) for name, column in (("rotor", "rotor inertia"), ("damping", "damping"), ("friction", "friction"))),
    *((name, (column,)) for name, column in (("stiffness", "stiffness"), ("rest", "rest"), ("mass", "mass"))),
    ("centre", ("cx", "cy", "cz")),
    ("inertia", tuple(f"I{a}{b}" for a in "xyz" for b in "xyz")),
)  # fmt: skip
PARTS = ("q", "qd", "qdd", "tau")  # value references of joint k: 4 k and so on
UNITS = {"revolute": ("rad", "rad/s", "rad/s2", "N.m"), "prismatic": ("m", "m/s", "m/s2", "N")}


CLOSING = {"revolute": (1, 2), "spherical": (1, 0), "coupling": (0, 0)}  # equations: of a point or not, of axes
Rows = list[dict[str, str]]


class UnsupportedKit(ValueError):
    """A kit that this generator cannot make an FMU of."""


@dataclass(frozen=True)
class Kit:
    """A kit: the rows of tree.csv with units left off the names, and case.json."""

    rows: Rows
    mechanism: Mapping[str, Any]
    case: Mapping[str, Any]

    @property
    def given(self) -> list[bool]:
        """Which joints the motion gives: the others follow from the closures."""
        known = {one["name"]: bool(one["given"]) for one in self.case["velocities"]}
        return [known[row["joint"]] for row in self.rows]

    @property
    def driven(self) -> list[bool]:
        """Which joints have an effort: in loops those with a drive."""
        known = {one["name"]: bool(one["actuated"]) for one in self.case["velocities"]}
        return [known[row["joint"]] or not self.mechanism["closures"] for row in self.rows]


def read(folder: Path) -> Kit:
    """Return what a kit says.  Raises Refused, in words."""
    said = json.loads((folder / "case.json").read_text(encoding="utf-8"))
    mechanism, name = said["mechanism"], said["mechanism"]["name"]
    for part in ("springs", "forces"):
        if mechanism[part]:
            raise UnsupportedKit(f"{name} has {part}, which are not compiled here")
    if not (folder / "tree.csv").is_file():
        raise UnsupportedKit(f"rigid links alone are compiled here; {name} bends")
    with (folder / "tree.csv").open(encoding="utf-8", newline="") as stream:
        rows = [{column.partition(" [")[0]: cell for column, cell in row.items()} for row in csv.DictReader(stream)]
    if others := sorted({row["kind"] for row in rows} - set(UNITS)):
        raise UnsupportedKit(f"revolute and prismatic joints alone are compiled here; {name} has {', '.join(others)}")
    if not rows:
        raise UnsupportedKit(f"{name} has no joint that moves")
    if others := sorted({one["kind"] for one in mechanism["closures"]} - set(CLOSING)):
        raise UnsupportedKit(
            f"closures that are {' or '.join(CLOSING)} alone are compiled here; {name} has {', '.join(others)}"
        )
    if any(one["active"] or one["capture"] for one in mechanism["closures"]):
        raise UnsupportedKit(f"{name} has closures that act for a while, which are not compiled here")
    kit = Kit(rows, mechanism, said["case"])
    if not mechanism["closures"] and not all(kit.given):
        raise UnsupportedKit(f"{name} has joints without a motion: an FMU of inverse dynamics integrates nothing")
    return kit


def listed(values: Iterable[object]) -> str:
    """Return numbers as C writes them, lists of them in braces."""
    parts = (listed(v) if isinstance(v, list | tuple) else str(int(v) if isinstance(v, bool) else v) for v in values)
    return "{" + ", ".join(parts) + "}"


def header(kit: Kit) -> str:
    """Return tree.h: the numbers of the tree, SI."""
    joints = []
    for row in kit.rows:
        parts = [
            f"{{{', '.join(row[c] for c in columns)}}}" if len(columns) > 1 else row[columns[0]]
            for _, columns in NUMBERS
        ]
        joints.append(f"    {{{int(row['kind'] == 'prismatic')}, {row['parent']}, {', '.join(parts)}}}")
    gravity = ", ".join(kit.rows[0][f"gravity {a}"] for a in "xyz")
    body = ",\n".join(joints)
    head = f"#define COUNT {len(kit.rows)}\n#define CLOSED {len(kit.mechanism['closures'])}\n"
    head += f"static const double GRAVITY[3] = {{{gravity}}};\n"
    return f"{head}static const Joint JOINTS[COUNT] = {{\n{body}}};\n"


def ties(kit: Kit) -> str:
    """Return ties.h: the closures, their ends in the frames of the links that move, and what is given and driven."""
    names, places = [row["joint"] for row in kit.rows], seats(kit)
    lines, count = [], 0
    for one in kit.mechanism["closures"]:
        points, across = CLOSING[one["kind"]]
        count += 3 * points + across or 1
        ends = [end(one[key], places) for key in ("first", "second")] if points else [(-1, np.zeros(3), np.eye(3))] * 2
        axis = np.array(one["axis"])
        beside = np.linalg.svd(axis[None])[2][1:]
        axes = [(ends[0][2] @ u).tolist() for u in beside]
        factors = [one["factors"].get(name, 0.0) for name in names]
        row = [points, across, [e[0] for e in ends], [e[1].tolist() for e in ends], axes, (ends[1][2] @ axis).tolist()]
        lines.append(listed([*row, factors, one["offset"]]))
    weights = {joint["name"]: joint["weight"] for joint in kit.mechanism["joints"]}
    start = [float(kit.case["start"].get(name, [0.0])[0]) for name in names]
    return (
        f"#define ROWS {count}\nstatic const Tie TIES[CLOSED] = {{{', '.join(lines)}}};\n"
        f"static const int GIVEN[COUNT] = {listed(kit.given)}, DRIVEN[COUNT] = {listed(kit.driven)};\n"
        f"static const double WEIGHT[COUNT] = {listed(weights[name] for name in names)}, GUESS[COUNT] = {listed(start)};\n"
    )


def seats(kit: Kit) -> dict[str, tuple[int, Any, Any]]:
    """Return by link the moving joint that carries it (-1: none), and its frame there: position [m], rotation."""
    names = [row["joint"] for row in kit.rows]
    result = {"world": (-1, np.zeros(3), np.eye(3))}
    for joint in kit.mechanism["joints"]:
        if joint["name"] in names:
            result[joint["child"]] = (names.index(joint["name"]), np.zeros(3), np.eye(3))
        else:
            result[joint["child"]] = end({"link": joint["parent"], "frame": joint["frame"]}, result)
    return result


def end(stated: Mapping[str, Any], places: Mapping[str, tuple[int, Any, Any]]) -> tuple[int, Any, Any]:
    """Return a frame of a link as a frame of the joint that carries it: number, position [m], rotation."""
    number, position, rotation = places[stated["link"]]
    own = (np.array(stated["frame"][key]) for key in ("position", "rotation"))
    there, turned = own
    return number, position + rotation @ there, rotation @ turned


def ports(kit: Kit, forward: bool) -> dict[tuple[int, str], str]:
    """Return the variables by joint and part: "input" or "output"; what nobody gives and nobody asks for is left out."""
    if forward:  # q and qd are states, set where they begin; qdd is the rate of qd
        return {(k, p): "input" if p == "tau" else "output" for k in range(len(kit.rows)) for p in PARTS}
    made: dict[tuple[int, str], str] = {}
    for k, (given, driven) in enumerate(zip(kit.given, kit.driven, strict=True)):
        made |= {(k, part): "input" for part in PARTS[:3] if given}
        made |= {(k, "tau"): "output"} if driven else {}
    return made


def description(kit: Kit, forward: bool, kinds: tuple[str, ...]) -> str:
    """Return modelDescription.xml: variables JOINT.q, .qd, .qdd, .tau with units, and what depends on what."""
    known, rows = ports(kit, forward), kit.rows
    number = {port: n for n, port in enumerate(known, 1)}
    lines = []
    for (k, part), causality in known.items():
        p, begins = PARTS.index(part), forward and part in ("q", "qd")
        start = ' start="0"' if causality == "input" or begins else ""
        rate = f' derivative="{number[k, PARTS[p - 1]]}"' if forward and part in ("qd", "qdd") else ""
        name, exact = quoteattr(f"{rows[k]['joint']}.{part}"), ' initial="exact"' if begins else ""
        unit = UNITS[rows[k]["kind"]][p]
        lines.append(
            f'<ScalarVariable name={name} valueReference="{4 * k + p}" causality="{causality}" variability="continuous"{exact}>'
            f'<Real unit="{unit}"{start}{rate}/></ScalarVariable>'
        )
    closed = kit.mechanism["closures"] and not forward
    for k in [k for k, given in enumerate(kit.given) if closed and not given]:  # which of its branches a loop is in
        name, start = quoteattr(f"{rows[k]['joint']}.start"), float(kit.case["start"].get(rows[k]["joint"], [0.0])[0])
        lines.append(
            f'<ScalarVariable name={name} valueReference="{4 * k}" causality="parameter" variability="fixed" initial="exact">'
            f'<Real unit="{UNITS[rows[k]["kind"]][0]}" start="{start}"/></ScalarVariable>'
        )
    every = " ".join(
        str(n) for port, n in number.items() if known[port] == "input" or (forward and port[1] in ("q", "qd"))
    )
    outputs = "".join(
        f'<Unknown index="{n}" dependencies="{every if port[1] in ("tau", "qdd") else n}"/>'
        for port, n in number.items()
        if known[port] == "output"
    )
    rates = "".join(f'<Unknown index="{n}"/>' for (_, part), n in number.items() if part in ("qd", "qdd"))
    asked = "qdd" if forward else "tau"
    first = "".join(f'<Unknown index="{n}"/>' for (_, part), n in number.items() if part == asked)
    moves = f"<Derivatives>{rates}</Derivatives>" if forward else ""
    units = "".join(f"<Unit name={quoteattr(u)}/>" for u in sorted({u for row in rows for u in UNITS[row["kind"]]}))
    parts = "".join(f'<{kind} modelIdentifier="tree"/>' for kind in kinds)
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<fmiModelDescription fmiVersion="2.0" modelName="tree" '
        f'guid="{{crosscheck-fmu-example}}" version="0.1" variableNamingConvention="structured" '
        f'generationTool="make_fmu.py">{parts}'
        f"<UnitDefinitions>{units}</UnitDefinitions><ModelVariables>{''.join(lines)}</ModelVariables>"
        f"<ModelStructure><Outputs>{outputs}</Outputs>{moves}<InitialUnknowns>{first}</InitialUnknowns></ModelStructure></fmiModelDescription>"
    )


def make(
    kit: Path, file: Path, forward: bool = False, kinds: tuple[str, ...] = KINDS, flags: tuple[str, ...] = ()
) -> Path:
    """Compile the FMU of a kit.  Raises Refused, and CalledProcessError where the compiler does not like it."""
    said = read(kit)
    if forward and said.mechanism["closures"]:
        raise UnsupportedKit(
            f"forward dynamics of trees alone are compiled here; {said.mechanism['name']} has closures"
        )
    spec = importlib.util.find_spec("fmpy")
    if spec is None or spec.origin is None:
        raise UnsupportedKit('FMPy is not installed, whose headers are needed; python -m pip install "flexinv[fmu]"')
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "tree.h").write_text(header(said), encoding="utf-8")
        (Path(folder) / "ties.h").write_text(ties(said) if said.mechanism["closures"] else "", encoding="utf-8")
        library = Path(folder) / "tree.so"
        words = ["gcc", "-shared", "-fPIC", "-O2", *(["-DFORWARD"] if forward else []), *flags, f"-I{folder}"]
        words += [f"-I{Path(spec.origin).parent / 'c-code'}", str(SOURCE), "-lm", "-o", str(library)]
        subprocess.run(words, check=True)
        with zipfile.ZipFile(file, "w") as archive:
            archive.writestr("modelDescription.xml", description(said, forward, kinds))
            archive.write(library, "binaries/linux64/tree.so")
    return file


def make_every(models: Path, out: Path, forward: bool = False) -> dict[str, str]:
    """Compile the FMU of every mechanism of a folder of models; return the reasons of those that are refused, by name."""
    from crosscheck.kit.write import write
    from crosscheck.verdicts.plan import discover

    out.mkdir(parents=True, exist_ok=True)
    refused: dict[str, str] = {}
    for task in {task.folder: task for task in discover(models).tasks}.values():
        with tempfile.TemporaryDirectory() as kit:
            write(task.mechanism, task.case, Path(kit))
            try:
                make(Path(kit), out / f"{task.folder.name}.fmu", forward)
            except UnsupportedKit as why:
                refused[task.folder.name] = str(why)
    return refused


if __name__ == "__main__":
    words = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    words.add_argument("kit", type=Path, nargs="?", help="a case kit; left out with --models")
    words.add_argument("fmu", type=Path, help="the FMU; with --models the folder of them")
    words.add_argument("--models", type=Path, help="a folder of mechanisms, each of which gets its FMU")
    words.add_argument("--forward", action="store_true")
    asked = words.parse_args()
    if asked.models is not None:
        for why in make_every(asked.models, asked.fmu, asked.forward).values():
            sys.stdout.write(f"{why}\n")
        sys.exit()
    if asked.kit is None:
        words.error("expected a kit, or --models")
    try:
        make(asked.kit, asked.fmu, asked.forward)
    except UnsupportedKit as why:
        sys.exit(str(why))
