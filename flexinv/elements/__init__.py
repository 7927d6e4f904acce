"""The beam element (quadrature, strains, nodal forces and their tangents, in space and in the plane) and the law of a joint."""
