"""Inverse dynamics of rigid bodies over SIMD lanes: recursive Newton-Euler, and closed loops whose whole motion is given."""
