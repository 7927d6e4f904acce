"""Measurements of a machine as an engine."""
