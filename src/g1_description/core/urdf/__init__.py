"""URDF documents."""
