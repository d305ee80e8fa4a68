"""Each fault is made, the doctor names it alone, and /diagnostics agrees."""

import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
import unittest
import venv
from contextlib import ExitStack, contextmanager
from pathlib import Path
from unittest import mock
from urllib.parse import urlparse

import g1_description.srv
import pybullet
import rosgraph
import rosnode
import rospy
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from gazebo_msgs.srv import GetModelState
from geometry_msgs.msg import TransformStamped
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import Empty
from support.patient import (
    Patient,
    Started,
    publishers,
    start_bridge,
    wait_slowly,
    walk,
)
from support.ros_testing import (
    DEADLINE,
    REPOSITORY,
    Repeated,
    process_of,
    program,
)
from tf2_msgs.msg import TFMessage

from g1_description.cli.doctor import System, check_nodes, check_simulator

DESCRIPTION = "/robot_description"
ELSEWHERE = "198.51.100.7"
"""An address for documentation: nobody has it."""
URDF = REPOSITORY / "urdf" / "g1_29dof.urdf"


def publisher(topic, kind):
    """Publish on a topic, in a context."""
    made = rospy.Publisher(topic, kind, queue_size=1)
    stack = ExitStack()
    stack.callback(made.unregister)
    stack.made = made
    return stack


@contextmanager
def parameter(name, value):
    """Set a parameter for a while; None deletes it."""
    before = rospy.get_param(name)
    if value is None:
        rospy.delete_param(name)
    else:
        rospy.set_param(name, value)
    try:
        yield before
    finally:
        rospy.set_param(name, before)


def doctor(*arguments, python=(), **environment):
    """Run the command; give its exit code and what it prints."""
    command = [*python, program("doctor"), *arguments]
    if python:
        command = [*python, REPOSITORY / "scripts" / "doctor", *arguments]
    run = subprocess.run(
        command,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        timeout=DEADLINE,
    )
    assert "Traceback" not in run.stderr, run.stderr
    return run.returncode, run.stdout


class TestDoctor(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.patient = Patient()
        cls.addClassCleanup(cls.patient.close)
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = Path(folder.name)

    def assert_fault(self, name, *words, **options):
        """Walk, and check that the fault is found, and what it names."""
        found = walk(**options)
        self.assertIsNotNone(found, name)
        self.assertEqual(found.name, name, found)
        for word in words:
            self.assertIn(word, found.sentence + found.cure)
        return found

    def wait_for_report(self, is_bad, *words):
        """Wait until the bridge reports a fault, or none, on /diagnostics."""

        def says_so(message):
            parts = [s for s in message.status if s.name.startswith("link_states_b")]
            texts = " ".join(status.message for status in parts)
            is_worse = any(status.level > DiagnosticStatus.OK for status in parts)
            return (
                bool(parts)
                and is_worse == is_bad
                and all(word in texts for word in words)
            )

        self.patient.diagnostics.clear()
        self.patient.diagnostics.wait(says_so, f"{is_bad} {words}")

    def stop(self, part):
        """End a part; it is started again after the test."""
        self.addCleanup(self.patient.heal)
        self.patient.stop(part)

    def start_otherwise(self, part, *arguments):
        """Start a part that was stopped, until the end of the test."""
        self.patient.start(part, *arguments)
        self.addCleanup(self.patient.stop, part)

    def cure(self, found):
        """Do what the doctor says."""
        subprocess.run(
            found.cure, shell=True, check=True, timeout=DEADLINE, executable="/bin/bash"
        )

    def assert_mended_by(self, found, until):
        """Do what the doctor says, where it goes on until it is ended."""
        process = subprocess.Popen(
            found.cure, shell=True, start_new_session=True, executable="/bin/bash"
        )
        try:
            wait_slowly(lambda: walk(until) is None, "the cure to mend it")
        finally:
            os.killpg(process.pid, signal.SIGINT)
            process.wait(DEADLINE)

    # --- whole ------------------------------------------------------------------------

    def test_a_whole_chain_is_whole_and_the_bridge_says_the_same(self):
        self.assertIsNone(walk())
        self.wait_for_report(False, "link states arrive", "29 joints are published")

    def test_the_command_says_so_as_lines_and_as_json(self):
        begin = time.monotonic()
        code, text = doctor("--until", "diagnostics", "--json")
        print(f"the walk took {time.monotonic() - begin:.1f} s", file=sys.stderr)
        told = json.loads(text)
        self.assertEqual((code, told["whole"], told["fault"]), (0, True, None))
        self.assertEqual({link["state"] for link in told["links"]}, {"ok"})

    def test_ctrl_c_ends_it_quietly(self):
        with subprocess.Popen(
            [program("doctor")],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        ) as process:
            process.stdout.readline()  # the first link
            os.killpg(process.pid, signal.SIGINT)
            _, errors = process.communicate(timeout=DEADLINE)
        self.assertEqual(process.returncode, 130, errors)
        self.assertNotIn("Traceback", errors)

    # --- Python and packages ----------------------------------------------------------

    def test_a_python_that_is_not_of_ros(self):
        venv.create(self.folder / "bare", symlinks=True, with_pip=False)
        bare = self.folder / "bare" / "bin"
        code, text = doctor("--json", python=[bare / "python3"])
        told = json.loads(text)
        self.assertEqual((code, told["fault"]), (1, "wrong_python"))
        self.assertIn(str(bare), told["sentence"])
        self.assertEqual(told["cure"], "export PATH=/usr/bin:$PATH")
        # As rosrun starts it, it has the Python of ROS whatever is on PATH.
        path = f"{bare}:{os.environ['PATH']}"
        code, text = doctor("--json", "--until", "master", PATH=path)
        told = json.loads(text)
        self.assertEqual((code, told["fault"]), (0, None))
        self.assertIn(f"python3 on PATH ({bare}", told["links"][0]["remark"])

    def test_pybullet_is_absent(self):
        """In an environment that has everything else."""
        python, path = self.python_without("pybullet")
        code, text = doctor("--json", python=[python], PYTHONPATH=path)
        told = json.loads(text)
        self.assertEqual((code, told["fault"]), (1, "no_pybullet"), told)
        self.assertIn("-m pip install pybullet", told["cure"])

    def python_without(self, package):
        """Make an environment as that of this test, with all packages but one.

        Returns:
            Its Python, and the folders where it finds what was built.
        """
        venv.create(
            self.folder / "less",
            symlinks=True,
            with_pip=False,
            system_site_packages=True,
        )
        (site,) = (self.folder / "less" / "lib").glob("python*/site-packages")
        for entry in Path(pybullet.__file__).parent.iterdir():
            if not entry.name.startswith((package, "_distutils", "distutils")):
                (site / entry.name).symlink_to(entry)
        # What was built tells Python where the environment of the nodes is.
        built = Path(g1_description.srv.__file__).parents[2]
        copied = self.folder / "built"
        (copied / "g1_description").mkdir(parents=True)
        for entry in built.iterdir():
            if entry.name != "g1_description":
                (copied / entry.name).symlink_to(entry)
        for entry in (built / "g1_description").iterdir():
            if not entry.name.startswith(("built_with", "__pycache__")):
                (copied / "g1_description" / entry.name).symlink_to(entry)
        path = os.environ["PYTHONPATH"].replace(str(built), str(copied))
        return self.folder / "less" / "bin" / "python3", path

    # --- master and addresses ---------------------------------------------------------

    def test_no_master(self):
        with mock.patch.dict(os.environ, ROS_MASTER_URI="http://localhost:1"):
            self.assert_fault("no_master", "localhost:1", "nothing listens")
        with mock.patch.dict(os.environ, ROS_MASTER_URI="localhost"):
            self.assert_fault("bad_master_uri", "localhost")

    def test_the_own_address_is_wrong(self):
        with mock.patch.dict(os.environ, ROS_IP=ELSEWHERE):
            os.environ.pop("ROS_HOSTNAME", None)
            self.assert_fault(
                "wrong_ros_ip", f"ROS_IP is {ELSEWHERE}", "export ROS_IP="
            )
        with mock.patch.dict(os.environ, ROS_HOSTNAME="nowhere.invalid"):
            self.assert_fault("wrong_ros_ip", "ROS_HOSTNAME is nowhere.invalid")

    def test_the_address_of_another_node_is_wrong(self):
        for variable in ("ROS_HOSTNAME", "ROS_IP"):
            value = {"ROS_HOSTNAME": "nowhere.invalid", "ROS_IP": ELSEWHERE}[variable]
            environment = {"ROS_HOSTNAME": None, variable: value}
            topic = "/astray/joint_states"
            node = started_by_rostopic(topic, "std_msgs/Empty", **environment)
            self.addCleanup(node.process.kill)
            words = f"{node.name} registered with the address http://{value}"
            self.assert_fault("wrong_node_address", words)
            node.end(signal.SIGKILL)  # else it tries to reach itself
            rosnode.cleanup_master_blacklist(rosgraph.Master("/test"), [node.name])

    def test_a_dead_node_is_told_if_it_had_a_part_and_the_cure_mends_it(self):
        started_by_rostopic("/other", "std_msgs/Empty").end(signal.SIGKILL)
        self.assertIsNone(walk("nodes"))
        started_by_rostopic("/tf", "tf2_msgs/TFMessage").end(signal.SIGKILL)
        found = self.assert_fault("dead_node", "/tf_of_rostopic")
        self.cure(found)
        self.assertIsNone(walk("nodes"))
        self.assertEqual(publishers("/other"), [])

    def test_a_stopped_node_is_told_and_the_cure_lets_it_go_on(self):
        node = started_by_rostopic("/tf", "tf2_msgs/TFMessage")
        self.addCleanup(node.process.kill)
        node.process.send_signal(signal.SIGSTOP)
        found = self.assert_fault("hung_node", node.name)
        self.cure(found)
        self.assertIsNone(walk("nodes"))
        node.end(signal.SIGINT)

    def test_what_takes_connections_and_is_silent_hangs(self):
        node = started_by_rostopic("/tf", "tf2_msgs/TFMessage")
        node.end(signal.SIGKILL)
        port = urlparse(rosgraph.Master("/test").lookupNode(node.name)).port
        with socket.create_server(("", port)):
            self.assert_fault("hung_node", node.name)
        self.cure(self.assert_fault("dead_node", node.name))

    # --- the robot --------------------------------------------------------------------

    def test_the_description_is_absent_or_none(self):
        with parameter(DESCRIPTION, None):
            self.assert_fault("no_description", "robot_description")
        with parameter(DESCRIPTION, "<robot"):
            self.assert_fault("bad_description", DESCRIPTION)

    def test_without_a_description_the_cure_sets_it_beside_the_simulator(self):
        with parameter(DESCRIPTION, None):
            self.cure(self.assert_fault("no_description"))
            self.assertIsNone(walk())

    def test_meshes_are_missing(self):
        text = rospy.get_param(DESCRIPTION)
        lost = text.replace("head_link.stl", "skull.stl")
        with parameter(DESCRIPTION, lost):
            self.assert_fault("missing_meshes", "skull")

    def test_without_its_model_the_cure_spawns_it_on_its_feet(self):
        state = rospy.ServiceProxy("/gazebo/get_model_state", GetModelState)
        before = state("g1_robot", "").pose
        services = self.services()
        services.call("delete_model", "g1_robot")
        services.close()
        found = self.assert_fault("no_model", "g1_robot")
        self.wait_for_report(True, "no link of g1_robot")
        self.cure(found)
        self.assertIsNone(walk("urdf"))
        self.assertAlmostEqual(state("g1_robot", "").pose.position.z, before.position.z)

    def test_another_robot_was_spawned_and_the_cure_mends_it(self):
        services = self.services()
        services.call("delete_model", "g1_robot")
        other = turned_axis(rospy.get_param(DESCRIPTION), "left_knee_joint")
        services.call("spawn_urdf_model", "g1_robot", other, "", pose(), "world")
        bent = ["left_knee_joint"], [0.5]
        services.call("set_model_configuration", "g1_robot", "", *bent)
        services.close()
        self.wait_for_report(True, "off their axes: left_knee_joint")
        found = self.assert_fault("other_urdf", "left_knee_joint", DESCRIPTION)
        self.cure(found)
        self.assertIsNone(walk())
        self.wait_for_report(False)

    # --- the simulator and its time ---------------------------------------------------

    def test_time_is_paused(self):
        rospy.ServiceProxy("/gazebo/pause_physics", Empty)()
        self.addCleanup(rospy.ServiceProxy("/gazebo/unpause_physics", Empty))
        found = self.assert_fault("paused")
        self.wait_for_report(False, "paused")
        self.cure(found)
        self.assertIsNone(walk("time"))

    def test_two_clocks(self):
        with publisher("/clock", Clock):
            self.assert_fault("two_clocks", rospy.get_name())

    def test_no_simulator_no_clock_no_link_states(self):
        self.stop("simulator")
        self.assert_fault("no_simulator", "/gazebo/set_model_configuration")
        self.wait_for_report(True)
        away = "/clock:=/no_clock", "/gazebo/link_states:=/no_states"
        self.start_otherwise("simulator", *away)
        self.assert_fault("no_clock")
        with parameter("/use_sim_time", False):
            self.assert_fault("no_link_states", "/gazebo/link_states")

    def test_a_clock_that_is_silent_and_the_cures_mend_it(self):
        """The first one ends the simulator, the second starts another."""
        self.stop("simulator")
        before = rospy.get_param("/gazebo")
        self.addCleanup(rospy.set_param, "/gazebo", before)
        silent = "_pub_clock_frequency:=0.001", "_on_floor:=true"
        self.patient.start("simulator", *silent)
        wait_slowly(lambda: walk("time") is not None, "the end of its first message")
        found = self.assert_fault("silent_clock", "/gazebo")
        self.cure(found)
        self.patient.wait_for_end("simulator")
        found = self.assert_fault("no_simulator")
        with parameter(DESCRIPTION, rospy.get_param(DESCRIPTION)):
            self.assert_mended_by(found, "tf")

    def test_a_simulator_that_hangs_and_the_cure_ends_it(self):
        """It was stopped after it had been asked as a node."""
        system = System("")
        check_nodes(system)
        self.addCleanup(self.patient.heal)
        pid = process_of("/gazebo")
        os.kill(pid, signal.SIGSTOP)
        self.addCleanup(
            rosnode.cleanup_master_blacklist, rosgraph.Master("/test"), ["/gazebo"]
        )
        found = check_simulator(system)
        self.assertEqual(found.name, "hung_simulator")
        self.assertIn(str(pid), found.cure)
        self.cure(found)
        self.patient.wait_for_end("simulator")

    # --- the bridge -------------------------------------------------------------------

    def test_no_bridge_and_the_cure_mends_it(self):
        self.assert_fault("no_bridge", "/left/tf_joint_states", namespace="left")
        self.stop("bridge")
        self.patient.stop("state_publisher")  # the launch file brings it, too
        found = self.assert_fault("no_bridge", "/tf_joint_states", "bridge.launch")
        self.assert_mended_by(found, "diagnostics")

    def test_two_bridges_and_the_cure_mends_it(self):
        second = start_bridge("/second_bridge")
        self.addCleanup(second.end)
        found = self.assert_fault("two_bridges", "/link_states_bridge, /second_bridge")
        self.wait_for_report(True, "joint_states are also published by /second_bridge")
        self.cure(found)
        second.process.wait(DEADLINE)
        wait_slowly(lambda: walk("tf") is None, "one bridge alone")

    def test_another_publisher_of_joint_states(self):
        with publisher("/joint_states", JointState):
            self.assert_fault("two_joint_states", rospy.get_name())
            self.wait_for_report(True, f"also published by {rospy.get_name()}")

    # --- TF ---------------------------------------------------------------------------

    def test_no_robot_state_publisher(self):
        self.stop("state_publisher")
        self.assert_fault("no_state_publisher", "/tf_joint_states")
        none = KeyValue("listeners to tf_joint_states", "0")
        self.patient.diagnostics.clear()
        self.patient.diagnostics.wait(
            lambda m: any(none in status.values for status in m.status), str(none)
        )

    def test_tf_lacks_edges_and_the_cure_mends_it(self):
        self.stop("state_publisher")
        self.patient.start("state_publisher", "_tf_prefix:=other")
        found = self.assert_fault("no_tf", "pelvis -> ", "/robot_state_publisher")
        self.assert_mended_by(found, "tf")
        self.patient.stop("state_publisher")

    def test_an_edge_has_two_owners(self):
        edge = TransformStamped(child_frame_id="left_knee_link")
        edge.header.frame_id = "left_hip_yaw_link"
        edge.transform.rotation.w = 1.0
        with publisher("/tf", TFMessage) as stack:
            made = stack.made
            repeated = Repeated(lambda: made.publish(TFMessage([edge])), 0.05)
            self.addCleanup(repeated.close)
            words = "left_knee_link", rospy.get_name(), "/robot_state_publisher"
            self.assert_fault("two_tf_owners", *words)
            repeated.close()

    # --- the picture ------------------------------------------------------------------

    def test_the_browser_view_counts_before_a_page_is_open(self):
        words = "_port:=0", "_controls:=true", "_read_only:=true"
        page = Started("/web", "/web/set_logger_level", program("web.py"), *words)
        self.addCleanup(page.end)
        with mock.patch.dict(os.environ, DISPLAY=""):
            self.assertIsNone(walk(until="picture"))

    def test_without_a_screen_nothing_needs_to_show_the_robot(self):
        with mock.patch.dict(os.environ, DISPLAY=""):
            self.assertIsNone(walk(until="picture"))

    def test_with_a_screen_something_has_to_show_the_robot(self):
        with mock.patch.dict(os.environ, DISPLAY=":987"):
            self.assert_fault("no_picture", "rviz.launch", until="picture")

    # --- helpers ----------------------------------------------------------------------

    def services(self):
        from support.wire.services import Services

        return Services()


def started_by_rostopic(topic, kind, **environment):
    """Start a node that publishes nothing, but could."""
    name = f"/{topic[1:].replace('/', '_')}_of_rostopic"
    words = "/usr/bin/env", "rostopic", "pub", "-r", "0.1", topic, kind, "{}"
    return Started(name, topic, *words, **environment)


def pose():
    from geometry_msgs.msg import Pose

    made = Pose()
    made.position.z, made.orientation.w = 0.8, 1.0
    return made


def turned_axis(text, joint):
    """Turn a joint's axis in a URDF."""
    start = text.index(f'<joint name="{joint}"')
    begin = text.index('xyz="', text.index("<axis", start)) + 5
    return text[:begin] + "1 0 0" + text[text.index('"', begin) :]
