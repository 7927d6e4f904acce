"""Responses: what a mechanism answers to a measured motion, by the free parameters; below the bandwidth and above it."""
