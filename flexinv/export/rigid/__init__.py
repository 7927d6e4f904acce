"""The library of a rigid mechanism: the torques of many samples, their terms, and what loops and springs add."""
