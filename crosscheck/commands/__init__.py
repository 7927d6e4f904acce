"""The commands of ``crosscheck``: one file each, named as the command (``_`` for ``-``), with a ``command`` in it.

A new command is a new file: `crosscheck.cli` finds it by its name and imports it only when it is asked for.  What
several commands share (options, the failure with exit code 2, progress) is in `crosscheck.commands.shared.terminal`.
"""
