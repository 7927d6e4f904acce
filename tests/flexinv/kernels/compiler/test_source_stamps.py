"""Kept machine code never outlives the sources it was made of."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from flexinv.kernels.compiler.source_stamps import compute_source_stamp, list_family, list_sources

FOLDER = Path(__file__).resolve().parents[4] / "flexinv"
SOURCES = list_sources(FOLDER)


def path_of(folder: Path, module: str) -> Path:
    return folder.joinpath(*module.split(".")).with_suffix(".py")


def test_every_module_with_kernels_is_a_source() -> None:
    files = {path for path in FOLDER.rglob("*.py") if "from flexinv.kernels.jit import" in path.read_text()}
    using = {".".join(path.relative_to(FOLDER).with_suffix("").parts) for path in files}
    assert len(using) > 30  # the test looks at something
    assert using <= set(SOURCES), using - set(SOURCES)


@pytest.mark.parametrize("name", SOURCES)
def test_a_change_of_a_source_changes_the_stamps_of_the_kernels_that_hold_it(name: str, tmp_path: Path) -> None:
    """And no other: who edits the march does not wait for the rigid kernel, nor the other way round."""
    for source in SOURCES:
        copy = path_of(tmp_path, source)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path_of(FOLDER, source), copy)
    with path_of(tmp_path, name).open("a") as file:
        file.write("# changed")
    changed = {m for m in (*SOURCES, "outside") if compute_source_stamp(tmp_path, m) != compute_source_stamp(FOLDER, m)}
    assert changed == {m for m in (*SOURCES, "outside") if name in list_family(m, FOLDER)}


def test_families() -> None:
    """The rigid kernel, the march, its planar form and the loops that are followed have little in common."""
    rigid, march, loops = (
        set(list_family(m, FOLDER)) for m in ("rigid.blocks", "dynamics.stepper", "constraints.continuation_kernel")
    )
    planar = {name for name in SOURCES if name.startswith("planar.")}
    rnea = {name for name in SOURCES if name.startswith("rnea.")}
    made_by = {
        "kernels.jit",
        *(f"kernels.compiler.{name}" for name in ("arrays", "code_cache", "kernel_compiler", "record_types")),
    }
    compiler = made_by | {"kernels.records", "kernels.vec3", "kernels.so3"}
    assert rigid == {
        "rigid.blocks", "elements.joint_law", "kernels.threads.atomics", "kernels.simd",
        "kernels.threads.worker_pool", "kernels.vec3", "model.joint_kinds", *made_by, *rnea,
    }  # fmt: skip
    assert march >= compiler | {
        "dynamics.assembly", "elements.beam", "dynamics.tree_solver", "dynamics.generalized_alpha", "dynamics.stepper",
        "kinematics.tree",
    }  # fmt: skip
    assert not march & {
        "rigid.blocks",
        "constraints.continuation_kernel",
        "kernels.simd",
        "linearized.rest_position",
        *rnea,
        *planar,
    }
    assert planar | {"kernels.simd", "dynamics.generalized_alpha"} <= set(list_family("planar.stepper", FOLDER))
    assert {"kernels.so3", "kernels.vec3"} <= set(list_family("elements.beam", FOLDER))  # all names of an import count
    assert loops == compiler | {
        "constraints.continuation_kernel", "constraints.equations", "kernels.fronts", "kernels.sparse_qr",
        "kinematics.configuration",
        "kinematics.tree", "model.joint_kinds",
    }  # fmt: skip
    assert list_family("outside", FOLDER) == SOURCES  # a kernel outside the project may call any


def test_kernels_carry_the_stamp() -> None:
    """What Numba compares before it takes code from the disk: with the function's own file, the stamp of its family."""
    from flexinv.dynamics.stepper import integrate_instants
    from flexinv.rigid.blocks import compute_torque_blocks

    assert integrate_instants._cache._cache_file._source_stamp[1] == compute_source_stamp(FOLDER, "dynamics.stepper")
    assert compute_torque_blocks._cache._cache_file._source_stamp[1] == compute_source_stamp(FOLDER, "rigid.blocks")
