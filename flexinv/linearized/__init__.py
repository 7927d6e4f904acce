"""Small motions: natural modes, steady rotation, damping ratios, state space."""
