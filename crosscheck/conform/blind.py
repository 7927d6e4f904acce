"""Blind rounds: the ladder with other masses, lengths, placements, drives and motions, drawn when the round begins.

What an engine is asked then has never been written down anywhere: nobody can have looked up the answer.  Every number is changed
by a factor of its own near 1; what has to stay stays: axes, angles of frames, gears, times, and that loops close.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from flexinv.files.toml_tables import read_toml

TomlValue = Mapping[str, "TomlValue"] | list["TomlValue"] | bool | int | float | str  # of the files of a model

# Parts by which numbers change: lengths little, so that linkages still turn and loops close on the same branch.
LENGTH = 0.02
MASS = 0.2
MOTION = 0.05
DRIVE = 0.2
SECTION = 0.1
ENDS = ("from", "to", "at")
OF_KEY = {
    "mass_kg": MASS,
    "com_m": 0.1,
    "xyz_m": LENGTH,
    "length_m": LENGTH,
    "rotor_inertia_kgm2": DRIVE,
    "motor_inertia_kgm2": DRIVE,
    "viscous_Nms_per_rad": DRIVE,
    "coulomb_Nm": DRIVE,
    "damping_Nms_per_rad": DRIVE,
    "friction_Nm": DRIVE,
    "stiffness_Nm_per_rad": DRIVE,
    "gravity_m_per_s2": 0.1,
    "EA_N": SECTION,
    "GA_N": SECTION,
    "GJ_Nm2": SECTION,
    "EI_Nm2": SECTION,
    "mass_per_length_kg_per_m": SECTION,
    "stiffness_matrix": SECTION,
    "mass_matrix": SECTION,
    "damping_matrix": DRIVE,
    "retardation_s": DRIVE,
    **dict.fromkeys((f"{end}_{unit}" for end in ENDS for unit in ("deg", "rad", "m", "xyz_m", "rpy_deg")), MOTION),
}
WITH_MASS = ("inertia_kgm2", "axial_inertia_kgm2")  # a body keeps a shape that bodies can have


def write_blind_models(ladder: Path, out: Path, seed: int) -> None:
    """Write a folder of models like another one, its numbers changed by a seed.  Raises OSError."""
    random = np.random.default_rng(seed)
    for folder in sorted(f.parent for f in ladder.glob("*/mechanism.toml")):
        (out / folder.name).mkdir(parents=True)
        for name in ("mechanism.toml", "cases.toml"):
            plain = scale_table(read_toml(folder / name), random, name == "cases.toml")
            (out / folder.name / name).write_text(format_toml(plain), encoding="utf-8")


def scale_table(
    table: Mapping[str, TomlValue], random: np.random.Generator, motion: bool = False, mass: float = 1.0
) -> dict[str, TomlValue]:
    """Return a table whose numbers are changed by factors [-]; mass : of the body it belongs to; motion : of a cases file."""
    factor = 1.0 + OF_KEY["mass_kg"] * random.uniform(-1.0, 1.0) if "mass_kg" in table else mass
    made: dict[str, TomlValue] = {}
    for key, value in table.items():
        if key == "start":
            made[key] = value  # the guess of a loop: its branch
        elif key == "mass_kg" or key in WITH_MASS:
            made[key] = scale_value(value, factor)
        elif isinstance(value, Mapping) and key not in OF_KEY:
            made[key] = scale_table(value, random, motion, factor)
        elif key in OF_KEY and not (motion and not key.startswith(("from_", "to_", "at_"))):
            made[key] = scale_value(value, 1.0 + OF_KEY[key] * random.uniform(-1.0, 1.0))
        else:
            made[key] = value
    return made


def scale_value(value: TomlValue, factor: float) -> TomlValue:
    """Return a number, a list or a table of numbers times a factor [-]."""
    if isinstance(value, Mapping):
        return {key: scale_value(one, factor) for key, one in value.items()}
    if isinstance(value, list):
        return [scale_value(one, factor) for one in value]
    return value if isinstance(value, bool | str) else float(value) * factor


def format_toml(table: Mapping[str, TomlValue]) -> str:
    """Return a table as TOML: every value inline, which reads the same."""
    text = "".join(f"{_format_key(key)} = {_format_value(value)}\n" for key, value in table.items())
    tomllib.loads(text)
    return text


def _format_key(name: str) -> str:
    return json.dumps(name, ensure_ascii=False)


def _format_value(value: TomlValue) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_format_key(k)} = {_format_value(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(_format_value(one) for one in value) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str) else repr(value)
