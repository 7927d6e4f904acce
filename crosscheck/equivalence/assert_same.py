"""assert_same: a test of one line that two descriptions are the same machine."""

from __future__ import annotations

from typing import Any

from crosscheck.equivalence.compare import compare
from crosscheck.equivalence.output.text import render_text
from crosscheck.equivalence.result import Comparison


def assert_same(a: Any, b: Any, **options: Any) -> Comparison:
    """Raise AssertionError with every difference where two descriptions are not the same machine; return the comparison.

    a, b, options : of `compare`
    """
    __tracebackhide__ = True
    comparison = compare(a, b, **options)
    if not comparison.equal:
        raise AssertionError(render_text(comparison))
    return comparison
