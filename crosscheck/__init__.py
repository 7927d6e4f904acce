"""crosscheck: one mechanism in several engines, each built from primary data, compared quantity by quantity and judged."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from crosscheck.identification.identify import identify

__all__ = ["identify"]


def __getattr__(name: str) -> Any:
    """Import a public function when it is first used: who compares engines does not wait for the compiler."""
    if name in __all__:
        from crosscheck.identification.identify import identify

        return identify
    raise AttributeError(f"module 'crosscheck' has no attribute {name!r}")
