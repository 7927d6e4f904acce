"""Compile an FMU from a case kit, with a C compiler and the headers that FMPy ships.

    crosscheck kit ur5 --case reach --out kit --blind
    python make_fmu.py kit ur5.fmu                     inverse dynamics: q, qd, qdd in, tau out
    python make_fmu.py kit ur5-forward.fmu --forward   forward dynamics: tau in, q out

Rigid trees of revolute and prismatic joints, with rotors, damping, dry friction and springs in joints; other kits are refused.
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
from pathlib import Path
from xml.sax.saxutils import quoteattr

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


class Refused(ValueError):
    """A kit that this generator cannot make an FMU of."""


def read(kit: Path) -> list[dict[str, str]]:
    """Return the rows of tree.csv, units left off the names.  Raises Refused, in words."""
    case = json.loads((kit / "case.json").read_text(encoding="utf-8"))
    mechanism = case["mechanism"]
    for part in ("closures", "springs", "forces"):
        if mechanism[part]:
            raise Refused(f"trees alone are compiled here; {mechanism['name']} has {part}")
    if not (kit / "tree.csv").is_file():
        raise Refused(f"rigid links alone are compiled here; {mechanism['name']} bends")
    with (kit / "tree.csv").open(encoding="utf-8", newline="") as stream:
        rows = [{name.partition(" [")[0]: cell for name, cell in row.items()} for row in csv.DictReader(stream)]
    if others := sorted({row["kind"] for row in rows} - set(UNITS)):
        raise Refused(
            f"revolute and prismatic joints alone are compiled here; {mechanism['name']} has {', '.join(others)}"
        )
    if not rows:
        raise Refused(f"{mechanism['name']} has no joint that moves")
    return rows


def header(rows: list[dict[str, str]]) -> str:
    """Return tree.h: the numbers of the mechanism, SI."""
    joints = []
    for row in rows:
        parts = [
            f"{{{', '.join(row[c] for c in columns)}}}" if len(columns) > 1 else row[columns[0]]
            for _, columns in NUMBERS
        ]
        joints.append(f"    {{{int(row['kind'] == 'prismatic')}, {row['parent']}, {', '.join(parts)}}}")
    gravity = ", ".join(rows[0][f"gravity {a}"] for a in "xyz")
    body = ",\n".join(joints)
    head = f"#define COUNT {len(rows)}\nstatic const double GRAVITY[3] = {{{gravity}}};\n"
    return f"{head}static const Joint JOINTS[COUNT] = {{\n{body}}};\n"


def description(rows: list[dict[str, str]], forward: bool, kinds: tuple[str, ...]) -> str:
    """Return modelDescription.xml: variables JOINT.q, .qd, .qdd, .tau with units, and what depends on what."""
    given = {"tau"} if forward else {"q", "qd", "qdd"}
    # forward: q and qd are states, set where they begin; qdd is the rate of qd
    answered = {"q", "qd", "qdd"} if forward else {"tau"}
    lines = []
    for k, row in enumerate(rows):
        for p, (part, unit) in enumerate(zip(PARTS, UNITS[row["kind"]], strict=True)):
            causality = "input" if part in given else "output"
            start = ' start="0"' if part in given or (forward and part in ("q", "qd")) else ""
            exact = ' initial="exact"' if forward and part in ("q", "qd") else ""
            rate = f' derivative="{4 * k + p}"' if forward and part in ("qd", "qdd") else ""
            name = quoteattr(f"{row['joint']}.{part}")
            lines.append(
                f'<ScalarVariable name={name} valueReference="{4 * k + p}" causality="{causality}" '
                f'variability="continuous"{exact}><Real unit="{unit}"{start}{rate}/></ScalarVariable>'
            )
    number = {(k, part): 4 * k + p + 1 for k in range(len(rows)) for p, part in enumerate(PARTS)}
    every = " ".join(str(n) for (_, part), n in number.items() if part in given or (forward and part in ("q", "qd")))
    outputs = "".join(
        f'<Unknown index="{n}" dependencies="{every if part in ("tau", "qdd") else n}"/>'
        for (_, part), n in number.items()
        if part in answered
    )
    rates = "".join(f'<Unknown index="{n}"/>' for (_, part), n in number.items() if part in ("qd", "qdd"))
    first = "".join(
        f'<Unknown index="{n}"/>' for (_, part), n in number.items() if part == ("qdd" if forward else "tau")
    )
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
    rows = read(kit)
    spec = importlib.util.find_spec("fmpy")
    if spec is None or spec.origin is None:
        raise Refused('FMPy is not installed, whose headers are needed; python -m pip install "flexinv[fmu]"')
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "tree.h").write_text(header(rows), encoding="utf-8")
        library = Path(folder) / "tree.so"
        words = ["gcc", "-shared", "-fPIC", "-O2", *(["-DFORWARD"] if forward else []), *flags, f"-I{folder}"]
        words += [f"-I{Path(spec.origin).parent / 'c-code'}", str(SOURCE), "-lm", "-o", str(library)]
        subprocess.run(words, check=True)
        with zipfile.ZipFile(file, "w") as archive:
            archive.writestr("modelDescription.xml", description(rows, forward, kinds))
            archive.write(library, "binaries/linux64/tree.so")
    return file


if __name__ == "__main__":
    words = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    words.add_argument("kit", type=Path)
    words.add_argument("fmu", type=Path)
    words.add_argument("--forward", action="store_true")
    asked = words.parse_args()
    try:
        make(asked.kit, asked.fmu, asked.forward)
    except Refused as why:
        sys.exit(str(why))
