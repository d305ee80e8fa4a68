"""What the doctor suggests mends a running system.

All faults are in test/cli/test_doctor.py, those of /diagnostics in
test_bridge_health.py.
"""

import json
import os
import signal
import subprocess
from contextlib import contextmanager

import pytest
import rosgraph
import rosnode
import rospy
from gazebo_msgs.srv import (
    GetModelState,
)
from geometry_msgs.msg import Pose
from std_srvs.srv import Empty
from support.patient import (
    Patient,
    Started,
    publishers,
    walk,
)
from support.ros_testing import (
    DEADLINE,
    program,
    wait_slowly,
)
from support.wire.services import Services

from g1_description.cli.doctor import check_nodes, check_simulator
from g1_description.cli.running_system import RunningSystem

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
def kept(name):
    """Put a parameter back to what it is now."""
    before = rospy.get_param(name)
    yield
    rospy.set_param(name, before)


def fault(name, *words):
    """Walk, and check that the fault is found, and what it names."""
    found = walk()
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


def test_a_whole_chain_has_no_fault(patient):
    run = subprocess.run(
        [program("doctor"), "--json", "--until", "diagnostics"],
        capture_output=True,
        text=True,
        timeout=DEADLINE,
    )
    found = json.loads(run.stdout)
    assert (run.returncode, run.stderr) == (0, "")
    assert (found["ok"], found["fault"]) == (True, None)
    assert {check["state"] for check in found["checks"]} == {"ok"}


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


def start_silent(topic, kind):
    """Start a node that publishes nothing, but could."""
    name = f"/{topic[1:]}_of_rostopic"
    words = "/usr/bin/env", "rostopic", "pub", "-r", "0.1", topic, kind, "{}"
    return Started(name, topic, *words)


def test_dead_nodes_are_cleaned_up(patient):
    start_silent("/other", "std_msgs/Empty").end(signal.SIGKILL)
    assert walk("nodes") is None
    start_silent("/tf", "tf2_msgs/TFMessage").end(signal.SIGKILL)
    fix(fault("dead_node", "/tf_of_rostopic"))
    assert walk("nodes") is None and publishers("/other") == []


def test_an_absent_description_is_set(patient):
    with kept(DESCRIPTION):
        rospy.delete_param(DESCRIPTION)
        fix(fault("no_description"))
        assert walk() is None


def test_another_robot_is_replaced_by_one_on_its_feet(patient):
    state = rospy.ServiceProxy("/gazebo/get_model_state", GetModelState)
    before = state("g1_robot", "").pose.position.z
    services = Services()
    services.call("delete_model", "g1_robot")
    other = turned_axis(rospy.get_param(DESCRIPTION), "left_knee_joint")
    place = Pose()
    place.position.z, place.orientation.w = 2.0, 1.0
    services.call("spawn_urdf_model", "g1_robot", other, "", place, "world")
    bent = ["left_knee_joint"], [0.5]
    services.call("set_model_configuration", "g1_robot", "", *bent)
    services.close()
    fix(fault("other_urdf", "left_knee_joint", DESCRIPTION))
    assert walk() is None
    assert abs(state("g1_robot", "").pose.position.z - before) < 1e-6


def turned_axis(text, joint):
    """Turn a joint's axis in a URDF."""
    start = text.index(f'<joint name="{joint}"')
    begin = text.index('xyz="', text.index("<axis", start)) + 5
    return text[:begin] + "1 0 0" + text[text.index('"', begin) :]


def test_time_is_paused(patient):
    rospy.ServiceProxy("/gazebo/pause_physics", Empty)()
    fix(fault("paused"))
    assert walk("time") is None


def test_tf_of_another_prefix_is_replaced(patient):
    patient.stop("state_publisher")
    patient.start("state_publisher", "_tf_prefix:=other")
    cure_until(fault("no_tf", "pelvis -> ", "/robot_state_publisher"), "tf")
    patient.wait_for_end("state_publisher")


def test_a_bridge_is_started(patient):
    patient.stop("bridge")
    patient.stop("state_publisher")  # the launch file brings it, too
    cure_until(fault("no_bridge", "/tf_joint_states", "bridge.launch"), "diagnostics")


def test_a_simulator_that_hangs_is_ended_and_started_again(patient):
    system = RunningSystem("")
    check_nodes(system)
    os.kill(system.pids["/gazebo"], signal.SIGSTOP)  # after it has answered
    found = check_simulator(system)
    assert found.name == "silent_simulator"
    kill, _, launch = found.fix.partition("  # on its machine; then: ")
    subprocess.run(kill, shell=True, check=True)
    patient.wait_for_end("simulator")
    rosnode.cleanup_master_blacklist(rosgraph.Master("/test"), ["/gazebo"])
    found = fault("no_simulator", launch)
    with kept("/gazebo"), kept(DESCRIPTION):  # which the launch file replaces
        cure_until(found, "diagnostics")
