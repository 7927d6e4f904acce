"""The library of a mechanism with beams: the steps of a controller, and where it begins."""
