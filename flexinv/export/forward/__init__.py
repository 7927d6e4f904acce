"""The library of a mechanism that torques move: the march of `flexinv.simulate`, step by step."""
