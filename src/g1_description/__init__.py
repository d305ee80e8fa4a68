"""A stand-in for Gazebo, a link-state bridge and a display for the Unitree G1."""
