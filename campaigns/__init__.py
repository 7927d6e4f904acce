"""Randomised runs that are too long for every test run; `campaigns/README.md` lists them."""
