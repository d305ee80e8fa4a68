"""Mass in motion: centre of mass, Jacobians, inverse dynamics."""
