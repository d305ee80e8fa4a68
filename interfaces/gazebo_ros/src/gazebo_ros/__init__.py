"""What Python nodes import from gazebo_ros."""
