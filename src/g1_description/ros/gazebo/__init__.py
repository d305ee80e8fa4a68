"""The stand-in's node /gazebo."""
