"""Shared parts of the commands: options, the terminal, exit codes."""
