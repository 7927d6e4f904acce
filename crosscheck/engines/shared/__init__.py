"""Shared parts of the engines' adapters: loop closure, wrenches, phases, exports; no engine is imported here."""
