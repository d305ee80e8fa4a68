"""Dynamics in PyBullet, which one module imports."""
