"""Faults of meshes and matrices of parts, as engineers make them: planted, and refused or found by lint."""
