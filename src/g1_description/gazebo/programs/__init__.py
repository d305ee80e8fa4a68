"""Executables of gazebo_ros, and commands of the launch files."""
