"""The command line: ``flexinv COMMAND``."""

from flexinv.cli.commands import main

__all__ = ["main"]
