"""Campaign: every attribute of MJCF that mj_inverse can feel, edited alone and two or three at once, seen by `compare`.

    python campaigns/mjcf_attributes.py [--count 200]

An MJCF of a hinge, a slide, a ball and a floating body is edited.  The judge is MuJoCo alone: `own_gap` asks mj_inverse of both
models for the same qpos, qvel and qacc, contacts, limits and equality constraints off, and dry friction made stiff.  It knows
nothing of mechanisms.  Where its efforts differ by more than 1e-9 of their range, `compare` must not say "the same machine";
where they do not, it must.  The program ends with 1 where one answer is wrong.  A third of the single edits is a test.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from itertools import islice
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

MODEL = """<mujoco model="bench"><compiler angle="radian"/>
  <option gravity="0.3 0 -9.81"/>
  <worldbody>
    <body name="arm" pos="0.1 0 0.5"><joint name="hinge" axis="0 1 0" damping="0.3" armature="0.02" frictionloss="0.1"/>
      <inertial pos="0.02 0.01 -0.2" mass="0.9" diaginertia="0.012 0.013 0.002"/>
      <body name="rod" pos="0 0.1 -0.4" quat="0.9 0.1 0.2 0.3">
        <joint name="slide" type="slide" axis="1 0.2 0" stiffness="30" springref="0.05"/>
        <inertial pos="0.05 0 0" mass="0.4" diaginertia="0.001 0.002 0.0025"/>
        <body name="hand" pos="0.3 0 0"><joint name="ball" type="ball"/>
          <inertial pos="0 0.02 -0.05" mass="0.2" diaginertia="0.0005 0.0004 0.0003"/></body></body></body>
    <body name="base" pos="1 0 1"><freejoint name="float"/>
      <inertial pos="0.01 0 0.1" mass="2" diaginertia="0.03 0.02 0.04"/>
      <body name="leg" pos="0 0 -0.2"><joint name="hip" axis="1 0 0"/>
        <inertial pos="0 0.03 -0.2" mass="0.5" diaginertia="0.004 0.004 0.001"/></body></body>
  </worldbody>
  <tendon><fixed name="cord"><joint joint="hinge" coef="1"/><joint joint="hip" coef="-0.5"/></fixed></tendon>
  <actuator><motor name="drive" joint="hinge" gear="3"/><motor name="winch" tendon="cord" gear="2"/></actuator>
</mujoco>"""
HINGE, SLIDE, BALL = '<joint name="hinge"', '<joint name="slide"', '<joint name="ball"'
CORD, DRIVE, WINCH, HIP = '<fixed name="cord"', '<motor name="drive"', '<motor name="winch"', '<joint name="hip"'
OPTION, ARM, INERTIAL = "<option", '<body name="arm"', '<inertial pos="0.02 0.01 -0.2"'
FLOAT, FREE = '<freejoint name="float"', '<joint name="float" type="free"'
FLAG = ('-9.81"/>', '-9.81"><flag {}="disable"/></option>')


def flag(name: str) -> tuple[str, str]:
    """Return the edit that disables something."""
    return FLAG[0], FLAG[1].format(name)


def with_words(tag: str, words: str) -> tuple[str, str]:
    """Return the edit that adds attributes to a tag."""
    return tag, f"{tag} {words}"


# What is edited, by the attribute.
EDITS = {
    "gravity": ('gravity="0.3 0 -9.81"', 'gravity="0 0 -9.81"'),
    "flag gravity": flag("gravity"),
    "flag spring": flag("spring"),
    "flag damper": flag("damper"),
    "flag frictionloss": flag("frictionloss"),
    "flag constraint": flag("constraint"),
    "density": with_words(OPTION, 'density="1.2"'),
    "viscosity": with_words(OPTION, 'viscosity="2e-5"'),
    "density and wind": with_words(OPTION, 'density="1.2" wind="1 2 0"'),
    "joint axis": ('axis="0 1 0"', 'axis="0.01 1 0"'),
    "joint pos": with_words(HINGE, 'pos="0.01 0 0"'),
    "joint ref": with_words(HINGE, 'ref="0.1"'),
    "joint damping": ('damping="0.3"', 'damping="0.31"'),
    "joint damping, second order": ('damping="0.3"', 'damping="0.3 0.1"'),
    "joint damping, third order": ('damping="0.3"', 'damping="0.3 0 0.1"'),
    "joint armature": ('armature="0.02"', 'armature="0.021"'),
    "joint frictionloss": ('frictionloss="0.1"', 'frictionloss="0.11"'),
    "joint stiffness": ('stiffness="30"', 'stiffness="31"'),
    "joint stiffness, second order": ('stiffness="30"', 'stiffness="30 5"'),
    "joint stiffness, third order": ('stiffness="30"', 'stiffness="30 0 40"'),
    "joint springref": ('springref="0.05"', 'springref="0.06"'),
    "ball stiffness": with_words(BALL, 'stiffness="2"'),
    "ball stiffness, third order": with_words(BALL, 'stiffness="0 0 2"'),
    "ball damping": with_words(BALL, 'damping="0.1"'),
    "ball damping, second order": with_words(BALL, 'damping="0 0.1"'),
    "ball armature": with_words(BALL, 'armature="0.001"'),
    "ball frictionloss": with_words(BALL, 'frictionloss="0.01"'),
    "free stiffness": (FLOAT, FREE + ' stiffness="20"'),
    "free damping": (FLOAT, FREE + ' damping="1"'),
    "free damping, third order": (FLOAT, FREE + ' damping="0 0 1"'),
    "free armature": (FLOAT, FREE + ' armature="0.1"'),
    "free frictionloss": (FLOAT, FREE + ' frictionloss="0.2"'),
    "body pos": ('pos="0 0.1 -0.4"', 'pos="0 0.1 -0.41"'),
    "body quat": ('quat="0.9 0.1 0.2 0.3"', 'quat="0.9 0.1 0.2 0.31"'),
    "body gravcomp": with_words(ARM, 'gravcomp="1"'),
    "inertial mass": ('mass="0.9"', 'mass="0.91"'),
    "inertial pos": ('pos="0.02 0.01 -0.2"', 'pos="0.021 0.01 -0.2"'),
    "inertial quat": with_words(INERTIAL, 'quat="0.9 0.1 0 0"'),
    "inertial diaginertia": ("0.012 0.013 0.002", "0.012 0.0131 0.002"),
    "actuator armature": with_words(DRIVE, 'armature="0.05"'),
    "actuator damping": with_words(DRIVE, 'damping="0.3"'),
    "actuator damping, second order": with_words(DRIVE, 'damping="0 0.3"'),
    "tendon stiffness": with_words(CORD, 'stiffness="7" springlength="0"'),
    "tendon stiffness, second order": with_words(CORD, 'stiffness="0 7" springlength="0"'),
    "tendon damping": with_words(CORD, 'damping="0.3"'),
    "tendon damping, third order": with_words(CORD, 'damping="0 0 0.3"'),
    "tendon armature": with_words(CORD, 'armature="0.02"'),
    "tendon frictionloss": with_words(CORD, 'frictionloss="0.1"'),
    "armature of an actuator on a tendon": with_words(WINCH, 'armature="0.05"'),
    "damping of an actuator on a tendon": with_words(WINCH, 'damping="0.3"'),
}  # fmt: skip
# What mj_inverse does not feel: no other machine.
UNFELT = {
    "contact flag": flag("contact"),
    "actuation of gravity compensation": with_words(HIP, 'actuatorgravcomp="true"'),
    "time step": with_words(OPTION, 'timestep="0.001"'),
    "integrator": with_words(OPTION, 'integrator="implicit"'),
    "discrete inverse": ('-9.81"/>', '-9.81"><flag invdiscrete="enable"/></option>'),
}


def edited(edit: tuple[str, str]) -> str:
    """Return the model with an edit."""
    before, after = edit
    assert before in MODEL
    return MODEL.replace(before, after)


def write(folder: Path, name: str, text: str) -> Path:
    """Write a model and return its file."""
    file = folder / name
    file.write_text(text)
    return file


def _plain(text: str) -> Any:
    model = mujoco.MjModel.from_xml_string(text)
    bits = mujoco.mjtDisableBit
    model.opt.disableflags |= int(bits.mjDSBL_CONTACT | bits.mjDSBL_LIMIT | bits.mjDSBL_EQUALITY)
    model.opt.enableflags = 0
    for solref in (model.dof_solref, model.tendon_solref_fri):
        solref[:] = (-1.0, -1e12)
    return model


def own_gap(one: str, two: str, seed: int = 5) -> float:
    """Return the largest difference of MuJoCo's own efforts of two texts over the range of its coordinate [-]."""
    rng = np.random.default_rng(seed)
    models = _plain(one), _plain(two)
    datas = [mujoco.MjData(model) for model in models]
    rows = []
    for _ in range(20):
        velocity, acceleration = rng.standard_normal((2, models[0].nv))
        place = models[0].qpos0.copy()
        mujoco.mj_integratePos(models[0], place, rng.standard_normal(models[0].nv), 1.0)
        rows.append([])
        for model, data in zip(models, datas, strict=True):
            data.qpos[:] = place
            data.qvel[:] = velocity
            data.qacc[:] = acceleration
            mujoco.mj_inverse(model, data)
            rows[-1].append(data.qfrc_inverse.copy())
    result = np.array(rows)
    gap = np.abs(result[:, 0] - result[:, 1]).max(axis=0)
    return float((gap / np.abs(result).max(axis=(0, 1))).max())


SEED, FELT = 34, 1e-9


def cases(count: int) -> dict[str, str]:
    """Return texts by what is edited: each edit alone, then ``count`` of two or three at once that do not touch one another."""
    every = {**EDITS, **UNFELT}
    result = {name: edited(edit) for name, edit in every.items()}
    rng = np.random.default_rng(SEED)
    wanted = len(result) + count
    while len(result) < wanted:
        names = [str(name) for name in rng.choice(list(every), rng.integers(2, 4), replace=False)]
        text = MODEL
        for name in names:
            before, after = every[name]
            text = text.replace(before, after) if before in text else ""
        if text and _is_read(text):
            result[" and ".join(names)] = text
    return dict(islice(result.items(), wanted))


def _is_read(text: str) -> bool:
    """Say if MuJoCo takes a text: two edits may state one attribute twice."""
    try:
        mujoco.MjModel.from_xml_string(text)
    except ValueError:
        return False
    return True


def main() -> int:
    """Run the campaign; return the exit code."""
    from crosscheck.equivalence.compare import compare
    from crosscheck.equivalence.sources import describe

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200, help="edits of two or three attributes at once")
    count = parser.parse_args().count
    wrong = 0
    counts: dict[str, int] = {}
    with tempfile.TemporaryDirectory() as folder:
        first = describe(write(Path(folder), "a.xml", MODEL))
        for name, text in cases(count).items():
            gap = own_gap(MODEL, text)
            comparison = compare(first, write(Path(folder), "b.xml", text))
            right = comparison.state == ("different" if gap > FELT else "equal") and not comparison.unexplained
            counts[comparison.state] = counts.get(comparison.state, 0) + 1
            if not right:
                wrong += 1
                sys.stdout.write(f"wrong: {name}: MuJoCo's own efforts differ by {gap:.2g}; {comparison.sentence}\n")
    sys.stdout.write(", ".join(f"{state}: {number}" for state, number in counts.items()) + f"; wrong: {wrong}\n")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
