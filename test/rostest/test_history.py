"""What has just happened is in the bridge's history, without a recording."""

import os
import signal
import tempfile
import unittest
from contextlib import closing, suppress
from pathlib import Path

import numpy as np
import rosbag
import rospy
from g1_description.msg import RobotState as RobotStateMessage
from g1_description.msg import RobotTrajectory
from g1_description.srv import GetHistory, PlayMotion, SaveHistory
from genpy import Time
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import JointState
from std_srvs.srv import Empty
from support.programs import Program, run
from support.ros_testing import (
    Connected,
    position_of,
    service,
    step_by,
    wait_for,
)
from trajectory_msgs.msg import JointTrajectory

from g1_description import Client
from g1_description.bridge.history import HistoryServices
from g1_description.bridge.parameters import RobotParameters
from g1_description.bridge.status import RobotStatus
from g1_description.errors import InvalidValueError
from g1_description.motion.files.formats import read_motion
from g1_description.motion.history import History
from g1_description.robot.state import RobotState
from g1_description.robot.urdf import parse_urdf
from g1_description.ros.conversions import robot_state_from_message
from g1_description.ros.history import HistoryClient, stretch_from_answer
from g1_description.ros.waiting import NoAnswerError, RefusedError

ELBOW, KNEE = "left_elbow_joint", "right_knee_joint"
LONG = 1000.0
"""Longer than the history of this test, in [s]."""


class TestHistory(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        step_by(0.005)
        cls.states = Connected("/robot_state", RobotStateMessage, queue_size=None)
        cls.addClassCleanup(cls.states.close)
        cls.get = service("/get_history", GetHistory)
        cls.save = service("/save_history", SaveHistory)
        cls.publishers = {
            name: rospy.Publisher(f"/{name}", kind, queue_size=100)
            for name, kind in (
                ("joint_commands", JointState),
                ("joint_trajectory", JointTrajectory),
                ("base_command", PoseStamped),
            )
        }
        for publisher in cls.publishers.values():
            wait_for(publisher.get_num_connections, f"a listener of {publisher.name}")
        cls.robot = parse_urdf(rospy.get_param("/robot_description"))
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = Path(folder.name)

    def bend(self, angle):
        """Command the elbow; return the state that shows it."""
        self.publishers["joint_commands"].publish(
            JointState(name=[ELBOW], position=[angle])
        )
        return self.states.wait(lambda m: abs(position_of(m, ELBOW) - angle) < 1e-6)

    def test_it_has_the_states_that_were_published(self):
        self.states.clear()
        self.bend(0.25)
        last = self.bend(0.75)
        published = [
            robot_state_from_message(m)
            for m in self.states.messages
            if m.header.stamp <= last.header.stamp
        ]
        first = published[0].stamp
        answer = self.get(begin=Time(0, first), end=last.header.stamp)
        self.assertTrue(answer.success, answer.status_message)
        kept = stretch_from_answer(answer).states()
        self.assertEqual([s.stamp for s in kept], [s.stamp for s in published])
        for one, other in zip(kept, published):
            self.assertEqual(one.names, other.names)
            self.assertEqual(one.positions.tobytes(), other.positions.tobytes())
            self.assertEqual(one.base_pose.tobytes(), other.base_pose.tobytes())
            np.testing.assert_array_equal(
                one.velocities, other.velocities.astype(np.float32)
            )
            self.assertEqual(one.commanded, other.commanded)
        self.assertIn(ELBOW, kept[-1].commanded)
        between = Time(0, published[-2].stamp + 1)
        (single,) = stretch_from_answer(self.get(begin=between, end=between)).states()
        self.assertEqual(single.stamp, published[-2].stamp)
        thin = self.get(last=LONG, max_samples=7)
        self.assertEqual(len(thin.states.times), 7)
        self.assertEqual(thin.states.start, thin.first)

    def test_it_has_the_commands_with_their_senders(self):
        begin = self.bend(0.1).header.stamp
        self.bend(0.2)
        play = service("/play_motion", PlayMotion)
        play(RobotTrajectory())
        self.publishers["joint_trajectory"].publish(
            JointTrajectory(joint_names=["nose"])
        )
        base = PoseStamped()
        base.header.frame_id = "map"
        base.pose.position.x, base.pose.position.z = 0.25, 0.9
        base.pose.orientation.w = 1.0
        self.publishers["base_command"].publish(base)
        me = rospy.get_name()
        expected = {
            (me, "joint_commands", ELBOW),
            (me, "play_motion", "stop"),
            (me, "base_command", "base"),
        }

        def found():
            commands = self.get(begin=begin).commands
            return {(c.sender, c.topic, c.content) for c in commands}

        wait_for(lambda: expected < found(), "the commands")
        wait_for(
            lambda: any(
                topic == "joint_trajectory"
                and "stop; refused: " in content
                and "nose" in content
                for _, topic, content in found()
            ),
            "the refused one",
        )
        self.assertEqual(self.get(begin=begin, without_commands=True).commands, [])
        with closing(HistoryClient("/get_history")) as client:
            self.assertEqual([*client.part(begin.to_nsec()).commands], [])
            found = client.part(begin.to_nsec(), with_commands=True).commands
        self.assertLess(expected, {tuple(one.command[:3]) for one in found})
        with Client() as client:
            commands = client.commands(LONG)
            with self.assertRaisesRegex(InvalidValueError, "seconds must be"):
                client.commands(0.0)
        bent = [c for c in commands if c.command[:3] == (me, "joint_commands", ELBOW)][
            -1
        ]
        self.assertEqual(bent.command.names, (ELBOW,))
        np.testing.assert_allclose(bent.positions[-1], [0.2], rtol=1e-7)

    def test_it_is_saved_and_read_as_a_motion(self):
        stamp = self.bend(0.4).header.stamp
        path = self.folder / "saved.csv"
        answer = self.save(last=1.0, end=Time(), file=str(path))
        self.assertTrue(answer.success, answer.status_message)
        motion = read_motion(path, self.robot)
        self.assertEqual(len(motion.times), answer.samples)
        elbow = motion.positions[:, motion.joint_names.index(ELBOW)]
        self.assertAlmostEqual(elbow[-1], 0.4, 9)
        self.assertLessEqual(motion.duration, 1.0)
        for request, words in (
            ({"file": str(path)}, "already exists"),
            ({"file": "saved.csv"}, "absolute path"),
            ({"file": "/saved.txt"}, "absolute path that ends in .csv"),
            ({"file": str(self.folder / "saved.csv" / "a.csv")}, "cannot be written"),
            ({"begin": Time(5000), "end": Time(5001)}, "There is no state from 5000"),
            ({"begin": stamp, "end": Time(0, 1)}, "begin must not be later"),
            ({"run": 999}, "run must be from"),
            ({"last": -1.0}, "last must be at least 0 s"),
        ):
            fields = {"file": str(self.folder / "other.csv"), **request}
            answer = self.save(**fields)
            self.assertFalse(answer.success, request)
            self.assertIn(words, answer.status_message)
        self.assertEqual([file.name for file in self.folder.glob("other*")], [])

    def test_it_keeps_what_was_before_a_reset(self):
        before = self.bend(0.6)
        number = self.get(last=1.0).run
        service("/gazebo/reset_simulation", Empty)()
        wait_for(lambda: self.get(last=1.0).run == number + 1, "another run")
        answer = self.get(
            run=number, begin=before.header.stamp, end=before.header.stamp
        )
        (state,) = stretch_from_answer(answer).states()
        self.assertAlmostEqual(state.positions_by_name[ELBOW], 0.6, 9)
        self.assertLess(self.get(last=1.0).last, before.header.stamp)

    def test_record_and_client_have_what_has_just_happened(self):
        self.bend(0.3)
        self.bend(0.9)
        path = self.folder / "last.csv"
        done = run("record", path, "--last", LONG, "--rate", 0)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("the history of the bridge has only ", done.stderr)
        motion = read_motion(path, self.robot)
        with Client() as client:
            same = client.history(LONG)
        count = len(motion.times)
        np.testing.assert_array_equal(motion.positions, same.positions[:count])
        np.testing.assert_allclose(motion.times, same.times[:count], atol=1e-9)
        elbow = same.positions[:, same.joint_names.index(ELBOW)]
        self.assertLess(np.abs(elbow - 0.3).min(), 1e-9)
        self.assertAlmostEqual(elbow[-1], 0.9, 9)

    def test_a_run_that_is_forgotten_meanwhile_is_refused_in_a_sentence(self):
        class Forgetful(History):
            """Has so many new runs, whenever it is read, that the older ones go."""

            def stretch(self, *where, **arguments):
                for stamp in resets:
                    self.add(RobotState(stamp, (), np.zeros(0)))
                    self.pack()
                return super().stretch(*where, **arguments)

        resets = range(1000, 0, -1)
        history = Forgetful(600.0, max_bytes=100_000)
        history.add(RobotState(2000, (), np.zeros(0)))
        status = RobotStatus("forgetful", self.robot, history)
        HistoryServices(RobotParameters("forgetful", "forgetful"), status)
        path = str(self.folder / "forgotten.csv")
        for name, kind, more in (
            ("get_history", GetHistory, {}),
            ("save_history", SaveHistory, {"file": path}),
        ):
            answer = service(f"/forgetful/{name}", kind)(run=history.run, **more)
            self.assertFalse(answer.success)
            self.assertIn("run must be from", answer.status_message)

    def test_record_takes_what_was_there_when_it_was_entered(self):
        self.states.clear()
        since = self.bend(0.25).header.stamp + rospy.Duration(0.5)
        self.states.wait(lambda m: m.header.stamp > since, "half a second")
        terminal, inside = os.openpty()
        self.addCleanup(os.close, terminal)
        path = self.folder / "entered.csv"
        process = Program(*("record", path, "--last", 1, "--rate", 0), terminal=inside)
        os.close(inside)
        process.send_signal(signal.SIGSTOP)  # a machine that is busy for long
        for angle in (0.75, 0.5, 0.8):
            later = self.bend(angle)
        process.send_signal(signal.SIGCONT)
        self.assertEqual(process.wait(), 0)
        output = os.read(terminal, 65536).decode()
        motion = read_motion(path, self.robot)
        elbow = motion.positions[:, motion.joint_names.index(ELBOW)]
        self.assertAlmostEqual(elbow[-1], 0.25, 9)
        begin = float(path.read_text().splitlines()[0].split()[-2])
        self.assertIn(f"begins at {begin:.3f} s", output)
        self.assertLess(begin + motion.times[-1], later.header.stamp.to_sec())

    def bridge(self, namespace, *arguments):
        """Start another bridge, and wait for it."""
        arguments = "link_states_bridge.py", f"__ns:={namespace}", *arguments
        process = Program(*arguments, environment={"ROS_HOME": str(self.folder)})
        self.addCleanup(process.wait)
        self.addCleanup(process.terminate)
        service(f"{namespace}/get_history", GetHistory)
        return process

    def test_a_client_finds_the_bridge_again_after_a_restart(self):
        client = HistoryClient("/again/get_history")
        self.addCleanup(client.close)
        last = self.folder / "g1_description" / "last.bag"
        for number in range(4):
            process = self.bridge("/again", "robot_description:=/robot_description")
            heard = Connected("/again/joint_states", JointState, queue_size=None)
            self.addCleanup(heard.close)

            def has_states():
                with suppress(RefusedError):  # none yet
                    return client.part()

            part = wait_for(has_states, "a state")
            self.assertEqual((part.first_run, part.last_run), (1, 1))
            self.assertEqual(client.at(part.last).stretch.stamps[-1], part.last)
            commands = rospy.Publisher(
                "/again/joint_commands", JointState, queue_size=1
            )
            wait_for(commands.get_num_connections, "the bridge")
            angle = 0.1 * (number + 1)
            commands.publish(JointState(name=[ELBOW], position=[angle]))
            heard.wait(lambda m, at=angle: abs(position_of(m, ELBOW) - at) < 1e-6)

            def is_commanded(at=angle):  # motors are heard after their states
                kept = client.at(client.part().last).stretch
                return kept.commanded[-1, kept.commanded_names.index(ELBOW)] == at

            wait_for(is_commanded, "the command in the history")
            process.send_signal((signal.SIGINT, signal.SIGTERM)[number % 2])
            output, _ = process.communicate()
            self.assertEqual(f"is in {last}" in output, number > 0)
            heard.close()
            with rosbag.Bag(str(last)) as bag:
                kept = [m for _, m, _ in bag.read_messages(["/joint_states"])]
                topic = ["/received_commands"]
                ((_, command, _),) = bag.read_messages(topic)
                wanted = [
                    m for _, m, _ in bag.read_messages(["/commanded_joint_states"])
                ]
            self.assertEqual(command.sender, rospy.get_name())
            np.testing.assert_allclose(command.positions, [angle], rtol=1e-6)
            self.assertEqual(len(wanted), len(kept))
            self.assertEqual(position_of(wanted[-1], ELBOW), angle)  # without a ghost
            known = {m.header.stamp: m.position for m in heard.messages}
            both = [m for m in kept if m.header.stamp in known]
            arrived = [abs(position_of(m, ELBOW) - angle) < 1e-6 for m in both]
            self.assertTrue(any(arrived))
            for m in both:
                self.assertEqual(m.position, known[m.header.stamp])
        files = sorted(path.name for path in last.parent.glob("*last*"))
        self.assertEqual(files, ["last.1.bag", "last.2.bag", "last.bag"])
        with self.assertRaisesRegex(NoAnswerError, "is a bridge running"):
            client.part()

    def test_a_bridge_without_a_history_says_so(self):
        for namespace, words in (("left", "is a bridge running"), ("off", "~history")):
            if namespace == "off":
                self.bridge("/off", "_history:=0")
            path = self.folder / "none.csv"
            done = run("record", path, "--last", 1, "--namespace", namespace)
            self.assertEqual(done.returncode, 1)
            self.assertIn(words, done.stderr)
            self.assertFalse(path.exists())
