"""Functional Mock-up Units: the exported library behind FMI 2.0 or 3.0 for co-simulation."""
