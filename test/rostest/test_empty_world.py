"""A launch file for Gazebo: its world file, its parameters, and spawn_model.

Where time stands still spawn_model works with the stand-in, elsewhere with services of
this test that keep what they are asked.
"""

import io
import math
import re
import signal
import subprocess
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import rospy
from gazebo_msgs.msg import LinkStates
from gazebo_msgs.srv import (
    DeleteModel,
    GetJointProperties,
    GetPhysicsProperties,
    GetWorldProperties,
    GetWorldPropertiesResponse,
    SetModelConfiguration,
    SetModelConfigurationResponse,
    SpawnModel,
    SpawnModelResponse,
)
from gazebo_ros import gazebo_interface
from geometry_msgs.msg import Point, Pose, Quaternion
from moveit_messages import MOVE, REMOVE, can, collision_object, pose
from rosgraph_msgs.msg import Clock, Log
from scipy.spatial.transform import Rotation
from std_msgs.msg import String
from std_srvs.srv import Empty, EmptyResponse
from support.golden.simulator import Simulator
from support.programs import run
from support.ros_testing import (
    DEADLINE,
    REPOSITORY,
    Listener,
    process_of,
    program,
    wait_for,
)
from visualization_msgs.msg import Marker, MarkerArray

from g1_description.errors import DescriptionError
from g1_description.gazebo.node import make_world
from g1_description.gazebo.parameters import GazeboParameters, SpawnParameters
from g1_description.gazebo.programs import spawn_model, spawn_robot
from g1_description.gazebo.programs.planning_scene import PlanningScene
from g1_description.gazebo.programs.spawn_model import GazeboServices
from g1_description.scenes.scene import Scene
from g1_description.scenes.scene_file import objects_of_yaml, sdf_of

SHELF = REPOSITORY / "test" / "data" / "shelf.world"
MODELS = ["ground_plane", "shelf", "cube"]
SECOND = "/second/gazebo"
URDF = str(REPOSITORY / "urdf" / "g1_29dof.urdf")
LINK = '<link name="link"/>'
BOX = f'<sdf version="1.6"><model name="box">{LINK}</model></sdf>'
ELBOW, KNEE = "left_elbow_joint", "left_knee_joint"


@pytest.fixture(scope="module")
def simulator():
    return Simulator()


def test_models_lights_and_physics_are_those_of_the_file(simulator):
    assert simulator.models() == MODELS
    physics = simulator.physics()
    assert physics["gravity"] == [0.0, 0.0, -2.0]
    assert (physics["time_step"], physics["max_update_rate"]) == (0.002, 500)
    ode = physics["ode_config"]
    assert (ode["sor_pgs_iters"], ode["sor_pgs_w"]) == (77, 1.4)
    assert (ode["erp"], ode["cfm"]) == (0.3, 0.0)
    board = simulator.link("shelf::board")["pose"]
    assert board == [1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    assert simulator.call("get_light_properties", light_name="sun")["success"]


def test_the_cube_comes_to_rest_on_the_board(simulator):
    simulator.run(2.0)
    assert simulator.state("cube")["pose"][2] == pytest.approx(1.11, abs=0.002)


def test_objects_are_published_to_who_comes_and_when_they_change(simulator):
    topics = (
        Listener("/gazebo/scene", String),
        Listener("/gazebo/object_states", LinkStates),
        Listener("/gazebo/world_markers", MarkerArray),
    )
    scene, states, markers = topics
    names = ["shelf::leg", "shelf::board", "cube"]

    def names_in(message):
        return [each.name for each in objects_of_yaml(message.data)]

    scene.wait(lambda message: names_in(message) == names)
    states.wait(lambda message: message.name == names)
    markers.wait(lambda message: [m.ns for m in message.markers] == names[1:])
    ball = Scene().sphere("ball", 0.2, [0, 0, 3], color=[0, 1, 0])
    for name in ("map", "ball"):  # the former cannot be the name of an object
        text = sdf_of([ball])
        simulator.call("spawn_sdf_model", model_name=name, model_xml=text)
    scene.wait(lambda message: names_in(message) == [*names, "ball"])
    pose = {"position": {"x": 2.0, "y": 0.0, "z": 0.5}, "orientation": {"w": 1.0}}
    state = {"model_name": "ball", "pose": pose}
    simulator.call("set_model_state", model_state=state)
    states.wait(lambda m: m.name == ["ball"] and m.pose[0].position.x == 2.0)
    (moved,) = markers.wait(lambda message: len(message.markers) == 1).markers
    assert (moved.ns, moved.type, moved.color.g) == ("ball", Marker.SPHERE, 1.0)
    assert (moved.pose.position.x, moved.scale.y) == (2.0, 0.4)
    for name in ("ball", "map"):
        simulator.call("delete_model", model_name=name)
    gone = markers.wait(lambda m: any(x.action == Marker.DELETE for x in m.markers))
    assert gone.markers[0].ns == "ball"
    for topic in topics:
        topic.close()


def test_objects_of_moveit_come_move_and_go(simulator):
    scene = PlanningScene(GazeboServices("/gazebo"))
    objects = Listener("/gazebo/scene", String)

    def is_there(message):
        return "can" in [each.name for each in objects_of_yaml(message.data)]

    def height():
        if "can" not in simulator.models():
            return None
        state = simulator.call("get_model_state", model_name="can")
        return state["pose"][2]

    scene.take(can())
    objects.wait(is_there)
    assert height() == pytest.approx(0.5)
    scene.take(collision_object("can", operation=MOVE, at=pose(3, 0, 0.7)))
    assert height() == pytest.approx(0.7)
    scene.take(collision_object("can", operation=REMOVE))
    objects.wait(lambda message: not is_there(message))
    scene.take(collision_object("can"))  # without shapes
    assert height() is None
    objects.close()


class Server:
    """A second simulator of this master, paused, with a command line of gzserver."""

    def __init__(self, *words):
        """Start it, and wait until it answers."""
        self._output = tempfile.TemporaryFile()  # noqa: SIM115  (kept until the end)
        command = [program("gzserver", "gazebo_ros"), "-u", *map(str, words)]
        self._process = subprocess.Popen(
            [*command, "__ns:=/second", "__name:=gazebo"],
            stdout=self._output,
            stderr=subprocess.STDOUT,
        )
        wait_for(lambda: process_of(SECOND) == self._process.pid, "the simulator")
        # dynamic_reconfigure's server is made last: it has written its numbers.
        rospy.wait_for_service(f"{SECOND}/set_parameters", DEADLINE)

    def physics(self):
        """Give gravity along z, the time step, and the solver's iterations."""
        name = f"{SECOND}/get_physics_properties"
        now = rospy.ServiceProxy(name, GetPhysicsProperties)()
        return now.gravity.z, now.time_step, now.ode_config.sor_pgs_iters

    def output(self):
        """Give all it has written."""
        self._output.seek(0)
        return self._output.read().decode()

    def kill(self):
        """End it, so that it cannot tidy up behind itself."""
        self._process.kill()
        self._process.wait(DEADLINE)


@pytest.fixture
def serve():
    """Give what starts a server in the place of the last one, killed before."""
    servers = []

    def start(*words):
        if servers:
            servers[-1].kill()
        servers.append(Server(*words))
        return servers[-1]

    yield start
    servers[-1].kill()
    rospy.delete_param("/second")


def test_what_a_former_simulator_wrote_is_no_wish_and_a_wish_wins_over_the_file(serve):
    server = serve("_gravity_z:=-1", "_initial/time_step:=0.01")
    assert server.physics() == (-9.8, 0.01, 50)
    words = "~gravity_z = -1 is ignored; set ~initial/gravity_z"
    assert server.output().count(words) == 1
    assert "overrides" not in server.output()  # there is no file
    assert rospy.get_param(f"{SECOND}/gravity_z") == -9.8
    rospy.delete_param(f"{SECOND}/initial")
    server = serve(SHELF)
    assert server.physics() == (-2.0, 0.002, 77)
    assert rospy.get_param(f"{SECOND}/gravity_z") == -2.0
    assert "overrides" not in server.output()
    rospy.set_param(f"{SECOND}/initial/gravity_z", -1)
    server = serve(SHELF, "_initial/sor_pgs_iters:=77")
    assert server.physics() == (-1.0, 0.002, 77)
    words = "shelf.world: gravity_z is -1 (~initial/gravity_z overrides the file's -2)"
    assert words in server.output()
    assert server.output().count("overrides") == 1


def test_a_world_file_that_is_none_is_named():
    for path, words in (
        ("/nowhere/w.world", "World file /nowhere/w.world does not exist."),
        (__file__, f"World file {__file__}: The SDF is not XML"),
    ):
        with pytest.raises(DescriptionError, match=re.escape(words)):
            make_world(GazeboParameters(world=path))


def test_a_wish_that_cannot_be_ends_the_node_with_its_name():
    done = run("gazebo_stand_in.py", "__ns:=/third", "_initial/gravity_z:=down")
    assert done.returncode == 1
    words = "~initial/gravity_z must be a float like -9.8 (got 'down')."
    assert words in done.stderr
    assert "Traceback" not in done.stderr


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


@pytest.fixture
def record():
    """Give what makes recorders."""
    recorders = []

    def make(namespace):
        recorders.append(Recorder(namespace))
        return recorders[-1]

    yield make
    for recorder in recorders:
        recorder.close()


@pytest.fixture(scope="module")
def log():
    return Listener("/rosout", Log)


@pytest.fixture
def hears(log):
    """Give what waits for a line of the log; when it comes, rospy is done with it.

    Interrupted while it logs its first line, rospy waits for itself for ever.
    """
    log.clear()
    return lambda words: log.wait(lambda message: words in message.msg, words)


def start(*arguments):
    return subprocess.Popen(
        [program("spawn_model", "gazebo_ros"), *map(str, arguments)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )


def ended(process, text=""):
    """Wait for its end; give exit code and the rest of its output."""
    output, _ = process.communicate(text, timeout=DEADLINE)
    return process.returncode, output


def interrupted(process):
    """Interrupt it as Ctrl-C would; give exit code and the rest of its output."""
    process.send_signal(signal.SIGINT)
    return ended(process)


def spawn(*arguments):
    """Do what spawn_model does, in this process."""
    asked = spawn_model.parse([*map(str, arguments)])
    spawn_model.spawn(asked, spawn_model.GazeboServices(asked.gazebo_namespace))


def test_every_argument_reaches_gazebo_in_order(record):
    recorder = record("/recorder")
    text = '<sdf><mesh filename="package://a/b.stl"/></sdf>'
    words = """-sdf -stdin -model box -x 1 -y -2 -z 3e-1 -R 0.1 -P -0.2 -Y -1e-3
        -reference_frame desk::top -J left 1 -J right -2e-1 -unpause -package_to_model
        -robot_namespace /kitchen -gazebo_namespace /recorder/"""
    code, output = ended(start(*words.split()), text)
    assert code == 0, output
    assert "spawned" in output
    names = [name for name, _ in recorder.requests]
    assert names == ["spawn_sdf_model", "set_model_configuration", "unpause_physics"]
    spawned, joints, _ = (request for _, request in recorder.requests)
    assert spawned.model_name == "box"
    assert spawned.model_xml == text.replace("package", "model")
    assert spawned.robot_namespace == "/kitchen"
    assert spawned.reference_frame == "desk::top"
    p, q = spawned.initial_pose.position, spawned.initial_pose.orientation
    assert (p.x, p.y, p.z) == (1.0, -2.0, 0.3)
    expected = Rotation.from_euler("xyz", [0.1, -0.2, -1e-3])
    turn = expected.inv() * Rotation.from_quat([q.x, q.y, q.z, q.w])
    assert np.linalg.norm(turn.as_rotvec()) < 1e-12
    assert joints.model_name == "box"
    assert joints.joint_names == ["left", "right"]
    assert joints.joint_positions == (1.0, -0.2)


def test_it_waits_for_gazebo_and_asks_for_nothing_that_was_not_wanted(record, hears):
    wanted = "-urdf", "-file", URDF, "-model", "g1", "-gazebo_namespace", "/late"
    process = start(*wanted, "__ns:=/left")
    hears("Waiting for the service /late/spawn_urdf_model")
    recorder = record("/late")
    code, output = ended(process)
    assert code == 0, output
    [(name, request)] = recorder.requests
    assert name == "spawn_urdf_model"
    assert request.model_xml == Path(URDF).read_text()
    assert request.robot_namespace == "/left/"
    assert request.reference_frame == ""


def test_an_interrupt_ends_the_waiting_with_a_sentence(hears):
    wanted = "-urdf", "-file", URDF, "-model", "g1", "-gazebo_namespace", "/never"
    process = start(*wanted)
    hears("Waiting for the service /never/spawn_urdf_model")
    code, output = interrupted(process)
    assert code == 1
    assert "interrupted before g1 was spawned" in output
    assert "Traceback" not in output


def elbow(simulator, model):
    """Give how a model's elbow is turned against its pelvis."""
    return simulator.state(model, f"{model}::left_elbow_link")["pose"][3:]


def test_the_robot_stands_where_it_was_asked_while_time_stands_still(simulator):
    rospy.set_param("/robot", Path(URDF).read_text())
    wanted = ("-urdf", "-param", "/robot", "-x", "-1", "-z", "0.79", "-model")
    spawn(*wanted, "g1", "-J", ELBOW, "0.5")
    assert simulator.state("g1")["pose"][:3] == [-1.0, 0.0, 0.79]
    spawn(*wanted, "straight")
    assert elbow(simulator, "g1") != elbow(simulator, "straight")
    code, output = ended(start(*wanted, "g1"))
    assert code == 1
    assert "SpawnModel: Failure - entity already exists." in output
    for name in ("g1", "straight"):
        simulator.call("delete_model", model_name=name)


def test_it_waits_for_a_model_and_deletes_its_own_at_the_end(simulator, hears):
    process = start("-urdf", "-file", URDF, *["-model", "guest", "-b", "-wait", "box"])
    hears("Waiting for the model box")
    assert "guest" not in simulator.models()
    simulator.call("spawn_sdf_model", model_name="box", model_xml=BOX)
    hears("Successfully spawned")
    assert "guest" in simulator.models()
    code, output = interrupted(process)
    assert code == 0, output
    assert "DeleteModel: successfully deleted model" in output
    assert simulator.models() == [*MODELS, "box"]
    simulator.call("delete_model", model_name="box")


def test_unpause_lets_time_run_and_the_clock_keeps_its_rate(simulator):
    clock = Listener("/clock", Clock)
    wanted = "-urdf", "-file", URDF, "-model", "runner"
    spawn(*wanted)
    assert clock.messages == []
    simulator.call("delete_model", model_name="runner")
    spawn(*wanted, "-unpause")
    wait_for(lambda: len(clock.messages) > 10, "the clock")
    # Before the pause, which publishes the time at which it began.
    stamps = [message.clock.to_nsec() for message in clock.messages]
    simulator.call("pause_physics")
    assert min(np.diff(stamps)) == 10_000_000
    clock.close()
    simulator.call("delete_model", model_name="runner")


def test_python_nodes_call_the_services_as_functions(simulator):
    pose = Pose(Point(1.0, 2.0, 3.0), Quaternion(0.0, 0.0, 0.0, 1.0))
    place = ("", pose, "world", "/gazebo")
    urdf = Path(URDF).read_text()
    assert gazebo_interface.spawn_urdf_model_client("g1", urdf, *place) is True
    assert gazebo_interface.spawn_sdf_model_client("ball", BOX, *place) is True
    for name in ("g1", "ball"):
        assert simulator.state(name)["pose"] == [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0]
    before = elbow(simulator, "g1")
    configure = gazebo_interface.set_model_configuration_client
    joints = ([ELBOW], [0.5], "/gazebo")
    assert configure("g1", "robot_description", *joints) is True
    assert elbow(simulator, "g1") != before
    for name in ("g1", "ball"):
        simulator.call("delete_model", model_name=name)


def test_what_a_function_could_not_do_is_logged_and_returned(hears):
    configure = gazebo_interface.set_model_configuration_client
    assert configure("nobody", "", [], [], "/gazebo") is False
    hears(
        "/gazebo/set_model_configuration: SetModelConfiguration: model does not exist"
    )


@pytest.mark.parametrize(
    ("source", "text", "words"),
    [
        ("-param /nowhere", "", "The parameter /nowhere is empty or missing."),
        ("-param /empty", "", "The parameter /empty is empty or missing."),
        ("-stdin", "", "The input is empty or missing."),
        ("-stdin", "hello", "The text of the input is not XML: Start tag"),
        ("-stdin", "<robot/>", "SpawnModel: Failure - "),
    ],
)
def test_what_is_no_model_is_told_and_not_spawned(
    source, text, words, monkeypatch, simulator
):
    monkeypatch.setattr("sys.stdin", io.StringIO(text))
    rospy.set_param("/empty", "")
    with pytest.raises((DescriptionError, rospy.ServiceException)) as error:
        spawn("-urdf", *source.split(), "-model", "bad")
    assert str(error.value).startswith(words)
    assert simulator.models() == MODELS


def test_a_mistake_ends_the_command_with_one_sentence():
    process = start(*["-urdf", "-file", "/nowhere.urdf", "-model", "bad"])
    code, output = ended(process)
    assert code == 1
    assert "Cannot read the file /nowhere.urdf" in output
    assert output.count("\n") == 1, output


SPAWNING = {
    "spawn_urdf_model": SpawnModel,
    "get_physics_properties": GetPhysicsProperties,
    "set_model_configuration": SetModelConfiguration,
    "get_joint_properties": GetJointProperties,
    "delete_model": DeleteModel,
    "pause_physics": Empty,
    "unpause_physics": Empty,
}
"""The services that spawners call."""


class Busy:
    """The simulator's services below /busy, as a busy Gazebo has them.

    It answers before a model is loaded, and what is set until then is lost.
    """

    def __init__(self):
        self.load_time, self.refusals, self.calls = 0.0, 0, []
        self._loaded, self._services = -math.inf, []

    def advertise(self, *names):
        for name in names:
            kind, answer = SPAWNING[name], partial(self._answer, name)
            self._services.append(rospy.Service(f"/busy/{name}", kind, answer))

    def _answer(self, name, request):
        self.calls.append(name)
        if name == "spawn_urdf_model" and self.calls.count(name) <= self.refusals:
            return SpawnModelResponse(False, "SpawnModel: busy")
        if name == "set_model_configuration" and time.monotonic() < self._loaded:
            return SetModelConfigurationResponse(True, "success")
        response = rospy.ServiceProxy(f"/gazebo/{name}", SPAWNING[name])(request)
        if name == "spawn_urdf_model":
            self._loaded = time.monotonic() + self.load_time
        return response

    def close(self):
        for service in self._services:
            service.shutdown()


@pytest.fixture
def busy(simulator):
    rospy.set_param("/robot", Path(URDF).read_text())
    made = Busy()
    yield made
    made.close()
    for name in {*simulator.models()} - {*MODELS}:
        simulator.call("delete_model", model_name=name)


def spawn_squatting():
    """Do what spawn_robot.py does, in this process."""
    parameters = SpawnParameters("/robot", initial_pose="squat")
    spawn_robot.spawn(parameters, spawn_model.GazeboServices("/busy"))


def knee(simulator):
    joint = f"g1_robot::{KNEE}"
    return simulator.call("get_joint_properties", joint_name=joint)["position"]


@pytest.mark.parametrize("late", ["pause_physics", "get_joint_properties"])
def test_the_spawner_calls_nothing_before_all_services_are_there(
    late, busy, simulator, log
):
    busy.advertise(*{*SPAWNING} - {late})
    waits = f"Waiting for the service /busy/{late}"
    log.clear()
    with ThreadPoolExecutor() as pool:
        spawning = pool.submit(spawn_squatting)
        wait_for(lambda: busy.calls or any(waits in m.msg for m in log.messages), waits)
        assert busy.calls == []
        busy.advertise(late)
        spawning.result(DEADLINE)
    assert knee(simulator) == [2.35]
    assert "unpause_physics" not in busy.calls  # it was paused before


def test_joints_that_gazebo_loses_while_it_loads_are_set_again(busy, simulator):
    busy.load_time = 1.0
    busy.advertise(*SPAWNING)
    spawn_squatting()
    assert knee(simulator) == [2.35]
    simulator.call("delete_model", model_name="g1_robot")
    busy.load_time = 0.3
    bent = "-J", KNEE, "0.5", "-gazebo_namespace", "/busy"
    spawn("-urdf", "-param", "/robot", "-model", "g1_robot", *bent)
    assert knee(simulator) == [0.5]


def test_a_robot_whose_joints_cannot_be_set_is_deleted(busy, simulator, monkeypatch):
    monkeypatch.setattr(spawn_robot, "SET_TIMEOUT", 0.0)
    busy.load_time = math.inf
    busy.advertise(*SPAWNING)
    words = "Gazebo has not set .* of g1_robot to .*; the robot is deleted again"
    with pytest.raises(rospy.ServiceException, match=words):
        spawn_squatting()
    assert simulator.models() == MODELS


def test_with_respawn_an_error_is_not_the_end(busy, simulator):
    busy.refusals = 1
    busy.advertise(*SPAWNING)
    words = "_respawn:=true", "_robot_description:=/robot", "_initial_pose:=squat"
    process = subprocess.Popen(
        [
            program("spawn_robot.py"),
            *words,
            *(f"/gazebo/{name}:=/busy/{name}" for name in SPAWNING),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    wait_for(lambda: knee(simulator) == [2.35], "the second attempt")
    assert "SpawnModel: busy. Trying again in 5 s." in interrupted(process)[1]
