"""Frames on paths: inverse kinematics, collocation over a time window, stable inversion."""
