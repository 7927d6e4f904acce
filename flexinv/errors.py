"""The exceptions that flexinv raises: each message says what was given, what was expected and what to write."""

from __future__ import annotations


class FlexinvError(Exception):
    """Base of every error that flexinv raises on purpose."""


class InputError(FlexinvError, ValueError):
    """A file, a table, a key or an argument is not what it has to be."""


class ConvergenceError(FlexinvError, RuntimeError):
    """Newton did not converge; the message names the time, the residual and what to try."""


class OpenLoops(ConvergenceError):
    """The loops do not close from a configuration: what is said of it, and what to do.

    example : joints and places from which they close, in words, "" where none was found: a verb or a command whose configuration
        has another name than ``start`` says with it what to write
    """

    def __init__(self, text: str, advice: str, example: str = "") -> None:
        """Keep the parts apart."""
        super().__init__(text, advice, example)
        self.said = text
        self.advice = advice
        self.example = example

    def __str__(self) -> str:
        """Return the statement and the advice in one sentence."""
        return f"{self.said}; {self.advice}"

    def replace_advice(self, advice: str) -> OpenLoops:
        """Return the same with another advice where another place closes the loops; else what they lack stands as it is."""
        return (
            OpenLoops(self.said, f"{advice} (they close near {self.example})", self.example) if self.example else self
        )


class ModelWarning(UserWarning):
    """The model was accepted, but something in it was changed or deserves a look."""
