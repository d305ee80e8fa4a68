"""What needs no ROS client library, no PyBullet and no clock."""
