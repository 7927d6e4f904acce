"""Drives: what rotor and friction of a motor need, which law of friction the logs speak for, and what follows angles."""
