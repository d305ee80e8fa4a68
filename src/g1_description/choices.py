"""Names and numbers that command lines and launch files offer; it needs no library."""

from __future__ import annotations

PHYSICS = ("kinematic", "hold", "limp")

GAZEBO = "/gazebo"
"""The name of the simulator, if no other is given."""

ENGINE_LIBRARIES = {"bullet": "PyBullet", "mujoco": "MuJoCo"}
"""The libraries of the physics engines."""

ENGINES = tuple(ENGINE_LIBRARIES)
"""The physics engines; the first one is the simulator's default."""

DEFAULT = "g1_29dof"
"""The profile of the robot that is used if no other is given."""

ZERO = "zero"
"""The pose of every robot with all joints at 0."""

MAX_PORT = 2**16 - 1
"""The largest number of a TCP port."""
