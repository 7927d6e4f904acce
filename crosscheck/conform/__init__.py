"""Conformance of one engine: a ladder of small mechanisms, each harder than the one before, and which of its rungs hold."""
