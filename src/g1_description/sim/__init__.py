"""The simulated world on PyBullet: knows core, not ROS."""
