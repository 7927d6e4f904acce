"""Sources of descriptions: files by what they hold, ``FILE@ENGINE`` by that engine's own reader, models in memory."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from crosscheck.doors.packages import list_installed_engines
from crosscheck.engines import ENGINES, Engine, describe_missing_package, resolve_adapter
from crosscheck.engines.base import offered
from crosscheck.kit.lift import lift_kit
from crosscheck.lifting.description import Description
from crosscheck.lifting.toml import lift_toml
from crosscheck.lifting.urdf import lift_urdf
from crosscheck.lifting.usd import PACKAGE as USD_PACKAGE
from crosscheck.lifting.usd import SUFFIXES as USD_SUFFIXES
from crosscheck.lifting.usd import can_read_usd, lift_usd
from flexinv.errors import InputError
from flexinv.files.from_urdf import read_xml
from flexinv.files.regular_files import NotRegularFile, describe_kind, read_regular
from flexinv.files.toml_tables import LONGEST_PATH, make_input_error
from flexinv.files.values import LONGEST_TEXT
from flexinv.model.mechanism import WORLD, Mechanism

# Readers of files that this project does not read itself, the first that is installed: by format.
READERS = {"mjcf": ("mujoco",), "sdf": ("drake",), "usd": ()}
INSTALL = {
    "mjcf": "python -m pip install mujoco",
    "sdf": "python -m pip install --no-deps drake, and the package plugins/crosscheck-drake of this project",
    "usd": f"python -m pip install {USD_PACKAGE}",
}
ROOTS = {"robot": "urdf", "mujoco": "mjcf", "sdf": "sdf"}
USD = (b"PXR-USDC", b"#usda", b"PK\x03\x04")
LARGEST_USD = 256 << 20  # [byte]: stages of robots with their shapes have some tens of megabytes
WRITE = "a URDF, MJCF, SDF or mechanism.toml, a folder with mechanism.toml or case.json, or FILE@ENGINE"


def describe(source: Any, base: str = "fixed") -> Description:
    """Return the description of a file, a model in memory, a mechanism or a description [m, kg, rad].

    base : how the root of a URDF is held, "fixed" or "free", where the file does not say
    Raises InputError: the file, what was given, what was expected, what to write.
    """
    if isinstance(source, Description):
        return source
    if isinstance(source, Mechanism):
        return Description(source.name, source, "live")
    if not isinstance(source, str | Path):
        return _read_live_model(source)
    name, engine = _split(str(source))
    path = Path(name)
    if engine:
        result = replace(_read_by_engine(path, engine), label=f"{path.name}@{engine}", reader=engine)
    elif os.path.isdir(path):  # Path.is_dir raises where a name is too long for the system
        result = _read_folder(path)
    else:
        result = _read_file(path, base)
    return result


def check_readable(source: str) -> None:
    """Read a description and forget it.  Raises InputError."""
    describe(source)


def describe_pair(a: Any, b: Any) -> tuple[Description, Description]:
    """Return two descriptions; where one says that its root is free and the other says nothing, that is taken to be free, too.

    So is gravity [m/s^2], which a URDF does not state.  Two of one name are told apart by their folders.  Raises InputError.
    """
    first = describe(a)
    second = describe(b)
    if _is_floating(first) != _is_floating(second):
        first = _add_free_root(first, a) if not first.root_stated and _is_floating(second) else first
        second = _add_free_root(second, b) if not second.root_stated and _is_floating(first) else second
    first, second = _apply_gravity(first, second), _apply_gravity(second, first)
    if first.label == second.label:
        names = [str(source) if isinstance(source, str | Path) else d.label for source, d in ((a, first), (b, second))]
        labels = list(_find_differing_ends(*names))
        if labels[0] == labels[1]:
            labels = [f"{labels[0]} (A)", f"{labels[1]} (B)"]
        first = replace(first, label=labels[0])
        second = replace(second, label=labels[1])
    return first, second


def _find_differing_ends(one: str, two: str) -> tuple[str, str]:
    """The ends of two paths from the folder on in which they differ."""
    parts = [Path(name).parts for name in (one, two)]
    for count in range(2, max(map(len, parts))):
        short = [str(Path(*part[-count:])) for part in parts]
        if short[0] != short[1]:
            return short[0], short[1]
    return one, two


def _is_floating(description: Description) -> bool:
    return any(joint.kind == "free" and joint.parent == WORLD for joint in description.mechanism.joints)


def _add_free_root(description: Description, source: Any) -> Description:
    """A URDF whose root is free; one that an engine has read keeps what that engine made of it."""
    if description.reader != "flexinv":
        return description
    free = describe(source, "free")
    words = "its root: a URDF does not say whether it is held; taken to be free, as in the other description"
    return replace(free, dropped=(*free.dropped, words))


def _apply_gravity(one: Description, other: Description) -> Description:
    """A description under the other's gravity, where it states none itself."""
    second = other.mechanism.gravity
    if one.gravity_stated or not other.gravity_stated or np.array_equal(one.mechanism.gravity, second):
        return one
    words = f"gravity: {one.format.upper()} does not state it; taken to be {second.tolist()} m/s^2, as in the other description"
    return replace(one, mechanism=replace(one.mechanism, gravity=second), dropped=(*one.dropped, words))


def _split(text: str) -> tuple[str, str]:
    """FILE@ENGINE; a file whose own name has an @ is itself."""
    name, at, engine = text.rpartition("@")
    return (name, engine) if at and name and "/" not in engine and not os.path.exists(text) else (text, "")


def _read_folder(path: Path) -> Description:
    if os.path.lexists(path / "case.json"):
        return lift_kit(path / "case.json")
    if os.path.lexists(path / "mechanism.toml"):
        return lift_toml(path)
    raise make_input_error(
        str(path), "a folder without mechanism.toml and case.json", "one of the two", _describe_folder_choice(path)
    )


def _describe_folder_choice(path: Path) -> str:
    """Return advice for a folder that is no description: the URDFs in it or one level below, else what can be read."""
    for pattern in ("*.urdf", "*/*.urdf"):
        if (one := next(path.glob(pattern), None)) is not None:
            return f"{path / pattern} for all in crosscheck lint, or one such as {one}"
    return WRITE


def _read_file(path: Path, base: str) -> Description:
    _check_regular(path)
    tables = {".toml": lift_toml, ".json": lift_kit}
    if path.suffix in tables and not is_xml(path):
        return tables[path.suffix](path)
    kind = find_format(path)
    if kind == "urdf":
        found = lift_urdf(path, base)
    else:
        found = (
            lift_usd(path) if kind == "usd" and can_read_usd() else _read_by_engine(path, _choose_reader(path, kind))
        )
    return replace(found, label=path.name, dropped=(*_describe_wrong_suffix(path, kind), *found.dropped))


def _check_regular(path: Path) -> None:
    """Raise InputError for what is no file whose bytes can be read: a pipe, a device, nothing."""
    if words := describe_kind(path):
        raise make_input_error(str(path)[:LONGEST_PATH], words, "a description of a machine, as a regular file", WRITE)


def _read_start(path: Path) -> bytes:
    """The first bytes of a regular file.  Raises InputError."""
    try:
        return read_regular(path, 4095)
    except NotRegularFile as error:
        expected = "a description of a machine, as a regular file"
        raise make_input_error(str(path)[:LONGEST_PATH], str(error), expected, WRITE) from None


def is_xml(path: Path) -> bool:
    """Return True if a file begins as XML does, whatever its name says."""
    start = _read_start(path)
    return start.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"<") or start[:2] in (b"\xff\xfe", b"\xfe\xff")


def find_format(path: Path) -> str:
    """Return the format of a file by what it holds: urdf, mjcf, sdf or usd.  Raises InputError."""
    start = _read_start(path)
    if not start.strip():
        raise make_input_error(str(path), "an empty file", "a description of a machine", WRITE)
    if start.startswith(USD):
        if (size := path.stat().st_size) > LARGEST_USD:
            write = "the stage without pictures and shapes, which no torque feels; payloads of their own for these"
            raise make_input_error(str(path), f"{size} bytes", f"at most {LARGEST_USD} bytes", write)
        return "usd"
    root = None if path.suffix == ".xacro" else read_xml(path)
    if root is None or any(str(part.tag).partition("}")[0].endswith("/xacro") for part in root.iter()):
        raise InputError(
            f"{path}\n  given:    a xacro, which is a program that writes a URDF\n  expected: the URDF itself\n"
            f"  write:    xacro {path.name} > {_resolve_xacro_name(path.name)}, and give that"
        )
    _check_words(path, root)
    kind = ROOTS.get(root.tag)
    if kind is None:
        expected = ", ".join(f"<{tag}>" for tag in ROOTS)
        raise InputError(f"{path}\n  given:    <{root.tag[:60]}>\n  expected: {expected}\n  write:    {WRITE}")
    return kind


def _resolve_xacro_name(name: str) -> str:
    """The name of what a xacro writes: never its own, which the shell would empty first."""
    plain = f"{name.removesuffix('.xacro').removesuffix('.urdf')}.urdf"
    return plain if plain != name else f"{name.removesuffix('.urdf')}.expanded.urdf"


def _check_words(path: Path, root: Element) -> None:
    """Refuse names and numbers without end: every later message would repeat them."""
    for part in root.iter():
        for key, text in (("tag", part.tag), ("text", part.text or ""), *part.attrib.items()):
            if len(text) > LONGEST_TEXT and len(text[: LONGEST_TEXT + 1].split(maxsplit=1)) == 1 and text.strip():
                raise InputError(
                    f"{path}: <{part.tag[:60]}>, {key[:60]}\n  given:    a word of {len(text)} characters, {text[:40]!r}...\n"
                    f"  expected: names and numbers of at most {LONGEST_TEXT} characters\n  write:    a shorter one"
                )


def _describe_wrong_suffix(path: Path, kind: str) -> Iterator[str]:
    suffixes = {f".{name}": name for name in ("urdf", "sdf", "mjcf", "toml", "json")} | dict.fromkeys(
        USD_SUFFIXES, "usd"
    )
    wrong = suffixes.get(path.suffix.lower(), kind)
    if wrong != kind:
        yield f"suffix {path.suffix}: the file is {kind.upper()}, and is read as that"


def _collect_engines() -> dict[str, Engine]:
    return {**ENGINES, **list_installed_engines()}


def _choose_reader(path: Path, kind: str) -> str:
    engines = _collect_engines()
    for name in READERS[kind]:
        if name in engines and describe_missing_package(engines[name]) is None:
            return name
    raise InputError(
        f"{path}\n  given:    {kind.upper()}, and no reader of it is installed\n"
        f"  expected: one that is kept well: {' or '.join(READERS[kind]) or USD_PACKAGE}\n  write:    {INSTALL[kind]}"
    )


def list_readers(kind: str) -> list[str]:
    """Return the engines that have a reader of their own for a format, those that are installed."""
    readers = []
    for name, engine in _collect_engines().items():
        if "-" in name or describe_missing_package(engine) is not None or name in ("measured", "flexinv"):
            continue
        try:
            adapter: Any = resolve_adapter(engine.module)
        except ImportError:
            continue
        if offered(adapter, "lift") is not None and kind in getattr(adapter, "READS", ("urdf", "mjcf")):
            readers.append(name)
    return readers


def _read_by_engine(path: Path, name: str) -> Description:
    engines = _collect_engines()
    if name == "flexinv":
        return _read_file(path, "fixed")
    if name not in engines:
        known = ", ".join(n for n in engines if "-" not in n and n != "measured")
        raise InputError(f"{path}@{name}: no engine is called {name!r}; known: {known}")
    if words := describe_missing_package(engines[name]):
        raise InputError(f"{path}@{name}: {words}")
    lift = offered(resolve_adapter(engines[name].module), "lift")
    if lift is None:
        raise InputError(
            f"{path}@{name}: {name} has no reader of its own here; write one of {', '.join(list_readers('urdf'))}"
        )
    find_format(path)
    description: Description = lift(path)
    return description


def _read_live_model(source: Any) -> Description:
    """A model in memory: asked are the engines whose package is loaded already."""
    for engine in _collect_engines().values():
        if engine.requires not in sys.modules or "-" in engine.name:
            continue
        adapter: Any = resolve_adapter(engine.module)
        lifts = offered(adapter, "lifts")
        lift = offered(adapter, "lift")
        if lifts is not None and lift is not None and lifts(source):
            description: Description = lift(source)
            return replace(description, reader=engine.name)
    kind = type(source).__module__ + "." + type(source).__name__
    raise InputError(
        f"{kind}: no engine knows a model of this kind; expected {WRITE}, mjModel, pin.Model or a mechanism"
    )
