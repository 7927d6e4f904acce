"""Eight mistakes in the program itself, each in a copy that is compiled: crosscheck names them, and names nothing else."""

from __future__ import annotations

import csv
import json
import shutil
import subprocess
from pathlib import Path

import pytest
import simbody_build
from test_simbody import SIGN

from crosscheck.conform.ladder import FOLDER

pytestmark = [
    pytest.mark.skipif(bool(simbody_build.why_not()), reason=simbody_build.why_not() or "nothing is missing"),
    pytest.mark.slow,
]
COUNT, ENOUGH, FEW = 8, 6, 3  # mistakes; those that have to be named; as many causes may stand side by side

# The arm's tensor is taken to be about its origin, which it is about its centre of mass: Steiner's part is there twice.
TENSOR = (".shiftFromMassCenter(c, m);", ".shiftFromMassCenter(c, m == 1.6 ? 2 * m : m);")
# Mistake: where it shows, what of the source is exchanged, and the causes of the dictionary that say it.
MISTAKES = {
    "tensor": ("tree", TENSOR, {"inertia about the origin", "inertia about the wrong point"}),
    "sign": ("tree", SIGN, {"effort sign of a joint", "axis sign"}),
    "no-rotors": (
        "drives",
        ('rotors.resize(nv, joint["rotor_inertia"]);', "rotors.resize(nv, 0.0);"),
        {"rotor inertia dropped", "rotor inertia", "rotor inertia scale"},
    ),
    "gear": (
        "gears",
        ('c["factors"][m.data["name"].get<std::string>()];', 'c["factors"][m.data["name"].get<std::string>()];\n'
         '                    if (name == "reduction" && bodies.size() == 2) factors[1] *= 1.02;'),
        {"coupling ratio"},
    ),
    "centre": (
        "tree",
        ('const Vec3 c = vec(body["com"]);', 'const Vec3 c = vec(body["com"]) + (m == 1.6 ? Vec3(0.02, 0, 0) : Vec3(0));'),
        {"centre of mass shifted"},
    ),
    "gravity": (
        "tree",
        ('vec(file["mechanism"]["gravity"])', '1.02 * vec(file["mechanism"]["gravity"])'),
        {"gravity magnitude", "base acceleration"},
    ),
    "no-damping": (
        "drives",
        ("if (damping != 0) Force", "if (false) Force"),
        {"damping dropped", "viscous damping", "damping scale"},
    ),
    "columns": (
        "tree",
        ('const auto start = std::chrono', 'std::swap(index[0], index[1]);\n        const auto start = std::chrono'),
        {"order of efforts"},
    ),
}  # fmt: skip


def test_mistakes_in_its_own_source_are_named(tmp_path: Path) -> None:
    assert len(MISTAKES) == COUNT
    programs = {
        name: (simbody_build.build(tmp_path / name, change), f"{rung}/*")
        for name, (rung, change, _) in MISTAKES.items()
    }
    simbody_build.engines(tmp_path / "crosscheck.toml", programs)
    words = (
        "run",
        "tree",
        "drives",
        "gears",
        "--models",
        str(FOLDER),
        "--config",
        "crosscheck.toml",
        "--trust-commands",
    )
    done = simbody_build.crosscheck(tmp_path, *words, "--engines", ",".join(["flexinv", *programs]), "--out", "report")
    assert done.returncode == 1, done.stdout + done.stderr
    found = {one["engine"]: one for one in json.loads((tmp_path / "report/results.json").read_text())["diagnoses"]}
    assert set(found) == set(MISTAKES)
    named = {name: [cause["cause"] for cause in one["named"]] for name, one in found.items()}
    right = {name for name, (_, _, causes) in MISTAKES.items() if len(named[name]) <= FEW and causes & set(named[name])}
    wrong = {name for name in MISTAKES if named[name] and not MISTAKES[name][2] & set(named[name])}
    assert not wrong, {name: found[name]["words"] for name in wrong}
    assert len(right) >= ENOUGH, {name: one["words"] for name, one in found.items()}


def test_a_wrong_inertia_is_named_from_a_csv_in_other_habits_alone(tmp_path: Path) -> None:
    """What the wrong program wrote is all there is: no certificate, columns in another order, nine digits, Windows' line ends."""
    program = simbody_build.build(tmp_path / "wrong", TENSOR)
    kit, out = tmp_path / "kit", tmp_path / "models" / "tree" / "records" / "elsewhere" / "reach"
    shutil.copytree(FOLDER / "tree", tmp_path / "models" / "tree")
    simbody_build.crosscheck(tmp_path, "kit", "tree", "--out", "kit", "--blind")
    out.mkdir(parents=True)
    subprocess.run([str(program), str(kit), str(out)], check=True)
    with (out / "series.csv").open(encoding="utf-8") as stream:
        header, *rows = list(csv.reader(stream))
    order = [0, *(k for k in range(len(header) - 1, 0, -1) if header[k].startswith("torque/"))]
    lines = [", ".join(header[k] for k in order), *(", ".join(f"{float(row[k]):+.8e}" for k in order) for row in rows)]
    for file in out.iterdir():
        file.unlink()
    (out / "series.csv").write_text("\r\n".join([*lines, ""]), encoding="utf-8", newline="")
    done = simbody_build.crosscheck(tmp_path, "run", "tree", "--engines", "flexinv,elsewhere", "--out", "report")
    assert done.returncode == 1, done.stdout + done.stderr
    (found,) = json.loads((tmp_path / "report/results.json").read_text())["diagnoses"]
    named = [cause["cause"] for cause in found["named"]]
    assert len(named) <= FEW
    assert MISTAKES["tensor"][2] & set(named), found["words"]
