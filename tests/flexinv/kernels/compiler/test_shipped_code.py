"""Machine code that came along: used where all agrees, else left alone, said once, and never run."""

from __future__ import annotations

import json
import sys
import warnings
from collections.abc import Callable, Iterator
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import pytest

from flexinv.kernels.compiler import shipped_code
from flexinv.kernels.compiler.shipped_code import INDEX, LEVELS, list_processor_levels, write_shipped

MODULE = """
from flexinv.kernels.jit import jit

@jit
def thrice(x):
    return 3.0 * x
"""
Load = Callable[[], Any]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of machine code for this processor, with the kernel `thrice`, that the package seems to bring along."""
    monkeypatch.setattr(shipped_code, "MACHINE_CODE", tmp_path / "machine_code")
    monkeypatch.setattr(shipped_code, "_told", [])
    (level, *_) = list_processor_levels()
    kernel = loaded(tmp_path / "made", monkeypatch)
    assert kernel(2.0) == 6.0
    assert write_shipped(tmp_path / "machine_code" / level, [kernel]) == 1
    shipped_code._choose_folder.cache_clear()
    yield tmp_path / "machine_code" / level
    shipped_code._choose_folder.cache_clear()


def loaded(place: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """The kernel as a new process finds it, with nothing kept."""
    place.mkdir()
    (place / "tripled.py").write_text(MODULE)
    spec = spec_from_file_location("tripled", place / "tripled.py")
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "tripled", module)
    spec.loader.exec_module(module)
    return module.thrice


def compiled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> bool:
    """Whether a new process compiles the kernel, whose value must be right in any case."""
    kernel = loaded(tmp_path / "used", monkeypatch)
    assert kernel(2.0) == 6.0
    return not sum(kernel.stats.cache_hits.values())


def change(folder: Path, *keys: str, to: str) -> None:
    """Change one entry of the index."""
    index = json.loads((folder / INDEX).read_text())
    table = index
    for key in keys[:-1]:
        table = table[key] if key != "*" else next(iter(table.values()))
    table[keys[-1]] = to
    (folder / INDEX).write_text(json.dumps(index))


def test_machine_code_that_came_along_is_not_compiled_again(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not compiled(tmp_path, monkeypatch)


@pytest.mark.parametrize("what", ["python", "numba", "llvmlite", "system"])
def test_another_maker(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, what: str) -> None:
    change(folder, "maker", what, to="0.1")
    with pytest.warns(RuntimeWarning, match=f"not used: it was made by {what} 0.1, and this is") as said:
        assert compiled(tmp_path, monkeypatch)
    assert len(said) == 1


def test_changed_sources(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    change(folder, "kernels", "*", "stamp", to="older")
    with pytest.warns(RuntimeWarning, match="the sources of flexinv have been changed"):
        assert compiled(tmp_path, monkeypatch)


@pytest.mark.parametrize("left", [b"", b"\x80", None])
def test_a_damaged_file(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, left: bytes | None) -> None:
    (file,) = (path for path in folder.iterdir() if path.name != INDEX)
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2] if left is None else left)
    with pytest.warns(RuntimeWarning, match="is damaged: install flexinv again"):
        assert compiled(tmp_path, monkeypatch)


@pytest.mark.parametrize("left", ["", "{}", "[1]", '{"maker": 1, "kernels": 2}'])
def test_a_damaged_index(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, left: str) -> None:
    (folder / INDEX).write_text(left)
    with pytest.warns(RuntimeWarning, match="is damaged: install flexinv again"):
        assert compiled(tmp_path, monkeypatch)


def test_a_missing_file(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (file,) = (path for path in folder.iterdir() if path.name != INDEX)
    file.unlink()
    with pytest.warns(RuntimeWarning, match="is damaged"):
        assert compiled(tmp_path, monkeypatch)


def test_another_processor(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shipped_code, "list_processor_levels", lambda: [])
    with pytest.warns(RuntimeWarning, match=f"it is for {folder.name}, which this processor is not"):
        assert compiled(tmp_path, monkeypatch)


def test_a_user_who_asks_for_a_processor_gets_its_code(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shipped_code.config, "CPU_NAME", "generic")
    assert shipped_code._choose_folder(folder.parent)[1] == {}


def test_levels_of_processors() -> None:
    """By the features of the x86-64 psABI: one that misses any is of the level below."""
    assert list_processor_levels({}) == []
    assert list_processor_levels(dict.fromkeys(LEVELS["x86-64-v3"], True)) == ["x86-64-v3"]
    best = dict.fromkeys(LEVELS["x86-64-v4"], True)
    assert list_processor_levels(best) == ["x86-64-v4", "x86-64-v3"]
    for name in LEVELS["x86-64-v4"][-5:]:
        assert list_processor_levels(best | {name: False}) == ["x86-64-v3"]
    for name in LEVELS["x86-64-v3"]:
        assert list_processor_levels(best | {name: False}) == []
