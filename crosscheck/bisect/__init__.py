"""Bisect: the release of a package from which on a script or a case of ours gives something else."""
