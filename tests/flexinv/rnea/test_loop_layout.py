"""Records in rows of the work space: no name lies over another, and a layout that would is refused."""

from __future__ import annotations

import pytest

from flexinv.kernels.simd import BLOCK
from flexinv.rnea import loop_layout
from flexinv.rnea.loop_layout import RowLayout

LAYOUTS = {name: value for name, value in vars(loop_layout).items() if isinstance(value, RowLayout)}


@pytest.mark.parametrize("name", LAYOUTS)
def test_every_row_of_a_record_has_one_name(name: str) -> None:
    layout = LAYOUTS[name]
    begins = [*layout.first.values(), layout.size]
    assert begins[0] == 0
    assert begins == sorted(set(begins))
    assert [int(layout[each]) for each in layout.first] == [BLOCK * first for first in begins[:-1]]


def test_kinds_of_closures_share_what_all_of_them_have_and_fit_before_the_vectors() -> None:
    kinds = [LAYOUTS[name] for name in ("_GAP_CLOSURE", "_REDUCED_CLOSURE", "_COUPLED_CLOSURE")]
    common = LAYOUTS["_CLOSURE"]
    assert all(kind.first[name] == first for kind in kinds for name, first in common.first.items())
    assert max(kind.size for kind in kinds) * BLOCK == int(loop_layout.VECTORS)


def test_a_name_over_another_is_refused() -> None:
    with pytest.raises(ValueError, match="row gap is laid out twice"):
        RowLayout(RowLayout(gap=3), gap=1)
    with pytest.raises(ValueError, match="row gap has 0 rows, expected 1 or more"):
        RowLayout(gap=0)
