"""A motion is shown without a simulator: its joints and its base, as the file says."""

import subprocess

import pytest
import rosbag
import rospy
import tf2_ros
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import JointState
from support.ros_testing import (
    DEADLINE,
    REPOSITORY,
    Connected,
    Launch,
    Listener,
    position_of,
    wait_for,
)
from tf2_msgs.msg import TFMessage

MOTION = REPOSITORY / "test" / "data" / "elbow.csv"
TREE = REPOSITORY / "test" / "data" / "tree.urdf"
ELBOW = "left_elbow_joint"
SPEED = 0.5
"""Of the base along y in [m/s], while the elbow turns by -1 rad/s."""


@pytest.fixture
def start():
    """Give what launches replay until the end of the test."""
    launches = []

    def launch(*arguments):
        launches.append(Launch("replay.launch", "rviz:=false", *arguments))
        return launches[-1]

    yield launch
    for one in launches:
        one.stop()


@pytest.fixture
def listen():
    """Give what listens until the end of the test."""
    listeners = []

    def begin(topic, kind, maker=Listener):
        listeners.append(maker(topic, kind))
        return listeners[-1]

    yield begin
    for one in listeners:
        one.close()


def bases(frames):
    """List stamps and places along y of the base."""
    return [
        (edge.header.stamp, edge.transform.translation.y)
        for message in list(frames.messages)
        for edge in message.transforms
        if edge.child_frame_id == "base_link"
    ]


def test_base_and_joints_are_those_of_the_motion_again_and_again(start, listen):
    start(f"motion:={MOTION}", "speed:=0.5")
    states = listen("/joint_states", JointState, Connected)
    frames = listen("/tf", TFMessage, Connected)

    def begins():
        """Tell whether the robot jumps back, and the motion is shown again."""
        places = [y for _, y in bases(frames)]
        jumps = [n for n, y in enumerate(places[1:], 1) if y < places[n - 1] - 0.1]
        return jumps and max(places[jumps[0] :]) == SPEED

    wait_for(begins, "the motion twice")
    elbows = {
        message.header.stamp: (message.position[n], message.velocity[n])
        for message in list(states.messages)
        for n in (message.name.index(ELBOW),)
    }
    compared = moving = 0
    for stamp, y in bases(frames):
        if stamp in elbows:
            position, velocity = elbows[stamp]
            assert abs(position - -y / SPEED) < 1e-9
            is_moving = 0.0 < y < SPEED
            # The motion's own is -1 rad/s, and it is shown at half its speed.
            assert abs(velocity - (-0.5 if is_moving else 0.0)) < 1e-9
            compared, moving = compared + 1, moving + is_moving
    assert compared > moving > 20


def write_bag(path):
    """Write a bag in which the robot goes along x while its elbow turns."""
    with rosbag.Bag(str(path), "w", compression="bz2") as bag:
        for second, part in (1, 0.0), (2, 1.0):
            edge = TransformStamped(child_frame_id="base_link")
            edge.header.frame_id, edge.transform.rotation.w = "map", 1.0
            edge.header.stamp = stamp = rospy.Time(second)
            edge.transform.translation.x = 2.5 * part
            states = JointState(name=[ELBOW], position=[0.75 * part])
            states.header.stamp = stamp
            bag.write("/left/joint_states", states, stamp)
            bag.write("/tf", TFMessage([edge]), stamp)


def test_a_bag_is_shown_stays_at_its_end_and_all_frames_are_there(
    start, listen, tmp_path
):
    write_bag(tmp_path / "a.bag")
    buffer = tf2_ros.Buffer()
    listener = tf2_ros.TransformListener(buffer)
    shown = listen("/joint_states", JointState)
    options = "topic:=left/joint_states", "loop:=false", "speed:=5.0"
    start(f"bag:={tmp_path / 'a.bag'}", *options)

    def place(parent, child):
        try:
            found = buffer.lookup_transform(parent, child, rospy.Time())
        except tf2_ros.TransformException:
            return None
        return found.transform.translation

    wait_for(lambda: place("map", "pelvis") and place("map", "pelvis").x == 2.5, "x")
    shown.wait(lambda m: position_of(m, ELBOW) == 0.75, "the elbow")
    shown.clear()
    later = shown.wait(lambda m: m.header.stamp > shown.messages[0].header.stamp)
    assert {position_of(m, ELBOW) for m in (shown.messages[0], later)} == {0.75}
    assert place("map", "pelvis").x == 2.5
    wait_for(lambda: place("world", "left_wrist_yaw_link"), "the hand")
    assert place("world", "left_wrist_yaw_link").x > 2.5
    listener.unregister()


def test_a_motion_of_another_robot_ends_the_launch_with_a_sentence():
    command = ["roslaunch", "--wait", "g1_description", "replay.launch", "rviz:=false"]
    run = subprocess.run(
        [*command, f"motion:={MOTION}", f"model:={TREE}"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=DEADLINE,
    )
    assert "none of the motion's joints" in run.stdout
    assert "Traceback" not in run.stdout
