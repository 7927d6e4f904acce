"""What pages show without running it: commands are read by the programs that they name, tables by the readers of their files.

Whole nights, other machines and installations are not run in tests (test_docs.py runs the rest); here no name of a command, of an
option, of a target of `make` or of a key may be one that does not exist.
"""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
from importlib import metadata
from pathlib import Path

import click
import logged_arm
import meshio
import numpy as np
import pytest
import scipy
from part_examples import make_block
from reader_pages import PAGES, ROOT, blocks, project

import crosscheck.cli
import flexinv.cli.commands
from crosscheck.corpus.notes import read_notes
from crosscheck.identification.settings import read_settings
from flexinv.files.load_mechanism import load_mechanism
from flexinv.parts.craig_bampton import compute_reduction
from flexinv.parts.part_matrices import build_part_matrices

PROGRAMS = {"crosscheck": crosscheck.cli.main, "flexinv": flexinv.cli.commands.app}
SHOWN = (*PAGES, "CONTRIBUTING.md", "crosscheck/README.md", "flexinv/README.md", "plugins/README.md")
OWN = re.compile(r"^[\w/*-]+\.(urdf|xml|csv|toml|sdf|usd|gz)(@.*)?$")  # a reader's own file
TABLES = {  # a page's tables in capitals are parts of files: what they are laid over
    "docs/howto/payload.md": ("docs/tutorials/own-mechanism.md", "models/ur5/mechanism.toml"),
    "docs/howto/corpus.md": ("", ""),
    "docs/howto/coupled-sections.md": ("", ""),
    "docs/howto/identify.md": ("", ""),
    "docs/howto/meshed-links.md": ("", ""),
}


def lines(page: str) -> list[str]:
    """Lines of the blocks of a page that show a shell without running it, indented ones too."""
    text = re.sub(r"^ +", "", (ROOT / page).read_text(), flags=re.M)
    return [line.removeprefix("$ ") for block in blocks(text, "(?:text|console)") for line in block.splitlines()]


def commands(page: str, program: str) -> list[list[str]]:
    words = [shlex.split(line, comments=True) for line in lines(page) if line.startswith(f"{program} ")]
    return [one for one in words if one]


def understood(words: list[str], folder: Path) -> str | None:
    """The command that a program reads, as it stands and without running it; files that a reader has are there, and empty."""
    for word in words[1:]:
        if OWN.match(word):
            file = folder / word.partition("@")[0]
            file.parent.mkdir(parents=True, exist_ok=True)
            file.touch()
    for own in ("answers", "corpus", "reports/latest"):
        (folder / own).mkdir(parents=True, exist_ok=True)
    group = PROGRAMS[words[0]]
    above = click.Context(group, info_name=words[0])
    command = group.get_command(above, words[1])
    assert command is not None, f"{words[0]} has no command {words[1]}"
    return command.make_context(words[1], list(words[2:]), parent=above).command.name


@pytest.mark.parametrize("page", [page for page in SHOWN if any(commands(page, program) for program in PROGRAMS)])
def test_commands_that_are_only_shown_are_understood(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(project(tmp_path))
    for program in PROGRAMS:
        for words in commands(page, program):
            assert understood(words, tmp_path) == words[1]


@pytest.mark.parametrize("wrong", ["crosscheck corpse", "crosscheck corpus --autit", "flexinv solve --cases a"])
def test_a_command_that_does_not_exist_is_found(wrong: str, tmp_path: Path) -> None:
    with pytest.raises((AssertionError, click.UsageError)):
        understood(wrong.split(), tmp_path)


@pytest.mark.skipif(shutil.which("make") is None, reason="there is no make")
@pytest.mark.parametrize("page", [page for page in SHOWN if commands(page, "make")])
def test_make_does_what_is_shown_with_programs_that_it_installs(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every `make TARGET` of a page is read by make; what it would start exists, and our own commands are understood."""
    copy = project(tmp_path)
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / name, copy / name)
    shutil.copytree(ROOT / "reports" / "baseline", copy / "reports" / "baseline")
    monkeypatch.chdir(copy)
    monkeypatch.delenv("MAKEFLAGS", raising=False)
    installed = {script.name for script in metadata.entry_points(group="console_scripts")} | {"python", "ruff"}
    for words in commands(page, "make"):
        done = subprocess.run([words[0], "-n", *words[1:]], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        for name, rest in re.findall(r"^-?\s*\.venv/bin/([\w-]+)(.*)$", done.stdout, re.M):
            assert name in installed, f"make {words[1]} would start {name}, which no extra brings"
            if name in PROGRAMS:
                understood([name, *shlex.split(rest.partition(";")[0].partition("||")[0])], copy)


def test_the_environment_that_is_activated_is_the_one_that_make_fills() -> None:
    venv = re.search(r"^VENV +:= +(\S+)$", (ROOT / "Makefile").read_text(), re.M)
    assert venv is not None
    shown = {line.split()[1] for page in SHOWN for line in lines(page) if line.startswith(". ")}
    assert f"{venv.group(1)}/bin/activate" in shown
    assert all(one in (f"{venv.group(1)}/bin/activate", "outside/bin/activate") for one in shown)


def test_every_part_of_a_file_that_is_shown_is_tested() -> None:
    others = {
        "docs/reference/files.md"
    }  # models/README.md: tests/test_models.py, test_task_file.py, test_optimum_file.py
    assert {page for page in PAGES if blocks((ROOT / page).read_text(), "TOML")} - others == set(TABLES)


def test_coupled_sections_that_are_shown_are_read(tmp_path: Path) -> None:
    """The bend-twist coupling and the mass centre of the page are in the section of a beam."""
    (shown,) = blocks((ROOT / "docs/howto/coupled-sections.md").read_text(), "TOML")
    beam = '[links.beam]\nkind = "beam"\nlength_m = 1\nsection = "blade"\n'
    joint = '[joints.root]\nkind = "fixed"\nparent = "world"\nchild = "beam"\n'
    (tmp_path / "mechanism.toml").write_text(
        f'source = "a test"\ngravity_m_per_s2 = [0, 0, 0]\n{shown}\n{beam}\n{joint}'
    )
    (link,) = load_mechanism(tmp_path).beams
    assert link.beam is not None
    assert link.beam.section.stiffness_matrices[0][3, 4] == 25.0
    assert link.beam.section.mass_centre is not None
    assert link.beam.section.mass_centre[0] == pytest.approx([0.01, 0.0])


def test_meshed_links_that_are_shown_are_read(tmp_path: Path) -> None:
    """The forearm of the page, from its mesh in millimetres and from matrices in tonnes, millimetres and seconds."""
    shown, laid, ready = blocks((ROOT / "docs/howto/meshed-links.md").read_text(), "TOML")
    points, cells = make_block("hexahedron20", (0.4, 0.05, 0.05), (2, 1, 1))
    held = np.flatnonzero(points[:, 0] < 1e-9)
    mesh = meshio.Mesh(1000.0 * points, [("hexahedron20", cells)], point_sets={"ELBOW": held})
    meshio.write(tmp_path / "forearm.inp", mesh)
    text = (tmp_path / "forearm.inp").read_text()
    (tmp_path / "forearm.inp").write_text(text.replace("C3D20RH", "C3D20"))  # meshio writes the hybrid kind
    others = """[links.hand]
kind = "rigid"
mass_kg = 1
com_m = [0, 0, 0]
inertia_kgm2 = { xx = 1e-3, yy = 1e-3, zz = 1e-3 }

[joints.elbow]
kind = "revolute"
parent = "world"
child = "forearm"
axis = [0, 0, 1]
"""
    head = 'source = "a test"\ngravity_m_per_s2 = [0, 0, 0]\n'
    (tmp_path / "mechanism.toml").write_text(f"{head}{shown}\n{others}")
    part = load_mechanism(tmp_path).link_of["forearm"].part
    assert part is not None
    assert [(one.name, one.tie) for one in part.interfaces] == [("elbow", "rigid"), ("flange", "average")]
    found = build_part_matrices(part)
    for name, matrix in (
        ("forearm_MASS1.mtx", scipy.sparse.kron(found.mass, scipy.sparse.eye_array(3))),
        ("forearm_STIF1.mtx", found.stiffness),
    ):
        scipy.io.mmwrite(tmp_path / name, scipy.sparse.coo_array(matrix / 1000.0), precision=16)
    mesh_keys = re.compile(r"^(file|unit_m|material) = .*\n", re.M)
    joined = mesh_keys.sub("", shown).replace('kind = "mesh"\n', f'kind = "mesh"\n{ready}', 1)
    (tmp_path / "mechanism.toml").write_text(f"{head}{joined}\n{others}")
    other = load_mechanism(tmp_path).link_of["forearm"].part
    assert other is not None
    assert compute_reduction(other).frequency == pytest.approx(compute_reduction(part).frequency, rel=1e-9)
    robot = tmp_path / "robot"
    robot.mkdir()
    shutil.copy(ROOT / "models/ur5_meshed_forearm/forearm.inp", robot)
    (robot / "mechanism.toml").write_text(f'source = "a test"\n{laid}')
    assert load_mechanism(robot).joint_of["wrist_1_joint"].interface == "wrist"


def test_payloads_that_are_shown_are_read(tmp_path: Path) -> None:
    """Laid over the crane of the tutorial, whose own payload is another one, and over the UR5."""
    page = "docs/howto/payload.md"
    tutorial, robot = TABLES[page]
    (crane,) = re.findall(r"^```toml\n(title.*?)^```$", (ROOT / tutorial).read_text(), re.M | re.S)
    beam, overlay = blocks((ROOT / page).read_text(), "TOML")
    for name, below, table, body in (
        ("crane", crane, beam, "load"),
        ("ur5", (ROOT / robot).read_text(), overlay, "ball"),
    ):
        folder = tmp_path / name
        folder.mkdir()
        without = re.sub(r"^\[\[links\.boom\.payload\]\]\n(?:.+\n)*", "", below, flags=re.M)
        (folder / "mechanism.toml").write_text(f"{without}\n{table.strip()}\n")
        bodies = [one.name for link in load_mechanism(folder).links for one in link.bodies]
        assert body in bodies


def test_sensors_that_are_shown_are_read(tmp_path: Path) -> None:
    """As identify.toml of the arm of the identification's tests, under the names that the page uses."""
    (table,) = blocks((ROOT / "docs/howto/identify.md").read_text(), "TOML")
    arm = load_mechanism(logged_arm.write_arm(tmp_path / "arm"))
    file = tmp_path / "arm" / "identify.toml"
    text = "bandwidth_Hz = 10\n" + table.replace('"forearm"', f'"{arm.links[-1].name}"')
    file.write_text(text)
    read = read_settings(file, arm)
    assert set(read.markers) == {"tip"}
    assert set(read.accelerometers) == {"wrist"}
    file.write_text(text.replace("xyz_m", "xyz_mm", 1))
    with pytest.raises(Exception, match="xyz_mm"):
        read_settings(file, arm)


def test_the_notes_of_a_corpus_that_are_shown_are_read(tmp_path: Path) -> None:
    (table,) = blocks((ROOT / "docs/howto/corpus.md").read_text(), "TOML")
    (tmp_path / "corpus.toml").write_text(table.lstrip())
    notes = read_notes(tmp_path)
    assert notes.mechanisms["ur5"].redistribute is False
    assert notes.published[0].value == 0.033
    (tmp_path / "corpus.toml").write_text(table.replace("redistribute", "redistributed"))
    with pytest.raises(Exception, match="redistribute"):
        read_notes(tmp_path)
