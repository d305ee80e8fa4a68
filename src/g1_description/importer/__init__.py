"""The import of robots from elsewhere: core and trimesh, not ROS, not PyBullet."""
