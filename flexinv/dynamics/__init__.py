"""Time integration in space: degrees of freedom, assembly, tree solver, constraints, generalized-alpha, start."""
