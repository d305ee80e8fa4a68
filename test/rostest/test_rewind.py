"""A fault of 0.2 s, which nobody has recorded, is found by rewinding on the page."""

import re

import numpy as np
import pytest
import rospy
from g1_description.msg import RobotState
from g1_description.srv import PlayMotion
from std_srvs.srv import Empty
from support.ros_testing import Connected, service, wait_for

import g1_description
from g1_description.motion.files.formats import read_motion
from g1_description.motion.motion import Motion
from g1_description.robot.rotation import conjugate, multiply
from g1_description.ros.conversions import robot_state_from_message
from g1_description.ros.motion_messages import whole_body_message

from page_client import PageClient

JOINTS = (
    "right_shoulder_roll_joint",
    "right_shoulder_yaw_joint",
    "left_elbow_joint",
)
IN_TORSO = (0.4, 0.8)
"""Where the first two of them are in the fault, in [rad]."""
FAULT = (0.6, 0.8)
"""When it is, from the start of its motion, in [s]."""
SECONDS = 1.5
"""Length of a motion, in [s]."""
PAST = r"Past:\*\* ([\d.]+) s"


def motion(is_faulty):
    """Make a motion that swings an elbow, with the fault or without."""
    times = np.array([0.0, FAULT[0] - 0.05, *FAULT, FAULT[1] + 0.05, SECONDS])
    positions = np.zeros((len(times), 3))
    positions[:, 2] = 0.6 * np.sin(2.0 * np.pi * times / SECONDS)
    if is_faulty:
        positions[2:4, :2] = IN_TORSO
    return Motion(times, JOINTS, positions)


def commanded(made, start, at):
    """Return where the joints of a motion are to be, linearly between samples."""
    return [np.interp(at - start, made.times, column) for column in made.positions.T]


@pytest.fixture(scope="module")
def states():
    listener = Connected("/robot_state", RobotState)
    yield listener
    listener.close()


@pytest.fixture
def client(address):
    with PageClient(address) as one:
        one.wait_until_whole()
        yield one
        one.press("Live")
        one.wait_for(lambda: not told(one, "Past:"), "live")


def told(client, pattern):
    """Find a pattern in the texts of the page."""
    elements = [*client.elements.values()]
    texts = (str(e.get("_markdown", "")).replace("\\", "") for e in elements)
    return next(filter(None, (re.search(pattern, text) for text in texts)), None)


def shown_time(client):
    """Return the time of the past that is shown, in [s]; None: live."""
    found = told(client, PAST)
    return found and float(found.group(1))


def drag(client, back):
    """Drag the time line; return the time that is shown then, in [s]."""
    before = shown_time(client)
    client.set("Back", back)
    client.wait_for(lambda: shown_time(client) not in (None, before), "another time")
    return shown_time(client)


def shared(client):
    """Press Share; return the page, which comes in parts."""
    client.press("Share")
    part = "FileTransferPart"
    client.wait_for(
        lambda: b"</html>" in bytes(client.others.get(part, {}).get("content", b"")),
        "the file",
    )
    return bytes(client.others[part]["content"]).decode()


def bend_of(client, model, joint):
    """Return the position of a joint in the scene, in [rad]."""
    child = joint.replace("_joint", "_link")
    w, x, y, z = next(
        node["wxyz"]
        for name, node in [*client.nodes.items()]
        if name.endswith(f"/{child}") and "/robots/" in name
    )
    (found,) = (j for j in model.description.movable_joints if j.name == joint)
    turn = multiply(conjugate(found.pose[3:]), np.array([x, y, z, w]))
    return 2.0 * np.arctan2(turn[:3] @ found.axis, turn[3])


def play_all(states):
    """Play motions, one of them with the fault; return that and its start in [s]."""
    play = service("/play_motion", PlayMotion)
    for is_faulty in (False, True, False, False, False):
        made = motion(is_faulty)
        answer = play(whole_body_message(made))
        assert answer.success, answer.status_message
        if is_faulty:
            faulty, start = made, answer.start.to_sec()
        end = answer.start + rospy.Duration(SECONDS)
        states.wait(lambda m, end=end: m.header.stamp >= end, "the end of a motion")
    return faulty, start


def test_a_fault_is_found_saved_checked_and_gone_back_to(client, states, home):
    model = g1_description.Robot()
    states.wait(lambda m: m.header.stamp.to_sec() > 5.0, "a past of 10 s")
    faulty, start = play_all(states)
    after = robot_state_from_message(states.messages[-1])

    # Found: dragged back until an arm is seen where it should not be.
    client.set("Last seconds", "10")
    for back in np.arange(0.1, 8.0, 0.1):
        at = drag(client, round(-float(back), 2))
        if bend_of(client, model, JOINTS[1]) > 0.9 * IN_TORSO[1]:
            break
    else:
        raise AssertionError("the fault is not to be seen")
    assert start + FAULT[0] - 0.05 < at < start + FAULT[1] + 0.05
    client.wait_for(
        lambda: told(client, r"at this time:\*\*[\s\S]*- .*right"), "what is wrong"
    )
    seen = [bend_of(client, model, joint) for joint in JOINTS]
    # The scene leaves out what moves by less than 1e-6.
    np.testing.assert_allclose(seen, commanded(faulty, start, at), rtol=0, atol=2e-6)
    sent = rf"{rospy.get_name()}, play_motion: .*{SECONDS:.2f} s"
    client.wait_for(lambda: told(client, sent), "who commanded it")
    # Nothing was commanded meanwhile.
    now = robot_state_from_message(states.messages[-1])
    np.testing.assert_array_equal(now.positions, after.positions)

    # A shorter time line is about the shown time; it is saved, once only.
    client.set("Last seconds", "5")
    client.wait_for(lambda: client.value("Back") == -2.5, "the middle")
    assert shown_time(client) == at
    file = home / "g1_description" / "motions" / "fault.csv"
    client.set("File name", "fault")
    client.press("Save this range")
    wait_for(file.exists, "the file")
    saved = read_motion(file, model.description)
    assert saved.duration == pytest.approx(5.0, abs=0.03)
    assert "self_collision" in {f.check for f in model.check(saved).findings}
    content = file.read_bytes()
    client.press("Save this range")
    client.wait_for(
        lambda: any("already exists" in str(e) for e in [*client.elements.values()]),
        "a refusal",
    )
    assert file.read_bytes() == content

    assert re.search('class="result failed"[^$]*self collision', shared(client))

    # Checked: its button leads there again.
    client.press("Live")
    client.wait_for(lambda: not told(client, PAST), "live")
    client.set("Last seconds", "30")
    client.press("Check this range")
    label = r"([\d.]+) s  self collision"
    button = client.wait_for(
        lambda: next(
            (
                e["label"]
                for e in [*client.elements.values()]
                if re.match(label, e.get("label") or "")
            ),
            None,
        ),
        "a finding",
    )
    client.press(button)
    worst = float(re.match(label, button).group(1))
    client.wait_for(
        lambda: shown_time(client) and abs(shown_time(client) - worst) < 0.011,
        "its time",
    )
    at = shown_time(client)
    assert start + FAULT[0] - 0.05 < at < start + FAULT[1] + 0.05

    # Gone back to.
    states.clear()
    client.press("Start here")
    client.wait_for(lambda: not told(client, PAST), "live")

    def is_there(message):
        state = robot_state_from_message(message).positions_by_name
        goal = commanded(faulty, start, at)
        return np.allclose([state[n] for n in JOINTS], goal, rtol=0, atol=1e-9)

    states.wait(is_there, "the robot where it was")


def test_nothing_falls_in_kinematic_physics(client, states):
    states.wait(lambda m: m.header.stamp.to_sec() > 1.0, "a past")
    client.set("Last seconds", "5")  # what others played has commands beyond limits
    client.press("Why?")
    client.wait_for(lambda: told(client, "Nothing failed: "), "no first cause")


def test_the_past_is_plotted_and_gone_to_by_its_peak(client, states):
    _, start = play_all(states)
    client.set("Last seconds", "30")
    client.set("Quantity", "position")
    client.set("Of", JOINTS[1][: -len("_joint")])
    client.press("Add")

    def line():
        found = [e for e in [*client.elements.values()] if "series" in e]
        return found[0]["data"] if found else None

    def peak():
        if line() is None or len(line()[0]) < 10:
            return None
        times, measured, commanded = line()[:3]
        measured = np.where(times > start, measured, np.nan)
        both = np.nanmax(measured), np.nanmax(commanded)
        is_there = np.allclose(both, IN_TORSO[1])
        return is_there and float(times[np.nanargmax(measured)])

    at = client.wait_for(peak, "the peak of the fault")
    client.set("Time in the plots", at)
    client.wait_for(lambda: shown_time(client), "the past")
    assert start + FAULT[0] - 0.02 <= shown_time(client) <= start + FAULT[1] + 0.02
    bend = bend_of(client, g1_description.Robot(), JOINTS[1])
    assert abs(bend - IN_TORSO[1]) < 1e-5
    client.wait_for(lambda: np.isfinite(line()[-1]).sum() == 2, "the mark")
    client.press("Clear")


def test_earlier_runs_are_there_while_time_stands(client, states):
    before = robot_state_from_message(states.wait())
    service("/gazebo/reset_simulation", Empty)()
    states.clear()
    states.wait(lambda m: m.header.stamp.to_nsec() < before.stamp, "another run")
    service("/gazebo/pause_physics", Empty)()
    drag(client, -0.01)
    client.wait_for(lambda: len(client.element("Run")["options"]) > 1, "two runs")
    newest = client.value("Run")
    client.set("Run", str(int(newest) - 1))
    found = client.wait_for(
        lambda: told(client, r"Past:\*\* run \d+, ([\d.]+) s"), "it"
    )
    assert float(found.group(1)) >= before.time - 1e-3
    service("/gazebo/unpause_physics", Empty)()
