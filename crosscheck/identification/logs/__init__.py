"""Logs of machines: read from files, and doubted in words."""
