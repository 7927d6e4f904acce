"""Derivatives of a flexible inverse dynamics by the motion and by the data of the mechanism."""
