"""What moves a robot by hand: sliders, poses, a gizmo."""
