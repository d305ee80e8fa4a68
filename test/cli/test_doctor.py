"""What the doctor finds; fixes of the running system are in test_doctor_fixes.py."""

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
from conftest import REPOSITORY

from g1_description.cli import doctor, running_system
from g1_description.cli.running_system import BRIDGE, PAGE_PARAMETERS, RunningSystem
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.transform import IDENTITY
from g1_description.robot.urdf import parse_urdf

URDF = (REPOSITORY / "urdf" / "g1_29dof.urdf").read_text()
PAGE = (REPOSITORY / "docs" / "doctor.md").read_text()
MODEL = "g1_robot"


def test_a_wrong_command_line_ends_with_a_sentence_and_2(monkeypatch, capsys):
    words, told = ["--until", "heaven"], "invalid choice: 'heaven'"
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
        if name in ("Fault", "several", "_silent"):
            names |= {getattr(node.args[0], "value", "")}
    return names - {""}


def test_all_faults_and_links_are_on_the_page():
    assert {"no_package", "two_clocks", "silent_clock", "paused"} <= faults()
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


@pytest.mark.parametrize(
    ("uri", "words", "fix"),
    [
        ("http://[::1", "(got 'http://[::1')", "export ROS_MASTER_URI=http://"),
        ("http://localhost:1", "nothing listens there", doctor.DISPLAY),
    ],
)
def test_no_master(monkeypatch, uri, words, fix):
    monkeypatch.setenv("ROS_MASTER_URI", uri)
    found = doctor.check_master(RunningSystem(""))
    assert found.name == "no_master" and words in found.message
    assert found.fix.startswith(fix)


@pytest.mark.parametrize(
    ("variables", "master_is_here", "is_right"),
    [
        ({"ROS_IP": "127.0.0.1"}, True, True),
        ({"ROS_IP": "127.0.0.1"}, False, False),
        ({"ROS_IP": "127.0.0.1", "ROS_HOSTNAME": "nowhere.invalid"}, True, False),
    ],
)
def test_own_addresses(monkeypatch, variables, master_is_here, is_right):
    for name in ("ROS_IP", "ROS_HOSTNAME"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    system = RunningSystem("")
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
        system = RunningSystem("")
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
    ("uri", "name", "words"),
    [
        ("http://nowhere.invalid:1/", "wrong_node_address", "cannot be resolved"),
        ("http://127.0.0.1:1/", "dead_node", "nothing listens there"),
        (None, "dead_node", "no answer within 2 s"),
    ],
)
def test_nodes_that_do_not_answer(monkeypatch, uri, name, words):
    monkeypatch.setattr(running_system, "WAIT", 2.0)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        uri = uri or f"http://127.0.0.1:{silent.getsockname()[1]}/"
        _, found = ask_nodes(monkeypatch, {"/a": uri}, {"/tf": ["/a"]}, {}, {})
    assert found.name == name and "/a" in found.message and words in found.message


@pytest.mark.parametrize(
    ("publishers", "subscribers", "services", "matters"),
    [
        ({"/left/joint_states": ["/a"]}, {}, {}, True),
        ({"/rosout": ["/a"]}, {"/joint_states": ["/a"]}, {}, False),
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
        (
            changed("left_knee_joint", "axis", r'xyz="[^"]*"', 'xyz="1 0 0"'),
            "axes of left_knee_joint",
        ),
        (
            changed("left_knee_joint", "origin", r'xyz="\S+', 'xyz="0.05'),
            "left_knee_joint is",
        ),
    ],
    ids=["same", "axis", "origin"],
)
def test_another_robot_is_told_from_the_described_one(spawned, told):
    found = doctor.difference(parse_urdf(URDF), MODEL, *simulated(spawned))
    assert told in found and bool(found) == bool(told)


# --- topics and TF ------------------------------------------------------------------


OWN = ["/bridge", "/rsp"]


@pytest.mark.parametrize(
    ("pairs", "killed"),
    [
        ({("/rsp", "a"), ("/bridge", "a")}, ""),
        ({("/rsp", "a"), ("/other", "a")}, "/other"),
        ({("/rsp", "a"), ("/rsp", "b")}, "/rsp"),
    ],
)
def test_owners_of_edges(pairs, killed):
    edges = {"x": pairs, "y": {("/rsp", "x")}}
    found = doctor.two_tf_owners(edges, [("a", "x"), ("x", "y")], OWN)
    assert (found.fix if found else "") == (killed and f"rosnode kill {killed}")


def test_diagnostics_that_are_a_fault():
    def bad(name, level):
        status = SimpleNamespace(name=f"bridge: {name}", level=level, message="text")
        return doctor.bad_status([status])

    assert bad("link states", 0) == bad("commands", 1) == ""
    assert bad("link states", 1) == "bridge: link states: text"
    assert bad("commands", 2)


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
        failed={},
        publishers={
            "/clock": [SIM],
            "/gazebo/link_states": [SIM],
            "/tf_joint_states": [BRIDGE],
            "/joint_states": [BRIDGE],
            "/tf": [BRIDGE, RSP],
            "/tf_static": [BRIDGE],
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
            BRIDGE: {"model_name": "post"},
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
            "/joint_states": [BRIDGE, SimpleNamespace(name=["elbow", "end"])],
            "/diagnostics": [BRIDGE, SimpleNamespace(status=[status])],
        },
        tf=[
            edges_of(RSP, "/tf", ("foot", "arm"), ("arm", "/tip")),
            edges_of(BRIDGE, "/tf", ("map", "base_link")),
            edges_of(BRIDGE, "/tf_static", ("world", "map"), ("base_link", "foot")),
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
    system.parameters[BRIDGE] = {"robots": robots}
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
        edges_of(BRIDGE, "/tf", ("map", "left/base_link"), ("world", "map")),
        edges_of(BRIDGE, "/tf_static", ("left/base_link", "left/foot")),
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


def both(first, second):
    """Give what changes a system twice."""
    return lambda system: (first(system), second(system))


def models(*names):
    told = SimpleNamespace(model_names=names)
    return change("answers", "/gazebo/get_world_properties", told)


def renamed(system):
    models("robot")(system)
    message = system.heard["/gazebo/link_states"][1]
    message.name = ["robot::foot", "robot::arm", "lamp::bulb"]


WITHOUT_RVIZ = change("services", "/rviz/reload_shaders")
PAGE_NODE = dict.fromkeys(PAGE_PARAMETERS, 1)

REMARKS = {
    "nothing": (lambda system: None, "model", "post"),
    "a namespace": (of_left_alone, "description", "/left/robot_description: 2 joints"),
    "a bag": (of_bag, "bridge", "not needed, joint states come from /bag"),
    "wall time": (
        change("parameters", "/use_sim_time", False),
        "clock",
        "not needed, /use_sim_time is false",
    ),
    "a page": (
        both(WITHOUT_RVIZ, change("parameters", "/page", PAGE_NODE)),
        "picture",
        "/page",
    ),
}
"""Changes of a system without a fault, a check, and what it remarks."""

MODELS, PHYSICS = "set_model_configuration", "get_physics_properties"
ABSENT = "No module named"
AGAIN = "kill -9 7  # on its machine; then: roslaunch g1_description gazebo.launch"
SPAWN = "delete_model post && rosrun g1_description spawn_robot.py"

FAULTS = {
    "no rospy": (change("failed", "rospy", ABSENT), "no_workspace", "ROS' Python: No "),
    "no PyBullet": (
        both(
            change("failed", "pybullet", ABSENT),
            change("services", f"/gazebo/{MODELS}"),
        ),
        "no_package",
        "install pybullet",
    ),
    "no description": (
        change("parameters", "/robot_description"),
        "no_description",
        "rosparam set -t /tmp/robot.urdf robot_description",
    ),
    "a mesh": (
        change("parameters", "/robot_description", POST.format(mesh="file:///no")),
        "missing_meshes",
        "in /robot_description are missing on this machine: file:///no.",
    ),
    "no simulator": (
        both(of_gazebo, change("services", f"/gazebo/{MODELS}")),
        "no_simulator",
        "roslaunch g1_description gazebo.launch sim:=gazebo",
    ),
    "a hung one": (change("answers", f"/gazebo/{PHYSICS}"), "silent_simulator", AGAIN),
    "no clock": (
        change("publishers", "/clock"),
        "no_clock",
        "rosparam set /use_sim_time false",
    ),
    "two clocks": (
        change("publishers", "/clock", ["/bag", SIM]),
        "two_clocks",
        "rosnode kill /bag",
    ),
    "a pause": (
        change("answers", f"/gazebo/{PHYSICS}", SimpleNamespace(pause=True)),
        "paused",
        "/gazebo/unpause_physics",
    ),
    "a silent clock": (
        both(of_gazebo, change("heard", "/clock")),
        "silent_clock",
        f"{AGAIN} sim:=gazebo",
    ),
    "no bridge": (
        change("publishers", "/tf_joint_states"),
        "no_bridge",
        "roslaunch g1_description bridge.launch",
    ),
    "no model": (models(), "no_model", "spawn_robot.py _robot_description:=/robot_de"),
    "another name": (
        renamed,
        "no_model",
        "rosparam set /link_states_bridge/model_name robot && rosnode kill /link",
    ),
    "one link more": (one_link_more, "other_urdf", SPAWN),
    "two bags": (
        both(of_bag, change("publishers", "/joint_states", ["/bag", "/other"])),
        "two_joint_states",
        "rosnode kill /other",
    ),
    "no joint states": (
        change("heard", "/joint_states"),
        "no_joint_states",
        "rosnode kill /link_states_bridge",
    ),
    "no robot_state_publisher": (
        of_left,
        "no_state_publisher",
        "joint_states:=/left/tf_joint_states _ignore_timestamp:=true __ns:=left "
        "_tf_prefix:='left'",
    ),
    "TF without an arm": (
        lambda system: system.tf.pop(0),
        "no_tf",
        "foot -> arm, arm -> tip, which /robot_state_publisher should publish",
    ),
    "TF twice": (
        lambda system: system.tf.append(edges_of("/other", "/tf", ("foot", "arm"))),
        "two_tf_owners",
        "rosnode kill /other",
    ),
    "no reports": (
        change("heard", "/diagnostics"),
        "bad_diagnostics",
        "/link_states_bridge reports on /diagnostics: nothing within 5 s",
    ),
    "no picture": (
        change("services", "/rviz/reload_shaders"),
        "no_picture",
        "roslaunch g1_description rviz.launch",
    ),
}
"""Changes of a system without a fault, its only fault, and words of that."""


def examined(monkeypatch, apply):
    """Change a system, and give the results of all checks."""
    given = whole_system()
    apply(given)

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
        RunningSystem,
        "parameter",
        lambda self, name, default=None: given.parameters.get(name, default),
    )
    of_master = {"master": None, "address": None, "nodes": begin}
    checks = [(n, a, of_master.get(n, check)) for n, a, check in doctor.CHECKS]
    monkeypatch.setattr(doctor, "CHECKS", [each for each in checks if each[2]])
    monkeypatch.setattr(doctor, "failed_imports", lambda names: given.failed)
    monkeypatch.setattr(doctor, "call", call)
    monkeypatch.setattr(doctor, "listen", listen)
    monkeypatch.setattr(running_system, "listen", listen)
    monkeypatch.setattr(doctor, "TF_WAIT", 0.0)
    monkeypatch.setenv("DISPLAY", given.screen)
    return list(doctor.run_checks(given.namespace, doctor.CHECK_NAMES))


@pytest.mark.parametrize("case", [*REMARKS])
def test_systems_without_a_fault(monkeypatch, case):
    apply, check, remark = REMARKS[case]
    results = examined(monkeypatch, apply)
    assert {result.state for result in results} == {doctor.OK}
    assert remark in {result.name: result.remark for result in results}[check]


@pytest.mark.parametrize("case", [*FAULTS])
def test_systems_with_a_fault(monkeypatch, case):
    apply, name, words = FAULTS[case]
    (fault,) = [r.fault for r in examined(monkeypatch, apply) if r.fault]
    assert fault.name == name and words in f"{fault.message}\n{fault.fix}"


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
