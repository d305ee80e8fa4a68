"""What the doctor decides, and that its command needs the standard library alone."""

import json
import os
import re
import string
import subprocess
import sys
import threading
from xmlrpc.server import SimpleXMLRPCServer

import numpy as np
import pytest
from conftest import REPOSITORY

from g1_description.cli.doctor import robot, shell
from g1_description.cli.doctor.faults import (
    BROKEN,
    DISPLAY,
    GAZEBO,
    LINKS,
    TABLE,
    fault,
)
from g1_description.cli.doctor.master import Master
from g1_description.cli.doctor.nodes import (
    UNKNOWN_HOST,
    Graph,
    NodeAnswer,
    node_addresses,
)
from g1_description.cli.doctor.walk import Walk
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.transform import IDENTITY
from g1_description.robot.urdf import parse_urdf

URDF = (REPOSITORY / "urdf" / "g1_29dof.urdf").read_text()
PAGE = (REPOSITORY / "docs" / "doctor.md").read_text()
MODEL, WORLD = "g1_robot", ("ground_plane",)
HERE = "http://127.0.0.1:1/"


def name_of(found):
    return found and found.name


def command(*words, python=(sys.executable,), **environment):
    return subprocess.run(
        [*python, REPOSITORY / "scripts" / "doctor", *words],
        env={**os.environ, "ROS_MASTER_URI": "http://localhost:1", **environment},
        capture_output=True,
        text=True,
    )


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--until", "heaven"], "invalid choice: 'heaven'"),
        (["--namespace", "a b"], "'a b' is no ROS name"),
        (["robot"], "unrecognized arguments: robot"),
    ],
)
def test_a_wrong_command_line_ends_with_a_sentence_and_2(words, told):
    run = command(*words)
    assert (run.returncode, run.stdout) == (2, "")
    assert told in run.stderr and len(run.stderr.splitlines()) == 1


def test_a_python_without_anything_names_what_it_lacks():
    """It has no packages, not even those of the distribution."""
    run = command("--json", python=(sys.executable, "-I", "-S"))
    assert run.stderr == ""
    told = json.loads(run.stdout)
    assert [link["name"] for link in told["links"]] == [*LINKS]


def test_the_command_imports_the_standard_library_alone():
    code = (
        "import sys; sys.path.append('src'); known = {*sys.modules}\n"
        "import g1_description.cli.doctor.doctor\n"
        "print(*{name.partition('.')[0] for name in {*sys.modules} - known})"
    )
    run = [sys.executable, "-I", "-S", "-c", code]
    loaded = subprocess.run(run, cwd=REPOSITORY, stdout=subprocess.PIPE, text=True)
    found = {*loaded.stdout.split()} - {"g1_description"}
    known = {*getattr(sys, "stdlib_module_names", found)}
    assert "argparse" in found
    assert found <= known


def test_all_faults_and_links_are_on_the_page():
    assert {*re.findall(r"^\| `(\w+)` \|", PAGE, flags=re.M)} == {
        "doctor",
        *LINKS,
        *TABLE,
    }


def test_each_fault_is_a_sentence_and_a_command():
    for name, (sentence, cure) in TABLE.items():
        fields = {f for text in (sentence, cure) for _, f, _, _ in _parsed(text) if f}
        made = fault(name, **dict.fromkeys(fields, 1))
        assert re.match(r"[A-Z/1].*[.1]$", made.sentence), name
        assert made.cure


def test_a_walk_that_takes_too_long_blames_no_link():
    made = fault("no_answer", link="tf", seconds=45.0)
    assert "more than 45 s in all" in made.sentence
    assert made.cure.startswith("rosrun g1_description doctor")


def test_a_late_answer_of_the_master_is_asked_for_again():
    calls = []

    def look_up(caller, node):
        calls.append(node)
        if len(calls) == 1:
            raise OSError("late")
        return 1, "", "http://nowhere.invalid:1/"

    with SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False) as server:
        server.register_function(look_up, "lookupNode")
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        master = Master(f"http://127.0.0.1:{server.server_address[1]}")
        found = master.ask_nodes(["/a"])
        server.shutdown()
        thread.join()
    assert found["/a"].problem == UNKNOWN_HOST and len(calls) == 2


def test_a_question_that_fails_is_told_without_a_traceback(monkeypatch):
    """No master is asked: what the walk asks fails at once."""

    def fail():
        raise TimeoutError

    made = Walk("", ["nodes"])
    monkeypatch.setattr(made, "_nodes", fail)
    monkeypatch.setattr(made, "_ask_master", lambda: "it answers")
    (found,) = made.run()
    assert (found.state, found.remark) == (BROKEN, "unfinished")
    assert "'nodes': no answer within" in found.fault.sentence


def _parsed(text):
    return string.Formatter().parse(text)


# --- this shell ---------------------------------------------------------------------

LACKS = {"rospy": "ModuleNotFoundError: No module named 'rospy'"}
GOOD = shell.Interpreter("/usr/bin/python3", {})
BARE = shell.Interpreter("/opt/bare/bin/python3", LACKS)


@pytest.mark.parametrize(
    ("own", "is_sourced", "name"),
    [
        (GOOD, True, None),
        (BARE, True, "wrong_python"),
        (BARE, False, "no_workspace"),
        (shell.Interpreter("/usr/bin/python3", LACKS), False, "no_workspace"),
        (
            shell.Interpreter("/usr/bin/python3", {"gazebo_msgs.msg": "absent"}),
            True,
            "no_workspace",
        ),
    ],
)
def test_pythons(own, is_sourced, name):
    found = shell.python(own, "/usr/bin", "setup.bash", is_sourced)
    assert name_of(found) == name


def test_another_python_on_path_is_told_with_what_it_breaks():
    """What ROS installs names its Python, so rosrun works all the same."""
    remark = shell.python_remark(GOOD, BARE, "/usr/bin")
    assert remark.startswith("/usr/bin/python3; python3 on PATH is /opt/bare/bin/pyth")
    assert "No module named 'rospy'" in remark
    assert "export PATH=/usr/bin:$PATH" in remark
    missing = shell.Interpreter("", {})
    assert "missing" in shell.python_remark(GOOD, missing, "/usr/bin")
    assert shell.python_remark(GOOD, GOOD, "/usr/bin") == "/usr/bin/python3"


def test_the_packages_of_the_nodes():
    def judge(module, needs_pybullet=True):
        own = shell.Interpreter("python3", {module: "absent"} if module else {})
        return shell.packages(own, needs_pybullet)

    assert judge("") is None
    assert name_of(judge("numpy")) == "no_package"
    assert name_of(judge("pybullet")) == "no_pybullet"
    assert judge("pybullet", needs_pybullet=False) is None


@pytest.mark.parametrize(
    ("uri", "meant"),
    [
        ("http://localhost:11311", None),
        ("http://10.0.0.7:11311/", None),
        ("http://[::1]:11311", None),
        ("localhost:15111", "http://localhost:15111"),
        ("robot", "http://robot:11311"),
        ("http://robot", "http://robot:11311"),
        ("https://robot:15111", "http://robot:15111"),
        ("http://localhost:port", "http://localhost:11311"),
        ("$(reboot):1", "http://localhost:11311"),
        ("", "http://localhost:11311"),
    ],
)
def test_addresses_of_masters(uri, meant):
    found = shell.master_uri(uri)
    cure = found.cure if found else None
    assert cure == (meant and f"export ROS_MASTER_URI={meant}")


def test_a_master_whose_host_is_not_known_is_not_started_there():
    known = shell.master("http://robot:11311", "nothing listens there", False)
    assert known.cure == "ssh robot roscore"
    unknown = shell.master("http://rowbot:11311", UNKNOWN_HOST, False)
    assert unknown.name == "no_remote_master"
    assert unknown.cure.startswith("getent hosts rowbot  #")
    assert "/etc/hosts" in unknown.cure


@pytest.mark.parametrize(
    ("addresses", "master_is_here", "is_right"),
    [
        ({"127.0.0.1": True}, True, True),
        ({"127.0.0.1": True}, False, False),
        ({"127.0.1.1": True, "10.0.0.7": True}, False, True),
        ({"10.0.0.7": True}, False, True),
        ({"10.0.0.8": False}, True, False),
        ({}, True, False),
    ],
)
def test_own_addresses(addresses, master_is_here, is_right):
    found = shell.own_address(("ROS_IP", "x"), addresses, master_is_here, "10.0.0.7")
    assert (found is None) == is_right
    if found:
        assert found.cure == "unset ROS_HOSTNAME; export ROS_IP=10.0.0.7"


# --- nodes --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("answer", "master_is_here", "name"),
    [
        (NodeAnswer(HERE, "", {"/tf", "/rosout"}), True, None),
        (NodeAnswer(HERE, "", {"/other", "/rosout"}), True, "wrong_node_address"),
        (NodeAnswer("http://x:1", UNKNOWN_HOST), True, "wrong_node_address"),
        (NodeAnswer("http://10.0.0.9:1", "no answer"), True, "wrong_node_address"),
        (NodeAnswer(HERE, "nothing listens", is_here=True), True, "dead_node"),
        (NodeAnswer(HERE, "no answer in 4 s", is_here=True), True, "hung_node"),
        (
            NodeAnswer(HERE, "no answer in 4 s", is_here=True, stopped="7"),
            True,
            "stopped_node",
        ),
        (
            NodeAnswer(HERE, "no answer", is_here=True, is_loopback=True),
            False,
            "wrong_node_address",
        ),
    ],
)
def test_addresses_of_nodes(answer, master_is_here, name):
    graph = Graph({"/tf": ["/a"], "/rosout": ["/a"]})
    assert name_of(node_addresses(graph, {"/a": answer}, master_is_here)) == name


@pytest.mark.parametrize(
    ("graph", "matters"),
    [
        (Graph({"/left/joint_states": ["/a"]}), True),
        (Graph({}, {"/left/tf_joint_states": ["/a"]}), True),
        (Graph({}, {}, {"/gazebo/set_model_configuration": ["/a"]}), True),
        (Graph({"/rosout": ["/a"]}, {"/joint_states": ["/a"]}), False),
        (Graph({"/tf": ["/b"], "/my_joint_states": ["/a"]}), False),
    ],
)
def test_a_dead_node_matters_in_the_chain_only(graph, matters):
    dead = NodeAnswer(HERE, "nothing listens there", is_here=True)
    asleep = NodeAnswer("http://10.0.0.9:1", "no answer within 4 s")
    for answer in (dead, asleep):
        assert (node_addresses(graph, {"/a": answer}, True) is not None) == matters


def test_a_node_that_has_just_stopped_to_publish_is_no_other_one():
    graph, answers = Graph({"/tf": ["/a"]}), {"/a": NodeAnswer(HERE, "", {"/rosout"})}
    assert node_addresses(graph.still(graph), answers, True) is not None
    assert node_addresses(graph.still(Graph({"/tf": ["/b"]})), answers, True) is None
    assert node_addresses(graph.still(Graph()), answers, True) is None


def test_a_graph_without_some_nodes():
    graph = Graph({"/a": ["/1", "/2"], "/b": ["/2"]}, {"/a": ["/2"]}, {"/s": ["/1"]})
    assert graph.nodes == ["/1", "/2"]
    assert graph.of({"/1"}) == Graph({"/a": ["/1"]}, {}, {"/s": ["/1"]})


# --- the robot ----------------------------------------------------------------------


def simulated(text, angle=0.3):
    """Give the links of a robot as a simulator has them: scoped names and poses."""
    lumped = lump_fixed_joints(parse_urdf(text)).description
    kinematics = Kinematics(lumped)
    positions = np.full(len(lumped.movable_joints), angle)
    poses = kinematics.link_poses(IDENTITY, positions)
    names = [f"{MODEL}::{name}" for name in lumped.link_names]
    return [*names, "ground_plane::link"], np.vstack([poses, [0, 0, 0, 0, 0, 0, 1]])


def changed(joint, tag, old, new):
    """Change an attribute below a joint of the G1."""
    begin = URDF.index(f'<joint name="{joint}"')
    place = URDF.index(f"<{tag} ", begin)
    end = URDF.index("/>", place)
    text = re.sub(old, new, URDF[place:end], count=1)
    assert text != URDF[place:end]
    return URDF[:place] + text + URDF[end:]


@pytest.mark.parametrize(
    ("spawned", "told"),
    [
        (URDF, ""),
        (URDF.replace("left_knee_link", "left_shin"), "no link left_knee_link"),
        (
            changed("left_knee_joint", "axis", r'xyz="[^"]*"', 'xyz="1 0 0"'),
            "axes of left_knee_joint",
        ),
        (
            changed("left_knee_joint", "origin", r'xyz="\S+', 'xyz="0.05'),
            "left_knee_joint is",
        ),
    ],
    ids=["same", "link", "axis", "origin"],
)
def test_another_robot_is_told_from_the_described_one(spawned, told):
    found = robot.difference(parse_urdf(URDF), MODEL, *simulated(spawned))
    assert told in found and bool(found) == bool(told)


def test_a_robot_with_more_links_is_another():
    less = re.sub(r"left_wrist_yaw", "hidden", URDF)
    found = robot.difference(parse_urdf(less), MODEL, *simulated(URDF))
    assert "left_wrist_yaw_link" in found or "hidden" in found


def test_models_and_what_mends_their_names():
    def judge(*models, link="pelvis"):
        names = [f"{model}::{link}" for model in models]
        robots = robot.models_of(parse_urdf(URDF), names, [MODEL, "right"])
        return robot.model(MODEL, models, robots, "/bridge", "/robot_description")

    assert judge(MODEL, *WORLD) is None
    assert robot.model("a::b", ["a"], [], "/bridge", "/r") is None
    assert judge("mine").cure.startswith("rosparam set /bridge/model_name mine ")
    others = judge("table", link="top"), judge("one", "two"), judge("right")
    for made in (judge(), *others):
        assert "spawn_robot.py" in made.cure and "_on_floor:=true" in made.cure


def test_no_cure_starts_a_simulator_beside_one():
    """It would be refused: one runs already."""
    starts = {name for name, (_, cure) in TABLE.items() if cure.startswith(GAZEBO)}
    assert starts == {"no_simulator"}


def test_without_a_robot_the_cure_depends_on_what_runs():
    assert robot.cure_of_description("/r", False) == DISPLAY
    cure = robot.cure_of_description("/r", True)
    assert "roslaunch" not in cure and cure.endswith("rosparam set -t /tmp/g1.urdf /r")


def test_one_publisher_is_enough():
    def judge(*nodes):
        return robot.publishers("two_clocks", nodes, ["/gazebo"])

    assert judge() is None and judge("/gazebo") is None and judge("/bag") is None
    assert judge("/gazebo", "/bag").cure == "rosnode kill /bag"
    assert judge("/bag", "/gazebo").cure == "rosnode kill /bag"


OWN = ["/bridge", "/rsp"]


@pytest.mark.parametrize(
    ("pairs", "killed"),
    [
        ({("/rsp", "a")}, ""),
        ({("/rsp", "a"), ("/bridge", "a")}, ""),  # fixed joints, when time stood still
        ({("/rsp", "a"), ("/other", "a")}, "/other"),
        ({("/rsp", "a"), ("/other", "b")}, "/other"),
        ({("/rsp", "a"), ("/rsp", "b")}, "/rsp"),
        ({("/rsp", "a"), ("/bridge", "b")}, "/rsp"),
        ({("/one", "a"), ("/two", "a")}, "/two"),
    ],
)
def test_owners_of_edges(pairs, killed):
    edges = {"x": pairs, "y": {("/rsp", "x")}}
    found = robot.tf_owners(edges, OWN, [("a", "x"), ("x", "y")], {})
    assert (found.cure if found else "") == (killed and f"rosnode kill {killed}")


def test_frames_of_other_robots_are_not_judged():
    """The bridge keeps their fixed joints from when time stood still."""
    other = {"right/x": {("/bridge", "right/a"), ("/right/rsp", "right/a")}}
    assert robot.tf_owners(other, OWN, [("left/a", "left/x")], {}) is None


def test_bridges_share_the_static_edge_to_the_map():
    def judge(*pairs, shared=("/bridge", "/second")):
        edge = ("world", "map")
        return robot.tf_owners({"map": {*pairs}}, OWN, [edge], {edge: shared})

    both = ("/bridge", "world"), ("/second", "world")
    assert judge(*both) is None
    assert judge(*both, shared=()).cure == "rosnode kill /second"
    assert judge(*both, ("/other", "world")) is not None
    assert judge(("/bridge", "world"), ("/second", "odom")) is not None


def test_missing_edges_and_who_should_send_them():
    edges = {"b": {("/rsp", "a")}}
    assert robot.missing_edges(edges, [("a", "b"), ("b", "c")]) == [("b", "c")]
    start = "/left/tf_joint_states", "left"
    base = [("map", "a")]
    of_base = robot.no_tf([("map", "a")], base, ("/bridge", "/rsp"), start)
    assert "/bridge should send" in of_base.sentence
    of_joint = robot.no_tf([("a", "b")], base, ("/bridge", "/rsp"), start)
    assert "/rsp should send" in of_joint.sentence
    assert "__ns:=left _tf_prefix:='left'" in of_joint.cure


def test_diagnostics_that_are_a_fault():
    def judge(name, level):
        return robot.diagnostics("/bridge", {f"bridge: {name}": (level, "text")})

    assert judge("link states", 0) is None
    assert "link states: text" in judge("link states", 1).sentence
    assert judge("commands", 1) is None and judge("commands", 2) is not None


def test_a_report_that_does_not_come_is_no_good_one():
    good, bad = {"bridge: time": (0, "comes")}, {"bridge: time": (1, "stands")}

    def judge(*rounds):
        return name_of(robot.reports("/bridge", rounds, 4.0))

    assert judge(good) is None and judge(bad, good) is None and judge({}, good) is None
    assert judge({}) == judge({}, {}) == "no_diagnostics"
    assert judge(bad, bad) == judge(bad, {}) == judge({}, bad) == "bad_diagnostics"


def test_meshes_that_are_missing():
    def cure(*lost):
        return robot.meshes(lost, "/robot_description", "/here").cure

    assert robot.meshes([], "/robot_description", "/here") is None
    assert cure("file:///here/meshes/a.stl") == "git -C /here checkout -- meshes"
    assert "model:=FILE" in cure("file:///there/a.stl", "file:///here/a.stl")
    assert "workspace with robots" in cure("package://robots/a.stl")
