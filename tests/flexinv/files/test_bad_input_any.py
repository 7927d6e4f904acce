"""Whatever is wrong in a file, it is an InputError: documents with parts left out, exchanged and replaced by junk."""

from __future__ import annotations

import contextlib
import copy
import json
import random
import re
import tomllib
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from flexinv.errors import InputError, ModelWarning
from flexinv.files.from_urdf import find_robots_folder, from_urdf
from flexinv.files.load_cases import load_cases
from flexinv.files.load_mechanism import load_mechanism
from flexinv.model.mechanism import Mechanism

README = (Path(__file__).resolve().parents[3] / "models" / "README.md").read_text(encoding="utf-8")
NATIVE, LOOP, URDF, CASES = re.findall(r"^```toml\n(.*?)^```$", README, re.M | re.S)
JUNK: list[Any] = [
    *(0, -1, 1, 1.5, 1e308, -1e308, 1e-320, 10**30, 10**320, float("nan"), float("inf"), True, False),
    *("", "x", "world", "\u0000", "é" * 50, "tube", [], {}, [[]], [{}], {"a": 1}, [0, 0, 0], [1, 2, 3], ["a", "b"]),
    *([[1, 2, 3]] * 3, {"y": 2, "z": 3}, {"xx": 1, "yy": 1, "zz": 1}),
]
KEYS = ["foo", "length_mm", "mass", "station", "kind", "axis", "tip_m", "beam"]
ROUNDS = 250


def toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{json.dumps(k)} = {toml(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(toml, value)) + "]"
    if isinstance(value, str):
        return json.dumps(value)
    return str(value).lower() if isinstance(value, bool | float | int) else value.isoformat()


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The paths of all parts of a document."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, part in items:
        yield (*path, key)
        yield from places(part, (*path, key))


def spoilt(document: dict[str, Any], chance: random.Random) -> dict[str, Any]:
    """The document with one to three faults."""
    document = copy.deepcopy(document)
    for _ in range(chance.choice([1, 1, 1, 2, 3])):
        *path, last = chance.choice(list(places(document)))
        owner: Any = document
        for key in path:
            owner = owner[key]
        fault = chance.random()
        if fault < 0.2:
            del owner[last]
        elif fault < 0.3 and isinstance(owner, dict):
            owner[chance.choice(KEYS)] = copy.deepcopy(chance.choice(JUNK))
        else:
            owner[last] = copy.deepcopy(chance.choice(JUNK))
    return document


def refused(load: Callable[[], object]) -> bool:
    """Whether the file is refused; anything but an InputError is let through and fails the test."""
    with warnings.catch_warnings(), contextlib.suppress(InputError):
        warnings.simplefilter("ignore", ModelWarning)
        load()
        return False
    return True


def write(path: Path, document: dict[str, Any]) -> None:
    path.write_text("\n".join(f"{json.dumps(k)} = {toml(v)}" for k, v in document.items()), encoding="utf-8")


@pytest.mark.parametrize("text", [NATIVE, LOOP, URDF], ids=["native", "loop", "urdf"])
def test_any_mechanism(tmp_path: Path, text: str) -> None:
    chance, document = random.Random(7), tomllib.loads(text)
    count = 0
    for _ in range(ROUNDS):
        write(tmp_path / "mechanism.toml", spoilt(document, chance))
        count += refused(lambda: load_mechanism(tmp_path))
    assert count > 0.8 * ROUNDS  # most faults are faults; some junk happens to be a valid value


def test_any_cases(tmp_path: Path) -> None:
    (tmp_path / "mechanism.toml").write_text(NATIVE, encoding="utf-8")
    mechanism: Mechanism = load_mechanism(tmp_path)
    chance, document = random.Random(11), tomllib.loads(CASES)
    count = 0
    for _ in range(ROUNDS):
        write(tmp_path / "cases.toml", spoilt(document, chance))
        count += refused(lambda: load_cases(tmp_path, mechanism))
    assert count > 0.8 * ROUNDS


def test_any_urdf(tmp_path: Path) -> None:
    """Elements left out, doubled or renamed, attributes left out or replaced; many of them do not matter."""
    source = ElementTree.parse(find_robots_folder() / "panda_description" / "urdf" / "panda.urdf")
    chance, path, count = random.Random(13), tmp_path / "robot.urdf", 0
    for _ in range(ROUNDS):
        root = copy.deepcopy(source.getroot())
        owner = chance.choice([e for e in root.iter() if len(e) and e.tag in ("robot", "link", "joint", "inertial")])
        part, fault = chance.choice(list(owner)), chance.random()
        if fault < 0.2:
            owner.remove(part)
        elif fault < 0.4:
            owner.append(copy.deepcopy(chance.choice(list(root.iter()))))
        elif part.attrib:
            part.set(
                chance.choice(list(part.attrib)), chance.choice(["", "nan", "1e400", "0 0", "-1", "x", "world", "\n"])
            )
        else:
            part.tag = "joint"
        path.write_text(ElementTree.tostring(root, encoding="unicode"), encoding="utf-8")
        count += refused(lambda: from_urdf(path))
    assert 0.2 * ROUNDS < count < ROUNDS
