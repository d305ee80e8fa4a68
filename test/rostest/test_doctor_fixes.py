"""Each fault is made, the doctor names it alone, its fix works, /diagnostics agrees.

What it finds without a robot is tested in test/cli/test_doctor.py.
"""

import json
import os
import signal
import subprocess
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from unittest import mock

import pytest
import rosgraph
import rosnode
import rospy
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from gazebo_msgs.srv import (
    GetModelState,
    GetPhysicsProperties,
    GetPhysicsPropertiesResponse,
)
from geometry_msgs.msg import Pose, TransformStamped
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import Empty
from support.patient import (
    Patient,
    Started,
    publishers,
    walk,
)
from support.ros_testing import (
    DEADLINE,
    Repeated,
    process_of,
    program,
    wait_slowly,
)
from support.wire.services import Services
from tf2_msgs.msg import TFMessage

from g1_description.cli.doctor import System, call, check_nodes, check_simulator

DESCRIPTION = "/robot_description"


@pytest.fixture(scope="module")
def whole():
    chain = Patient()
    yield chain
    chain.close()


@pytest.fixture
def patient(whole):
    """Give the chain of nodes, whole."""
    whole.heal()
    return whole


@contextmanager
def publishing(topic, kind):
    made = rospy.Publisher(topic, kind, queue_size=1)
    yield made
    made.unregister()


@contextmanager
def kept(name):
    """Put a parameter back to what it is now."""
    before = rospy.get_param(name)
    yield
    rospy.set_param(name, before)


@contextmanager
def parameter(name, value):
    """Set a parameter for a while; None deletes it."""
    with kept(name):
        if value is None:
            rospy.delete_param(name)
        else:
            rospy.set_param(name, value)
        yield


def fault(name, *words, **options):
    """Walk, and check that the fault is found, and what it names."""
    found = walk(**options)
    assert found is not None and found.name == name, found
    for word in words:
        assert word in found.message + found.fix
    return found


def fix(found):
    """Do what the doctor says."""
    subprocess.run(
        found.fix, shell=True, check=True, timeout=DEADLINE, executable="/bin/bash"
    )


def cure_until(found, until):
    """Do what the doctor says, where it goes on until it is ended."""
    process = subprocess.Popen(
        found.fix, shell=True, start_new_session=True, executable="/bin/bash"
    )
    try:
        wait_slowly(lambda: walk(until) is None, "the fix to mend it")
    finally:
        os.killpg(process.pid, signal.SIGINT)
        process.wait(DEADLINE)


def wait_for_report(patient, is_bad, *words):
    """Wait until the bridge reports a fault, or none, on /diagnostics."""

    def says_so(message):
        parts = [s for s in message.status if s.name.startswith("link_states_b")]
        texts = " ".join(status.message for status in parts)
        is_worse = any(status.level > DiagnosticStatus.OK for status in parts)
        return parts and is_worse == is_bad and all(word in texts for word in words)

    patient.diagnostics.clear()
    patient.diagnostics.wait(says_so, f"{is_bad} {words}")


# --- whole --------------------------------------------------------------------------


def test_a_whole_chain_is_whole_and_the_bridge_says_the_same(patient, tmp_path):
    """The command has the Python of ROS whatever is on PATH, which it mentions."""
    wait_for_report(patient, False, "link states arrive", "29 joints are published")
    other = tmp_path / "python3"
    other.write_text("#!/bin/sh\nexit 1\n")
    other.chmod(0o755)
    run = subprocess.run(
        [program("doctor"), "--json", "--until", "diagnostics"],
        env={**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        timeout=DEADLINE,
    )
    told = json.loads(run.stdout)
    assert (run.returncode, run.stderr) == (0, "")
    assert (told["ok"], told["fault"]) == (True, None)
    assert {link["state"] for link in told["checks"]} == {"ok"}
    assert f"python3 on PATH ({other}" in told["checks"][0]["remark"]


def test_with_a_screen_something_has_to_show_the_robot(patient):
    with mock.patch.dict(os.environ, DISPLAY=":987"):
        fault("no_picture", "rviz.launch", until="picture")
    with mock.patch.dict(os.environ, DISPLAY=""):
        assert walk(until="picture") is None


def test_ctrl_c_ends_it_quietly(patient):
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
    assert process.returncode == 130 and "Traceback" not in errors


# --- nodes --------------------------------------------------------------------------


def start_silent(topic, kind):
    """Start a node that publishes nothing, but could."""
    name = f"/{topic[1:]}_of_rostopic"
    words = "/usr/bin/env", "rostopic", "pub", "-r", "0.1", topic, kind, "{}"
    return Started(name, topic, *words)


def test_a_stopped_node_and_a_dead_one_are_told_if_they_had_a_part(patient):
    start_silent("/other", "std_msgs/Empty").end(signal.SIGKILL)
    node = start_silent("/tf", "tf2_msgs/TFMessage")
    node.process.send_signal(signal.SIGSTOP)
    fix(fault("hung_node", node.name))
    assert walk("nodes") is None
    node.end(signal.SIGKILL)
    fix(fault("dead_node", node.name))
    assert walk("nodes") is None and publishers("/other") == []


# --- the robot ----------------------------------------------------------------------


def test_a_description_that_is_absent_broken_or_lacks_meshes(patient):
    text = rospy.get_param(DESCRIPTION)
    with parameter(DESCRIPTION, "<robot"):
        fault("bad_description", DESCRIPTION)
    with parameter(DESCRIPTION, text.replace("head_link.stl", "skull.stl")):
        fault("missing_meshes", "skull")
    with parameter(DESCRIPTION, None):
        fix(fault("no_description", "robot_description"))
        assert walk() is None


def test_a_robot_that_is_absent_or_another_is_spawned_on_its_feet(patient):
    state = rospy.ServiceProxy("/gazebo/get_model_state", GetModelState)
    before = state("g1_robot", "").pose.position.z
    services = Services()
    services.call("delete_model", "g1_robot")
    fault("no_model", "g1_robot", "spawn_robot.py")
    wait_for_report(patient, True, "no link of g1_robot")
    other = turned_axis(rospy.get_param(DESCRIPTION), "left_knee_joint")
    place = Pose()
    place.position.z, place.orientation.w = 2.0, 1.0
    services.call("spawn_urdf_model", "g1_robot", other, "", place, "world")
    bent = ["left_knee_joint"], [0.5]
    services.call("set_model_configuration", "g1_robot", "", *bent)
    services.close()
    wait_for_report(patient, True, "off their axes for 2 s: left_knee_joint")
    fix(fault("other_urdf", "left_knee_joint", DESCRIPTION))
    assert walk() is None
    wait_for_report(patient, False)
    assert abs(state("g1_robot", "").pose.position.z - before) < 1e-6


def turned_axis(text, joint):
    """Turn a joint's axis in a URDF."""
    start = text.index(f'<joint name="{joint}"')
    begin = text.index('xyz="', text.index("<axis", start)) + 5
    return text[:begin] + "1 0 0" + text[text.index('"', begin) :]


# --- other publishers ---------------------------------------------------------------


def test_two_clocks(patient):
    with publishing("/clock", Clock):
        fault("two_clocks", rospy.get_name())


def test_another_publisher_of_joint_states(patient):
    with publishing("/joint_states", JointState):
        fault("two_joint_states", rospy.get_name())
        wait_for_report(patient, True, f"also published by {rospy.get_name()}")


def test_an_edge_has_two_owners(patient):
    edge = TransformStamped(child_frame_id="left_knee_link")
    edge.header.frame_id = "left_hip_yaw_link"
    edge.transform.rotation.w = 1.0
    with publishing("/tf", TFMessage) as made:
        repeated = Repeated(lambda: made.publish(TFMessage([edge])), 0.05)
        fault("two_tf_owners", "left_knee_link", rospy.get_name(), "/robot_state_pub")
        repeated.close()


def test_two_bridges(patient):
    with publishing("/tf_joint_states", JointState):
        names = f"/link_states_bridge, {rospy.get_name()}"
        fault("two_bridges", names, f"rosnode kill {rospy.get_name()}")


# --- parts that are missing ---------------------------------------------------------


def test_a_service_that_a_simulator_still_has_to_offer_is_waited_for(patient):
    name, answer = "/starting/get_physics_properties", GetPhysicsPropertiesResponse()
    with ThreadPoolExecutor() as pool:
        asked = pool.submit(call, name, GetPhysicsProperties)
        wait([asked], 1.0)
        late = rospy.Service(name, GetPhysicsProperties, lambda request: answer)
        assert asked.result(DEADLINE) == answer
        late.shutdown()


def test_time_is_paused(patient):
    rospy.ServiceProxy("/gazebo/pause_physics", Empty)()
    found = fault("paused")
    wait_for_report(patient, False, "paused")
    fix(found)
    assert walk("time") is None


def test_tf_has_no_publisher_or_lacks_edges(patient):
    patient.stop("state_publisher")
    fault("no_state_publisher", "/tf_joint_states")
    none = KeyValue("listeners to tf_joint_states", "0")
    patient.diagnostics.clear()
    patient.diagnostics.wait(
        lambda m: any(none in status.values for status in m.status), str(none)
    )
    patient.start("state_publisher", "_tf_prefix:=other")
    cure_until(fault("no_tf", "pelvis -> ", "/robot_state_publisher"), "tf")
    patient.wait_for_end("state_publisher")


def test_no_bridge(patient):
    fault("no_bridge", "/left/tf_joint_states", namespace="left")
    patient.stop("bridge")
    patient.stop("state_publisher")  # the launch file brings it, too
    cure_until(fault("no_bridge", "/tf_joint_states", "bridge.launch"), "diagnostics")


def test_no_clock_no_link_states_a_simulator_that_hangs_and_none(patient):
    patient.stop("simulator")
    away = "/clock:=/no_clock", "/gazebo/link_states:=/no_states"
    patient.start("simulator", *away)
    fault("no_clock")
    with parameter("/use_sim_time", False):
        fault("no_link_states", "/gazebo/link_states")
    # It is stopped after it was asked as a node.
    system = System("")
    check_nodes(system)
    pid = process_of("/gazebo")
    os.kill(pid, signal.SIGSTOP)
    found = check_simulator(system)
    assert found.name == "hung_simulator" and str(pid) in found.fix
    fix(found)
    patient.wait_for_end("simulator")
    rosnode.cleanup_master_blacklist(rosgraph.Master("/test"), ["/gazebo"])
    found = fault("no_simulator", "/gazebo/set_model_configuration", "gazebo.launch")
    wait_for_report(patient, True)
    with kept("/gazebo"), kept(DESCRIPTION):  # which the launch file replaces
        cure_until(found, "diagnostics")
