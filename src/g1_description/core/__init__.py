"""Robot mathematics: knows numpy and URDF, neither ROS nor PyBullet."""
