"""The parts of a library of one mechanism: its entries, the block that they work on, and the numbers that its C files name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from flexinv.export.machine_code import Entry
from flexinv.export.memory_image import MemoryImage
from flexinv.model.mechanism import Mechanism
from flexinv.typing import Array

BLOCK_HEADER = (
    64  # bytes that the C file keeps for itself at the beginning of the block: whose it is, and where it stands
)


@dataclass(frozen=True)
class GoldenSeries:
    """Motion and efforts that flexinv has computed, which the self-test replays.

    q : (samples, nq) [rad], [m]; qd, qdd, tau : (samples, nv) per second, [N m], [N]
    tolerance : of the efforts, in parts of the largest one [-]; phase : number of the closures that act at each sample, or ()
    """

    q: Array
    qd: Array
    qdd: Array
    tau: Array
    tolerance: float
    phase: tuple[int, ...] = ()


@dataclass(frozen=True)
class LibraryPlan:
    """The parts of a library.

    kind : of the templates, "rigid", "flexible" or "forward"; entries : functions of machine code; image : the block of memory
    values : name in the templates -> text; golden : series for the self-test, where there is one
    parts : templates of its header, source and page, in their order
    start : (nq,) position in which a flexible mechanism begins [rad], [m]; step : of its march [s]
    """

    kind: str
    mechanism: Mechanism
    entries: list[Entry]
    image: MemoryImage
    values: Mapping[str, str]
    golden: GoldenSeries | None
    parts: tuple[str, ...]
    start: Array | None = None
    step: float | None = None
