"""What Gazebo 11 was observed to do, and the same done with the stand-in."""
