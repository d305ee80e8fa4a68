"""Goals of the action follow_joint_trajectory, and an ordinary client for them."""

import actionlib
import rospy
from actionlib_msgs.msg import GoalStatus
from control_msgs.msg import (
    FollowJointTrajectoryAction,
    FollowJointTrajectoryGoal,
    JointTolerance,
)
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from .ros_testing import Connected, wait_for

NAMES = ("PENDING", "ACTIVE", "PREEMPTED", "SUCCEEDED", "ABORTED", "REJECTED", "LOST")
STATES = {getattr(GoalStatus, name): name for name in NAMES}


def goal_of(points, velocities=None, stamp=0.0, **fields):
    """Make a goal.

    Args:
        points: By the time from the start in [s], the position of each joint by name.
        velocities: The velocities of each point, likewise; None: there are none.
        stamp: When the times count from, in [s]; 0: at once.
        fields: Others of the goal.
    """
    names = [*next(iter(points.values()))] if points else []
    trajectory = JointTrajectory(joint_names=names)
    trajectory.header.stamp = rospy.Time.from_sec(stamp)
    for number, (time, positions) in enumerate(points.items()):
        point = JointTrajectoryPoint(positions=[*positions.values()])
        if velocities:
            point.velocities = [*velocities[number]]
        point.time_from_start = rospy.Duration.from_sec(time)
        trajectory.points.append(point)
    return FollowJointTrajectoryGoal(trajectory=trajectory, **fields)


def tolerance(name, position=0.0, velocity=0.0):
    """Make the tolerances of one joint."""
    return [JointTolerance(name=name, position=position, velocity=velocity)]


class Client:
    """actionlib's client of one action, and the feedback that came."""

    def __init__(self, action):
        self._client = actionlib.SimpleActionClient(action, FollowJointTrajectoryAction)
        assert self._client.wait_for_server(rospy.Duration(0)), action
        self.feedback = []

    def send(self, goal):
        self.feedback = []
        self._client.send_goal(goal, feedback_cb=self.feedback.append)

    def wait_until_active(self):
        """Wait until the goal is accepted; on a busy machine it may be done by then."""
        wait_for(lambda: self.state != "PENDING", "an answer to the goal")
        assert self.state in ("ACTIVE", "SUCCEEDED"), self.state

    def cancel(self):
        self._client.cancel_goal()

    @property
    def state(self):
        return STATES[self._client.get_state()]

    def end(self):
        """Wait for the end of the goal; give its state and result."""
        wait_for(self._client.get_result, "the end of the goal")
        return self.state, self._client.get_result()

    def run(self, goal):
        """Send a goal and wait for its end."""
        self.send(goal)
        return self.end()


class Joints:
    """The joint states of a robot, by the time of each."""

    def __init__(self, namespace=""):
        self._states = Connected(f"{namespace}/joint_states", JointState)

    def clear(self):
        self._states.clear()

    def close(self):
        self._states.close()

    @property
    def messages(self):
        return [*self._states.messages]

    def wait(self, what, **positions):
        """Wait for joints at positions, within 1e-9."""
        return self._states.wait(
            lambda m: all(
                abs(m.position[m.name.index(name)] - position) < 1e-9
                for name, position in positions.items()
            ),
            what,
        )

    def next(self):
        """Wait for the next message."""
        self._states.clear()
        return Snapshot(self._states.wait())

    def forget(self, time):
        """Wait for the first message before a time in [s], then forget all until it."""
        self._states.wait(lambda m: m.header.stamp.to_sec() < time)
        self._states.clear()

    def at(self, time):
        """Wait for the first message of a time in [s], or later."""
        return Snapshot(self._states.wait(lambda m: m.header.stamp.to_sec() >= time))


class Snapshot:
    """One message."""

    def __init__(self, message):
        self.stamp = message.header.stamp.to_sec()
        self.position = dict(zip(message.name, message.position))
        self.velocity = dict(zip(message.name, message.velocity))
