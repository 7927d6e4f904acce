"""Lifting: a file, or a model in memory, as a mechanism and a list of what the mechanism cannot say of it."""
