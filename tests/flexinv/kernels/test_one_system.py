"""Kernels are compiled once: the system of every mechanism, tree or loop, with beams or meshes, is of one type for them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexinv
from flexinv.kernels.dense import build_blocks
from flexinv.sensitivity.march_states import build_free_system

MODELS = Path(__file__).resolve().parents[3] / "models"
TREE = "flex_one_link"
OTHERS = ("spatial_arm", "slider_crank", "four_bar_flexible", "geared_four_bar", "four_bar_bracket", "stewart_platform")


def collect_types(record: Any, path: str = "system") -> dict[str, str]:
    """Numba's type of every array and number of nested records, by where it is."""
    numba = pytest.importorskip("numba")
    fields = getattr(record, "_fields", None) or tuple(getattr(type(record), "__dataclass_fields__", ()))
    if not fields:
        return {path: str(numba.typeof(record))}
    return {k: t for name in fields for k, t in collect_types(getattr(record, name), f"{path}.{name}").items()}


def find_types(name: str) -> dict[str, str]:
    mechanism = flexinv.load_mechanism(MODELS / name)
    case = next(iter(flexinv.load_cases(MODELS / name, mechanism).values()))
    return collect_types(build_free_system(mechanism, case.motion.joints(mechanism)).solver.system)


@pytest.mark.parametrize("name", OTHERS)
def test_trees_and_loops_share_their_kernels(name: str) -> None:
    """Half a minute of compiling each, where an array of one of them lies in memory in another order."""
    assert find_types(name) == find_types(TREE)


def test_another_order_in_memory_would_be_seen() -> None:
    blocks = build_blocks([1, 2], np.ones((1, 2), dtype=bool))
    turned = blocks._replace(entry=np.asfortranarray(blocks.entry))
    assert collect_types(blocks) != collect_types(turned)
