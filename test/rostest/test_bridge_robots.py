"""Several robots: one bridge for all, a bridge for each, and none for nonsense."""

import re
import subprocess
import unittest

import rosgraph
import rospy
import tf2_ros
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from gazebo_msgs.msg import LinkState, ModelState
from gazebo_msgs.srv import (
    DeleteModel,
    GetLinkState,
    GetModelProperties,
    SetLinkState,
    SetModelState,
    SpawnModel,
)
from geometry_msgs.msg import Point, Pose, Quaternion
from sensor_msgs.msg import JointState
from std_srvs.srv import Empty
from support.bridge.arm import URDF
from support.programs import Program, run
from support.ros_testing import (
    DEADLINE,
    REPOSITORY,
    Connected,
    Launch,
    Listener,
    NodeLog,
    program,
    wait_for,
)
from tf2_msgs.msg import TFMessage

ELBOW, KNEE = "left_elbow_joint", "right_knee_joint"
HEIGHT = 0.793
FLYER = (REPOSITORY / "test" / "data" / "free_bodies.urdf").read_text()
"""A robot whose base floats in the world, with a free body besides."""


def place(x=0.0, y=0.0, z=HEIGHT):
    return Pose(Point(x, y, z), Quaternion(0.0, 0.0, 0.0, 1.0))


def call(name, kind, *arguments):
    return rospy.ServiceProxy(f"/gazebo/{name}", kind)(*arguments)


def link_place(link):
    """Give where a link of the flyer is."""
    answer = call("get_link_state", GetLinkState, f"flyer::{link}", "world")
    assert answer.success, answer.status_message
    p = answer.link_state.pose.position
    return [round(number, 6) for number in (p.x, p.y, p.z)]


def spawn(name, urdf, x):
    service = rospy.ServiceProxy("/gazebo/spawn_urdf_model", SpawnModel)
    answer = service(name, urdf, "", place(x), "world")
    assert answer.success, answer.status_message


class Robot:
    """The topics of a robot."""

    def __init__(self, namespace):
        self.states = Connected(f"{namespace}/joint_states", JointState)
        self._commands = rospy.Publisher(
            f"{namespace}/joint_commands", JointState, queue_size=1000
        )
        wait_for(self._commands.get_num_connections, f"a bridge for {namespace}")

    def command(self, **positions):
        message = JointState(name=[*positions], position=[*positions.values()])
        self._commands.publish(message)

    def wait_for(self, **positions):
        """Wait for joint states, from now on, that have these positions."""

        def has_them(message):
            found = dict(zip(message.name, message.position))
            return all(
                abs(found.get(name, 1e9) - position) < 1e-9
                for name, position in positions.items()
            )

        self.states.clear()
        return self.states.wait(has_them, f"{positions}")


class TestBridgeRobots(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.wait_for_service("/gazebo/spawn_urdf_model", DEADLINE)
        cls.urdf = rospy.get_param("/robot_description")
        cls.statics = Listener("/tf_static", TFMessage)
        cls.log = NodeLog("/bridge_of_two")
        spawn("a", cls.urdf, 0.0)
        asked = f"-urdf -param robot_description -model b -x 1 -z {HEIGHT}"
        subprocess.run([program("spawn_model", "gazebo_ros"), *asked.split()])
        cls.a, cls.b = Robot("/a"), Robot("/b")
        cls.buffer = tf2_ros.Buffer()
        cls.transforms = tf2_ros.TransformListener(cls.buffer)

    def where(self, frame, parent="map"):
        """Give a frame's place, as numbers; nothing if it is not known."""
        try:
            found = self.buffer.lookup_transform(parent, frame, rospy.Time())
        except tf2_ros.TransformException:
            return None
        t, q = found.transform.translation, found.transform.rotation
        return [round(number, 6) for number in (t.x, t.y, t.z, q.x, q.y, q.z, q.w)]

    def hand(self, name):
        """Give the place of a robot's hand, seen from the robot."""
        return self.where(f"{name}/left_wrist_yaw_link", f"{name}/base_link")

    def wait_until_at(self, frame, x):
        """Wait until a base is upright at some x."""
        wanted = [x, 0.0, HEIGHT, 0.0, 0.0, 0.0, 1.0]
        wait_for(lambda: self.where(frame) == wanted, f"{frame} at {x}")

    def test_1_each_robot_has_its_own_joints_and_commands(self):
        for robot in (self.a, self.b):
            self.assertEqual(len(robot.states.wait().name), 29)
        self.a.command(**{ELBOW: 0.5})
        self.a.wait_for(**{ELBOW: 0.5})
        self.b.wait_for(**{ELBOW: 0.0})
        self.b.command(**{ELBOW: 0.25, KNEE: 0.75})
        self.b.wait_for(**{ELBOW: 0.25, KNEE: 0.75})
        self.a.wait_for(**{ELBOW: 0.5, KNEE: 0.0})
        for number in range(100):
            self.a.command(**{ELBOW: 0.001 * number})
            self.b.command(**{ELBOW: -0.001 * number})
        self.a.wait_for(**{ELBOW: 0.099, KNEE: 0.0})
        self.b.wait_for(**{ELBOW: -0.099, KNEE: 0.75})
        topics = dict(rosgraph.Master("/test").getSystemState()[0])
        self.assertNotIn("/joint_states", topics)

    def test_2_each_robot_has_its_own_frames(self):
        self.wait_until_at("a/base_link", 0.0)
        self.wait_until_at("b/base_link", 1.0)
        for prefix in ("a/", "b/"):
            for frame in ("left_wrist_yaw_link", "imu_in_torso", "body_imu"):
                wait_for(lambda f=prefix + frame: self.where(f, "world"), frame)
        for robot in (self.a, self.b):
            robot.command(**{ELBOW: 0.0})
        wait_for(lambda: self.hand("a") == self.hand("b"), "both hands alike")
        before = self.hand("b")
        self.a.command(**{ELBOW: 1.25})
        wait_for(lambda: self.hand("a") != before, "one hand to move")
        self.b.wait_for(**{ELBOW: 0.0})
        self.assertEqual(self.hand("b"), before)
        move = rospy.ServiceProxy("/gazebo/set_model_state", SetModelState)
        move(ModelState(model_name="b", pose=place(3.0), reference_frame="world"))
        self.wait_until_at("b/base_link", 3.0)
        self.wait_until_at("a/base_link", 0.0)

    def test_3_the_static_frames_are_there_once(self):
        *_, newest = (
            message
            for message in self.statics.messages
            if message._connection_header["callerid"] == "/bridge_of_two"
        )
        edges = [
            (transform.header.frame_id, transform.child_frame_id)
            for transform in newest.transforms
        ]
        expected = {("world", "map")}
        for name in "ab":
            expected |= {
                (f"{name}/base_link", f"{name}/pelvis"),
                (f"{name}/imu_in_torso", f"{name}/body_imu"),
            }
        # It also has the fixed joints, if the simulator was silent for long.
        self.assertLessEqual(expected, {*edges})
        self.assertEqual(len({child for _, child in edges}), len(edges))

    def test_4_a_robot_is_deleted_and_spawned_again(self):
        statuses = Connected("/diagnostics", DiagnosticArray)
        self.addCleanup(statuses.close)

        def wait_for_status(level, words):
            def has_it(message):
                return any(
                    status.name == "bridge_of_two: a joints"
                    and (status.level, words) == (level, status.message)
                    for status in message.status
                )

            statuses.clear()
            statuses.wait(has_it, words)

        wait_for_status(DiagnosticStatus.OK, "29 joints are published")
        self.log.clear()
        rospy.ServiceProxy("/gazebo/delete_model", DeleteModel)("a")
        self.log.wait(lambda m: "no link of it" in m.msg, "a line of the bridge")
        wait_for_status(DiagnosticStatus.ERROR, "the simulator has no link of a")
        self.b.states.clear()
        gone = self.b.states.wait().header.stamp
        self.b.command(**{ELBOW: 0.125})
        self.b.wait_for(**{ELBOW: 0.125})
        stamps = [message.header.stamp for message in self.a.states.messages]
        self.assertEqual([stamp for stamp in stamps if stamp > gone], [])
        spawn("a", self.urdf, -2.0)
        self.a.wait_for(**{ELBOW: 0.0})
        self.wait_until_at("a/base_link", -2.0)
        self.a.command(**{ELBOW: 0.375})
        self.a.wait_for(**{ELBOW: 0.375})
        self.b.wait_for(**{ELBOW: 0.125})
        wait_for_status(DiagnosticStatus.OK, "29 joints are published")

    def test_5_a_bridge_in_each_namespace_finds_its_robot_upward(self):
        rospy.set_param("/left/robot_description", FLYER)
        spawn("flyer", FLYER, 5.0)
        for space, model in (("/left/arm", "flyer"), ("/right", "b")):
            launch = Launch(
                "bridge.launch",
                f"robot_name:={model}",
                f"frame_prefix:={space[1:]}/",
                f"__ns:={space}",
            )
            self.addClassCleanup(launch.stop)
        left, right = Robot("/left/arm"), Robot("/right")
        self.assertEqual(left.states.wait().name, ["elbow"])
        self.assertEqual(len(right.states.wait().name), 29)
        left.command(elbow=0.5)
        left.wait_for(elbow=0.5)
        right.command(**{ELBOW: 0.625})
        for robot in (right, self.b):
            robot.wait_for(**{ELBOW: 0.625})
        self.wait_until_at("left/arm/base", 5.0)
        wait_for(lambda: self.where("left/arm/arm"), "the left one's arm")
        self.wait_until_at("right/base_link", 3.0)
        wait_for(
            lambda: self.where("right/left_wrist_yaw_link"), "the right one's hand"
        )
        left.command(elbow=0.0)
        left.wait_for(elbow=0.0)

    def seen(self, frame):
        """Give where a frame of the flyer is on TF."""
        found = self.where(f"left/arm/{frame}")
        return found and found[:3]

    def test_6_what_floats_moves_in_the_map_and_a_free_body_is_set_alone(self):
        found = call("get_model_properties", GetModelProperties, "flyer")
        self.assertEqual(found.body_names, ["base", "arm", "puck"])
        self.assertEqual(found.joint_names, ["elbow"])
        state = ModelState(model_name="flyer", pose=place(1.0, 2.0, 3.0))
        self.assertTrue(call("set_model_state", SetModelState, state).success)
        wait_for(lambda: self.seen("base") == [1.0, 2.0, 3.0], "the base on TF")
        wait_for(lambda: self.seen("arm") == [1.5, 2.0, 3.0], "the arm on TF")
        self.assertEqual(link_place("puck"), [1.5, 2.0, 4.0])
        for state in (
            LinkState(link_name="flyer::puck", pose=place(0.0, 0.0, 5.0)),
            LinkState(link_name="arm", pose=place(1.5, 2.0, 3.0)),
        ):
            self.assertTrue(call("set_link_state", SetLinkState, state).success)
            self.assertEqual(link_place("puck"), [0.0, 0.0, 5.0])
            self.assertEqual(link_place("base"), [1.0, 2.0, 3.0])
        call("reset_simulation", Empty)
        self.assertEqual(link_place("puck"), [5.5, 0.0, round(HEIGHT + 1.0, 6)])
        self.assertEqual(link_place("base"), [5.0, 0.0, HEIGHT])
        # What the old one has from before the reset would make it refuse what is new.
        self.transforms.unregister()
        type(self).buffer = tf2_ros.Buffer()
        type(self).transforms = tf2_ros.TransformListener(self.buffer)
        self.wait_until_at("left/arm/base", 5.0)

    def test_7_of_a_robot_that_vanished_it_says_so(self):
        """None of its links has a mass: its model is there, without a link."""
        statuses = Connected("/diagnostics", DiagnosticArray)
        self.addCleanup(statuses.close)
        rospy.set_param("/hollow", re.sub("(?s)<inertial>.*?</inertial>", "", URDF))
        bridge = Program(
            *("link_states_bridge.py", "__name:=bridge_of_none", "_model_name:=hollow"),
            "_robot_description:=/hollow",
        )
        self.addCleanup(bridge.wait)
        self.addCleanup(bridge.terminate)
        for listener in (self.log, statuses):
            listener.clear()
        self.log.wait(lambda m: "links without mass" in m.msg, "a line of the bridge")
        statuses.wait(
            lambda m: any(
                "dropped every link of hollow" in s.message for s in m.status
            ),
            "a status",
        )


def test_robots_that_make_no_sense_end_the_node_with_a_sentence():
    rospy.set_param("/not_a_robot", "hello")
    for robots, words in (
        ("[a]", "must be a dictionary with a name"),
        ("[{name: a, description: /not_a_robot}]", "description"),
    ):
        ended = run("link_states_bridge.py", "__name:=nonsense", f"_robots:={robots}")
        assert ended.returncode == 1
        (line,) = (ended.stdout + ended.stderr).splitlines()
        assert words in line
