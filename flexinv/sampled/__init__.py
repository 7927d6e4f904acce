"""Efforts of motions in files: samples in parts, compared with themselves, differentiated, and computed in bulk."""
