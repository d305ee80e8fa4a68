"""What the launch files launch, and with which arguments.

roslaunch reads the files in this process. Their command, which checks the arguments,
runs here as well; what it learns from the command line of roslaunch is given to it.
"""

import io
import os
import shutil
import socket
import subprocess
import sys
import threading
from xml.etree import ElementTree
from xmlrpc.server import SimpleXMLRPCServer

import pytest
from conftest import REPOSITORY
from forked import run_script

roslaunch = pytest.importorskip("roslaunch.config", reason="ROS is not there")
loaders = pytest.importorskip("roslaunch.xmlloader")

from g1_description.errors import InvalidValueError  # noqa: E402
from g1_description.files import model_files  # noqa: E402
from g1_description.gazebo.programs import launched_robot  # noqa: E402
from g1_description.robot.launch_arguments import (  # noqa: E402
    CHOICES,
    STAND_IN_ONLY,
    given_to_own_file,
)

LAUNCH = REPOSITORY / "launch"
FOUND = shutil.which("rospack") and shutil.which("roslaunch")
HERE = (
    FOUND
    and not subprocess.run(
        ["rospack", "find", "g1_description"], capture_output=True, check=False
    ).returncode
)
pytestmark = pytest.mark.skipif(not HERE, reason="no workspace is sourced")


class Run:
    """A process that runs here: the command of a parameter."""

    def __init__(self, words, **_):
        """Run it; its error is raised, as roslaunch would say less."""
        out = io.TextIOWrapper(io.BytesIO())
        before = sys.argv, sys.stdout
        sys.argv, sys.stdout = words, out
        try:
            launched_robot.main()
        finally:
            sys.argv, sys.stdout = before
        out.flush()
        self.returncode, self._out = 0, out.buffer.getvalue()

    def communicate(self):
        """Give its output."""
        return self._out, None


@pytest.fixture
def launch(monkeypatch):
    """Give what reads a launch file, and the configuration that roslaunch makes.

    By default the command line is another program's: then only what launch files hand
    on is checked.
    """

    def read(*arguments, file="display", display="", on_command_line=False):
        path = str(LAUNCH / f"{file}.launch")
        words = ["python3", "/usr/bin/roslaunch", "g1_description", f"{file}.launch"]
        words = [*words, *arguments] if on_command_line else ["pytest"]
        monkeypatch.setattr(launched_robot, "words_of_parent", lambda: words)
        monkeypatch.setenv("DISPLAY", display)
        config = roslaunch.ROSLaunchConfig()
        with monkeypatch.context() as patched:
            patched.setattr(subprocess, "Popen", Run)
            loader = loaders.XmlLoader()
            loader.load(path, config, argv=arguments, verbose=False)
        return config

    return read


def nodes(config):
    return [f"{node.namespace}{node.name}" for node in config.nodes]


def parameters(config):
    return {name: parameter.value for name, parameter in config.params.items()}


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Give what installs gazebo_ros: the real one, or this package's own."""
    own = tmp_path / "gazebo_ros"
    shutil.copytree(REPOSITORY / "interfaces" / "gazebo_ros", own)
    path = os.pathsep.join([str(tmp_path), os.environ["ROS_PACKAGE_PATH"]])
    monkeypatch.setenv("ROS_PACKAGE_PATH", path)

    def put(is_real):
        manifest = own / "package.xml"
        needs = "<exec_depend>{}</exec_depend>".format
        if is_real:
            text = manifest.read_text()
            manifest.write_text(text.replace(needs("g1_description"), needs("gazebo")))
        model_files.packages.cache_clear()

    yield put
    model_files.packages.cache_clear()


@pytest.fixture
def real_gazebo(install):
    install(is_real=True)


def test_the_stand_in_does_not_start_in_place_of_a_gazebo_that_is_missing(
    launch, install
):
    install(is_real=False)
    for file in ("display", "two_robots"):
        told = refusal(launch, "sim:=gazebo", file=file)
        assert told.startswith("sim:=gazebo needs the real Gazebo, ")
    install(is_real=True)
    assert "/spawn_urdf" in nodes(launch("sim:=gazebo"))


@pytest.mark.parametrize("sim", ["standin", "gazebo"])
@pytest.mark.usefixtures("real_gazebo")
def test_what_an_earlier_launch_left_on_the_master_is_cleared(launch, sim):
    """Else a robot, its physics and a pause would come back in the next world."""
    assert "/gazebo/" in launch(f"sim:={sim}").clear_params


def test_the_stand_in_is_the_default_and_rviz_needs_a_screen(launch):
    alone = ["/gazebo", "/link_states_bridge", "/robot_state_publisher"]
    assert sorted(nodes(launch())) == alone
    assert "/rviz" in nodes(launch(display=":99"))
    assert "/checker" in nodes(launch("checks:=true"))
    assert "/interactive" in nodes(launch("interactive:=true"))
    scene = REPOSITORY / "test" / "data" / "shelf.world"
    assert "/spawn_scene" in nodes(launch(f"scene:={scene}"))


@pytest.mark.usefixtures("real_gazebo")
def test_gazebo_is_started_with_its_own_spawn_model(launch):
    assert set(nodes(launch("sim:=gazebo", "rviz:=false"))) == {
        "/gazebo",
        "/spawn_urdf",
        "/link_states_bridge",
        "/robot_state_publisher",
    }


@pytest.mark.usefixtures("real_gazebo")
def test_arguments_reach_gazebo(launch):
    wanted = ("sim:=gazebo", "gui:=true", "robot_name:=7", "use_sim_time:=false")
    config = launch(*wanted)
    assert "/gazebo_gui" in nodes(config)
    assert parameters(config)["/link_states_bridge/model_name"] == "7"
    assert parameters(config)["/use_sim_time"] is False


@pytest.mark.usefixtures("real_gazebo")
@pytest.mark.parametrize(
    ("sim", "node"), [("standin", "gazebo"), ("gazebo", "spawn_urdf")]
)
def test_the_robot_is_put_on_the_floor_unless_its_height_is_given(launch, sim, node):
    wanted = (f"sim:={sim}", "initial_pose:=stand")
    found = parameters(launch(*wanted))
    assert found[f"/{node}/initial_pose"] == "stand"
    assert found[f"/{node}/on_floor"] is True
    assert f"/{node}/z" not in found
    found = parameters(launch(*wanted, "z:=0"))
    assert found[f"/{node}/on_floor"] is False
    assert found[f"/{node}/z"] == 0.0


WRONG = {
    "model:=/nowhere.urdf": "Cannot use the model /nowhere.urdf: There is no file /now",
    "model:=package://g1_description/urdf/g1_29dfo.urdf": "did you mean g1_29dof.urdf?",
    "robot:=g1_29": "There is no profile and no file 'g1_29'. Known profiles: g1_29dof",
    "sim:=gazbo": "Unknown sim 'gazbo'. Known values: gazebo, standin.",
    "physics:=holdd": "Unknown physics 'holdd'. Known values: hold, kinematic, limp.",
    "initial_pose:=standd": "Unknown pose 'standd'. Known poses: stand, zero, squat,",
    **{f"{name}:=abc": f"{name} must be a number (got 'abc')." for name in "xyzRPY"},
    "rate:=-1": "rate must be from 0 to 1e6 states per second",
    "Y:=inf": "Y must be a number (got 'inf').",
    "fixed_base:=yes": "fixed_base must be true or false (got 'yes').",
    "paused:=yes": "paused must be true or false (got 'yes').",
}
"""Arguments that the launch file hands on, which others may include."""

WRONG_ON_COMMAND_LINE = {
    "model:=": "model:= is empty; leave it out to use the default, g1_29dof.",
    "robot:=": "robot:= is empty; leave it out to use the default, g1_29dof.",
    "physics:=": "physics:= is empty; leave it out to use the default, kinematic.",
    "trails:=pelvs": "Unknown link pelvs in trails. Known links: pelvis,",
    "port:=99999": "port must be a whole number from 0 to 65535 (got '99999').",
    "ghost:=ja": "ghost must be true or false (got 'ja').",
    "web:=2": "web must be true or false (got '2').",
    "interactive:=2": "interactive must be true or false (got '2').",
    "use_sim_time:=1": "use_sim_time must be true or false (got '1').",
    "motors:=my.yaml": "motors must be an absolute path (got 'my.yaml').",
    "scene:=/no.yaml": "The file /no.yaml of scene does not exist.",
    f"scene:={REPOSITORY}/config/checks.yaml": "Unknown section",
    "collisions:=my.yaml": "collisions must be an absolute path (got 'my.yaml').",
    "thresholds:=/no.yaml": "The file /no.yaml of thresholds does not exist.",
    "rvizconfig:=/no.rviz": "The file /no.rviz of rvizconfig does not exist.",
}


def refusal(launch, *arguments, **options):
    with pytest.raises(SystemExit) as end:
        launch(*arguments, **options)
    return end.value.code


@pytest.mark.parametrize("argument", WRONG)
def test_a_wrong_argument_ends_the_launch_with_a_sentence(launch, argument):
    assert WRONG[argument] in refusal(launch, argument)


@pytest.mark.parametrize("argument", WRONG_ON_COMMAND_LINE)
def test_what_is_on_the_command_line_alone_is_checked_too(launch, argument):
    told = refusal(launch, argument, on_command_line=True)
    assert WRONG_ON_COMMAND_LINE[argument] in told


@pytest.mark.parametrize(
    "argument", ["physics:=limp", "engine:=mujoco", "fixed_base:=true", "motors:=own"]
)
def test_what_the_real_gazebo_ignores_is_refused(launch, argument):
    told = refusal(launch, "sim:=gazebo", argument)
    assert told.startswith(f"{argument} has no effect with sim:=gazebo; leave it out")


def test_the_docs_of_arguments_say_which_the_real_gazebo_ignores():
    """An anchor has an effect where a package is in Gazebo's place."""
    arguments = ElementTree.parse(LAUNCH / "gazebo.launch").iter("arg")
    only = {a.get("name") for a in arguments if "stand-in only" in a.get("doc", "")}
    assert only == {*STAND_IN_ONLY, "anchor"}


def test_a_robot_of_which_no_feet_are_known_has_no_lowest_foot(launch):
    model = f"model:={REPOSITORY}/test/data/five_links.urdf"
    assert "name a link instead" in refusal(launch, model, "anchor:=lowest_foot")
    assert launch("anchor:=lowest_foot")


@pytest.mark.slow
def test_roslaunch_itself_ends_with_the_sentence_alone():
    """What it was started with is read from the system, for a path as for a name."""
    run = subprocess.run(
        ["roslaunch", "--nodes", LAUNCH / "display.launch", "port:=-1"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode != 0
    assert run.stdout == ""
    assert run.stderr.startswith("port must be a whole number")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["base:=a b c d e f"], "base must be 'X Y Z YAW PITCH ROLL' in [m] and [rad]"),
        (["base:=1,2"], "base must be 'X Y Z YAW PITCH ROLL' in [m] and [rad]"),
        (["base:=0 0 1 0 0 0", "root:=pelvs"], "(got 'pelvs'); links are p"),
    ],
)
def test_a_wrong_base_of_a_view_is_refused(launch, arguments, words):
    assert words in refusal(launch, *arguments, file="view")


@pytest.mark.parametrize("root", ["pelvis", "left/pelvis", "/pelvis"])
def test_a_base_of_a_view_is_taken(launch, root):
    config = launch("base:=0 0 0.793 0 0 0", f"root:={root}", file="view")
    assert "/base" in nodes(config)


def test_what_roslaunch_takes_for_true_is_taken(launch):
    words = ("web:=1", "checks:=1", "ghost:=0")
    assert {"/web", "/checker"} <= {*nodes(launch(*words, on_command_line=True))}


def test_an_argument_that_the_file_does_not_have_is_not_checked(launch):
    found = launch("trails:=left_foo", file="two_robots", on_command_line=True)
    assert "/left/robot_state_publisher" in nodes(found)


def test_a_relative_file_is_told_with_its_full_path(launch, tmp_path, monkeypatch):
    (tmp_path / "own.yaml").touch()
    monkeypatch.chdir(tmp_path)
    told = refusal(launch, "thresholds:=own.yaml", on_command_line=True)
    assert f"path (got 'own.yaml'); use {tmp_path / 'own.yaml'}." in told


def test_arguments_of_others_launch_files_are_theirs(monkeypatch):
    """Also where they are called as ours, in the folder of ours."""
    words = ["/usr/bin/roslaunch", "my_robot", "robot.launch", "port:=/dev/ttyUSB0"]
    monkeypatch.chdir(LAUNCH)
    assert given_to_own_file(words) == {}
    for own in (["web.launch"], [str(LAUNCH / "display_and_gazebo.launch")]):
        assert given_to_own_file([*words, *own]) == {"port": "/dev/ttyUSB0"}


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
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
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
        ("/", "web", ["-p", "1", "g1_description", "web.launch"], ""),  # another master
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


def test_a_master_that_is_silent_holds_nothing_up(monkeypatch):
    words = ["/usr/bin/python3", "/usr/bin/roslaunch", "g1_description", "web.launch"]
    monkeypatch.setattr(launched_robot, "TIMEOUT", 0.1)
    with socket.create_server(("localhost", 0)) as silent:
        uri = f"http://localhost:{silent.getsockname()[1]}"
        monkeypatch.setenv("ROS_MASTER_URI", uri)
        check = threading.Thread(
            target=launched_robot._check_for_node, args=("web", words), daemon=True
        )
        check.start()
        check.join(60.0)
        assert not check.is_alive()


@pytest.mark.parametrize("file", ["web", "view"])
def test_a_page_beside_a_page_is_refused(launch, master, monkeypatch, file):
    monkeypatch.setenv("ROS_NAMESPACE", "/")
    wanted = [] if file == "web" else ["web:=true"]
    told = refusal(launch, *wanted, file=file, on_command_line=True)
    assert told.startswith(f"A node /web is already running at {master}.")


def test_a_wrong_argument_is_told_before_a_node_that_runs(launch, master, monkeypatch):
    monkeypatch.setenv("ROS_NAMESPACE", "/")
    told = refusal(launch, "web:=true", "robot:=g1_29dfo", on_command_line=True)
    assert "g1_29dfo" in told


def test_a_pose_that_does_not_suit_the_robot_ends_the_launch(launch, tmp_path):
    robot = tmp_path / "r.urdf"
    robot.write_text('<robot name="r"><link name="a"/></robot>')
    told = refusal(launch, f"model:={robot}", "initial_pose:=stand")
    assert told.startswith("Unknown pose 'stand'. Known poses: zero.")


@pytest.fixture
def profile(tmp_path):
    """Give the folder of a profile with a robot of its own."""
    (tmp_path / "robot.yaml").write_text("names: [r]\nmodel: r.urdf\n")
    (tmp_path / "poses.yaml").write_text("low: {}\n")
    (tmp_path / "r.urdf").write_text('<robot name="r"><link name="a"/></robot>')
    return tmp_path


@pytest.mark.parametrize("file", ["display", "view", "replay", "two_robots"])
def test_a_profile_chooses_the_robot_and_is_told_to_all_nodes(launch, profile, file):
    found = parameters(launch(f"robot:={profile}", file=file))
    assert '<robot name="r">' in found["/robot_description"]
    assert found["/robot_description_profile"] == str(profile)


def test_a_relative_folder_of_a_profile_is_told_with_its_path(
    launch, profile, monkeypatch
):
    """Nodes run in another folder than roslaunch."""
    monkeypatch.chdir(profile.parent)
    told = refusal(launch, f"robot:={profile.name}")
    assert f"an absolute path (got '{profile.name}'); use {profile}." in told


def test_a_wrong_profile_ends_the_launch_with_a_sentence(launch, profile):
    (profile / "robot.yaml").write_text("nmaes: [r]\nmodel: r.urdf\n")
    told = refusal(launch, f"robot:={profile}")
    assert told.startswith("Cannot use the model ") and "unknown key nmaes" in told


def test_a_wrong_profile_of_the_user_ends_a_launch_that_looks_for_one(
    launch, tmp_path, monkeypatch
):
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    folder = tmp_path / "g1_description" / "robots" / "mine"
    folder.mkdir(parents=True)
    (folder / "robot.yaml").write_text("- a")
    told = refusal(launch, f"model:={REPOSITORY}/test/data/five_links.urdf")
    assert told == f"The profile {folder / 'robot.yaml'}: it must be a mapping."


def test_a_model_may_be_given_the_profile_of_another(launch, profile):
    """Its poses are known then."""
    model = REPOSITORY / "test" / "data" / "five_links.urdf"
    wanted = (f"model:={model}", "initial_pose:=low")
    assert "Unknown pose 'low'" in refusal(launch, *wanted)
    found = parameters(launch(*wanted, f"robot:={profile}"))
    assert '<robot name="strider">' in found["/robot_description"]
    assert found["/robot_description_profile"] == str(profile)


def test_without_a_profile_each_node_finds_it(launch):
    assert parameters(launch())["/robot_description_profile"] == ""


def test_allowed_collisions_reach_checks_and_page(launch, profile):
    file = profile / "poses.yaml"
    switches = {"checker": "checks", "interactive": "interactive", "web": "web"}
    wanted = [f"{switch}:=true" for switch in switches.values()]
    found = parameters(launch(*wanted, f"collisions:={file}"))
    assert {found[f"/{node}/collisions"] for node in switches} == {str(file)}


def test_arguments_that_are_right_or_may_be_empty_are_taken(launch):
    wanted = ("physics:=limp", "initial_pose:=wave", "x:=-1e-1", "z:=")
    found = parameters(launch(*wanted, on_command_line=True))
    assert found["/gazebo/x"] == -0.1
    assert found["/gazebo/on_floor"] is True


def test_there_is_a_launch_file_for_each_simulator():
    names = {file.name[len("sim_") : -len(".launch.xml")] for file in LAUNCH.glob("s*")}
    assert names == set(CHOICES["sim"])


@pytest.mark.slow
def test_a_model_may_be_a_xacro_file_of_a_package_with_arguments(tmp_path):
    (tmp_path / "package.xml").write_text("<package><name>my_arm</name></package>")
    (tmp_path / "arm.xacro").write_text(
        '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        '<xacro:arg name="root" default="base"/><link name="$(arg root)"/></robot>'
    )
    path = os.pathsep.join([str(tmp_path), os.environ["ROS_PACKAGE_PATH"]])
    words = ["--dump-params", "g1_description", "display.launch"]
    words += ["model:=package://my_arm/arm.xacro root=torso"]
    run = run_script(
        FOUND, *words, environment={**os.environ, "ROS_PACKAGE_PATH": path}
    )
    assert run.returncode == 0, run.stderr
    assert '<link name=\\"torso\\"' in run.stdout


@pytest.mark.usefixtures("real_gazebo")
def test_two_robots_have_one_simulator_and_one_bridge(launch):
    alike = {"/spawn_right", "/link_states_bridge"}
    alike |= {f"/{side}/robot_state_publisher" for side in ("left", "right")}
    assert {*nodes(launch(file="two_robots"))} == alike | {"/gazebo"}
    found = launch("sim:=gazebo", file="two_robots")
    assert {*nodes(found)} == alike | {"/gazebo", "/spawn_urdf"}
    found = {*nodes(launch("interactive:=true", file="two_robots"))}
    assert {"/left/interactive", "/right/interactive"} <= found
    told = refusal(launch, "physics:=holdd", file="two_robots")
    assert "Unknown physics 'holdd'" in told


@pytest.mark.parametrize(
    ("wanted", "found"),
    [
        ([], ["/robot_state_publisher"]),
        (["robot_state_publisher:=false", "rviz:=true"], ["/rviz"]),
        (["base:=0 0 0.8 0 0 0"], ["/robot_state_publisher", "/base"]),
        (["checks:=true"], ["/robot_state_publisher", "/checker"]),
    ],
)
def test_a_view_has_no_simulator_and_only_what_is_wanted(launch, wanted, found):
    assert nodes(launch(*wanted, file="view")) == found


def test_rviz_shows_a_view_in_the_frame_that_is_asked_for(launch):
    config = launch("rviz:=true", "fixed_frame:=odom", file="view")
    (rviz,) = [node for node in config.nodes if node.name == "rviz"]
    assert rviz.args.endswith("/view.rviz' -f 'odom'")
