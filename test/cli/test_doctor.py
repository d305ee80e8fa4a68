"""What the doctor decides, and that its command needs the standard library alone."""

import ast
import json
import os
import re
import socket
import subprocess
import sys
import threading
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from xmlrpc.server import SimpleXMLRPCServer

import numpy as np
import pytest
from conftest import REPOSITORY

from g1_description.cli import doctor
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.transform import IDENTITY
from g1_description.robot.urdf import parse_urdf

URDF = (REPOSITORY / "urdf" / "g1_29dof.urdf").read_text()
PAGE = (REPOSITORY / "docs" / "doctor.md").read_text()
MODEL = "g1_robot"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--until", "heaven"], "invalid choice: 'heaven'"),
        (["--namespace", "a b"], "'a b' is not a valid ROS name"),
        (["robot", "a:=b"], "unrecognized arguments: robot"),
    ],
)
def test_a_wrong_command_line_ends_with_a_sentence_and_2(
    monkeypatch, capsys, words, told
):
    monkeypatch.setattr(sys, "argv", ["doctor", *words])
    with pytest.raises(SystemExit) as end:
        doctor.main()
    assert end.value.code == 2
    output = capsys.readouterr()
    assert output.out == "" and len(output.err.splitlines()) == 1
    assert told in output.err and "a:=b" not in output.err


def test_a_python_without_anything_says_that_no_workspace_is_sourced():
    """It has no packages, not even those of the distribution."""
    run = subprocess.run(
        [sys.executable, "-I", "-S", REPOSITORY / "scripts" / "doctor", "--json"],
        env={**os.environ, "ROS_MASTER_URI": "http://localhost:1"},
        capture_output=True,
        text=True,
    )
    assert (run.returncode, run.stderr) == (1, "")
    told = json.loads(run.stdout)
    assert [link["name"] for link in told["links"]] == doctor.LINKS
    assert {*told} == {"whole", "fault", "sentence", "cure", "links"}
    assert {*told["links"][0]} == {"name", "state", "about", "remark"}


def faults():
    """List the names of all faults that the code makes."""
    names = set()
    for node in ast.walk(ast.parse(Path(doctor.__file__).read_text())):
        name = getattr(getattr(node, "func", None), "id", "")
        if name in ("Fault", "several", "_silent") and node.args:
            first = node.args[0]
            options = [first, getattr(first, "body", 0), getattr(first, "orelse", 0)]
            names |= {part.value for part in options if hasattr(part, "value")}
    return names


def test_all_faults_and_links_are_on_the_page():
    assert {"no_pybullet", "two_clocks", "no_diagnostics", "paused"} <= faults()
    listed = {*re.findall(r"^\| `(\w+)` \|", PAGE, flags=re.M)}
    assert listed == {*doctor.LINKS, *faults()}


def test_a_check_that_fails_is_reported_without_a_traceback(monkeypatch):
    def fail(system):
        raise TimeoutError

    monkeypatch.setattr(doctor, "CHECKS", [("nodes", "", fail), ("tf", "", fail)])
    monkeypatch.setattr(doctor, "check_master", lambda system: "it answers")
    nodes, tf = doctor.run_checks("", ["nodes", "tf"])
    assert (nodes.state, nodes.remark) == (doctor.BROKEN, "unfinished")
    assert "'nodes'" in nodes.fault.sentence
    assert tf.state == doctor.NOT_LOOKED_AT


# --- this shell ---------------------------------------------------------------------

LACKS_ROSPY = {"rospy": "No module named 'rospy'"}


@pytest.mark.parametrize(
    ("own", "failed", "is_sourced", "name"),
    [
        ("/usr/bin/python3", {}, True, None),
        ("/opt/bare/bin/python3", LACKS_ROSPY, True, "wrong_python"),
        ("/opt/bare/bin/python3", LACKS_ROSPY, False, "no_workspace"),
        ("/usr/bin/python3", LACKS_ROSPY, False, "no_workspace"),
        ("/usr/bin/python3", {"gazebo_msgs.msg": "absent"}, True, "no_workspace"),
    ],
)
def test_pythons(monkeypatch, own, failed, is_sourced, name):
    spec = object() if is_sourced else None
    monkeypatch.setattr(sys, "executable", own)
    monkeypatch.setattr(doctor, "failed_imports", lambda python, names: failed)
    monkeypatch.setattr(doctor, "find_spec", lambda name: spec)
    monkeypatch.setattr("shutil.which", lambda name: own)
    found = doctor.check_python(doctor.System(""))
    assert found == own if name is None else found.name == name


@pytest.mark.parametrize("first", ["/opt/bare/bin/python3", None])
def test_another_python_on_path_is_remarked_with_what_it_breaks(monkeypatch, first):
    """What ROS installs names its Python, so rosrun works all the same."""

    def failed(python, names):
        return {} if python == sys.executable else LACKS_ROSPY

    monkeypatch.setattr(doctor, "failed_imports", failed)
    monkeypatch.setattr(doctor, "find_spec", lambda name: object())
    monkeypatch.setattr("shutil.which", lambda name: first)
    remark = doctor.check_python(doctor.System(""))
    assert remark.startswith(f"{sys.executable}; python3 on PATH ({first or 'missi'}")
    assert "export PATH=/usr/bin:$PATH" in remark


@pytest.mark.parametrize(
    ("module", "services", "name"),
    [
        ("", [], None),
        ("numpy", [], "no_package"),
        ("pybullet", [], "no_pybullet"),
        ("pybullet", ["set_model_configuration", "step"], "no_pybullet"),
        ("pybullet", ["set_model_configuration"], None),  # the real Gazebo
    ],
)
def test_the_packages_of_the_nodes(monkeypatch, module, services, name):
    system = doctor.System("")
    system.failed = {module: "absent"} if module else {}
    tables = [{}, {}, {f"/gazebo/{service}": ["/gazebo"] for service in services}]
    monkeypatch.setattr(system, "ask_graph", lambda: tables)
    found = doctor.check_packages(system)
    assert found == sys.executable if name is None else found.name == name


@pytest.mark.parametrize(
    "uri", ["localhost:11311", "robot", "http://robot", "http://localhost:port", "ftp:"]
)
def test_what_is_not_an_address_of_a_master(monkeypatch, uri):
    monkeypatch.setenv("ROS_MASTER_URI", uri)
    found = doctor.check_master(doctor.System(""))
    assert found.name == "bad_master_uri" and f"'{uri}'" in found.sentence


@pytest.mark.parametrize(
    ("host", "name", "cure"),
    [
        ("localhost", "no_master", doctor.DISPLAY),
        ("robot.invalid", "no_remote_master", "ssh robot.invalid roscore"),
    ],
)
def test_no_master(monkeypatch, host, name, cure):
    monkeypatch.setenv("ROS_MASTER_URI", f"http://{host}:1")
    found = doctor.check_master(doctor.System(""))
    assert (found.name, found.cure) == (name, cure)


@pytest.mark.parametrize(
    ("variables", "master_is_here", "is_right"),
    [
        ({"ROS_IP": "127.0.0.1"}, True, True),
        ({"ROS_IP": "127.0.0.1"}, False, False),
        ({"ROS_IP": "198.51.100.7"}, True, False),
        ({"ROS_IP": "127.0.0.1", "ROS_HOSTNAME": "nowhere.invalid"}, True, False),
        ({"ROS_IP": "nowhere.invalid", "ROS_HOSTNAME": "127.0.0.1"}, True, True),
    ],
)
def test_own_addresses(monkeypatch, variables, master_is_here, is_right):
    for name in ("ROS_IP", "ROS_HOSTNAME"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    system = doctor.System("")
    system.master_is_here = master_is_here
    found = doctor.check_address(system)
    assert isinstance(found, str) == is_right
    if not is_right:
        assert found.cure.startswith("unset ROS_HOSTNAME; export ROS_IP=")


# --- nodes --------------------------------------------------------------------------


@contextmanager
def xmlrpc(**methods):
    """Answer as a master or a node does; give the address."""
    with SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False) as server:
        for name, value in methods.items():

            def answer(*given, value=value):
                return 1, "", value(*given[1:]) if callable(value) else value

            server.register_function(answer, name)
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        yield f"http://127.0.0.1:{server.server_address[1]}"
        server.shutdown()
        thread.join()


def ask_nodes(monkeypatch, addresses, *tables):
    """Let the doctor check nodes of a master; give the system, and what it found."""
    tables = [[*table.items()] for table in tables]
    with xmlrpc(getSystemState=tables, lookupNode=addresses.get) as uri:
        monkeypatch.setenv("ROS_MASTER_URI", uri)
        system = doctor.System("")
        return system, doctor.check_nodes(system)


def test_nodes_that_answer_are_known(monkeypatch):
    with xmlrpc(getPid=7) as uri:
        addresses = {"/a": uri, "/dead": "http://127.0.0.1:1/"}
        topics = {"/tf": ["/a"], "/other": ["/a", "/dead"]}
        system, found = ask_nodes(monkeypatch, addresses, topics, {}, {})
    assert found == "1 answer, not /dead"
    assert system.pids == {"/a": 7} and system.here == {"/a"}
    assert system.publishers == {"/tf": ["/a"], "/other": ["/a"]}


@pytest.mark.parametrize(
    ("uri", "name"),
    [
        ("http://nowhere.invalid:1/", "wrong_node_address"),
        ("nonsense", "wrong_node_address"),
        ("http://127.0.0.1:1/", "dead_node"),
        ("http://198.51.100.7:1/", "wrong_node_address"),  # nobody's
    ],
)
def test_nodes_that_do_not_answer(monkeypatch, uri, name):
    monkeypatch.setattr(doctor, "WAIT", 2.0)
    _, found = ask_nodes(monkeypatch, {"/a": uri}, {"/tf": ["/a"]}, {}, {})
    assert found.name == name and "/a" in found.sentence


def test_a_node_that_takes_connections_and_is_silent_hangs(monkeypatch):
    monkeypatch.setattr(doctor, "WAIT", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        uri = f"http://127.0.0.1:{silent.getsockname()[1]}/"
        _, found = ask_nodes(monkeypatch, {"/a": uri}, {"/tf": ["/a"]}, {}, {})
    assert found.name == "hung_node" and found.cure.startswith("kill -CONT ")


@pytest.mark.parametrize(
    ("publishers", "subscribers", "services", "matters"),
    [
        ({"/left/joint_states": ["/a"]}, {}, {}, True),
        ({}, {"/left/tf_joint_states": ["/a"]}, {}, True),
        ({}, {}, {"/gazebo/set_model_configuration": ["/a"]}, True),
        ({"/rosout": ["/a"]}, {"/joint_states": ["/a"]}, {}, False),
        ({"/my_joint_states": ["/a"]}, {}, {}, False),
    ],
)
def test_a_dead_node_matters_in_the_pipeline_only(
    monkeypatch, publishers, subscribers, services, matters
):
    dead = {"/a": "http://127.0.0.1:1/"}
    _, found = ask_nodes(monkeypatch, dead, publishers, subscribers, services)
    assert isinstance(found, doctor.Fault) == matters


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
        (URDF.replace("left_knee_link", "left_shin"), "lacks the link left_knee_link"),
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
    found = doctor.difference(parse_urdf(URDF), MODEL, *simulated(spawned))
    assert told in found and bool(found) == bool(told)


def test_a_robot_with_more_links_is_another():
    less = re.sub(r"left_wrist_yaw", "hidden", URDF)
    found = doctor.difference(parse_urdf(less), MODEL, *simulated(URDF))
    assert "left_wrist_yaw_link" in found or "hidden" in found


# --- topics and TF ------------------------------------------------------------------


def test_one_publisher_is_enough():
    def cure(*nodes):
        found = doctor.several("two_clocks", nodes, ["/gazebo"], "")
        return found and found.cure

    assert cure() is None and cure("/gazebo") is None and cure("/bag") is None
    assert cure("/gazebo", "/bag") == cure("/bag", "/gazebo") == "rosnode kill /bag"


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
    found = doctor.two_tf_owners(edges, [("a", "x"), ("x", "y")], OWN)
    assert (found.cure if found else "") == (killed and f"rosnode kill {killed}")


def test_frames_of_other_robots_are_ignored():
    """The bridge keeps their fixed joints from when time stood still."""
    other = {"right/x": {("/bridge", "right/a"), ("/right/rsp", "right/a")}}
    assert doctor.two_tf_owners(other, [("left/a", "left/x")], OWN) is None


def test_missing_edges():
    edges = {"b": {("/rsp", "a")}}
    assert doctor.missing_edges(edges, [("a", "b"), ("b", "c")]) == [("b", "c")]


def test_diagnostics_that_are_a_fault():
    def bad(name, level):
        status = SimpleNamespace(name=f"bridge: {name}", level=level, message="text")
        return doctor.bad_status([status])

    assert bad("link states", 0) == bad("commands", 1) == ""
    assert bad("link states", 1) == "bridge: link states: text"
    assert bad("commands", 2)


def test_meshes_that_are_missing():
    def cure(*lost):
        return doctor.meshes_cure(lost, "/here")

    assert cure("file:///here/meshes/a.stl") == "git -C /here checkout -- meshes"
    assert "model:=FILE" in cure("file:///there/a.stl", "file:///here/a.stl")
    assert "workspace with robots" in cure("package://robots/a.stl")


@pytest.mark.parametrize(
    ("check", "topic", "name"),
    [
        (doctor.check_time, "/clock", "silent_clock"),
        (doctor.check_link_states, "/gazebo/link_states", "silent_simulator"),
        (doctor.check_joint_states, "/joint_states", "no_joint_states"),
    ],
)
def test_a_topic_without_messages_is_silent(monkeypatch, check, topic, name):
    system = doctor.System("")
    monkeypatch.setattr(system, "parameter", lambda name, default=None: default)
    monkeypatch.setattr(doctor, "first_message", lambda topic, kind: None)
    system.publishers[topic], system.pids["/node"] = ["/node"], 7
    found = check(system)
    assert found.name == name and "/node runs, but there was no mess" in found.sentence
    cure = "rosnode kill /node" if name == "no_joint_states" else "kill 7"
    assert topic in found.sentence and found.cure.startswith(cure)


@pytest.mark.parametrize(
    ("services", "parameters", "screen", "told"),
    [
        ({"/rviz/reload_shaders": ["/rviz"]}, {}, ":0", "/rviz"),
        ({}, dict.fromkeys(doctor.PAGE_PARAMETERS, 0), ":0", "/web"),
        ({}, {"port": 8080}, ":0", "no_picture"),
        ({}, {}, "", "not needed without a screen"),
    ],
)
def test_rviz_and_the_browser_view_show_the_robot(
    monkeypatch, services, parameters, screen, told
):
    """The browser view counts before a page is open: its parameters tell it."""
    system = doctor.System("")
    system.services.update(services)
    system.pids["/web"] = 7
    known = {"/web": parameters}
    monkeypatch.setattr(system, "parameter", lambda name, default: known[name])
    monkeypatch.setenv("DISPLAY", screen)
    found = doctor.check_picture(system)
    assert getattr(found, "name", found).startswith(told)


BRIDGE_SAYS = {0: None, 2: "bad_diagnostics", None: "no_diagnostics"}


@pytest.mark.parametrize("level", [*BRIDGE_SAYS])
def test_the_bridge_reports_what_is_wrong_or_nothing(monkeypatch, level):
    status = SimpleNamespace(name="bridge: link states", level=level, message="none")
    heard = [("/diagnostics", "/bridge", SimpleNamespace(status=[status]))]
    others = [("/diagnostics", "/other", SimpleNamespace(status=[]))]
    given = others if level is None else others + heard
    monkeypatch.setattr(doctor, "listen", lambda topics, is_enough: given)
    system = doctor.System("")
    system.publishers["/tf_joint_states"] = ["/bridge"]
    found = doctor.check_diagnostics(system)
    assert getattr(found, "name", None) == BRIDGE_SAYS[level]
    if level:
        assert "/bridge reports on /diagnostics: bridge: link states: none" in str(
            found
        )


def test_a_bag_needs_no_bridge(monkeypatch):
    def nodes(system):
        system.publishers["/joint_states"] = ["/bag"]
        return "1 answers"

    monkeypatch.setattr(doctor, "CHECKS", [("nodes", "", nodes), ("bridge", "", None)])
    found = [*doctor.run_checks("", ["nodes", "bridge"])]
    assert [one.state for one in found] == [doctor.OK, doctor.OK]
    assert found[1].remark == "not needed, joint states come from /bag"


FAULT = doctor.Fault("no_tf", "TF lacks all.", "rosnode kill /rsp")
LINES = """\
ok             nodes            all answer (2)
broken         tf               TF is complete (no_tf)
not looked at  picture          RViz runs

doctor: TF lacks all.
        rosnode kill /rsp
"""


@pytest.mark.parametrize(
    ("tf", "code", "told"), [(FAULT, 1, LINES), ("", 0, "\ndoctor: no fault found.\n")]
)
def test_the_command_prints_the_links_and_the_cure(monkeypatch, capsys, tf, code, told):
    checks = [
        ("nodes", "all answer", lambda system: "2"),
        ("tf", "TF is complete", lambda system: tf),
        ("picture", "RViz runs", lambda system: ""),
    ]
    monkeypatch.setattr(doctor, "CHECKS", checks)
    monkeypatch.setattr(sys, "argv", ["doctor", "__name:=other"])
    with pytest.raises(SystemExit) as end:
        doctor.main()
    assert end.value.code == code
    assert capsys.readouterr().out.endswith(told)
