"""The simulated world, backed by PyBullet."""
