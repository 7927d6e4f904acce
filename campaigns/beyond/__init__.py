"""Faults beyond the dictionary: what users get wrong, planted in real engines, and what the checker makes of it."""
