"""Programs that gazebo_ros has: gzserver, gzclient, spawn_model."""
