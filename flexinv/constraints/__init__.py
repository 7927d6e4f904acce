"""Closed loops: constraint equations, continuation, impacts, reactions, and allocation of efforts to actuators."""
