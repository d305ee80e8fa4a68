"""A robot: description, tree, kinematics, dynamics, URDF, named poses."""
