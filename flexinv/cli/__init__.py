"""The command line: ``flexinv COMMAND``."""
