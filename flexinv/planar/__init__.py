"""Time integration in a plane, three degrees of freedom a node: the same parts as in `flexinv.dynamics`."""
