"""flexinv as one engine among the others."""
