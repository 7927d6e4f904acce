"""The parts of a library of one mechanism: its entries, the block that they work on, and the numbers that its C files name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from flexinv.errors import InputError
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
    tolerance : of the efforts, in parts of the largest one [-]
    """

    q: Array
    qd: Array
    qdd: Array
    tau: Array
    tolerance: float


@dataclass(frozen=True)
class LibraryPlan:
    """The parts of a library.

    kind : of the templates, "rigid" or "flexible"; entries : functions of machine code; image : the block of memory
    values : name in the templates -> text; golden : series for the self-test
    more : templates of what only some libraries of a kind have
    start : (nq,) position in which a flexible mechanism begins [rad], [m]; step : of its march [s]
    """

    kind: str
    mechanism: Mechanism
    entries: list[Entry]
    image: MemoryImage
    values: Mapping[str, str]
    golden: GoldenSeries
    more: tuple[str, ...] = ()
    start: Array | None = None
    step: float | None = None


def refuse_parts(mechanism: Mechanism, parts: Mapping[str, Sequence[Any]], instead: str) -> None:
    """Raise InputError [-] where a mechanism has parts for which there is no kernel that C may call.

    parts : kind of part -> those that the mechanism has; instead : what to call from Python
    """
    for kind, found in parts.items():
        if found:
            names = ", ".join(repr(one.name) for one in found)
            raise InputError(
                f"export_c: mechanism {mechanism.name!r} has {kind} ({names}), which the C library cannot take; call {instead} "
                "from Python, or export the mechanism without them"
            )
