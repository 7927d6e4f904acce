"""The exceptions that flexinv raises: each message says what was given, what was expected and what to write."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache


class FlexinvError(Exception):
    """Base of every error that flexinv raises on purpose."""


class InputError(FlexinvError, ValueError):
    """A file, a table, a key or an argument is not what it has to be."""


class ConvergenceError(FlexinvError, RuntimeError):
    """Newton did not converge; the message names the time, the residual and what to try."""


class TooFewElements(ConvergenceError):
    """An element bends further than its nodes can follow: shorter steps do not help, more elements do."""


class OpenLoops(ConvergenceError):
    """The loops do not close from a configuration: what is said of it, and what to do.

    find_advice : returns the advice, and joints and places from which they close, in words, "" where none is found: a verb or a
        command whose configuration has another name than ``start`` says with them what to write.  It is called when somebody
        reads them, as it searches for such places: whoever tries many machines, of which some do not close, does not wait for it.
    """

    def __init__(self, text: str, find_advice: Callable[[], tuple[str, str]]) -> None:
        """Keep the parts apart."""
        super().__init__(text, find_advice)
        self.said = text
        self.find_advice = cache(find_advice)

    @property
    def advice(self) -> str:
        """The advice, in words."""
        return self.find_advice()[0]

    @property
    def example(self) -> str:
        """Joints and places from which the loops close, "" where none was found."""
        return self.find_advice()[1]

    def __str__(self) -> str:
        """Return the statement and the advice in one sentence."""
        return f"{self.said}; {self.advice}"

    def __repr__(self) -> str:
        """Return the class and the sentence."""
        return f"{type(self).__name__}({str(self)!r})"

    def __reduce__(self) -> tuple[Callable[..., OpenLoops], tuple[str, str, str]]:
        """Return words for another process, since the search would need the mechanism there."""
        return _make_open_loops, (self.said, self.advice, self.example)

    def replace_advice(self, advice: str) -> OpenLoops:
        """Return the same with another advice where another place closes the loops; else what they lack stands as it is."""
        if not self.example:
            return self
        return _make_open_loops(self.said, f"{advice} (they close near {self.example})", self.example)


def _make_open_loops(said: str, advice: str, example: str) -> OpenLoops:
    """The error with words that were found before."""
    return OpenLoops(said, lambda: (advice, example))


class ModelWarning(UserWarning):
    """The model was accepted, but something in it was changed or deserves a look."""
