"""Identification: from a log of any mechanism to parameters with intervals, torques with bands, and causes of what remains."""
