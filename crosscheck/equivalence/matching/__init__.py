"""Matching of the joints of two machines: by names, by structure, and where the numbers in names count otherwise."""
