"""Where the stand-in deliberately does something else than Gazebo, or more.

The numbers are those of docs/gazebo_compatibility.md.
"""

import math
import time
import unittest
from concurrent.futures import ThreadPoolExecutor

import rospy
from dynamic_reconfigure.client import Client
from gazebo_msgs.msg import LinkStates, WorldState
from rosgraph_msgs.msg import Clock
from scipy.spatial.transform import Rotation
from support.golden.simulator import UP, Simulator, pose_fields
from support.ros_testing import DEADLINE, Connected, wait_for

MASS = (
    '<inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" '
    'ixz="0" iyz="0"/></inertial>'
)
ARM = f"""<robot name="arm"><link name="base">{MASS}</link>
<link name="upper">{MASS}</link><link name="lower">{MASS}</link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="upper"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="1.2" effort="10"
velocity="5"/><dynamics damping="0.25"/></joint><joint name="turn" type="continuous">
<parent link="upper"/><child link="lower"/></joint></robot>"""
LAMP = """<sdf version="1.6"><light type="point" name="lamp"><pose>1 2 3 0 0 0</pose>
<diffuse>0.5 0.25 0.125 1</diffuse><attenuation><range>20</range>
<constant>0.5</constant><linear>0.25</linear><quadratic>0.125</quadratic></attenuation></light></sdf>"""
BALL = """<sdf version="1.6"><model name="m"><link name="l"/><link name="k"/>
<joint name="b" type="ball"><parent>l</parent><child>k</child></joint></model></sdf>"""
GUI = """<sdf version="1.6"><model name="m"><link name="l">
<sensor name="eye" type="camera"/></link>
<plugin name="p" filename="f.so"/></model></sdf>"""
EYE = f"""<robot name="eye"><link name="body">{MASS}</link>
<link name="eye">{MASS}</link><link name="lid">{MASS}</link>
<joint name="neck" type="fixed"><parent link="body"/><child link="eye"/></joint>
<joint name="hem" type="fixed"><parent link="eye"/><child link="lid"/></joint>
<gazebo reference="neck"><disableFixedJointLumping>true</disableFixedJointLumping>
<provideFeedback>true</provideFeedback></gazebo>
<gazebo reference="hem"><preserveFixedJoint>true</preserveFixedJoint></gazebo>
<gazebo reference="eye"><turnGravityOff>true</turnGravityOff><kp>1e6</kp>
<sensor name="camera" type="camera"/></gazebo></robot>"""

TWIN = '<collision name="c"><geometry><sphere/></geometry></collision>'
TWINS = f"""<sdf version="1.6"><model name="m"><link name="l">{TWIN}{TWIN}</link>
</model></sdf>"""


class TestDeviations(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.simulator = Simulator()

    def setUp(self):
        self.call = self.simulator.call
        self.simulator.make_scene("empty", [0.0, 0.0, 0.0])
        answer = self.spawn("arm", ARM)
        self.assertTrue(answer["success"], answer)

    def spawn(self, name, text, service="spawn_urdf_model", pose=(0, 0, 1, *UP)):
        fields = {"model_name": name, "model_xml": text}
        return self.call(service, initial_pose=pose_fields(pose), **fields)

    def snapshot(self):
        """Give all that can be asked for."""
        links = ("base", "upper", "lower")
        return [
            self.simulator.models(),
            [self.simulator.link(f"arm::{link}") for link in links],
            [self.call("get_link_properties", link_name=f"arm::{n}") for n in links],
            [self.simulator.joint(joint) for joint in ("hinge", "turn")],
            self.simulator.physics(),
            self.call("get_light_properties", light_name="sun"),
        ]

    def assert_refused(self, service, words="refused, ", **fields):
        """A sentence comes, and nothing has changed."""
        before = self.snapshot()
        answer = self.call(service, **fields)
        self.assertIs(answer["success"], False, answer)
        self.assertIn(words, answer["status_message"])
        self.assertEqual(self.snapshot(), before)

    def test_1_numbers_that_no_world_can_have_are_refused(self):
        for bad in (math.nan, 1e300):
            self.set_everything(bad)
        for bad in (math.inf, -math.inf):
            state = {"model_name": "arm", "twist": {"linear": {"z": bad}}}
            self.assert_refused("set_model_state", model_state=state)
            self.assert_refused("apply_joint_effort", joint_name="hinge", effort=bad)

    def set_everything(self, bad):
        vector, link = {"x": bad}, {"link_name": "arm::base"}
        up = {"orientation": {"w": 1.0}}
        for pose, twist in (
            ({"position": vector, **up}, {}),
            ({"orientation": vector}, {}),
            (up, {"linear": vector}),
            (up, {"angular": vector}),
        ):
            state = {"pose": pose, "twist": twist}
            model = {"model_name": "arm", **state}
            self.assert_refused("set_model_state", model_state=model)
            self.assert_refused("set_link_state", link_state={**link, **state})
        body = {"mass": 1.0, "ixx": 1.0, "iyy": 1.0, "izz": 1.0}
        for spoiled in ({"mass": bad}, {"iyy": bad}, {"com": {"position": vector}}):
            fields = {**link, **body, **spoiled}
            self.assert_refused("set_link_properties", **fields)
        for wrench in ({"force": vector}, {"torque": vector}):
            fields = {"body_name": "arm::base", "wrench": wrench}
            self.assert_refused("apply_body_wrench", **fields)
        self.assert_refused("apply_joint_effort", joint_name="hinge", effort=bad)
        config = {"damping": [bad]}
        fields = {"joint_name": "hinge", "ode_joint_config": config}
        self.assert_refused("set_joint_properties", **fields)
        fields = {"joint_names": ["turn"], "joint_positions": [bad]}
        self.assert_refused("set_model_configuration", model_name="arm", **fields)
        for numbers in ({"time_step": bad}, {"gravity": vector}):
            self.assert_refused("set_physics_properties", **numbers)
        self.assert_refused("set_light_properties", light_name="sun", direction=vector)
        fields = {
            "model_name": "b",
            "model_xml": ARM,
            "initial_pose": {"position": vector},
        }
        self.assert_refused("spawn_urdf_model", "Failure - ", **fields)
        self.assert_refused("set_real_time_factor", real_time_factor=bad)

    def test_1_a_wrong_number_for_dynamic_reconfigure_changes_nothing(self):
        before = self.snapshot()
        doubles = [{"name": "gravity_z", "value": math.nan}]
        answer = self.call("set_parameters", config={"doubles": doubles})
        told = {entry["name"]: entry["value"] for entry in answer["config"]["doubles"]}
        self.assertEqual(told["gravity_z"], 0.0)
        self.assertEqual(self.snapshot(), before)

    def test_2_what_is_hopeless_is_told_at_once(self):
        two_roots = (
            f'<robot name="r"><link name="a">{MASS}</link><link name="b"/></robot>'
        )
        for text, words in (
            ("this is not xml", "not XML"),
            ("", "not XML"),
            ("<html/>", "not URDF"),
            (two_roots, "one root link (got a and b)"),
        ):
            fields = {"model_name": "b", "model_xml": text}
            self.assert_refused("spawn_urdf_model", words, **fields)
        fields = {"model_name": "", "model_xml": ARM}
        self.assert_refused("spawn_urdf_model", "a model needs a name", **fields)

    def test_3_a_link_that_is_not_the_root_moves_along_its_joint(self):
        self.simulator.set_joints("arm", {"hinge": 0.5})
        base = self.simulator.link("arm::base")["pose"]
        turned = Rotation.from_rotvec([0.0, 0.25, 0.0]).as_quat()
        for height, clauses in (
            (0.0, ""),
            (
                5.0,
                "; with hinge, arm::upper is still 5 m and 0 rad from that pose",
            ),
        ):
            pose = pose_fields([0, 0, height, *turned])
            state = {"link_name": "arm::upper", "reference_frame": "arm::base"}
            told = self.call("set_link_state", link_state={**state, "pose": pose})
            self.assertTrue(told["success"])
            expected = "SetLinkState: success" + clauses
            self.assertEqual(told["status_message"], expected)
            (angle,) = self.simulator.joint("hinge")["position"]
            self.assertAlmostEqual(angle, 0.25)
            self.assertEqual(self.simulator.link("arm::base")["pose"], base)

    def test_4_the_true_kind_and_damping_of_joints(self):
        hinge, turn = (self.simulator.joint(name) for name in ("hinge", "turn"))
        self.assertEqual(hinge["damping"] + turn["damping"], [0.25, 0.0])
        self.assertEqual([hinge["type"], turn["type"]], [0, 1])

    def test_4_asking_for_the_world_logs_nothing(self):
        _, log = self.simulator.log_since(lambda: self.call("get_world_properties"))
        self.assertEqual(log, [])

    def test_5_what_was_ignored_or_changed_is_told_behind_gazebos_words(self):
        answer = self.simulator.set_joints("arm", {"hinge": 9.0, "tail": 1.0})
        self.assertEqual(
            answer["status_message"],
            "SetModelConfiguration: success; ignored, no movable joint of arm: tail; "
            "clamped to the limits: hinge from 9 to 1.2 (9 looks like degrees, "
            "positions are in radians)",
        )
        answer = self.spawn("eye", GUI, "spawn_sdf_model")
        self.assertEqual(
            answer["status_message"],
            "SpawnModel: Successfully spawned entity; plugin of model m is not "
            "simulated; sensor of link l is not simulated",
        )
        answer = self.spawn("ball", BALL, "spawn_sdf_model")
        self.assertIn("; joint b is ball, which is not", answer["status_message"])
        two = BALL.replace("</sdf>", '<model name="n"/></sdf>')
        answer = self.spawn("two", two, "spawn_sdf_model")
        self.assertIn("; model n is ignored", answer["status_message"])
        for name in ("eye", "ball", "two"):
            self.call("delete_model", model_name=name)

    def test_5_of_a_urdf_what_gazebo_elements_say_is_done_or_told(self):
        answer = self.spawn("eye", EYE)
        self.assertEqual(
            answer["status_message"],
            "SpawnModel: Successfully spawned entity; unsupported <gazebo> elements: "
            "provideFeedback, kp",
        )
        found = self.call("get_model_properties", model_name="eye")
        self.assertEqual(found["body_names"], ["body", "eye", "lid"])
        self.assertEqual(found["joint_names"], ["neck", "hem"])
        self.assertFalse(found["is_static"])
        kinds = [self.simulator.joint(name)["type"] for name in ("neck", "hem")]
        self.assertEqual(kinds, [0, 3])
        pulled = [
            self.call("get_link_properties", link_name=f"eye::{name}")["gravity_mode"]
            for name in ("body", "eye", "lid")
        ]
        self.assertEqual(pulled, [True, False, True])
        self.call("delete_model", model_name="eye")
        static = "<gazebo><static>true</static></gazebo></robot>"
        self.assertTrue(self.spawn("eye", EYE.replace("</robot>", static))["success"])
        found = self.call("get_model_properties", model_name="eye")
        self.assertTrue(found["is_static"])
        self.call("delete_model", model_name="eye")

    def test_5_what_gazebo_takes_is_taken_and_told(self):
        answer = self.spawn("twins", TWINS, "spawn_sdf_model")
        self.assertEqual(
            answer["status_message"],
            "SpawnModel: Successfully spawned entity; link l has 2 collisions called c",
        )
        told = self.call("get_model_properties", model_name="twins")
        self.assertEqual(told["geom_names"], ["c", "c"])
        odd = ARM.replace('lower="-1" upper="1.2"', 'lower="1" upper="-1"')
        odd = odd.replace(f'<link name="upper">{MASS}', '<link name="upper"><x:y/>')
        answer = self.spawn("odd", odd)
        self.assertEqual(
            answer["status_message"],
            "SpawnModel: Successfully spawned entity; link upper has no mass; link "
            "lower is below upper, which has no mass",
        )
        answer = self.spawn("free", odd.replace("<x:y/>", f"<x:y/>{MASS}"))
        self.assertEqual(
            answer["status_message"],
            "SpawnModel: Successfully spawned entity; joint hinge has no limits: its "
            "lower one, 1, is above its upper one, -1",
        )
        for name in ("twins", "odd", "free"):
            self.call("delete_model", model_name=name)

    def test_6_a_model_can_be_commanded_when_spawn_answers(self):
        self.call("unpause_physics")
        for number in range(5):
            self.assertTrue(self.call("delete_model", model_name="arm")["success"])
            self.assertNotIn("arm", self.simulator.models())
            self.assertTrue(self.spawn("arm", ARM)["success"])
            self.simulator.set_joints("arm", {"hinge": 0.01 * number})
            position = self.simulator.joint("arm::hinge")["position"][0]
            self.assertAlmostEqual(position, 0.01 * number, 9)

    def test_6_what_wedges_gazebo_is_refused(self):
        for text, words in (
            ("<sdf/>", "Failure - "),
            ('<sdf version="1.6"/>', "Failure - "),
            ("<sdf><!-- ", "not SDF or URDF"),
            ('<sdf version="1.6"><model name="m"/></sdf>', "Failure - "),
        ):
            fields = {"model_name": "b", "model_xml": text}
            self.assert_refused("spawn_sdf_model", words, **fields)
        self.assert_refused("set_physics_properties", time_step=-0.001)
        self.assertTrue(self.spawn("b", ARM)["success"])

    def test_6_link_states_are_those_of_the_clock_sent_before(self):
        """A link that drifts at 1 m/s tells the time by its place."""
        self.simulator.put("arm", [0, 0, 1, *UP], [1.0, *[0.0] * 5])
        begin = self.simulator.time()
        order = []
        clock = Connected("/clock", Clock)
        states = Connected("/gazebo/world_state", WorldState)
        self.simulator.run(0.05)
        last = states.wait(lambda m: m.header.stamp.to_sec() > begin + 0.0495)
        # Of time that stands still may come several: the arm came in two calls.
        for message in (m for m in states.messages if m.header.stamp.to_sec() > begin):
            x = message.pose[message.name.index("arm::base")].position.x
            stamp = message.header.stamp.to_sec()
            self.assertAlmostEqual(x, stamp - begin, 9)
            order.append(stamp)
        clock.wait(lambda m: m.clock == last.header.stamp)
        self.assertEqual(order, sorted(set(order)))
        # rospy keeps but the newest of the times that come together.
        times = {m.clock.to_sec() for m in clock.messages}
        self.assertLessEqual(times, {begin, *order})
        clock.close()
        states.close()

    def test_7_steps_pass_while_time_stands_still(self):
        states = Connected("/gazebo/link_states", LinkStates)
        # The publisher may know of it a little later than it does itself.
        wait_for(
            lambda: self.call("step", steps=1) and states.messages, "the first message"
        )
        before, begin = len(states.messages), self.simulator.time()
        answer = self.call("step", steps=25)
        self.assertEqual(
            answer, {"success": True, "status_message": "Step: 25 steps done"}
        )
        self.assertAlmostEqual(self.simulator.time() - begin, 0.025, 9)
        self.assertTrue(self.simulator.is_paused())
        wait_for(lambda: len(states.messages) >= before + 25, "25 messages")
        states.close()
        self.assertTrue(self.call("step", steps=0)["success"])
        self.call("unpause_physics")
        answer = self.call("step", steps=1)
        self.assertIn("Step: refused, time is running", answer["status_message"])

    def test_7_steps_end_when_somebody_pauses(self):
        for service in ("pause_physics", "reset_world", "reset_simulation"):
            with ThreadPoolExecutor(1) as pool:
                stepping = pool.submit(self.simulator.proxy("step", False), 10**9)
                start = self.simulator.time()
                wait_for(lambda start=start: self.simulator.time() > start, "a step")
                self.call(service)
                answer = stepping.result(DEADLINE)
            self.assertFalse(answer.success)
            self.assertRegex(
                answer.status_message, f"ended by {service} after [0-9]+ of"
            )
            self.assertTrue(self.simulator.is_paused())

    def test_7_the_real_time_factor_is_set(self):
        self.assertTrue(
            self.call("set_real_time_factor", real_time_factor=0.25)["success"]
        )
        self.assertEqual(self.simulator.physics()["max_update_rate"], 250.0)
        self.call("unpause_physics")
        begin, start = time.monotonic(), self.simulator.time()
        wait_for(lambda: self.simulator.time() > start + 0.5, "time")
        passed = self.simulator.time() - start
        # A busy machine may be slower.
        self.assertLess(passed / (time.monotonic() - begin), 0.3)
        self.call("set_real_time_factor", real_time_factor=0.0)  # no limit
        self.assertEqual(self.simulator.physics()["max_update_rate"], 0.0)
        start = self.simulator.time()
        wait_for(lambda: self.simulator.time() > start + 5.0, "time")

    def test_7_world_state_is_link_states_with_a_stamp(self):
        links = Connected("/gazebo/link_states", LinkStates)
        world = Connected("/gazebo/world_state", WorldState)
        self.simulator.put("arm", [0, 0, 1, *UP], [1.0, 2.0, 3.0, 0.4, 0.5, 0.6])
        # The publisher may know of them a little later than they do themselves.
        for listener in (links, world):
            wait_for(
                lambda listener=listener: (
                    self.simulator.run(0.001) or listener.messages
                ),
                "the first message",
            )
        begin, before = self.simulator.time(), len(links.messages)
        self.simulator.run(0.01)
        wait_for(lambda: len(links.messages) >= before + 10, "ten link states")
        # What changes while time stands still comes on world_state, too.
        world.wait(lambda m: m.header.stamp.to_sec() > begin + 0.0095, "the last")
        stamped = {m.header.stamp.to_nsec(): m for m in world.messages}
        steps = [stamped[stamp] for stamp in sorted(stamped)[-10:]]
        for one, other in zip(links.messages[-10:], steps):
            for field in ("name", "pose", "twist"):
                self.assertEqual(getattr(one, field), getattr(other, field))
            self.assertEqual((other.header.frame_id, other.wrench), ("world", []))
        links.close()
        world.close()

    def test_a_client_of_dynamic_reconfigure_changes_the_physics(self):
        client = Client("/gazebo", timeout=DEADLINE)
        groups = client.get_group_descriptions()
        names = [parameter["name"] for parameter in groups["parameters"]]
        self.assertEqual(names[:3], ["time_step", "max_update_rate", "gravity_x"])
        self.assertEqual(len(names), 15)
        before = client.get_configuration()["gravity_z"]
        told = client.update_configuration({"gravity_z": -500.0, "sor_pgs_iters": 60})
        self.assertEqual((told["gravity_z"], told["sor_pgs_iters"]), (-100.0, 60))
        physics = self.simulator.physics()
        self.assertEqual(physics["gravity"], [0.0, 0.0, -100.0])
        self.assertEqual(physics["ode_config"]["sor_pgs_iters"], 60)
        self.assertEqual(rospy.get_param("/gazebo/gravity_z"), -100.0)
        client.update_configuration({"gravity_z": before, "sor_pgs_iters": 50})
        client.close()

    def test_lights_are_kept_as_data(self):
        answer = self.spawn("lamp", LAMP, "spawn_sdf_model", (10, 0, 0, *UP))
        self.assertTrue(answer["success"], answer)
        seen = self.simulator.state("arm", "lamp")
        self.assertEqual(seen["pose"][:3], [-11.0, -2.0, -2.0])
        self.assertNotIn("lamp", self.simulator.models())
        again = self.spawn("lamp", LAMP, "spawn_sdf_model")
        self.assertIn("entity already exists", again["status_message"])
        told = self.call("get_light_properties", light_name="lamp")
        self.assertEqual(told["attenuation_linear"], 0.25)
        changed = {"light_name": "lamp", "diffuse": {"r": 1.0, "a": 1.0}}
        changed["pose"] = pose_fields([4, 5, 6, *UP])
        self.assertTrue(self.call("set_light_properties", **changed)["success"])
        told = self.call("get_light_properties", light_name="lamp")
        self.assertEqual(told["diffuse"], {"r": 1.0, "g": 0.0, "b": 0.0, "a": 1.0})
        seen = self.simulator.state("arm", "lamp")
        self.assertEqual(seen["pose"][:3], [-4.0, -5.0, -5.0])
        self.assertTrue(self.call("delete_light", light_name="lamp")["success"])
        self.assertFalse(self.simulator.state("arm", "lamp")["success"])
