"""Thresholds of the causes: what each is worth, by halving and doubling it while known faults are planted."""
