#!/usr/bin/python3
"""A planner that moves joints to a goal in straight lines.

Subscribed: goal, joint_states (sensor_msgs/JointState)
Published: joint_trajectory (trajectory_msgs/JointTrajectory)
Parameters: ~speed, the largest joint speed in [rad/s]
"""

import rospy
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

RATE = 50.0  # [Hz] of the points
PEAK = 1.875  # largest speed of a minimum-jerk motion, as a multiple of its mean


class ReachPlanner:
    """Plans a way from where the joints are to where they shall be."""

    def __init__(self):
        """Advertise and subscribe."""
        self._speed = rospy.get_param("~speed", 1.0)
        self._plans = rospy.Publisher("joint_trajectory", JointTrajectory, queue_size=1)
        rospy.Subscriber("goal", JointState, self._on_goal)

    def _on_goal(self, message):
        goal = dict(zip(message.name, message.position))
        state = rospy.wait_for_message("joint_states", JointState)
        start = dict(zip(state.name, state.position))
        missing = [name for name in goal if name not in start]
        if missing:
            rospy.logwarn("Nothing is known of %s.", ", ".join(missing))
            return
        self._plans.publish(plan(start, goal, self._speed))


def plan(start, goal, speed):
    """Plan a minimum-jerk motion.

    Args:
        start: Positions by joint, in [rad].
        goal: Those of the joints to move.
        speed: The largest one of any joint, in [rad/s].

    Returns:
        A trajectory_msgs/JointTrajectory.
    """
    way = {name: goal[name] - start[name] for name in goal}
    seconds = PEAK * max(map(abs, way.values())) / speed
    n_steps = max(1, round(seconds * RATE))
    trajectory = JointTrajectory(joint_names=list(goal))
    for step in range(n_steps + 1):
        s = step / n_steps
        share = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        point = JointTrajectoryPoint()
        point.positions = [start[name] + share * way[name] for name in goal]
        point.time_from_start = rospy.Duration(step / RATE)
        trajectory.points.append(point)
    return trajectory


if __name__ == "__main__":
    rospy.init_node("reach_planner")
    ReachPlanner()
    rospy.spin()
