"""Accuracy instead of a step: steps, mesh and extrapolation chosen so that results are as exact as was asked."""
