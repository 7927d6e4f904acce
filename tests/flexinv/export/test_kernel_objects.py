"""Kernels are translated once for all mechanisms that need the same ones, and one program takes libraries of several."""

from __future__ import annotations

import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from c_library import Block, needs_compiler
from rigid_trees import tree

import flexinv
from flexinv.export import kernel_objects
from flexinv.export.export_c import ExportedLibrary, export_c
from flexinv.export.machine_code import Processor
from flexinv.rnea.loop_plan import sample_configurations

pytestmark = needs_compiler


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where objects are kept here: no other test, and no run before, has left one."""
    return tmp_path_factory.mktemp("kept") / "kernels.o"


@pytest.fixture(autouse=True)
def kept_there(place: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Keep objects in a place of these tests, and list the kernels that are translated."""
    translated = list[str]()
    translate = kernel_objects._make_object

    def note(modules: Sequence[Any], names: Mapping[str, str], processor: Processor) -> bytes:
        translated.extend(names)
        return translate(modules, names, processor)

    monkeypatch.setattr(kernel_objects, "_find_place", lambda *_: place)
    monkeypatch.setattr(kernel_objects, "_make_object", note)
    return translated


@pytest.fixture(scope="module")
def first(place: Path, tmp_path_factory: pytest.TempPathFactory) -> ExportedLibrary:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kernel_objects, "_find_place", lambda *_: place)
        return export_c(replace(tree(), name="first"), tmp_path_factory.mktemp("first"))


def read_kernels(made: ExportedLibrary) -> bytes:
    return (made.folder / "lib" / "native" / f"{made.name}_kernels.o").read_bytes()


def test_another_mechanism_takes_the_kernels_that_are_kept(
    first: ExportedLibrary, kept_there: list[str], tmp_path: Path
) -> None:
    """None is translated again, and its torques are its own; both libraries fit into one program."""
    heavy = replace(tree(), name="second", gravity=(0.0, 0.0, -3.7))
    second = export_c(heavy, tmp_path / "second")
    assert kept_there == []
    assert read_kernels(second) == read_kernels(first)
    q = sample_configurations(heavy, 1)[0]
    rest = np.zeros(heavy.nv)
    tau = np.zeros(heavy.nv)
    assert Block(second).call("torque", q, rest, rest, tau) == "OK"
    assert np.array_equal(tau, flexinv.joint_torques(heavy, q, rest, rest))
    libraries = [made.folder / "lib" / "native" / f"lib{made.name}.a" for made in (first, second)]
    whole = "-Wl,--whole-archive", *libraries, "-Wl,--no-whole-archive"
    words = ["cc", "-shared", *whole, "-lm", "-o", tmp_path / "both.so"]
    subprocess.run(list(map(str, words)), check=True)


@pytest.mark.parametrize("spoil", [lambda code: code[:-1], lambda code: b"x" + code[1:], lambda code: b""])
def test_an_object_that_was_spoiled_or_is_of_other_kernels_is_made_again(
    first: ExportedLibrary, place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, spoil: Any
) -> None:
    whole = place.read_bytes()
    place.write_bytes(spoil(whole))
    made = list[bytes]()
    monkeypatch.setattr(kernel_objects, "_make_object", lambda *_: made.append(b"again") or read_kernels(first))
    again = export_c(replace(tree(), name="again"), tmp_path / "again")
    assert made == [b"again"]
    assert read_kernels(again) == read_kernels(first)
    assert place.read_bytes() == whole


def test_a_folder_that_cannot_be_written_to_costs_time_only(
    first: ExportedLibrary, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kernel_objects, "_find_place", lambda *_: tmp_path / "missing" / "kernels.o")
    monkeypatch.setattr(kernel_objects, "_make_object", lambda *_: read_kernels(first))
    assert read_kernels(export_c(replace(tree(), name="unkept"), tmp_path / "unkept")) == read_kernels(first)
