"""Kept machine code never outlives the sources it was made of."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from flexinv.sources import SOURCES, family, source_stamp

FOLDER = Path(__file__).resolve().parent.parent / "flexinv"


def test_every_module_with_kernels_is_a_source() -> None:
    using = {path.stem for path in FOLDER.glob("*.py") if "from flexinv.compiled import" in path.read_text()}
    assert using <= set(SOURCES), using - set(SOURCES)


@pytest.mark.parametrize("name", SOURCES)
def test_a_change_of_a_source_changes_the_stamps_of_the_kernels_that_hold_it(name: str, tmp_path: Path) -> None:
    """And no other: who edits the march does not wait for the rigid kernel, nor the other way round."""
    for source in SOURCES:
        shutil.copy(FOLDER / f"{source}.py", tmp_path)
    with (tmp_path / f"{name}.py").open("a") as file:
        file.write("# changed")
    changed = {m for m in (*SOURCES, "kernels") if source_stamp(tmp_path, m) != source_stamp(FOLDER, m)}
    assert changed == {m for m in (*SOURCES, "kernels") if name in family(m, FOLDER)}


def test_families() -> None:
    """The rigid kernel, the march, its planar form and the loops that are followed have little in common."""
    rigid, march, loops = (set(family(module, FOLDER)) for module in ("blocks", "march", "branch"))
    planar = {name for name in SOURCES if name.startswith("planar")}
    loop_lanes = {name for name in SOURCES if name.startswith("loop_")}
    assert rigid == {"atomics", "blocks", "compiled", "kinds", "lanes", "offers", "recursion"} | loop_lanes
    assert march >= {"assemble", "beam", "compiled", "eliminate", "integrate", "march", "rotations", "tree", "vectors"}
    assert not march & {"blocks", "branch", "lanes", "modes", "recursion", *planar}
    assert planar | {"lanes", "integrate"} <= set(family("planar_march", FOLDER))
    assert loops == {"branch", "compiled", "coordinates", "kinds", "rotations", "rows", "tree", "vectors"}
    assert family("kernels", FOLDER) == SOURCES  # a kernel outside the project may call any


def test_kernels_carry_the_stamp() -> None:
    """What Numba compares before it takes code from the disk: with the function's own file, the stamp of its family."""
    from flexinv.blocks import torque_blocks
    from flexinv.march import march

    assert march._cache._cache_file._source_stamp[1] == source_stamp(FOLDER, "march")
    assert torque_blocks._cache._cache_file._source_stamp[1] == source_stamp(FOLDER, "blocks")
