"""The exceptions that flexinv raises: each message says what was given, what was expected and what to write."""

from __future__ import annotations


class FlexinvError(Exception):
    """Base of every error that flexinv raises on purpose."""


class InputError(FlexinvError, ValueError):
    """A file, a table, a key or an argument is not what it has to be."""


class ConvergenceError(FlexinvError, RuntimeError):
    """Newton did not converge; the message names the time, the residual and what to try."""


class ModelWarning(UserWarning):
    """The model was accepted, but something in it was changed or deserves a look."""
