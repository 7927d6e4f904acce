"""Meshed parts: solid elements, what ties interfaces, Craig-Bampton reduction, and the point masses that move alike."""
