"""A node written by someone else for Gazebo runs on the stand-in, unmodified."""

import subprocess
import sys
import unittest

import rospy
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from support.ros_testing import DEADLINE, SHARED, Listener, wait_for

CLIENT = SHARED / "clients" / "link_states_bridge_original.py"


@unittest.skipUnless(CLIENT.exists(), f"{CLIENT.name} is not there")
@unittest.skipUnless(hasattr(Rotation, "magnitude"), "that node needs scipy 1.4")
class TestOriginalClient(unittest.TestCase):
    def test_it_publishes_29_joints_and_its_commands_are_obeyed(self):
        client = subprocess.Popen([sys.executable, str(CLIENT)])
        self.addCleanup(client.wait, DEADLINE)
        self.addCleanup(client.terminate)
        states = Listener("/joint_states", JointState)
        message = states.wait()
        self.assertEqual(
            message._connection_header["callerid"], "/link_states_to_joint_state"
        )
        self.assertEqual(len(message.name), 29)
        commands = rospy.Publisher("/joint_commands", JointState, queue_size=1)
        wait_for(commands.get_num_connections, "the client to listen")
        commands.publish(JointState(name=["left_elbow_joint"], position=[0.5]))
        elbow = message.name.index("left_elbow_joint")
        states.wait(lambda m: abs(m.position[elbow] - 0.5) < 1e-9, "the elbow at 0.5")
