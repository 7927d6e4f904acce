"""Machine code on disk: read where it can be, and never a reason to stop."""

from __future__ import annotations

import gc
import pickle
import sys
from collections.abc import Callable
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numba
import pytest
from numba.core import caching
from numba.core.errors import TypingError

from flexinv.dynamics.stepper import integrate_instants

MODULE = """
from flexinv.kernels.jit import jit

@jit
def twice(x):
    return 2.0 * x
"""
MOVED = b"cflexinv.assemble\nGone\n."  # names a class that is no more


@pytest.fixture
def fresh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], Any]:
    """A kernel as a new process finds it."""
    (tmp_path / "doubled.py").write_text(MODULE)
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")  # beside the module, wherever the tests keep theirs

    def kernel() -> Any:
        spec = spec_from_file_location("doubled", tmp_path / "doubled.py")
        assert spec is not None
        assert spec.loader is not None
        module = module_from_spec(spec)
        monkeypatch.setitem(sys.modules, "doubled", module)
        spec.loader.exec_module(module)
        return module.twice

    return kernel


def was_kept(kernel: Any) -> bool:
    """Whether its machine code came from the disk."""
    assert kernel(3.0) == 6.0
    return bool(sum(kernel.stats.cache_hits.values()))


def test_kernels_of_the_project_are_kept() -> None:
    assert "forgiving" in integrate_instants._cache._cache_file._load_index.__qualname__
    assert "forgiving" in integrate_instants._cache._cache_file.load.__qualname__


@pytest.mark.parametrize("end", ["nbi", "nbc"])  # the index, and the machine code
@pytest.mark.parametrize("left", [b"", b"\x80", bytes(500), MOVED, None])
def test_what_cannot_be_read_is_made_again(
    fresh: Callable[[], Any], tmp_path: Path, end: str, left: bytes | None
) -> None:
    """Files that are empty, hold zeros or older classes, or end in the middle."""
    assert not was_kept(fresh())
    assert was_kept(fresh())
    (file,) = tmp_path.glob(f"__pycache__/*.{end}")
    whole, before = file.read_bytes(), pickle.dumps(numba.__version__) if end == "nbi" and left == MOVED else b""
    file.write_bytes(whole[: len(whole) // 2] if left is None else before + left)
    assert not was_kept(fresh())
    assert was_kept(fresh())


def test_a_full_disk_keeps_nothing(fresh: Callable[[], Any], monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(caching.IndexDataCacheFile, "_save_data", full)
    assert not was_kept(fresh())
    assert not was_kept(fresh())


def test_where_no_folder_can_be_written_to_it_is_told_and_compiled_every_time(
    fresh: Callable[[], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(caching.CacheImpl, "_locator_classes", [])
    with pytest.warns(RuntimeWarning, match="machine code cannot be kept: neither .* set NUMBA_CACHE_DIR to a folder"):
        kernel = fresh()
    assert not was_kept(kernel)


@pytest.mark.parametrize("collects", [True, False])
def test_compiling_leaves_the_collector_as_it_was(fresh: Callable[[], Any], collects: bool) -> None:
    """Also where the kernel cannot be compiled: a text is not doubled."""
    kernel = fresh()
    if not collects:
        gc.disable()
    try:
        assert kernel(3.0) == 6.0
        assert gc.isenabled() == collects
        with pytest.raises(TypingError):
            kernel("three")
        assert gc.isenabled() == collects
    finally:
        gc.enable()
