"""The services of /gazebo, by subject."""
