"""Motions that are chosen: the shortest, the quietest or the one that asks least of its drives, within limits."""
