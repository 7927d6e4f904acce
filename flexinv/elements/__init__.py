"""The beam element: quadrature, strains, nodal forces and their tangents, in space and in the plane."""
