"""A height with noise that nobody has given a seed."""

import random

import mujoco

print("height", 0.2 + 0.01 * random.random(), mujoco.__version__)
