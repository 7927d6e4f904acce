"""New mechanisms: a folder of two files that run at once, from a starter or around a URDF."""

from __future__ import annotations

import re
import shutil
import tempfile
import warnings
from pathlib import Path

import numpy as np

from flexinv.errors import InputError, ModelWarning
from flexinv.files.from_urdf import read_robot
from flexinv.files.load_mechanism import load_mechanism
from flexinv.files.toml_tables import make_input_error
from flexinv.model.mechanism import Joint, Mechanism

FOLDER = Path(__file__).resolve().parents[1] / "starters"
TEMPLATES = tuple(sorted(folder.name for folder in FOLDER.iterdir() if folder.is_dir()))
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")
# What a joint of a URDF does in its first case: a fifth of its range about the middle, or this where it has no limits.
# [deg], [m], [-]
SWING = 30.0
SLIDE = 0.1
PART = 0.2
ROBOT = "robot.urdf"
ROBOT_FILES = (ROBOT, "mechanism.toml", "cases.toml")
URDF = """title = {title}
source = {source}

[urdf]
path = "robot.urdf"
base = "{base}"                  # "free": six freedoms without a drive
{mimic}
"""
CASES = """source = "made by crosscheck new"

[cases.move]
title = "Every joint moves by a part of its range in 1 s, then rests"
step_s = 0.01
quantities = ["torque", "tip"]

[cases.move.motion]
law = "quintic"
duration_s = 1.0
hold_s = 0.2
{joints}

# --- limits: crosscheck verify NAME --write replaces those below that it proposed ---

[[limits]]
quantity = "torque"
engines = ["pinocchio", "mujoco", "mujoco-flex", "exudyn*"]
maximum = 1e-2
reason = "provisional: crosscheck verify proposes one from the error bars"

[[limits]]
quantity = "tip"
engines = ["pinocchio", "mujoco", "mujoco-flex", "exudyn*"]
maximum = 1e-2
reason = "provisional: crosscheck verify proposes one from the error bars"
"""


def write_from_template(models: Path, name: str, template: str) -> Path:
    """Write the starter ``template`` as ``models/name``; return the folder.  Raises InputError for a name that cannot be."""
    folder = _resolve_new_folder(models, name)
    folder.mkdir(parents=True)  # ours from here on
    try:
        shutil.copytree(FOLDER / template, folder, dirs_exist_ok=True)
    except OSError:
        shutil.rmtree(folder)
        raise
    return folder


def write_from_urdf(models: Path, name: str, file: Path, base: str = "fixed") -> Path:
    """Write a mechanism around a copy of a URDF, with a first motion within the limits of its joints.

    Raises InputError where the URDF cannot be read; nothing is left behind then.
    """
    folder = _resolve_new_folder(models, name)
    folder.mkdir(parents=True)
    try:
        _write_files(folder, file, format_title(name), f"URDF file {file.name}", base)
    except (InputError, OSError):
        shutil.rmtree(folder)
        raise
    return folder


def _read(folder: Path, text: str) -> Mechanism:
    (folder / "mechanism.toml").write_text(text.rstrip() + "\n", encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)  # `crosscheck verify` shows what was changed
        return load_mechanism(folder)


def format_title(name: str) -> str:
    """Return the title of a mechanism [-]."""
    return name.replace("_", " ").capitalize()


def write_robot(file: str, folder: Path, title: str, source: str, base: str = "fixed") -> None:
    """Write the three files of a mechanism around a copy of a URDF into a folder, in the place of older ones.

    Raises InputError where the URDF cannot be read; nothing is written then.
    """
    with tempfile.TemporaryDirectory() as scratch:
        place = Path(scratch)
        try:
            _write_files(place, Path(file), title, source, base)
        except InputError as problem:
            raise InputError(str(problem).replace(str(place / ROBOT), file)) from problem
        folder.mkdir(parents=True, exist_ok=True)
        for name in ROBOT_FILES:
            shutil.copyfile(place / name, folder / name)


def _write_files(folder: Path, file: Path, title: str, source: str, base: str) -> None:
    """Write robot.urdf, mechanism.toml and cases.toml."""
    read_robot(file)  # a file, of a size that is read: nothing is copied without end
    shutil.copyfile(file, folder / ROBOT)
    words = {"title": _format_toml(title), "source": _format_toml(source)}
    mechanism = _read(folder, URDF.format(**words, base=base, mimic=""))
    if any("mimic" in note for note in mechanism.notes):
        mimic = 'mimic = "independent"            # coordinates of their own'
        _read(folder, URDF.format(**words, base=base, mimic=mimic))
    if not any(joint.nv for joint in mechanism.joints):
        raise make_input_error(
            str(file),
            "no joint that moves, on a fixed base",
            "something that moves",
            "--free-base, which lets its root move",
        )
    joints = "\n".join(_format_motion(joint) for joint in mechanism.joints if joint.nv)
    (folder / "cases.toml").write_text(CASES.format(joints=joints), encoding="utf-8")


def _resolve_new_folder(models: Path, name: str) -> Path:
    if not NAME.fullmatch(name):
        raise InputError(
            f"a mechanism called {name!r}: expected letters, digits, _ and -, beginning with a letter or digit"
        )
    folder = models / name
    if folder.exists():
        raise InputError(f"{folder} exists already; write another name, or remove it")
    return folder


def _format_motion(joint: Joint) -> str:
    key = f"joints.{_format_toml(joint.name)}"
    if joint.kind == "free":
        return f"{key} = {{ at_xyz_m = [0, 0, 0], at_quaternion = [0, 0, 0, 1] }}"
    lower = joint.limits.lower
    upper = joint.limits.upper
    angle = joint.kind != "prismatic"
    usual = np.radians(SWING) if angle else SLIDE
    first = -usual / 2
    last = usual / 2
    if np.isfinite([lower, upper]).all() and upper > lower:
        middle = (lower + upper) / 2
        half = min(PART * (upper - lower), usual) / 2
        first = middle - half
        last = middle + half
    if angle:
        return f"{key} = {{ from_deg = {np.degrees(first):.4g}, to_deg = {np.degrees(last):.4g} }}"
    return f"{key} = {{ from_m = {first:.4g}, to_m = {last:.4g} }}"


def _format_toml(text: str) -> str:
    """Return a TOML string (also for a key); control characters, which TOML forbids, become spaces."""
    plain = "".join(c if c.isprintable() else " " for c in text)
    return '"' + plain.replace("\\", "\\\\").replace('"', '\\"') + '"'
