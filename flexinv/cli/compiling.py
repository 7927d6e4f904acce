"""Compilation note: one line on stderr when a first call has kernels to compile."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import click
from numba.core import event

NOTE = "flexinv: compiling kernels, up to a minute; the machine code is kept for the next time"


class _Note(event.Listener):
    """Writes one line when the first kernel is compiled, none where all are read from the disk."""

    told = False

    def on_start(self, event: event.Event) -> None:
        """Say so, once."""
        if not self.told:
            self.told = True
            click.echo(NOTE, err=True)

    def on_end(self, event: event.Event) -> None:
        """Nothing."""


@contextmanager
def telling() -> Iterator[None]:
    """Say on stderr when kernels are compiled in this block."""
    with event.install_listener("numba:compile", _Note()):
        yield
