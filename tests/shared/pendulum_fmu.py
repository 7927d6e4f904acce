"""Compile the double pendulum as an FMU, with a C compiler and the headers that FMPy ships."""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

PORTS = [f"{joint}.{part}" for joint in ("pivot", "knee") for part in ("q", "qd", "qdd")]
UNITS = {"q": "rad", "qd": "rad/s", "qdd": "rad/s2", "tau": "N.m"}
SOURCE = Path(__file__).with_name("fmu") / "pendulum.c"


def why_not() -> str:
    """What is missing here, in words; "" where an FMU can be made and run."""
    if importlib.util.find_spec("fmpy") is None:
        return "FMPy is not installed (python -m pip install fmpy)"
    if shutil.which("gcc") is None:
        return "there is no C compiler"
    return "" if sys.platform == "linux" else "the FMU is compiled for Linux here"


def description(
    kinds: tuple[str, ...], tau_unit: str = "N.m", states: bool = False, names: tuple[str, ...] = ()
) -> str:
    """modelDescription.xml; names : of the inputs, those of the mechanism unless given."""
    units = "".join(f'<Unit name="{u}"/>' for u in dict.fromkeys([*UNITS.values(), tau_unit]))
    variables = [
        f'<ScalarVariable name="{name}" valueReference="{k}" causality="input" variability="continuous">'
        f'<Real start="0" unit="{UNITS[PORTS[k].partition(".")[2]]}"/></ScalarVariable>'
        for k, name in enumerate(names or PORTS)
    ]
    variables += [
        f'<ScalarVariable name="{joint}.tau" valueReference="{6 + k}" causality="output" variability="continuous">'
        f'<Real unit="{tau_unit}"/></ScalarVariable>'
        for k, joint in enumerate(("pivot", "knee"))
    ]
    outputs = "".join(f'<Unknown index="{k}" dependencies="1 2 3 4 5 6"/>' for k in (7, 8))
    derivatives = '<Derivatives><Unknown index="8" dependencies=""/></Derivatives>' if states else ""
    interfaces = "".join(f'<{kind} modelIdentifier="pendulum"/>' for kind in kinds)
    return (
        '<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="2.0" modelName="pendulum" guid="{p}" '
        f'version="1.2" variableNamingConvention="structured">{interfaces}<UnitDefinitions>{units}</UnitDefinitions>'
        f"<ModelVariables>{''.join(variables)}</ModelVariables>"
        f"<ModelStructure><Outputs>{outputs}</Outputs>{derivatives}</ModelStructure></fmiModelDescription>"
    )


def build(folder: Path, flags: tuple[str, ...] = (), **words: object) -> Path:
    """An FMU in a folder; flags : -DLATE, -DWRONG; words : of the description."""
    spec = importlib.util.find_spec("fmpy")
    assert spec is not None
    assert spec.origin is not None
    library = folder / "pendulum.so"
    headers = Path(spec.origin).parent / "c-code"
    subprocess.run(
        ["gcc", "-shared", "-fPIC", "-O2", *flags, f"-I{headers}", str(SOURCE), "-lm", "-o", str(library)], check=True
    )
    file = folder / "pendulum.fmu"
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("modelDescription.xml", description(**{"kinds": ("ModelExchange", "CoSimulation"), **words}))  # type: ignore[arg-type]
        archive.write(library, "binaries/linux64/pendulum.so")
    return file


def rewrite(file: Path, old: str, new: str) -> None:
    """Exchange words of the model description of an FMU."""
    with zipfile.ZipFile(file) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    text = parts["modelDescription.xml"].decode()
    assert old in text
    parts["modelDescription.xml"] = text.replace(old, new).encode()
    with zipfile.ZipFile(file, "w") as archive:
        for name, data in parts.items():
            archive.writestr(name, data)
