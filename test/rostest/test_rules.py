"""Rules of Gazebo's interface that no single observation shows."""

import select
import socket
import unittest
from io import BytesIO

import numpy as np
import rospy
from dynamic_reconfigure.msg import Config, ConfigDescription, GroupState
from rosgraph.network import encode_ros_handshake_header, read_ros_handshake_header
from support.golden.simulator import QUARTER, UP, Simulator, pose_fields
from support.ros_testing import DEADLINE, Listener

BOX = """<sdf version="1.6"><model name="in_file">
<pose>0.5 0 0 0 0 1.5707963267948966</pose>
<static>{}</static><link name="body"><inertial><mass>2</mass><inertia><ixx>0.0133</ixx>
<iyy>0.0133</iyy><izz>0.0133</izz></inertia></inertial></link></model></sdf>"""
SWING = """<robot name="swing"><link name="world"/><link name="mount"><inertial>
<mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
</link><link name="bob"><inertial><mass value="1"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="anchor" type="fixed"><parent link="world"/><child link="mount"/></joint>
<joint name="hinge" type="continuous"><parent link="mount"/><child link="bob"/>
<axis xyz="0 1 0"/></joint></robot>"""
NEST = """<sdf version="1.7"><model name="nest"><link name="branch"/>
<model name="egg"><link name="shell"><collision name="oval"><geometry><sphere>
<radius>0.1</radius></sphere></geometry></collision></link><link name="lid"/>
<joint name="crack" type="revolute"><parent>shell</parent><child>lid</child>
<axis><xyz>0 0 1</xyz></axis></joint><model name="yolk"><link name="dot"/></model>
</model>
<joint name="glue" type="fixed"><parent>branch</parent><child>egg::shell</child></joint>
<joint name="white" type="fixed"><parent>branch</parent><child>egg::yolk::dot</child>
</joint></model></sdf>"""
FOREVER = {"secs": -1}


class TestRules(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.simulator = Simulator()

    def setUp(self):
        self.call = self.simulator.call
        self.simulator.make_scene("empty", [0.0, 0.0, 0.0])
        self.spawn("box", BOX.format("false"), [0, 0, 1, *UP])
        self.spawn("swing", SWING, [3, 0, 1, *UP])

    def spawn(self, name, text, pose, frame=""):
        fields = {"model_name": name, "model_xml": text, "reference_frame": frame}
        answer = self.call("spawn_sdf_model", initial_pose=pose_fields(pose), **fields)
        self.assertTrue(answer["success"], answer)

    def twist(self, link):
        return np.array(self.simulator.link(link)["twist"])

    def assert_near(self, one, other, tolerance=1e-9):
        np.testing.assert_allclose(one, other, atol=tolerance)

    def connect(self, service):
        address = self.simulator.master.lookupService(service)
        host, port = address[len("rosrpc://") :].split(":")
        return socket.create_connection((host, int(port)), DEADLINE)

    def test_a_client_of_another_type_is_refused_in_the_handshake(self):
        asked = {
            "service": "/gazebo/pause_physics",
            "callerid": "/x",
            "md5sum": "0" * 32,
        }
        with self.connect("/gazebo/pause_physics") as connection:
            connection.sendall(encode_ros_handshake_header(asked))
            told = read_ros_handshake_header(connection, BytesIO(), 65536)
        self.assertIn("md5sums do not match", told["error"])

    def test_a_handshake_may_come_in_pieces(self):
        """As it does over a network, where a packet has 1500 bytes."""
        asked = {"service": "/gazebo/step", "callerid": "/x", "md5sum": "*"}
        header = encode_ros_handshake_header({**asked, "probe": "1"})
        with self.connect("/gazebo/step") as connection:
            for piece in (header[:2], header[2:20]):
                connection.sendall(piece)
                told = select.select([connection], [], [], 0.3)[0]
                self.assertFalse(told, "the rest is not waited for")
            connection.sendall(header[20:])
            told = read_ros_handshake_header(connection, BytesIO(), 65536)
        self.assertEqual(told["type"], "g1_description/Step")

    def test_the_files_pose_is_seen_from_the_initial_pose(self):
        self.assert_near(self.simulator.state("box")["pose"], [0.5, 0, 1, *QUARTER])
        self.spawn("other", BOX.format("false"), [1, 0, 0, *UP], "box::body")
        pose = self.simulator.state("other")["pose"]
        self.assert_near(np.abs(pose), [0.5, 1.5, 1, 0, 0, 1, 0])

    def test_what_is_static_stays_and_has_no_mass(self):
        self.simulator.set_physics([0.0, 0.0, -9.8])
        self.spawn("wall", BOX.format("true"), [0, 0, 5, *UP])
        self.simulator.run(0.1)
        self.assert_near(self.simulator.state("wall")["pose"][:3], [0.5, 0, 5])
        self.assertLess(self.simulator.state("box")["pose"][2], 0.99)
        self.assertTrue(
            self.call("get_model_properties", model_name="wall")["is_static"]
        )
        told = self.call("get_link_properties", link_name="wall::body")
        self.assertEqual((told["mass"], told["gravity_mode"]), (0.0, False))

    def test_wrenches_are_cleared_by_the_scoped_name(self):
        wrench = {"force": {"x": 2.0}}
        fields = {"body_name": "box::body", "wrench": wrench, "duration": FOREVER}
        self.call("apply_body_wrench", **fields)
        self.simulator.run(0.1)
        self.call("clear_body_wrenches", body_name="box::body")
        self.simulator.run(0.1)
        self.assert_near(self.twist("box::body")[0], 0.1, 1e-6)

    def test_efforts_are_cleared_by_the_plain_name(self):
        fields = {"joint_name": "swing::hinge", "effort": 0.5, "duration": FOREVER}
        self.call("apply_joint_effort", **fields)
        self.simulator.run(0.1)
        self.call("clear_joint_forces", joint_name="hinge")
        self.simulator.run(0.1)
        self.assert_near(self.simulator.joint("hinge")["rate"], [0.5], 1e-3)

    def test_a_twist_is_seen_from_a_frame_that_moves(self):
        self.simulator.put("box", [0, 0, 1, *QUARTER], [1.0, 2.0, 3.0, 0.1, 0.2, 0.3])
        self.spawn("other", BOX.format("false"), [5, 0, 1, *UP])
        self.simulator.put("other", [5, 0, 1, *UP], [0.5, 0.5, 0.5, 0.0, 0.0, 0.0])
        seen = self.simulator.link("other::body", "box")["twist"]
        self.assert_near(seen, [-1.5, 0.5, -2.5, -0.2, 0.1, -0.3])
        self.assert_near(self.simulator.state("other", "box::body")["twist"], seen)

    def test_reset_world_puts_models_back_and_leaves_all_else(self):
        self.simulator.set_joints("swing", {"hinge": 0.5})
        self.simulator.put("box", [9, 9, 9, *UP], [1.0, *[0.0] * 5])
        self.simulator.set_physics([0.0, 0.0, -1.0], time_step=0.002)
        self.simulator.run(0.1)
        before = self.simulator.time()
        self.call("reset_world")
        self.assertEqual(self.simulator.time(), before)
        self.assert_near(self.simulator.state("box")["pose"], [0.5, 0, 1, *QUARTER])
        self.assert_near(self.simulator.state("box")["twist"], np.zeros(6))
        self.assertNotEqual(self.simulator.joint("hinge")["position"], [0.0])
        physics = self.simulator.physics()
        self.assertEqual((physics["time_step"], physics["gravity"][2]), (0.002, -1.0))

    def test_reset_simulation_begins_again_and_stays_paused(self):
        self.simulator.set_joints("swing", {"hinge": 0.5})
        self.simulator.set_physics([0.0, 0.0, -1.0], time_step=0.002)
        self.simulator.run(0.1)
        self.call("reset_simulation")
        self.assertEqual(self.simulator.time(), 0.0)
        self.assertEqual(self.simulator.joint("hinge")["position"], [0.0])
        self.assert_near(self.simulator.state("box")["pose"], [0.5, 0, 1, *QUARTER])
        self.assertTrue(self.simulator.is_paused())
        self.assertEqual(self.simulator.physics()["time_step"], 0.002)

    def test_time_stands_still_where_a_step_is_zero(self):
        self.simulator.set_physics([0.0, 0.0, -1.0], time_step=0.0)
        self.call("unpause_physics")
        self.assertTrue(self.simulator.is_paused())
        self.assertFalse(self.simulator.physics()["pause"])
        self.simulator.set_physics([0.0, 0.0, -1.0])
        self.assertFalse(self.simulator.is_paused())

    def test_joints_on_the_world_are_listed_and_only_some_move(self):
        told = self.call("get_model_properties", model_name="swing")
        self.assertEqual(told["joint_names"], ["anchor", "hinge"])
        self.assertEqual(told["body_names"], ["mount", "bob"])
        answer = self.simulator.set_joints("swing", {"anchor": 1.0, "hinge": 7.0})
        self.assertTrue(answer["success"])
        self.assertEqual(self.simulator.joint("swing::hinge")["position"], [7.0])

    def properties(self, name):
        told = self.call("get_model_properties", model_name=name)
        self.assertTrue(told["success"], told)
        lists = ("body_names", "geom_names", "joint_names", "child_model_names")
        return told["parent_model_name"], *(told[name] for name in lists)

    def test_a_model_inside_of_a_model_tells_what_it_is_made_of(self):
        self.spawn("nest", NEST, [0, 5, 1, *UP])
        own = ("", ["branch"], [], ["glue", "white"], ["egg"])
        self.assertEqual(self.properties("nest"), own)
        egg = ("nest", ["shell", "lid"], ["oval"], ["crack"], ["yolk"])
        for name in ("nest::egg", "egg"):
            self.assertEqual(self.properties(name), egg)
        yolk = ("egg", ["dot"], [], [], [])
        self.assertEqual(self.properties("nest::egg::yolk"), yolk)
        for name in ("nest::yolk", "nest::branch", "branch"):
            told = self.call("get_model_properties", model_name=name)
            self.assertFalse(told["success"])

    def test_numbers_are_described_as_gazebo_ros_does_and_begin_as_they_are(self):
        descriptions = Listener("/gazebo/parameter_descriptions", ConfigDescription)
        updates = Listener("/gazebo/parameter_updates", Config)
        told, current = descriptions.wait(), updates.wait()
        descriptions.close()
        updates.close()
        for config in (told.max, told.min, told.dflt, current):
            self.assertEqual(config.groups, [GroupState("Default", True, 0, 0)])
        names = {parameter.name for parameter in told.groups[0].parameters}
        numbers = [numbers_of(c) for c in (told.min, told.dflt, told.max, current)]
        for config in numbers:
            self.assertEqual(set(config), names)
        defaults = {"max_update_rate": 60.0, "sor_pgs_iters": 20, "max_contacts": 100}
        defaults["sor_pgs_rms_error_tol"] = -1.0
        now = {"max_contacts": 20, "sor_pgs_rms_error_tol": 0.0}
        # Those of the world file.
        now.update(max_update_rate=500.0, time_step=0.002, gravity_z=-2.0)
        now.update(sor_pgs_iters=77, sor_pgs_w=1.4, erp=0.3)
        self.assertEqual({name: numbers[1][name] for name in defaults}, defaults)
        self.assertEqual({name: numbers[3][name] for name in now}, now)
        for name in names - set(now):
            self.assertEqual(numbers[1][name], numbers[3][name], name)
        self.assertEqual(rospy.get_param("/gazebo/max_update_rate"), 500.0)


def numbers_of(config):
    """Give the numbers of a configuration by name."""
    entries = (*config.bools, *config.ints, *config.doubles)
    return {entry.name: entry.value for entry in entries}
