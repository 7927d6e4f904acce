"""Estimation: parameters of least cost with the noise that they leave, draws from the posterior, what is told together."""
