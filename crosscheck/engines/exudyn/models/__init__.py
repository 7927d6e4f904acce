"""Models in time that Exudyn gets: layout, bodies, beams and connectors, in the plane and in space."""
