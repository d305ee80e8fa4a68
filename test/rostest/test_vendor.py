"""The vendor's file as it is finds its meshes, and plays clips made by others.

joint_states has each row of a CSV; the frames in TF are where another program, MuJoCo,
put the bodies of a clip.
"""

import subprocess
import unittest
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import rospy
import tf2_ros
from sensor_msgs.msg import JointState
from support.ros_testing import DEADLINE, SHARED, Connected, Launch, program, step_by
from tf2_msgs.msg import TFMessage

MODEL = SHARED / "data" / "unitree_g1" / "g1_29dof_rev_1_0.urdf"
CLIPS = SHARED / "data" / "motions"
PERIOD = 10_000_000
"""Between two rows of a CSV as they are played, in [ns]."""
SAMPLES = 3, 25_000_000
"""So many samples of an npz last so long as they are played, in [ns]: whole steps."""
PART = ("--from", "1", "--until", "2")
"""What is played of a clip, in [s] of it."""
TOLERANCE = 2e-6
"""In [m] and [rad]."""
MEASURED = 1e-9
"""Joints are measured to this, in [rad]."""
NOTHING = "the vendor's model and the clips are not beside the repository"


def angle(one, other):
    """Give the angle between quaternions (w, x, y, z), in [rad]."""
    other = other / np.linalg.norm(other)
    chord = min(np.linalg.norm(one - other), np.linalg.norm(one + other))
    return 4.0 * np.arcsin(min(1.0, 0.5 * chord))


@unittest.skipUnless(MODEL.exists() and CLIPS.is_dir(), NOTHING)
class TestVendor(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.display = Launch(
            "display.launch", "rviz:=false", "rate:=1000", f"model:={MODEL}"
        )
        cls.addClassCleanup(cls.display.stop)
        step_by(0.005)
        cls.states = Connected("/joint_states", JointState, queue_size=None)
        cls.names = cls.states.wait().name
        cls.tf = Connected("/tf", TFMessage, queue_size=None)
        cls.static = Connected("/tf_static", TFMessage, queue_size=None)
        cls.urdf = ElementTree.fromstring(rospy.get_param("/robot_description"))
        joints = cls.urdf.iter("joint")
        below = {j.get("name"): j.find("child").get("link") for j in joints}
        cls.bodies = ["pelvis", *(below[name] for name in cls.names)]

    def play(self, file, rows, *arguments):
        """Play a file to its end; return the number of a row and the stamp it has."""
        self.states.clear()
        self.tf.clear()
        done = subprocess.run(
            [program("play"), file, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=DEADLINE,
        )
        self.assertEqual(done.returncode, 0, done.stdout)
        for message in [*self.states.messages]:
            off = np.abs(rows - message.position).max(axis=1)
            if off.min() <= MEASURED and any(message.velocity):
                return int(off.argmin()), message.header.stamp.to_nsec()
        raise AssertionError(f"no state has a row of {file.name}")

    def test_its_meshes_are_absolute_and_exist(self):
        files = [mesh.get("filename") for mesh in self.urdf.iter("mesh")]
        self.assertGreater(len(files), 50)
        for file in files:
            self.assertTrue(file.startswith("file:///"), file)
            self.assertTrue(Path(file[len("file://") :]).is_file(), file)

    def test_joint_states_have_each_row_of_a_csv(self):
        file = CLIPS / "B_HandsUp.csv"
        rows = np.loadtxt(str(file), delimiter=",")[:, 7:]
        number, stamp = self.play(file, rows, "--fps", "100", *PART)
        shown = {m.header.stamp.to_nsec(): m.position for m in self.states.messages}
        stamps = {n: stamp + (n - number) * PERIOD for n in range(100, 201)}
        there = [n for n, stamp in stamps.items() if stamp in shown]
        # A busy machine may skip some states, none is wrong.
        self.assertTrue(there)
        for n in there:
            off = np.abs(rows[n] - shown[stamps[n]]).max()
            self.assertLessEqual(off, MEASURED, n)

    def test_frames_are_where_another_program_put_the_bodies(self):
        file = CLIPS / "J_ShortDance16_JazzWalk.npz"
        data = np.load(str(file))
        rows = data["joint_pos"].astype(float)
        number, stamp = self.play(file, rows, "--speed", "2", *PART)
        self.assertEqual(number % SAMPLES[0], 0)
        places, turns = data["body_pos_w"], data["body_quat_w"]
        start = stamp - number // SAMPLES[0] * SAMPLES[1]
        end = start + 120 // SAMPLES[0] * SAMPLES[1]
        self.tf.wait(
            lambda m: any(t.header.stamp.to_nsec() >= end for t in m.transforms), "TF"
        )
        frames = tf2_ros.BufferCore(rospy.Duration(1000))
        stamps = {"base_link": set(), "left_knee_link": set()}
        for message in [*self.static.messages]:
            for edge in message.transforms:
                frames.set_transform_static(edge, "test")
        for message in [*self.tf.messages]:
            for edge in message.transforms:
                frames.set_transform(edge, "test")
                if edge.child_frame_id in stamps:
                    stamps[edge.child_frame_id].add(edge.header.stamp.to_nsec())
        worst = [0.0, 0.0]
        n_compared = 0
        for n in range(60, 121, SAMPLES[0]):
            time_ns = start + n // SAMPLES[0] * SAMPLES[1]
            # On a busy machine robot_state_publisher leaves some joint states out.
            if not all(time_ns in known for known in stamps.values()):
                continue
            n_compared += 1
            when = rospy.Time(time_ns // 10**9, time_ns % 10**9)
            for body, place, turn in zip(self.bodies, places[n], turns[n]):
                edge = frames.lookup_transform_core("map", body, when).transform
                t, q = edge.translation, edge.rotation
                away = np.abs([t.x, t.y, t.z] - place).max()
                turned = angle(np.array([q.w, q.x, q.y, q.z]), turn.astype(float))
                worst = [max(worst[0], away), max(worst[1], turned)]
        print(
            f"{file.name}: {n_compared} samples, {worst[0]:.2g} m, {worst[1]:.2g} rad"
        )
        self.assertTrue(n_compared)
        self.assertLess(max(worst), TOLERANCE)
