"""The display launch: nodes up, every frame reachable, steady TF."""

import os
import subprocess
import unittest
import xml.etree.ElementTree as ET

import numpy as np
import rosgraph
import rosnode
import rospy
import tf2_ros
from gazebo_msgs.msg import LinkStates
from rosgraph_msgs.msg import Clock, Log
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from support.ros_testing import DEADLINE, Listener, wait_for
from tf2_msgs.msg import TFMessage


def matrix_of(buffer, frame):
    """Look a frame up in the map: rotation and translation, shape (4, 4)."""
    try:
        found = buffer.lookup_transform("map", frame, rospy.Time()).transform
    except tf2_ros.TransformException:
        return np.full((4, 4), np.nan)
    q, p = found.rotation, found.translation
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat([q.x, q.y, q.z, q.w]).apply(np.eye(3)).T
    matrix[:3, 3] = [p.x, p.y, p.z]
    return matrix


class TestDisplay(unittest.TestCase):
    def test_a_second_one_is_refused_and_ends_nothing(self):
        master = rosgraph.Master(rospy.get_name())
        nodes = ("/gazebo", "/link_states_bridge", "/robot_state_publisher")
        wait_for(lambda: set(nodes) <= set(rosnode.get_node_names()), f"{nodes}")
        before = [master.lookupNode(node) for node in nodes]
        second = subprocess.run(
            ["roslaunch", "g1_description", "display.launch", "rviz:=false"],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=DEADLINE,
        )
        self.assertEqual(second.returncode, 1, second.stdout)
        uri = os.environ["ROS_MASTER_URI"]
        words = f"A node /gazebo is already running at {uri}."
        self.assertIn(words, second.stdout)
        self.assertEqual([master.lookupNode(node) for node in nodes], before)
        self.assertTrue(all(rosnode.rosnode_ping(node, 1) for node in nodes))

    def test_joint_states_are_complete_and_honest(self):
        listener = Listener("/joint_states", JointState)
        message = listener.wait()
        listener.close()
        urdf = ET.fromstring(rospy.get_param("/robot_description"))
        movable = [
            joint.get("name")
            for joint in urdf.findall("joint")
            if joint.get("type") != "fixed"
        ]
        self.assertEqual(len(movable), 29)
        self.assertEqual(message.name, movable)
        self.assertEqual(len(message.position), 29)
        self.assertEqual(len(message.velocity), 29)
        self.assertEqual(list(message.effort), [])
        self.assertGreater(message.header.stamp.to_sec(), 0.0)

    def test_link_states_name_the_ground_and_every_lumped_body(self):
        listener = Listener("/gazebo/link_states", LinkStates)
        names = listener.wait().name
        listener.close()
        self.assertEqual(names[:2], ["ground_plane::link", "g1_robot::pelvis"])
        self.assertEqual(len(names), 31)

    def test_every_link_is_reached_from_the_map(self):
        buffer = tf2_ros.Buffer()
        tf2_ros.TransformListener(buffer)
        urdf = ET.fromstring(rospy.get_param("/robot_description"))
        frames = [link.get("name") for link in urdf.findall("link")]
        self.assertEqual(len(frames), 40)
        for frame in [*frames, "base_link", "body_imu", "map"]:
            wait_for(
                lambda frame=frame: buffer.can_transform("world", frame, rospy.Time()),
                f"a transform from world to {frame}",
            )
        pelvis = buffer.lookup_transform("map", "pelvis", rospy.Time()).transform
        self.assertEqual(pelvis.translation.z, 0.793)
        body = buffer.lookup_transform("imu_in_torso", "body_imu", rospy.Time())
        self.assertEqual(body.transform.rotation.w, 1.0)

    def test_every_frame_is_where_scipy_puts_it(self):
        """A random configuration, through the bridge and robot_state_publisher."""
        from oracle import forward_kinematics

        text = rospy.get_param("/robot_description")
        random, wanted = np.random.default_rng(3), {}
        for joint in ET.fromstring(text).findall("joint"):
            if joint.get("type") == "revolute":
                limit = joint.find("limit")
                bounds = [float(limit.get(side)) for side in ("lower", "upper")]
                wanted[joint.get("name")] = random.uniform(*bounds)
        # A connection keeps the queue of the node's first publisher of the topic.
        commands = rospy.Publisher("/joint_commands", JointState, queue_size=100)
        wait_for(commands.get_num_connections, "the bridge to listen")
        commands.publish(JointState(name=[*wanted], position=[*wanted.values()]))
        self.addCleanup(
            commands.publish, JointState(name=[*wanted], position=[0.0] * len(wanted))
        )

        def is_there(message):
            found = dict(zip(message.name, message.position))
            return all(abs(found[name] - wanted[name]) < 1e-9 for name in wanted)

        listener = Listener("/joint_states", JointState)
        listener.wait(is_there, "the joints where they were told to be")
        listener.close()
        upright = np.array([0.0, 0.0, 0.793, 0.0, 0.0, 0.0, 1.0])
        buffer = tf2_ros.Buffer()
        tf2_ros.TransformListener(buffer)
        for link, pose in forward_kinematics(text, upright, wanted).items():
            expected = np.eye(4)
            expected[:3, :3] = Rotation.from_quat(pose[3:]).apply(np.eye(3)).T
            expected[:3, 3] = pose[:3]
            wait_for(
                lambda link=link, expected=expected: np.allclose(
                    matrix_of(buffer, link), expected, atol=1e-9
                ),
                f"{link} at {pose}",
            )

    def test_static_frames_come_from_one_message_of_one_node(self):
        listener = Listener("/tf_static", TFMessage)
        edges = {
            ("world", "map"),
            ("base_link", "pelvis"),
            ("imu_in_torso", "body_imu"),
        }

        def has_them(message):
            found = {(t.header.frame_id, t.child_frame_id) for t in message.transforms}
            return found == edges

        message = listener.wait(has_them, "the three static frames")
        listener.close()
        self.assertEqual(message._connection_header["callerid"], "/link_states_bridge")

    def test_a_still_robot_is_sent_each_50_ms_with_new_stamps(self):
        listener = Listener("/tf", TFMessage)

        def stamps():
            return [
                transform.header.stamp.to_nsec()
                for message in list(listener.messages)
                for transform in message.transforms
                if transform.child_frame_id == "base_link"
            ]

        wait_for(lambda: len(stamps()) > 50, "fifty transforms of base_link")
        listener.close()
        # It may have been put there just now.
        still = stamps()[10:]
        steps = [(b - a) / 1e6 for a, b in zip(still, still[1:])]
        # A busy machine may leave states out, and so be late, or stand still for so
        # long that the last state is shown at once.
        regular = [step for step in steps if step >= 50.0]
        self.assertGreater(len(regular), len(steps) / 4, steps)
        self.assertLess(min(regular), 52.0)

    def test_nobody_complains(self):
        """Listen to the log, past and for a second; KDL's warning is known."""
        listener = Listener("/rosout", Log)
        clock = Listener("/clock", Clock)
        start = clock.wait().clock
        clock.wait(lambda m: (m.clock - start).to_sec() > 1.0, "a second")
        clock.close()
        listener.close()
        loud = [m.msg for m in listener.messages if m.level >= Log.WARN]
        self.assertEqual([text for text in loud if "KDL" not in text], [])

    def test_one_publisher_each(self):
        published, _, _ = rosgraph.Master("/test").getSystemState()
        publishers = {topic: nodes for topic, nodes in published}
        self.assertEqual(publishers["/joint_states"], ["/link_states_bridge"])
        self.assertEqual(publishers["/clock"], ["/gazebo"])
