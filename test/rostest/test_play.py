"""The command play, in a terminal and without one."""

import re
import signal
import tempfile
import unittest
from pathlib import Path

import numpy as np
import rospy
import tf2_ros
from g1_description.msg import RobotTrajectory
from g1_description.srv import DetachObject, PlayMotion
from gazebo_msgs.srv import DeleteModel, GetModelState, SpawnModel
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import JointState
from support.joint_limits import limits
from support.programs import Program, run
from support.ros_testing import Connected, is_at, service, step_by
from support.terminal import Terminal
from tf2_msgs.msg import TFMessage
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from g1_description.motion.files.formats import read_motion
from g1_description.ros.conversions import pose_from_array, pose_to_array
from g1_description.ros.parameters import read_robot
from g1_description.scenes.carried import holds_of, motion_links, object_poses
from g1_description.scenes.scene import Scene
from g1_description.scenes.scene_file import sdf_model

HEADER = "time,base_x,base_y,base_z,base_qx,base_qy,base_qz,base_qw,left_elbow_joint"
SPACE, RIGHT, LEFT, CTRL_C = b" ", b"\x1b[C", b"\x1b[D", b"\x03"
ELBOW = "left_elbow_joint"


class TestPlay(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        step_by(0.005)
        cls.states = Connected("/joint_states", JointState, queue_size=None)
        cls.tf = Connected("/tf", TFMessage, queue_size=None)
        for listener in (cls.states, cls.tf):
            cls.addClassCleanup(listener.close)
        cls.index = limits()[0].index(ELBOW)
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.file = Path(folder.name) / "wave.csv"
        rows = [
            (0.1 * n, 0.01 * n, 0.0, 0.9, 0.0, 0.0, 0.0, 1.0, round(0.02 * n, 2))
            for n in range(41)
        ]
        lines = [",".join(map(repr, row)) for row in rows]
        cls.file.write_text("\n".join([HEADER, *lines]))

    def setUp(self):
        self.states.clear()
        self.tf.clear()

    def base_pose(self):
        """Give where the base is, once it is where it was before."""
        self.tf.clear()
        message = self.tf.wait(
            lambda m: any(t.child_frame_id == "base_link" for t in m.transforms)
        )
        edge = next(t for t in message.transforms if t.child_frame_id == "base_link")
        t, q = edge.transform.translation, edge.transform.rotation
        return np.array([t.x, t.y, t.z, q.x, q.y, q.z, q.w])

    def assert_still(self):
        """Wait until the robot rests, and see that it stays there; give the elbow."""
        self.states.clear()
        first = self.states.wait(lambda m: not any(m.velocity), "a rest")
        later = self.states.wait(
            lambda m: (m.header.stamp - first.header.stamp).to_sec() > 0.3
        )
        self.assertEqual(later.position, first.position)
        self.assertFalse(any(later.velocity))
        return first.position[self.index]

    def test_ctrl_c_leaves_the_robot_where_it_is(self):
        playing = Terminal("play", str(self.file), "--speed", "0.5")
        self.states.wait(lambda m: m.velocity[self.index] > 0.0)
        playing.press(CTRL_C)
        self.assertEqual(playing.end(), 130)
        self.assertIn("the robot keeps its position", playing.text)
        self.assertTrue(0.0 < self.assert_still() < 0.8)

    def test_a_terminal_that_is_closed_leaves_it_there_too(self):
        playing = Terminal("play", str(self.file), "--speed", "0.5")
        self.states.wait(lambda m: m.velocity[self.index] > 0.0)
        playing.close()
        self.assertTrue(0.0 < self.assert_still() < 0.8)

    def test_it_goes_to_the_beginning_in_its_time_and_plays_a_part_at_a_speed(self):
        run("play", self.file, "--from", 3.5, "--speed", 8)
        self.assert_still()  # its last states may still come
        self.states.clear()
        arguments = "--from", 0.5, "--until", 1, "--lead-in", 1, "--speed", 2
        done = run("play", self.file, *arguments)
        self.assertEqual(done.returncode, 0, done.stdout)
        self.assertEqual(
            done.stdout.splitlines()[-1], f"play: {self.file}: 0.50 s played."
        )
        words = "Joints missing from the motion are not moved: left_hip_pitch_joint"
        self.assertIn(words, done.stdout)
        self.states.wait(lambda m: is_at(m, ELBOW, 0.2), "the end")
        moved = [m for m in self.states.messages if m.velocity[self.index]]
        way = [m for m in moved if m.velocity[self.index] < 0.0]
        rest = [m for m in moved if m.velocity[self.index] > 0.0]
        self.assertAlmostEqual(rest[0].velocity[self.index], 0.4, delta=1e-9)
        # A busy machine may skip some states, also the first and the last ones.
        first = rest[0].header.stamp.to_sec()
        begin = first - (rest[0].position[self.index] - 0.1) / 0.4
        for message in rest:
            passed = message.header.stamp.to_sec() - begin
            at = message.position[self.index]
            self.assertAlmostEqual(at, 0.1 + 0.4 * passed, delta=1e-6)
        for message in way:
            passed = message.header.stamp.to_sec() - begin + 1.0
            at = message.position[self.index]
            self.assertAlmostEqual(at, 0.8 - 0.7 * passed, delta=1e-6)

    def test_a_robot_that_was_taken_elsewhere_is_told(self):
        playing = Terminal("play", str(self.file))
        self.states.wait(lambda m: m.velocity[self.index] > 0.0)
        other = rospy.ServiceProxy("/play_motion", PlayMotion)
        motion = RobotTrajectory()
        point = JointTrajectoryPoint(positions=[0.3])
        motion.joint_trajectory = JointTrajectory(joint_names=[ELBOW], points=[point])
        self.assertTrue(other(motion).success)
        self.assertEqual(playing.end(), 1)
        words = f"not at its last sample: {ELBOW} at 0.3 instead of 0.8 rad"
        self.assertIn(words, playing.text)

    def test_space_pauses_and_arrows_step(self):
        playing = Terminal("play", str(self.file), "--speed", "0.5")
        playing.wait("sample ([5-9]|[12][0-9]) of 41")
        self.states.wait(lambda m: m.velocity[self.index] > 0.0)
        playing.press(SPACE)
        playing.wait("paused")
        number = int(re.findall(r"sample (\d+) of", playing.text)[-1])
        self.assert_still()
        for key, step in ((RIGHT, 1), (RIGHT + RIGHT, 2), (LEFT, -1)):
            number += step
            playing.press(key)
            playing.wait(f"sample {number} of 41")
            wanted = round(0.02 * (number - 1), 2)
            self.states.wait(lambda m, at=wanted: is_at(m, ELBOW, at))
        playing.press(SPACE)
        self.states.wait(lambda m: is_at(m, ELBOW, 0.8), "the end")
        self.assertEqual(playing.end(), 0)

    def test_it_begins_again_until_a_signal_leaves_the_robot_where_it_is(self):
        playing = Program("play", self.file, "--from", 3.5, "--loop")
        self.states.wait(lambda m: is_at(m, ELBOW, 0.8), "the end")
        self.states.clear()
        self.states.wait(lambda m: m.position[self.index] < 0.75, "the beginning")
        playing.send_signal(signal.SIGTERM)
        self.assertNotEqual(playing.wait(), 0)
        self.assert_still()

    def test_it_begins_where_the_robot_is(self):
        """Here under another name, as where the bridge has a frame prefix."""
        there = TransformStamped(child_frame_id="left/base_link")
        there.header.frame_id = "map"
        there.transform.translation.x = 3.0
        there.transform.rotation.z = there.transform.rotation.w = np.sqrt(0.5)
        sender = tf2_ros.StaticTransformBroadcaster()
        sender.sendTransform(there)
        done = run(
            "play",
            *(self.file, "--start-here", "--base-frame", "left/base_link"),
            *("--speed", 8),
        )
        self.assertEqual(done.returncode, 0, done.stdout)
        self.tf.wait(
            lambda m: any(
                t.child_frame_id == "base_link"
                and abs(t.transform.translation.y - 0.4) < 1e-9
                for t in m.transforms
            ),
            "the end",
        )
        wanted = [3.0, 0.4, 0.9, 0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]
        np.testing.assert_allclose(self.base_pose(), wanted, atol=1e-9)

    def test_it_puts_the_motion_on_the_floor(self):
        """The legs are straight: the soles are where a standing robot has them."""
        done = run("play", self.file, "--on-floor", "--from", 3.9, "--until", 4.0)
        self.assertEqual(done.returncode, 0, done.stdout)
        self.assertAlmostEqual(self.base_pose()[2], 0.792, delta=0.005)

    def test_links_carry_the_objects_of_a_scene_next_to_the_motion(self):
        scene = Scene()
        for name in ("box", "ghost"):  # the latter is not in the simulator
            scene.box(name, [0.1, 0.1, 0.1], [0.4, 0.2, 1.0])
            scene.attach(name, "left_hand", begin=1.0, end=2.0)
        scene.save(self.file.with_name("wave.scene.yaml"))
        self.addCleanup(self.file.with_name("wave.scene.yaml").unlink)
        box = scene["box"]
        spawn = service("/gazebo/spawn_sdf_model", SpawnModel)
        text = sdf_model("box", {"link": box}, box.pose)
        spawn("box", text, "", pose_from_array(box.pose), "")
        delete = service("/gazebo/delete_model", DeleteModel)
        self.addCleanup(delete, "box")
        done = run("play", self.file)
        self.assertEqual(done.returncode, 0, done.stdout)
        self.assertEqual(done.stdout.count("ghost is not carried: There is no"), 1)
        self.assertNotIn("box is not carried", done.stdout)
        states = service("/gazebo/get_model_state", GetModelState)
        state = states("box", "")
        robot = read_robot("robot_description")
        links = motion_links(robot, read_motion(self.file, robot))
        holds = holds_of([box], robot, links)
        ((expected,),) = object_poses(holds, np.array([4.0]), links)
        self.assertGreater(np.abs(expected - box.pose).max(), 0.05)
        found = pose_to_array(state.pose)
        np.testing.assert_allclose(found, expected, atol=0.02)  # of a busy machine
        detach = service("/gazebo/detach_object", DetachObject)
        self.assertEqual(detach("box").status_message, "no link carries box")
        # It is in the same grip from the middle on, wherever the motion begins.
        ((expected,),) = object_poses(holds, np.array([1.8]), links)
        for option, shift in ((), 0.0), (["--start-here"], 0.03):
            done = run("play", self.file, "--from", 1.5, "--until", 1.8, *option)
            self.assertEqual(done.returncode, 0, done.stdout)
            found = pose_to_array(states("box", "").pose)
            expected[0] += shift
            np.testing.assert_allclose(found, expected, atol=1e-3)

    def test_what_is_wrong_is_told_in_a_sentence(self):
        arms = self.file.with_name("arms.csv")
        arms.write_text("time,left_elbow_joint\n0,0\n1,1\n")
        for arguments, text in (
            (
                (self.file, "--from", 2, "--until", 9),
                "The requested range 2-9 s is outside the motion (0-4 s).",
            ),
            (
                (self.file, "--start-here", "--base-frame", "right/base_link"),
                "no transform from frame 'right/base_link': nothing publishes it on "
                "/tf (did you mean left/base_link?)",
            ),
            (
                (arms, "--on-floor"),
                "--on-floor needs a motion with a base, which arms.csv lacks.",
            ),
        ):
            with self.subTest(text=text):
                done = run("play", *arguments)
                self.assertEqual(done.returncode, 2)
                self.assertIn(text, done.stderr.splitlines()[-1])
