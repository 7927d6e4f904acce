"""Bodies of MJCF without <inertial>: MuJoCo and Pinocchio weigh other shapes, and lint says both masses."""

from __future__ import annotations

from pathlib import Path

import pytest

from crosscheck.findings.finding import Finding
from crosscheck.linting.lint import check_sources, lint

mujoco = pytest.importorskip("mujoco")
pin = pytest.importorskip("pinocchio")
MODEL = """<mujoco><compiler {compiler}/><worldbody><body name="arm" pos="0 0 1">{joint}{shapes}</body></worldbody></mujoco>"""
HINGE = '<joint name="hinge" axis="0 1 0"/>'
SHAPE = '<geom type="box" size="0.1 0.1 0.1" {}/>'  # 8 kg of water
TOUCHED = SHAPE.format('group="3"')
SEEN = SHAPE.format('group="2" contype="0" conaffinity="0"')
LIGHT_TOUCHED = SHAPE.format('group="3" mass="0"')
LIGHT_SEEN = SHAPE.format('group="2" contype="0" conaffinity="0" density="0"')
INERTIAL = '<inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/>'


def find_masses(folder: Path, shapes: str, compiler: str = "", joint: str = HINGE) -> tuple[Path, list[Finding]]:
    file = folder / "arm.xml"
    file.write_text(MODEL.format(compiler=compiler, shapes=shapes, joint=joint))
    return file, [one for one in lint(file).findings if one.check == "mass of shapes"]


@pytest.mark.parametrize(
    ("shapes", "compiler", "words"),
    [
        (TOUCHED + SEEN, "", ("16 kg", "8 kg", "groups 0 to 5")),
        (SEEN, "", ("8 kg", "0 kg", "groups 0 to 5")),
        (LIGHT_TOUCHED + SEEN, "", ("8 kg", "0 kg", "groups 0 to 5")),
        (TOUCHED + TOUCHED + SEEN, 'inertiagrouprange="0 2"', ("8 kg", "16 kg", "groups 0 to 2")),
        (TOUCHED + SEEN, 'discardvisual="true"', ("16 kg", "8 kg", "groups 0 to 5")),
        (INERTIAL + TOUCHED + SEEN, 'inertiafromgeom="true"', ("16 kg", "8 kg", "groups 0 to 5")),
    ],
)
def test_both_masses_are_those_of_the_readers(
    shapes: str, compiler: str, words: tuple[str, str, str], tmp_path: Path
) -> None:
    file, (found,) = find_masses(tmp_path, shapes, compiler)
    assert found.place == "link arm"
    assert found.given == f"no <inertial>; its shapes weigh {words[0]}, those that collide {words[1]}"
    assert words[2] in found.why
    masses = (mujoco.MjModel.from_xml_path(str(file)).body_mass[1], pin.buildModelFromMJCF(str(file)).inertias[1].mass)
    assert [f"{mass:.4g} kg" for mass in masses] == list(words[:2])


@pytest.mark.parametrize(
    ("shapes", "compiler", "joint"),
    [
        (TOUCHED + LIGHT_SEEN, "", HINGE),
        (TOUCHED, "", HINGE),
        (TOUCHED + SEEN, 'inertiagrouprange="3 3"', HINGE),
        (INERTIAL + TOUCHED + SEEN, "", HINGE),
        (TOUCHED + SEEN, "", ""),  # it stands still
    ],
)
def test_nothing_is_said_where_both_weigh_the_same(shapes: str, compiler: str, joint: str, tmp_path: Path) -> None:
    file, found = find_masses(tmp_path, shapes, compiler, joint)
    assert found == []
    if joint:
        own = mujoco.MjModel.from_xml_path(str(file)).body_mass[1]
        assert pin.buildModelFromMJCF(str(file)).inertias[1].mass == pytest.approx(own)


@pytest.mark.parametrize("compiler", ["", 'inertiagrouprange="3 3"'])
def test_a_body_that_moves_and_weighs_nothing_is_refused_in_the_words_of_mujoco(compiler: str, tmp_path: Path) -> None:
    file = tmp_path / "arm.xml"
    shapes = (SEEN if compiler else LIGHT_SEEN) + LIGHT_TOUCHED
    file.write_text(MODEL.format(compiler=compiler, shapes=shapes, joint=HINGE))
    (report,) = check_sources([file])
    assert "mass and inertia of moving bodies must be larger" in report.findings[0].given
