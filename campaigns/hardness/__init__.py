"""Hardness of exported C libraries: what they take of the system, what any call does to them, how many instructions, how fast."""
