"""spawn_model says to Gazebo what it is told, and tells what came of it.

Some cases run against the stand-in, where time stands still, the others against
services of this test that keep what they are asked.
"""

import os
import shutil
import signal
import subprocess
import tempfile
import unittest
from pathlib import Path

import numpy as np
import rospy
from gazebo_msgs.srv import (
    DeleteModel,
    GetModelState,
    GetWorldProperties,
    GetWorldPropertiesResponse,
    SetModelConfiguration,
    SetModelConfigurationResponse,
    SpawnModel,
    SpawnModelResponse,
)
from gazebo_ros import gazebo_interface
from geometry_msgs.msg import Point, Pose, Quaternion
from rosgraph_msgs.msg import Clock, Log
from scipy.spatial.transform import Rotation
from std_srvs.srv import Empty, EmptyResponse
from support.ros_testing import DEADLINE, REPOSITORY, Listener, wait_for

URDF = str(REPOSITORY / "urdf" / "g1_29dof.urdf")
LINK = '<link name="link"/>'
BOX = '<sdf version="1.6"><model name="box"/></sdf>'


class Recorder:
    """Gazebo's services below a namespace; they keep what they are asked."""

    def __init__(self, namespace):
        self.requests, self.models = [], []
        answers = {
            "spawn_sdf_model": (SpawnModel, SpawnModelResponse(True, "spawned")),
            "spawn_urdf_model": (SpawnModel, SpawnModelResponse(True, "spawned")),
            "set_model_configuration": (
                SetModelConfiguration,
                SetModelConfigurationResponse(True, "set"),
            ),
            "unpause_physics": (Empty, EmptyResponse()),
        }
        self._services = [
            rospy.Service(f"{namespace}/{name}", kind, self._answer(name, response))
            for name, (kind, response) in answers.items()
        ]
        self._services.append(
            rospy.Service(
                f"{namespace}/get_world_properties",
                GetWorldProperties,
                lambda _: GetWorldPropertiesResponse(
                    model_names=self.models, success=True
                ),
            )
        )

    def _answer(self, name, response):
        def answer(request):
            self.requests.append((name, request))
            return response

        return answer

    def close(self):
        for service in self._services:
            service.shutdown()


def start(*arguments, **options):
    return subprocess.Popen(
        ["rosrun", "gazebo_ros", "spawn_model", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        **options,
    )


def run(*arguments, text="", **options):
    """Run spawn_model to its end; give exit code and output."""
    process = start(*arguments, stdin=subprocess.PIPE, **options)
    output, _ = process.communicate(text, timeout=DEADLINE)
    return process.returncode, output


def interrupt(process):
    """Interrupt it as Ctrl-C would; give exit code and the rest of its output."""
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=DEADLINE)
    return process.returncode, output


class TestSpawnModel(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.log = Listener("/rosout", Log)
        rospy.wait_for_service("/gazebo/get_world_properties", DEADLINE)
        cls.model_state = rospy.ServiceProxy("/gazebo/get_model_state", GetModelState)
        cls.world = rospy.ServiceProxy(
            "/gazebo/get_world_properties", GetWorldProperties
        )

    def setUp(self):
        self.log.clear()

    def wait_for_words(self, words):
        """Wait for a line of the log; when it comes, rospy is done with it.

        Interrupted while it logs its first line, rospy waits for itself for ever.
        """
        self.log.wait(lambda message: words in message.msg, words)

    def recorder(self, namespace):
        recorder = Recorder(namespace)
        self.addCleanup(recorder.close)
        return recorder

    def delete_later(self, *names):
        delete = rospy.ServiceProxy("/gazebo/delete_model", DeleteModel)
        for name in names:
            self.addCleanup(delete, name)

    def test_every_argument_reaches_gazebo_in_order(self):
        recorder = self.recorder("/recorder")
        text = '<sdf><mesh filename="package://a/b.stl"/></sdf>'
        code, output = run(
            *("-sdf", "-stdin", "-model", "box", "-x", 1, "-y", -2, "-z", "3e-1"),
            *(
                "-R",
                "0.1",
                "-P",
                "-0.2",
                "-Y",
                "-1e-3",
                "-reference_frame",
                "desk::top",
            ),
            *(
                "-J",
                "left",
                "1",
                "-J",
                "right",
                "-2e-1",
                "-unpause",
                "-package_to_model",
            ),
            *("-robot_namespace", "/kitchen", "-gazebo_namespace", "/recorder/"),
            text=text,
        )
        self.assertEqual(code, 0, output)
        self.assertIn("spawned", output)
        names = [name for name, _ in recorder.requests]
        self.assertEqual(
            names, ["spawn_sdf_model", "set_model_configuration", "unpause_physics"]
        )
        spawn, joints, _ = (request for _, request in recorder.requests)
        self.assertEqual(spawn.model_name, "box")
        self.assertEqual(spawn.model_xml, text.replace("package", "model"))
        self.assertEqual(spawn.robot_namespace, "/kitchen")
        self.assertEqual(spawn.reference_frame, "desk::top")
        p, q = spawn.initial_pose.position, spawn.initial_pose.orientation
        self.assertEqual((p.x, p.y, p.z), (1.0, -2.0, 0.3))
        expected = Rotation.from_euler("xyz", [0.1, -0.2, -1e-3])
        turn = expected.inv() * Rotation.from_quat([q.x, q.y, q.z, q.w])
        self.assertLess(np.linalg.norm(turn.as_rotvec()), 1e-12)
        self.assertEqual(joints.model_name, "box")
        self.assertEqual(joints.joint_names, ["left", "right"])
        self.assertEqual(joints.joint_positions, (1.0, -0.2))

    def test_nothing_is_asked_that_was_not_wanted(self):
        recorder = self.recorder("/plain")
        code, output = run(
            *("-urdf", "-file", URDF, "-model", "g1", "-gazebo_namespace", "/plain"),
            "__ns:=/left",
        )
        self.assertEqual(code, 0, output)
        [(name, request)] = recorder.requests
        self.assertEqual(name, "spawn_urdf_model")
        self.assertEqual(request.model_xml, Path(URDF).read_text())
        self.assertEqual(request.robot_namespace, "/left/")
        self.assertEqual(request.reference_frame, "")

    def test_a_model_of_the_database_is_a_folder_of_the_model_path(self):
        recorder = self.recorder("/shelf")
        folder = Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, folder)
        (folder / "box").mkdir(parents=True)
        (folder / "box" / "model.sdf").write_text(BOX)
        wanted = ("-sdf", "-model", "b", "-gazebo_namespace", "/shelf", "-database")
        environment = {**os.environ, "GAZEBO_MODEL_PATH": str(folder)}
        code, output = run(*wanted, "box", env=environment)
        self.assertEqual((code, recorder.requests[0][1].model_xml), (0, BOX), output)
        code, output = run(*wanted, "ball", env=environment)
        self.assertEqual((code, len(recorder.requests)), (1, 1))
        self.assertIn("No ball/model.sdf below GAZEBO_MODEL_PATH", output)

    def elbow(self, model):
        """Give how a model's elbow is turned against its pelvis."""
        return self.model_state(model, f"{model}::left_elbow_link").pose.orientation

    def test_the_robot_stands_where_it_was_asked_while_time_stands_still(self):
        self.delete_later("g1", "straight")
        wanted = ("-urdf", "-param", "/robot", "-x", "-1", "-z", "0.79", "-model")
        code, output = run(*wanted, "g1", "-J", "left_elbow_joint", "0.5")
        self.assertEqual(code, 0, output)
        self.assertIn("SpawnModel: Successfully spawned entity", output)
        state = self.model_state("g1", "")
        self.assertEqual((state.pose.position.x, state.pose.position.z), (-1.0, 0.79))
        self.assertEqual(run(*wanted, "straight")[0], 0)
        self.assertNotEqual(self.elbow("g1"), self.elbow("straight"))
        code, output = run(*wanted, "g1")
        self.assertEqual(code, 1)
        self.assertIn("SpawnModel: Failure - entity already exists.", output)

    def test_unpause_lets_time_run_and_the_clock_keeps_its_rate(self):
        self.delete_later("runner")
        clock = Listener("/clock", Clock)
        self.addCleanup(clock.close)
        self.addCleanup(rospy.ServiceProxy("/gazebo/pause_physics", Empty))
        wanted = ("-urdf", "-file", URDF, "-model", "runner")
        self.assertEqual(run(*wanted)[0], 0)
        self.assertEqual(clock.messages, [])
        rospy.ServiceProxy("/gazebo/delete_model", DeleteModel)("runner")
        self.assertEqual(run(*wanted, "-unpause")[0], 0)
        wait_for(lambda: len(clock.messages) > 10, "the clock")
        first, second = (message.clock for message in clock.messages[-2:])
        self.assertAlmostEqual((second - first).to_sec(), 0.01)

    def test_it_waits_for_a_model(self):
        recorder = self.recorder("/patient")
        process = start(
            *("-urdf", "-file", URDF, "-model", "g1", "-wait", "table"),
            *("-gazebo_namespace", "/patient"),
        )
        self.wait_for_words("Waiting for the model table")
        self.assertEqual(recorder.requests, [])
        recorder.models = ["ground_plane", "table"]
        process.communicate(timeout=DEADLINE)
        self.assertEqual(process.returncode, 0)
        self.assertEqual(len(recorder.requests), 1)

    def test_it_waits_for_gazebo_and_says_so(self):
        wanted = ("-urdf", "-file", URDF, "-model", "g1", "-gazebo_namespace", "/late")
        process = start(*wanted)
        self.wait_for_words("Waiting for the service /late/spawn_urdf_model")
        recorder = self.recorder("/late")
        process.communicate(timeout=DEADLINE)
        self.assertEqual((process.returncode, len(recorder.requests)), (0, 1))

    def test_an_interrupt_ends_the_waiting_with_a_sentence(self):
        wanted = ("-urdf", "-file", URDF, "-model", "g1", "-gazebo_namespace", "/never")
        process = start(*wanted)
        self.wait_for_words("Waiting for the service /never/spawn_urdf_model")
        code, output = interrupt(process)
        self.assertEqual(code, 1)
        self.assertIn("interrupted before g1 was spawned", output)
        self.assertNotIn("Traceback", output)

    def test_a_bound_model_is_deleted_at_the_end(self):
        process = start("-urdf", "-file", URDF, "-model", "guest", "-b")
        wait_for(lambda: "guest" in self.world().model_names, "the guest")
        self.wait_for_words("Successfully spawned")
        code, output = interrupt(process)
        self.assertEqual(code, 0, output)
        self.assertIn("DeleteModel: successfully deleted model", output)
        self.assertNotIn("guest", self.world().model_names)

    def test_python_nodes_call_the_services_as_functions(self):
        self.delete_later("g1", "ball")
        pose = Pose(Point(1.0, 2.0, 3.0), Quaternion(0.0, 0.0, 0.0, 1.0))
        place = ("", pose, "world", "/gazebo")
        urdf = Path(URDF).read_text()
        sdf = BOX.replace("/></sdf>", f">{LINK}</model></sdf>")
        self.assertIs(
            gazebo_interface.spawn_urdf_model_client("g1", urdf, *place), True
        )
        self.assertIs(
            gazebo_interface.spawn_sdf_model_client("ball", sdf, *place), True
        )
        self.assertEqual(self.model_state("g1", "").pose, pose)
        self.assertEqual(self.model_state("ball", "").pose, pose)
        before = self.elbow("g1")
        configure = gazebo_interface.set_model_configuration_client
        joints = (["left_elbow_joint"], [0.5], "/gazebo")
        self.assertIs(configure("g1", "robot_description", *joints), True)
        self.assertNotEqual(self.elbow("g1"), before)

    def test_what_a_function_could_not_do_is_logged_and_returned(self):
        configure = gazebo_interface.set_model_configuration_client
        self.assertIs(configure("nobody", "", [], [], "/gazebo"), False)
        words = (
            "/gazebo/set_model_configuration: "
            "SetModelConfiguration: model does not exist"
        )
        self.wait_for_words(words)

    def test_what_is_no_model_is_told_in_one_sentence_and_not_spawned(self):
        cases = (
            (("-file", "/nowhere.urdf"), "", "Cannot read the file /nowhere.urdf"),
            (("-param", "/nowhere"), "", "The parameter /nowhere is empty or missing."),
            (("-param", "/empty"), "", "The parameter /empty is empty or missing."),
            (("-stdin",), "", "The input is empty or missing."),
            (("-stdin",), "hello", "The text of the input is not XML: Start tag"),
            (("-stdin",), "<robot/>", "SpawnModel: Failure - "),
        )
        for source, text, words in cases:
            with self.subTest(words):
                code, output = run("-urdf", *source, "-model", "bad", text=text)
                self.assertEqual(code, 1)
                self.assertIn(words, output)
                self.assertEqual(output.count("\n"), 1, output)
        self.assertEqual(self.world().model_names, ["ground_plane"])
