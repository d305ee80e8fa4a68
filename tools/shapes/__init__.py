"""The G1's shapes, from the dimensions in urdf/g1_29dof_shapes.yaml to meshes."""
