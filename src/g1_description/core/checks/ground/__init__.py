"""The robot and the floor: what bears, sinks in, floats or slides."""
