"""What the display launches, and with which arguments."""

import os
import shutil
import subprocess
import threading
from xmlrpc.server import SimpleXMLRPCServer

import pytest
from conftest import REPOSITORY
from forked import run_script

from g1_description.errors import InvalidValueError
from g1_description.gazebo.programs import launched_robot
from g1_description.robot.launch_arguments import CHOICES, given_to_own_file

FOUND = shutil.which("rospack") and shutil.which("roslaunch")
HERE = (
    FOUND
    and not subprocess.run(
        ["rospack", "find", "g1_description"], capture_output=True, check=False
    ).returncode
)
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not HERE, reason="no workspace is sourced"),
]


@pytest.fixture(scope="module", autouse=True)
def roslaunch_is_imported():
    """Import for all forks what each would import for itself."""
    pytest.importorskip("roslaunch.node_args")


def roslaunch(option, *arguments, file="display.launch", **environment):
    """Run roslaunch in a fork, which costs half of what starting it does."""
    words = [*option.split(), "g1_description", file, *arguments]
    return run_script(FOUND, *words, environment={**os.environ, **environment})


def started(option, *arguments, **options):
    """Start roslaunch itself with the display; its command line is read."""
    words = [*option.split(), "g1_description", "display.launch", *arguments]
    return roslaunch_itself(*words, **options)


def roslaunch_itself(*words, cwd=None):
    """Start roslaunch itself with any words."""
    return subprocess.run(
        ["roslaunch", *words], capture_output=True, text=True, check=False, cwd=cwd
    )


@pytest.mark.parametrize("sim", ["standin", "gazebo"])
def test_what_an_earlier_launch_left_on_the_master_is_cleared(sim):
    """Else a robot, its physics and a pause would come back in the next world."""
    code = (
        "import roslaunch.config as c, roslaunch.rlutil as r, sys\n"
        "from roslaunch.xmlloader import XmlLoader\n"
        "config = c.ROSLaunchConfig()\n"
        "file = r.resolve_launch_arguments(['g1_description', 'display.launch'])[0]\n"
        "XmlLoader().load(file, config, argv=sys.argv[1:], verbose=False)\n"
        "print(config.clear_params)\n"
    )
    words = ["/usr/bin/python3", "-c", code, f"sim:={sim}", "rviz:=false", "gui:=false"]
    run = subprocess.run(words, capture_output=True, text=True, check=False)
    assert "'/gazebo/'" in run.stdout, run.stderr


def test_the_stand_in_is_the_default_and_rviz_needs_a_screen():
    nodes = roslaunch("--nodes", DISPLAY="").stdout.split()
    assert nodes == ["/gazebo", "/link_states_bridge", "/robot_state_publisher"]
    assert "/rviz" in roslaunch("--nodes", DISPLAY=":99").stdout.split()
    assert "/checker" in roslaunch("--nodes", "checks:=true").stdout.split()


def test_gazebo_is_started_with_its_own_spawn_model():
    run = roslaunch("--nodes", "sim:=gazebo", "rviz:=false", DISPLAY="")
    assert run.returncode == 0, run.stderr
    assert set(run.stdout.split()) == {
        "/gazebo",
        "/spawn_urdf",
        "/link_states_bridge",
        "/robot_state_publisher",
    }


def test_arguments_reach_gazebo():
    wanted = ("sim:=gazebo", "gui:=true", "robot_name:=7", "use_sim_time:=false")
    assert "/gazebo_gui" in roslaunch("--nodes", *wanted).stdout.split()
    parameters = roslaunch("--dump-params", *wanted).stdout
    assert "/link_states_bridge/model_name: '7'" in parameters
    assert "/use_sim_time: false" in parameters


@pytest.mark.parametrize(
    ("sim", "node"), [("standin", "gazebo"), ("gazebo", "spawn_urdf")]
)
def test_the_robot_is_put_on_the_floor_unless_its_height_is_given(sim, node):
    wanted = (f"sim:={sim}", "initial_pose:=stand")
    parameters = roslaunch("--dump-params", *wanted).stdout
    assert f"/{node}/initial_pose: stand" in parameters
    assert f"/{node}/on_floor: true" in parameters
    assert f"/{node}/z:" not in parameters
    parameters = roslaunch("--dump-params", *wanted, "z:=0").stdout
    assert f"/{node}/on_floor: false" in parameters
    assert f"/{node}/z: 0.0" in parameters


@pytest.mark.parametrize(
    ("argument", "words"),
    [
        (
            "model:=/nowhere.urdf",
            "Cannot use the model /nowhere.urdf: There is no file /nowhere.urdf",
        ),
        (
            "model:=package://g1_description/urdf/g1_29dfo.urdf",
            "did you mean g1_29dof.urdf?",
        ),
        ("sim:=mujoco", "Unknown sim 'mujoco'. Known values: standin, gazebo."),
        ("sim:=gazbo", "Unknown sim 'gazbo'. Known values: gazebo, standin."),
        (
            "physics:=holdd",
            "Unknown physics 'holdd'. Known values: hold, kinematic, limp.",
        ),
        (
            "initial_pose:=standd",
            "Unknown pose 'standd'. Known poses: stand, zero, squat,",
        ),
        ("x:=abc", "x must be a number (got 'abc')."),
        ("Y:=inf", "Y must be a number (got 'inf')."),
        ("paused:=yes", "paused must be true or false (got 'yes')."),
    ],
)
def test_a_wrong_argument_ends_the_launch_with_a_sentence(argument, words):
    assert_refused(roslaunch("--nodes", argument), words)


@pytest.mark.parametrize(
    ("argument", "words"),
    [
        ("model:=", "model:= is empty; leave it out to use the default, /"),
        (
            "physics:=",
            "physics:= is empty; leave it out to use the default, kinematic.",
        ),
        (
            "robot_name:=",
            "robot_name:= is empty; leave it out to use the default, g1_robot.",
        ),
        ("trails:=pelvs", "Unknown link pelvs in trails. Known links: pelvis,"),
        ("port:=99999", "port must be a whole number from 0 to 65535 (got '99999')."),
        ("ghost:=ja", "ghost must be true or false (got 'ja')."),
        ("web:=2", "web must be true or false (got '2')."),
        ("use_sim_time:=1", "use_sim_time must be true or false (got '1')."),
        ("motors:=my.yaml", "motors must be an absolute path (got 'my.yaml')."),
        (
            "thresholds:=/nowhere.yaml",
            "The file /nowhere.yaml of thresholds does not exist.",
        ),
        (
            "rvizconfig:=/nowhere.rviz",
            "The file /nowhere.rviz of rvizconfig does not exist.",
        ),
    ],
)
def test_what_is_on_the_command_line_alone_is_checked_too(argument, words):
    assert_refused(started("--nodes", argument), words)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["base:=a b c d e f"], "base must be 'X Y Z YAW PITCH ROLL' in [m] and [rad]"),
        (["base:=1,2"], "base must be 'X Y Z YAW PITCH ROLL' in [m] and [rad]"),
        (["base:=0 0 1 0 0 0", "root:=pelvs"], "(got 'pelvs'); links are p"),
    ],
)
def test_a_wrong_base_of_a_view_is_refused(arguments, words):
    assert_refused(roslaunch("--nodes", *arguments, file="view.launch"), words)


@pytest.mark.parametrize("root", ["pelvis", "left/pelvis", "/pelvis"])
def test_a_base_of_a_view_is_taken(root):
    arguments = "base:=0 0 0.793 0 0 0", "rviz:=false", f"root:={root}"
    assert "/base" in roslaunch("--nodes", *arguments, file="view.launch").stdout


def test_what_roslaunch_takes_for_true_is_taken():
    run = started("--nodes", "web:=1", "checks:=1", "ghost:=0")
    assert "/web" in run.stdout and "/checker" in run.stdout


def test_an_argument_that_the_file_does_not_have_is_not_checked():
    words = ("g1_description", "two_robots.launch", "trails:=left_foo", "rviz:=false")
    run = roslaunch_itself("--nodes", *words)
    assert "/left/robot_state_publisher" in run.stdout, run.stderr


def test_a_relative_file_is_told_with_its_full_path(tmp_path):
    (tmp_path / "own.yaml").touch()
    run = started("--nodes", "thresholds:=own.yaml", cwd=tmp_path)
    assert_refused(
        run, f"must be an absolute path (got 'own.yaml'); use {tmp_path / 'own.yaml'}."
    )


def test_arguments_of_others_launch_files_are_theirs(tmp_path):
    file = tmp_path / "robot.launch"
    include = '<include file="$(find g1_description)/launch/display.launch"/>'
    file.write_text(f'<launch><arg name="port"/>{include}</launch>')
    run = roslaunch_itself("--nodes", file, "port:=/dev/ttyUSB0")
    assert "/link_states_bridge" in run.stdout


def test_others_files_are_theirs_in_the_folder_of_our_launch_files_too(monkeypatch):
    words = ["/usr/bin/roslaunch", "my_robot", "robot.launch", "port:=/dev/ttyUSB0"]
    monkeypatch.chdir(REPOSITORY / "launch")
    assert given_to_own_file(words) == {}
    assert given_to_own_file([*words, "web.launch"]) == {"port": "/dev/ttyUSB0"}


@pytest.mark.parametrize("name", ["display", "display_and_gazebo"])
def test_own_launch_files_are_known_by_their_paths_too(name):
    file = REPOSITORY / "launch" / f"{name}.launch"
    assert_refused(
        roslaunch_itself("--nodes", file, "port:=-1"), "port must be a whole number"
    )


class Master:
    """A master that knows some nodes, and is each of them."""

    def __init__(self, uri, names):
        self._uri, self._names = uri, names

    def _dispatch(self, method, words):
        if method == "getPid":
            return [1, "", 1]
        assert method == "lookupNode"
        return [1, "", self._uri] if words[1] in self._names else [-1, "", 0]


@pytest.fixture
def master(monkeypatch):
    """Run a master of nodes in two namespaces; give its address."""
    with SimpleXMLRPCServer(("localhost", 0), logRequests=False) as server:
        uri = f"http://localhost:{server.server_address[1]}"
        server.register_instance(Master(uri, ["/web", "/left/checker"]))
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        monkeypatch.setenv("ROS_MASTER_URI", uri)
        yield uri
        server.shutdown()
        thread.join()


@pytest.mark.parametrize(
    ("namespace", "node", "words", "runs"),
    [
        ("/", "web", ["g1_description", "web.launch"], "/web"),
        ("/", "/web", ["my_robot", "robot.launch"], "/web"),
        ("/left", "checker", ["g1_description", "checks.launch"], "/left/checker"),
        ("/", "checker", ["g1_description", "checks.launch"], ""),
        ("/left", "web", ["g1_description", "web.launch"], ""),
        ("/", "web", ["my_robot", "robot.launch"], ""),
        ("/", "web", ["--nodes", "g1_description", "web.launch"], ""),
    ],
)
def test_a_node_that_runs_is_not_launched_again(
    monkeypatch, master, namespace, node, words, runs
):
    monkeypatch.setenv("ROS_NAMESPACE", namespace)
    words = ["/usr/bin/python3", "/usr/bin/roslaunch", *words]
    if not runs:
        launched_robot._check_for_node(node, words)
        return
    with pytest.raises(InvalidValueError, match=f"node {runs} is already running at"):
        launched_robot._check_for_node(node, words)


def test_a_page_beside_a_page_is_refused(master):
    for file in ("web.launch", "view.launch"):
        words = ("g1_description", file, "web:=true", "rviz:=false")
        run = roslaunch_itself(*words)
        assert f"A node /web is already running at {master}." in run.stderr


def assert_refused(run, words):
    assert run.returncode != 0
    assert run.stdout == ""
    sentence = run.stderr.splitlines()[0]
    assert words in sentence


def test_a_pose_that_does_not_suit_the_robot_ends_the_launch(tmp_path):
    robot = tmp_path / "r.urdf"
    robot.write_text('<robot name="r"><link name="a"/></robot>')
    run = roslaunch("--nodes", f"model:={robot}", "initial_pose:=stand")
    assert run.returncode != 0
    told = run.stderr.splitlines()[0]
    assert "Pose stand of " in told
    assert "'r' has no movable joint" in told


def test_arguments_that_are_right_or_may_be_empty_are_taken():
    wanted = ("physics:=limp", "initial_pose:=wave", "x:=-1e-1", "z:=")
    parameters = started("--dump-params", *wanted).stdout
    assert "/gazebo/x: -0.1" in parameters
    assert "/gazebo/on_floor: true" in parameters


def test_there_is_a_launch_file_for_each_simulator():
    files = (REPOSITORY / "launch").glob("sim_*.launch.xml")
    names = {file.name[len("sim_") : -len(".launch.xml")] for file in files}
    assert names == set(CHOICES["sim"])


def test_a_model_may_be_a_xacro_file_of_a_package_with_arguments(tmp_path):
    (tmp_path / "package.xml").write_text("<package><name>my_arm</name></package>")
    (tmp_path / "arm.xacro").write_text(
        '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        '<xacro:arg name="root" default="base"/><link name="$(arg root)"/></robot>'
    )
    path = os.pathsep.join([str(tmp_path), os.environ["ROS_PACKAGE_PATH"]])
    model = "model:=package://my_arm/arm.xacro root=torso"
    run = roslaunch("--dump-params", model, ROS_PACKAGE_PATH=path)
    assert run.returncode == 0, run.stderr
    assert '<link name=\\"torso\\"' in run.stdout


def test_two_robots_have_one_simulator_and_one_bridge():
    def nodes(*wanted):
        found = roslaunch("--nodes", *wanted, file="two_robots.launch", DISPLAY="")
        return set(found.stdout.split())

    alike = {"/spawn_right", "/link_states_bridge"}
    alike |= {f"/{side}/robot_state_publisher" for side in ("left", "right")}
    assert nodes() == alike | {"/gazebo"}
    assert nodes("sim:=gazebo") == alike | {"/gazebo", "/spawn_urdf"}
    run = roslaunch("--nodes", "physics:=holdd", file="two_robots.launch")
    assert "Unknown physics 'holdd'" in run.stderr


def test_a_view_has_no_simulator_and_only_what_is_wanted():
    def nodes(*wanted):
        found = roslaunch("--nodes", *wanted, file="view.launch", DISPLAY="")
        return found.stdout.split()

    assert nodes() == ["/robot_state_publisher"]
    assert nodes("robot_state_publisher:=false", "rviz:=true") == ["/rviz"]
    assert nodes("base:=0 0 0.8 0 0 0") == ["/robot_state_publisher", "/base"]
    assert nodes("checks:=true") == ["/robot_state_publisher", "/checker"]
    wanted = ("rviz:=true", "fixed_frame:=odom")
    rviz = roslaunch("--args /rviz", *wanted, file="view.launch").stdout
    assert "view.rviz -f odom" in rviz
