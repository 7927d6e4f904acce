"""Kept machine code never outlives the sources it was made of."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from flexinv.compiled import SOURCES, source_stamp

FOLDER = Path(__file__).resolve().parent.parent / "flexinv"


def test_every_module_with_kernels_is_a_source() -> None:
    using = {path.stem for path in FOLDER.glob("*.py") if "from flexinv.compiled import" in path.read_text()}
    assert using <= set(SOURCES), using - set(SOURCES)


@pytest.mark.parametrize("name", SOURCES)
def test_a_change_of_any_source_changes_the_stamp(name: str, tmp_path: Path) -> None:
    for source in SOURCES:
        shutil.copy(FOLDER / f"{source}.py", tmp_path)
    assert source_stamp(tmp_path) == source_stamp(FOLDER)
    with (tmp_path / f"{name}.py").open("a") as file:
        file.write("# changed")
    assert source_stamp(tmp_path) != source_stamp(FOLDER)


def test_kernels_carry_the_stamp() -> None:
    """What Numba compares before it takes code from the disk: with the function's own file, the stamp of all."""
    from flexinv.march import march

    assert march._cache._cache_file._source_stamp[1] == source_stamp(FOLDER)
