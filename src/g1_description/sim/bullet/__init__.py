"""The only room that talks to PyBullet's dynamics."""
