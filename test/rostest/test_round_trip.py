"""Commands come back as joint states, to the last digit; bad ones are told."""

import subprocess
import unittest

import numpy as np
import rospy
from sensor_msgs.msg import JointState
from support.joint_limits import limits
from support.ros_testing import Listener, NodeLog, position_of, wait_for


class TestRoundTrip(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.commands = rospy.Publisher("/joint_commands", JointState, queue_size=100)
        cls.states = Listener("/joint_states", JointState)
        cls.log = NodeLog("/link_states_bridge")
        cls.states.wait()
        wait_for(cls.commands.get_num_connections, "the bridge to listen")
        cls.names, (cls.lower, cls.upper) = limits()

    def command(self, names, positions):
        self.states.clear()
        self.commands.publish(JointState(name=names, position=positions))

    def position(self, name):
        return position_of(self.states.messages[-1], name)

    def test_random_configurations_come_back(self):
        """The largest error is below 1e-9 rad; it is printed."""
        random = np.random.default_rng(0)
        worst = 0.0
        for _ in range(30):
            wanted = random.uniform(self.lower, self.upper)
            self.command(self.names, wanted.tolist())

            def error(message, wanted=wanted):
                return np.abs(np.array(message.position) - wanted).max()

            arrived = self.states.wait(lambda m: error(m) < 1e-3, "the configuration")
            self.assertEqual(arrived.name, self.names)
            worst = max(worst, error(arrived))
        print(f"largest error of 30 configurations: {worst:.3g} rad")
        self.assertLess(worst, 1e-9)

    def test_a_command_typed_in_a_shell_arrives(self):
        command = "{name: [left_elbow_joint], position: [0.75]}"
        self.states.clear()
        subprocess.run(
            ["rostopic", "pub", "-1", self.commands.name, JointState._type, command],
            check=True,
            stdout=subprocess.DEVNULL,
        )
        index = self.names.index("left_elbow_joint")
        self.states.wait(lambda m: abs(m.position[index] - 0.75) < 1e-9, "the elbow")

    def test_many_commands_at_once_all_count(self):
        """Each names one joint; the newest of each wins, none is lost."""
        goal = dict(zip(self.names, 0.5 * self.lower + 0.5 * self.upper))
        for share in (0.1, 0.9, 0.5):
            for name, low, high in zip(self.names, self.lower, self.upper):
                self.commands.publish(
                    JointState(name=[name], position=[low + share * (high - low)])
                )
        wanted = np.array([goal[name] for name in self.names])
        self.states.wait(
            lambda m: np.abs(np.array(m.position) - wanted).max() < 1e-9,
            "every joint's newest position",
        )

    def test_of_a_bad_command_the_good_part_is_obeyed_and_the_rest_told(self):
        nan, inf = float("nan"), float("inf")
        cases = [
            (
                ["left_knee_joint", "wing"],
                [0.3, 1.0],
                "unknown joint wing",
            ),
            (
                ["left_knee_joint", "waist_yaw_joint"],
                [0.4],
                "no position for waist_yaw",
            ),
            (
                ["waist_yaw_joint", "left_knee_joint"],
                [nan, 0.5],
                "waist_yaw_joint = nan",
            ),
            (
                ["waist_yaw_joint", "left_knee_joint"],
                [inf, 0.6],
                "waist_yaw_joint = inf",
            ),
            (["left_knee_joint"], [0.7, 0.2], "2 positions for 1 name"),
        ]
        self.command(["waist_yaw_joint"], [0.25])
        waist = self.names.index("waist_yaw_joint")
        self.states.wait(lambda m: abs(m.position[waist] - 0.25) < 1e-9, "the waist")
        knee = self.names.index("left_knee_joint")
        for names, positions, words in cases:
            self.log.clear()
            wanted = positions[names.index("left_knee_joint")]
            self.command(names, positions)
            self.states.wait(
                lambda m, wanted=wanted: abs(m.position[knee] - wanted) < 1e-9,
                f"the knee at {wanted}",
            )
            self.log.wait(lambda m, words=words: words in m.msg, f"'{words}'")
            self.assertAlmostEqual(self.position("waist_yaw_joint"), 0.25, 9)

    def test_what_was_clamped_is_told(self):
        knee = self.names.index("left_knee_joint")
        self.log.clear()
        self.command(["left_knee_joint"], [9.0])
        limit = self.upper[knee]
        self.states.wait(lambda m: abs(m.position[knee] - limit) < 1e-9, "the limit")
        self.log.wait(
            lambda m: "clamped" in m.msg and "left_knee_joint" in m.msg, "a warning"
        )

    def test_empty_and_absurd_commands_do_no_harm(self):
        for names, positions in (([], []), ([], [1.0]), (["left_knee_joint"], [])):
            self.log.clear()
            self.command(names, positions)
            self.log.wait(lambda m: "ignored" in m.msg, "a warning")
        self.command(["tail"] * 10000, [0.0] * 10000)
        self.command(["left_knee_joint"], [0.125])
        knee = self.names.index("left_knee_joint")
        self.states.wait(lambda m: abs(m.position[knee] - 0.125) < 1e-9, "the knee")
