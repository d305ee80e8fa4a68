"""How the bridge sends: merged while a call is under way, refusals told, none lost."""

import socket
import struct
import threading
import unittest
from urllib.parse import urlparse

import rosgraph
import rospy
from gazebo_msgs.srv import SetModelConfiguration, SetModelConfigurationResponse
from sensor_msgs.msg import JointState
from support.ros_testing import DEADLINE, NodeLog, wait_for

SERVICE = "/gazebo/set_model_configuration"


class Simulator:
    """The service, answering when and what the test wants."""

    def __init__(self):
        self.requests = []
        self.may_answer = threading.Event()
        self.may_answer.set()
        self.answer = SetModelConfigurationResponse(
            True, "SetModelConfiguration: success"
        )
        self.service = rospy.Service(SERVICE, SetModelConfiguration, self._called)

    def _called(self, request):
        self.requests.append(dict(zip(request.joint_names, request.joint_positions)))
        self.may_answer.wait(DEADLINE)
        return self.answer


class Relay:
    """A wire to a service that can be cut the hard way."""

    def __init__(self, uri):
        self._target = urlparse(uri)
        self._listener = socket.create_server(("localhost", 0))
        self.uri = f"rosrpc://localhost:{self._listener.getsockname()[1]}"
        self.wires = []
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self):
        while True:
            near, _ = self._listener.accept()
            near.settimeout(None)  # as in raw_service.Simulator
            far = socket.create_connection((self._target.hostname, self._target.port))
            self.wires.append(near)
            for pair in ((near, far), (far, near)):
                threading.Thread(target=self._copy, args=pair, daemon=True).start()

    @staticmethod
    def _copy(source, sink):
        try:
            while True:
                data = source.recv(65536)
                if not data:
                    break
                sink.sendall(data)
        except OSError:
            sink.close()

    def cut(self):
        """Reset all connections, as a machine that went away does."""
        for wire in self.wires:
            wire.setsockopt(
                socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0)
            )
            wire.shutdown(socket.SHUT_RD)
            wire.close()


class TestSender(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.simulator = Simulator()
        master = rosgraph.Master(rospy.get_name())
        cls.relay = Relay(master.lookupService(SERVICE))
        master.registerService(SERVICE, cls.relay.uri, rospy.get_node_uri())
        cls.log = NodeLog("/link_states_bridge")
        cls.commands = rospy.Publisher("/joint_commands", JointState, queue_size=1000)
        wait_for(cls.commands.get_num_connections, "the bridge to listen")

    def setUp(self):
        self.simulator.requests.clear()

    def command(self, **positions):
        self.commands.publish(
            JointState(name=[*positions], position=[*positions.values()])
        )

    def wait_for_request(self, **positions):
        wait_for(
            lambda: positions in self.simulator.requests, f"a call with {positions}"
        )

    def test_commands_that_come_during_a_call_make_one_more_call(self):
        self.simulator.may_answer.clear()
        self.command(left_knee_joint=0.1)
        self.wait_for_request(left_knee_joint=0.1)
        for share in range(200):
            self.command(left_elbow_joint=share / 400.0)
            self.command(right_elbow_joint=-share / 400.0)
        self.command(waist_yaw_joint=0.5)
        # The bridge takes commands in their order: a bad one tells that it has all.
        self.log.clear()
        self.command(no_such_joint=1.0)
        self.log.wait(lambda m: "no_such_joint" in m.msg, "the last command's warning")
        self.simulator.may_answer.set()
        newest = {"left_elbow_joint": 0.4975, "right_elbow_joint": -0.4975}
        self.wait_for_request(waist_yaw_joint=0.5, **newest)
        self.assertEqual(len(self.simulator.requests), 2)

    def test_a_refusal_is_told_with_its_reason(self):
        success = self.simulator.answer
        self.simulator.answer = SetModelConfigurationResponse(
            False, "SetModelConfiguration: model does not exist"
        )
        self.log.clear()
        self.command(left_knee_joint=0.2)
        told = self.log.wait(lambda m: "model does not exist" in m.msg, "the reason")
        self.assertIn("left_knee_joint", told.msg)
        self.simulator.answer = success
        self.command(left_knee_joint=0.25)
        self.wait_for_request(left_knee_joint=0.25)

    def test_a_connection_that_is_reset_loses_no_command(self):
        self.command(left_knee_joint=0.3)
        self.wait_for_request(left_knee_joint=0.3)
        self.assertTrue(self.relay.wires, "the bridge does not go through the relay")
        self.relay.cut()
        for number in range(5):
            self.command(left_knee_joint=0.4, right_knee_joint=0.01 * number)
        wait_for(
            lambda: any(
                request.get("right_knee_joint") == 0.04
                and request.get("left_knee_joint") == 0.4
                for request in self.simulator.requests
            ),
            "the newest command",
        )
