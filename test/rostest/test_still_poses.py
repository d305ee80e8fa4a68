"""The command pose where simulated time, or the robot, stands still."""

import unittest
import xml.etree.ElementTree as ET

import rospy
from g1_description.srv import PlayMotion, PlayMotionResponse
from sensor_msgs.msg import JointState
from support.pose_command import KNEE, POSES, run, start
from support.ros_testing import DEADLINE, Listener, Repeated

PERIOD = 0.02
"""Of joint states in [s]."""


class Frozen:
    """A robot that obeys at once; all its joint states have the same stamp."""

    def __init__(self, namespace, obeys=True):
        self.namespace = namespace
        self.runs = False
        self._stamp = rospy.Time(7)
        joints = ET.fromstring(rospy.get_param("/robot_description")).iter("joint")
        self.positions = {
            j.get("name"): 0.0 for j in joints if j.get("type") != "fixed"
        }
        topic = f"/{namespace}/joint_states"
        self._states = rospy.Publisher(topic, JointState, queue_size=10)
        self._commands = rospy.Subscriber(
            f"/{namespace}/joint_commands", JointState, self._obey if obeys else None
        )
        self._way = None
        self._motions = rospy.Service(
            f"/{namespace}/play_motion", PlayMotion, self._follow
        )
        self._repeated = Repeated(self._show, PERIOD)

    def _obey(self, message):
        self.positions.update(zip(message.name, message.position))

    def _follow(self, request):
        self._way = request.motion.joint_trajectory, self._stamp
        return PlayMotionResponse(True, "", self._stamp)

    def _show(self):
        if self.runs:
            self._stamp += rospy.Duration(PERIOD)
        if self._way:
            (message, begin) = self._way
            last = message.points[-1]
            if self._stamp >= begin + last.time_from_start:
                self.positions.update(zip(message.joint_names, last.positions))
        message = JointState(
            name=[*self.positions], position=[*self.positions.values()]
        )
        message.header.stamp = self._stamp
        self._states.publish(message)

    def close(self):
        self._repeated.close()
        self._commands.unregister()
        self._motions.shutdown()
        self._states.unregister()


class TestStillPoses(unittest.TestCase):
    def test_a_jump_is_there_at_once_while_time_stands_still(self):
        frozen = Frozen("frozen_jump")
        self.addCleanup(frozen.close)
        jump = run("squat", "--namespace", frozen.namespace)
        self.assertEqual(jump, (0, "pose: squat\n", ""))
        self.assertEqual(frozen.positions[KNEE], POSES["squat"][KNEE])

    def test_a_way_waits_while_time_stands_still_and_says_so(self):
        frozen = Frozen("frozen_way")
        self.addCleanup(frozen.close)
        process = start("squat", "--seconds", 2, "--namespace", frozen.namespace)
        self.addCleanup(process.kill)
        told = process.stdout.readline()
        self.assertEqual(told, "pose: waiting: simulated time stands still at 7 s.\n")
        self.assertEqual(frozen.positions[KNEE], 0.0)
        frozen.runs = True
        output, errors = process.communicate(timeout=DEADLINE)
        self.assertEqual((output, errors), ("pose: squat\n", ""))

    def test_what_does_not_happen_is_told(self):
        """All at once, as each waits long: no states, no obedience, no bridge."""
        self.addCleanup(Listener("/silent/joint_commands", JointState).close)
        deaf = Frozen("deaf", obeys=False)
        self.addCleanup(deaf.close)
        asked = (
            (["squat"], "silent"),
            (["squat"], "deaf"),
            (["squat"], "nobody"),
        )
        running = [start(*words, "--namespace", space) for words, space in asked]
        done = [process.communicate(timeout=DEADLINE) for process in running]
        self.assertEqual([process.returncode for process in running], [1] * 3)
        for (_, space), (output, errors) in zip(asked, done):
            quiet = f"no messages on /{space}/joint_states; is a simulator running"
            stands = "simulated time stands still at 7 s"
            waiting = f"pose: waiting: {stands if space == 'deaf' else quiet}"
            self.assertTrue(output.startswith(waiting), output)
            self.assertEqual(len(output.splitlines()), 1)
            # rospy may tell of a connection that the end of another one broke.
            own = [line for line in errors.splitlines() if "[WARN]" not in line]
            self.assertEqual(len(own), 1, errors)
            if space == "silent":
                self.assertIn(quiet, errors)
        self.assertIn("left_knee_joint at 0 instead of 2.35 rad", done[1][1])
        self.assertIn("; simulated time stands still.", done[1][1])
        self.assertIn("Nothing subscribes to /nobody/joint_commands", done[2][1])
