"""Findings in a description: their form, and those in the inertias of bodies."""
