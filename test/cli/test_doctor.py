"""What the doctor decides, and that its command needs the standard library alone."""

import ast
import json
import os
import re
import socket
import subprocess
import sys
import threading
from collections import defaultdict
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from xmlrpc.server import SimpleXMLRPCServer

import numpy as np
import pytest
from checked import assert_as_kept
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
    assert [link["name"] for link in told["checks"]] == doctor.CHECK_NAMES
    assert {*told} == {"ok", "fault", "message", "fix", "checks"}
    assert {*told["checks"][0]} == {"name", "state", "about", "remark"}


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
    assert listed == {*doctor.CHECK_NAMES, *faults()}
    abouts = {name: about for name, about, _ in doctor.CHECKS}
    shown = re.findall(r"^(?:ok|failed|skipped) +(\w+) +(.+?)(?: \(|$)", PAGE, re.M)
    assert len(shown) == 5 and all(abouts[name] == about for name, about in shown)


def test_a_check_that_fails_is_reported_without_a_traceback(monkeypatch):
    def fail(system):
        raise TimeoutError

    monkeypatch.setattr(doctor, "CHECKS", [("nodes", "", fail), ("tf", "", fail)])
    monkeypatch.setattr(doctor, "check_master", lambda system: "it answers")
    nodes, tf = doctor.run_checks("", ["nodes", "tf"])
    assert (nodes.state, nodes.remark) == (doctor.FAILED, "unfinished")
    assert "'nodes'" in nodes.fault.message
    assert tf.state == doctor.SKIPPED


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
    assert found.name == "bad_master_uri" and f"'{uri}'" in found.message


@pytest.mark.parametrize(
    ("host", "name", "fix"),
    [
        ("localhost", "no_master", doctor.DISPLAY),
        ("robot.invalid", "no_remote_master", "ssh robot.invalid roscore"),
    ],
)
def test_no_master(monkeypatch, host, name, fix):
    monkeypatch.setenv("ROS_MASTER_URI", f"http://{host}:1")
    found = doctor.check_master(doctor.System(""))
    assert (found.name, found.fix) == (name, fix)


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
        assert found.fix.startswith("unset ROS_HOSTNAME; export ROS_IP=")


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
    assert found == "1 answer; no answer from /dead"
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
    assert found.name == name and "/a" in found.message


def test_a_node_that_takes_connections_and_is_silent_hangs(monkeypatch):
    monkeypatch.setattr(doctor, "WAIT", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        uri = f"http://127.0.0.1:{silent.getsockname()[1]}/"
        _, found = ask_nodes(monkeypatch, {"/a": uri}, {"/tf": ["/a"]}, {}, {})
    assert found.name == "hung_node" and found.fix.startswith("kill -CONT ")


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
    def fix(*nodes):
        found = doctor.several("two_clocks", nodes, ["/gazebo"], "")
        return found and found.fix

    assert fix() is None and fix("/gazebo") is None and fix("/bag") is None
    assert fix("/gazebo", "/bag") == fix("/bag", "/gazebo") == "rosnode kill /bag"


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
    assert (found.fix if found else "") == (killed and f"rosnode kill {killed}")


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
    def fix(*lost):
        return doctor.meshes_fix(lost, "/here", "display")

    assert fix("file:///here/meshes/a.stl") == "git -C /here checkout -- meshes"
    assert "display model:=FILE" in fix("file:///there/a.stl", "file:///here/a.stl")
    assert "workspace with robots" in fix("package://robots/a.stl")


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
    assert found.name == name and "/node runs, but there was no mess" in found.message
    fix = "rosnode kill /node" if name == "no_joint_states" else "kill 7"
    assert topic in found.message and found.fix.startswith(fix)


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


# --- a whole system -----------------------------------------------------------------

POST = """<robot name="post"><link name="foot"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="arm"><visual><geometry><mesh filename="{mesh}"/></geometry></visual>
<inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tip"/>
<joint name="elbow" type="revolute"><parent link="foot"/><child link="arm"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="end" type="revolute"><parent link="arm"/><child link="tip"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>"""
MESH = f"file://{REPOSITORY}/package.xml"  # any file
SIM, RSP = "/gazebo", "/robot_state_publisher"


def edges_of(sender, topic, *pairs):
    """Give a message of TF, as it was heard."""
    transforms = [
        SimpleNamespace(header=SimpleNamespace(frame_id=parent), child_frame_id=child)
        for parent, child in pairs
    ]
    return topic, sender, SimpleNamespace(transforms=transforms)


def whole_system():
    """Give a system without a fault."""
    pose = SimpleNamespace(
        position=SimpleNamespace(x=1.0, y=2.0, z=3.0),
        orientation=SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0),
    )
    status = SimpleNamespace(name="bridge: links", level=0, message="good")
    return SimpleNamespace(
        namespace="",
        publishers={
            "/clock": [SIM],
            "/gazebo/link_states": [SIM],
            "/tf_joint_states": [doctor.BRIDGE],
            "/joint_states": [doctor.BRIDGE],
            "/tf": [doctor.BRIDGE, RSP],
            "/tf_static": [doctor.BRIDGE],
        },
        subscribers={"/tf_joint_states": [RSP]},
        services={
            "/gazebo/set_model_configuration": [SIM],
            "/gazebo/step": [SIM],
            "/rviz/reload_shaders": ["/rviz"],
        },
        parameters={
            "/robot_description": POST.format(mesh=MESH),
            "/use_sim_time": True,
            doctor.BRIDGE: {"model_name": "post"},
        },
        pids={SIM: 7, "/page": 8},
        here={SIM},
        answers={
            "/gazebo/get_physics_properties": SimpleNamespace(pause=False),
            "/gazebo/get_world_properties": SimpleNamespace(model_names=["post"]),
        },
        heard={
            "/clock": [SIM, "time"],
            "/gazebo/link_states": [
                SIM,
                SimpleNamespace(
                    name=["post::foot", "post::arm", "post::tip"], pose=[pose] * 3
                ),
            ],
            "/joint_states": [doctor.BRIDGE, SimpleNamespace(name=["elbow", "end"])],
            "/diagnostics": [doctor.BRIDGE, SimpleNamespace(status=[status])],
        },
        tf=[
            edges_of(RSP, "/tf", ("foot", "arm"), ("arm", "/tip")),
            edges_of(doctor.BRIDGE, "/tf", ("map", "base_link")),
            edges_of(
                doctor.BRIDGE, "/tf_static", ("world", "map"), ("base_link", "foot")
            ),
        ],
        screen=":0",
    )


def of_gazebo(system):
    """Make the simulator the real Gazebo, which sim:=gazebo has started."""
    del system.services["/gazebo/step"]
    system.parameters["/gazebo/sim"] = "gazebo"


def of_bag(system):
    system.services.clear()
    system.publishers = {"/joint_states": ["/bag"], "/tf": ["/bag"]}
    system.parameters["/use_sim_time"] = False
    system.screen = ""


def of_left(system):
    """Move the robot into a namespace."""
    system.namespace = "left"
    robots = [{"name": "post", "namespace": "left", "frame_prefix": "left/"}]
    system.parameters[doctor.BRIDGE] = {"robots": robots}
    for table in (system.publishers, system.subscribers):
        for name in ("joint_states", "tf_joint_states"):
            table[f"/left/{name}"] = table.pop(f"/{name}", [])
    system.subscribers["/left/tf_joint_states"] = []
    system.heard["/left/joint_states"] = system.heard["/joint_states"]


def of_left_alone(system):
    of_left(system)
    system.subscribers["/left/tf_joint_states"] = [RSP]
    system.parameters["/left/robot_description"] = system.parameters.pop(
        "/robot_description"
    )
    system.tf[:] = [
        edges_of(RSP, "/tf", ("left/foot", "left/arm"), ("left/arm", "left/tip")),
        edges_of(doctor.BRIDGE, "/tf", ("map", "left/base_link"), ("world", "map")),
        edges_of(doctor.BRIDGE, "/tf_static", ("left/base_link", "left/foot")),
    ]


def one_link_more(system):
    message = system.heard["/gazebo/link_states"][1]
    message.name += ["post::hand", "post::lamp::bulb"]
    message.pose *= 2


def change(table, key, value=None):
    """Give what changes a table of a system; without a value its key is removed."""

    def apply(system):
        if value is None:
            del getattr(system, table)[key]
        else:
            getattr(system, table)[key] = value

    return apply


def models(*names):
    told = SimpleNamespace(model_names=names)
    return change("answers", "/gazebo/get_world_properties", told)


def renamed(system):
    models("robot")(system)
    message = system.heard["/gazebo/link_states"][1]
    message.name = ["robot::foot", "robot::arm", "lamp::bulb"]


def bad_report(system):
    (status,) = system.heard["/diagnostics"][1].status
    status.level = 2


CHANGES = {
    "nothing": lambda system: None,
    "a bag": of_bag,
    "no description": change("parameters", "/robot_description"),
    "a description that is none": change("parameters", "/robot_description", "<a/>"),
    "a mesh": change(
        "parameters", "/robot_description", POST.format(mesh="file:///no")
    ),
    "a simulator elsewhere": lambda system: system.here.clear(),
    "no simulator": change("services", "/gazebo/set_model_configuration"),
    "a hung simulator": change("answers", "/gazebo/get_physics_properties"),
    "no simulated time": change("parameters", "/use_sim_time", False),
    "no clock": change("publishers", "/clock"),
    "two clocks": change("publishers", "/clock", [SIM, "/bag"]),
    "pause": change(
        "answers", "/gazebo/get_physics_properties", SimpleNamespace(pause=True)
    ),
    "a silent clock": change("heard", "/clock"),
    "a silent clock of Gazebo": lambda system: (
        of_gazebo(system),
        system.heard.pop("/clock"),
    ),
    "no Gazebo": lambda system: (
        of_gazebo(system),
        system.services.pop("/gazebo/set_model_configuration"),
    ),
    "neither Gazebo nor a description": lambda system: (
        of_gazebo(system),
        system.services.pop("/gazebo/set_model_configuration"),
        system.parameters.pop("/robot_description"),
    ),
    "no link states": change("publishers", "/gazebo/link_states"),
    "silent link states": change("heard", "/gazebo/link_states"),
    "no bridge": change("publishers", "/tf_joint_states"),
    "a bridge elsewhere": lambda system: (
        change("publishers", "/tf_joint_states")(system),
        change("publishers", "/right/tf_joint_states", ["/right/bridge"])(system),
    ),
    "two bridges": change("publishers", "/tf_joint_states", ["/a", doctor.BRIDGE]),
    "no world": change("answers", "/gazebo/get_world_properties"),
    "no models": models(),
    "another name": renamed,
    "another robot": change(
        "parameters",
        "/robot_description",
        POST.format(mesh=MESH).replace("arm", "leg"),
    ),
    "two joint states": change("publishers", "/joint_states", ["/a", doctor.BRIDGE]),
    "silent joint states": change("heard", "/joint_states"),
    "no robot state publisher": change("subscribers", "/tf_joint_states"),
    "one in a namespace": of_left,
    "all of it in a namespace": of_left_alone,
    "a bag with less": lambda system: (of_bag(system), system.tf.pop(0)),
    "one link more": one_link_more,
    "two bags": lambda system: (
        of_bag(system),
        system.publishers.update({"/joint_states": ["/bag", "/other"]}),
    ),
    "TF without an arm": lambda system: system.tf.pop(0),
    "TF without a base": lambda system: system.tf.pop(1),
    "TF twice": lambda system: system.tf.append(
        edges_of("/other", "/tf", ("foot", "arm"))
    ),
    "no reports": change("heard", "/diagnostics"),
    "a bad report": bad_report,
    "a page": lambda system: (
        system.services.pop("/rviz/reload_shaders"),
        system.parameters.update({"/page": {"controls": 1, "port": 1, "read_only": 1}}),
    ),
    "no picture": change("services", "/rviz/reload_shaders"),
    "no screen": lambda system: (
        system.services.pop("/rviz/reload_shaders"),
        setattr(system, "screen", ""),
    ),
}


def examined(monkeypatch, given):
    """Give what the doctor says of a system, as lines of text."""

    def begin(system):
        for name in ("publishers", "subscribers", "services"):
            setattr(system, name, defaultdict(list, getattr(given, name)))
        system.pids, system.here = given.pids, given.here
        return "begun"

    def call(service, kind):
        if service not in given.answers:
            raise OSError(service)
        return given.answers[service]

    def listen(topics, is_enough):
        heard = [(t, *given.heard[t]) for t in topics if t in given.heard]
        heard += given.tf if "/tf" in topics else []
        is_enough(heard)
        return heard

    monkeypatch.setattr(
        doctor.System,
        "parameter",
        lambda self, name, default=None: given.parameters.get(name, default),
    )
    checks = doctor.CHECKS[doctor.CHECK_NAMES.index("description") :]
    monkeypatch.setattr(doctor, "CHECKS", [("begin", "", begin), *checks])
    monkeypatch.setattr(doctor, "call", call)
    monkeypatch.setattr(doctor, "listen", listen)
    monkeypatch.setattr(doctor, "TF_WAIT", 0.0)
    monkeypatch.setenv("DISPLAY", given.screen)
    names = [name for name, _, _ in doctor.CHECKS]
    results = list(doctor.run_checks(given.namespace, names))
    faults = [result.fault for result in results if result.fault]
    for fault in faults:
        yield f"  {fault.name}"
        yield from (f"    {fault.message}", f"    {fault.fix}")
    if not faults:
        yield from (f"  {result.name}: {result.remark}" for result in results)


def test_what_is_said_of_systems_with_a_fault(monkeypatch, tmp_path):
    lines = []
    for name, apply in CHANGES.items():
        given = whole_system()
        apply(given)
        with monkeypatch.context() as patch:
            lines += [name, *examined(patch, given)]
    text = "".join(f"{line}\n" for line in lines)
    assert_as_kept(text.replace(str(REPOSITORY), "HERE"), "doctor.txt", tmp_path)


def test_a_signal_ends_the_checks(monkeypatch):
    monkeypatch.setattr(doctor, "CHECKS", [("a", "", lambda system: "well")])
    monkeypatch.setattr(doctor, "is_shut_down", lambda: True)
    with pytest.raises(KeyboardInterrupt):
        next(doctor.run_checks("", ["a"]))


FAULT = doctor.Fault("no_b", "There is no b.", "make b")
RESULTS = [
    doctor.Result("tf", "a is there", doctor.OK, "/a"),
    doctor.Result("picture", "b is there", doctor.FAILED, FAULT.name, FAULT),
    doctor.Result("more", "c is there", doctor.SKIPPED),
]


@pytest.mark.parametrize("n_results", [1, 3])
def test_results_are_told_as_text_and_as_json(monkeypatch, capsys, n_results):
    asked, fault = [], FAULT if n_results > 1 else None

    def run_checks(*given):
        asked.append(given)
        return iter(RESULTS[:n_results])

    monkeypatch.setattr(doctor, "run_checks", run_checks)
    told = []
    for words in ([], ["--json", "--namespace", "/left/", "--until", "packages"]):
        monkeypatch.setattr(sys, "argv", ["doctor", *words])
        with pytest.raises(SystemExit) as end:
            doctor.main()
        assert end.value.code == (1 if fault else 0)
        told.append(capsys.readouterr().out)
    assert asked == [("", doctor.CHECK_NAMES), ("left", ["python", "packages"])]
    lines = [
        "ok       tf               a is there (/a)",
        "failed   picture          b is there (no_b)",
        "skipped  more             c is there",
    ][:n_results]
    end = ["doctor: There is no b.", "        make b"]
    end = end if fault else ["doctor: no fault found."]
    assert told[0].splitlines() == [*lines, "", *end]
    links = [("tf", "ok", "a is there", "/a")]
    links += [("picture", "failed", "b is there", "no_b")]
    links += [("more", "skipped", "c is there", "")]
    keys = "name", "state", "about", "remark"
    assert json.loads(told[1]) == {
        "ok": not fault,
        "fault": fault and "no_b",
        "message": fault and "There is no b.",
        "fix": fault and "make b",
        "checks": [dict(zip(keys, link)) for link in links[:n_results]],
    }
