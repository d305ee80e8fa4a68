"""The simulator outlives clients that mean harm: documents, bytes, messages."""

import socket
import struct
import unittest

import rospy
from g1_description.msg import ModelTrajectory
from gazebo_msgs.msg import LinkState, ModelState
from support.ros_testing import DEADLINE, wait_for
from support.stand_in import Node

from tcpros import HangupError, ServiceError, header_of, packed

ROBOT = "g1_robot"
SECRET = '<!DOCTYPE r [<!ENTITY s SYSTEM "file:///etc/passwd">]>'
LINK = '<link name="l"><inertial><mass value="{}"/></inertial></link>'
DOCUMENTS = {
    "not XML": ("spawn_urdf_model", "<robot>" + "x" * 200_000),
    "a file as an entity": (
        "spawn_urdf_model",
        f'{SECRET}<robot name="&s;">{LINK.format(1)}</robot>',
    ),
    "a mass that is no number": (
        "spawn_urdf_model",
        f'<robot name="r">{LINK.format("nan")}</robot>',
    ),
    "nested deeply": ("spawn_sdf_model", "<sdf>" * 5000 + "</sdf>" * 5000),
    "a model that includes itself": (
        "spawn_sdf_model",
        '<sdf version="1.7"><model name="m"><include><uri>/proc/self/fd/0</uri>'
        "</include></model></sdf>",
    ),
}


class TestHostile(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.node = Node("_physics:=limp", "_z:=0.793")
        cls.addClassCleanup(cls.node.close)
        cls.services = cls.node.services

    def tearDown(self):
        self.assertTrue(self.node.is_alive(), self.node.output()[-2000:])
        self.assertEqual(self.node.trouble(), [])

    def names(self):
        """Call the simulator as a new client; return the names of models."""
        self.services["get_world_properties"].close()
        return self.services.call("get_world_properties").model_names

    def test_motors_that_are_not_there_play_nothing(self):
        """A robot without motors, which is not harm but refused as well."""
        motion = ModelTrajectory(
            model_name=ROBOT, joint_names=["left_elbow_joint"], times=[0], positions=[0]
        )
        answer = self.services.call("set_model_trajectory", motion)
        words = "nothing drives the joints in limp physics"
        self.assertEqual((answer.success, answer.status_message), (False, words))

    def test_documents_are_refused_and_leave_nothing(self):
        before = self.names()
        for name, (service, xml) in DOCUMENTS.items():
            with self.subTest(name):
                fields = (packed(b"bad"), packed(xml.encode()), packed(b""), bytes(56))
                connection = self.services[service]
                answer = connection.send(b"".join([*fields, packed(b"")]))
                response = connection.kind._response_class().deserialize(answer)
                self.assertFalse(response.success)
                self.assertNotIn("root:", response.status_message)
                self.assertEqual(self.names(), before)

    def test_bytes_that_are_no_handshake_or_request_block_nobody(self):
        place = self.services["get_world_properties"].place
        whole = header_of(
            service="/gazebo/get_world_properties",
            md5sum=self.services["get_world_properties"].kind._md5sum,
            callerid="/hostile",
        )
        for start in (
            b"",
            b"GET / HTTP/1.1\r\n\r\n",
            whole[: len(whole) // 2],
            packed(struct.pack("<I", 2**32 - 1) + b"a=b"),
            header_of(service="/nobody", md5sum="*", callerid="x"),
            whole + struct.pack("<I", 2**32 - 1) + b"x" * 1000,
            whole + packed(b"x" * 100),
        ):
            sock = socket.create_connection(place, DEADLINE)
            self.addCleanup(sock.close)
            sock.sendall(start)
            self.assertIn(ROBOT, self.names())
        for name in ("get_model_state", "set_model_configuration"):
            with self.assertRaises((ServiceError, HangupError)):
                self.services[name].send(b"\xff" * 7)

    def test_messages_that_are_no_state_do_not_stop_those_that_are(self):
        for topic, kind, x in (("model", ModelState, 7.0), ("link", LinkState, 8.0)):
            publisher = rospy.Publisher(
                f"/gazebo/set_{topic}_state", kind, queue_size=1000
            )
            wait_for(publisher.get_num_connections, "the simulator to listen")
            for number in (float("nan"), 1e308):
                for name in (ROBOT, f"{ROBOT}::pelvis", "", "n" * 100_000):
                    state = kind()
                    setattr(state, f"{topic}_name", name)
                    state.pose.position.x = number
                    publisher.publish(state)
            state = kind()
            setattr(state, f"{topic}_name", {"model": ROBOT, "link": "pelvis"}[topic])
            state.pose.position.x = x
            publisher.publish(state)
            wait_for(lambda x=x: abs(self.robot_x() - x) < 0.5, f"{topic} at {x}")
            publisher.unregister()

    def robot_x(self):
        """Return where the robot is along x, in [m]."""
        return self.services.call("get_model_state", ROBOT, "").pose.position.x
