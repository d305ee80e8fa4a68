"""A stand-in for Gazebo, a link-state bridge and a display for the Unitree G1."""

from pkgutil import extend_path

# The generated services, g1_description.srv, lie in another folder of this name.
__path__ = extend_path(__path__, __name__)
