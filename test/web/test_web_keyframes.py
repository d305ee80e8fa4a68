"""Keyframes and keys, as a browser sends and sees them."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from waiting import wait_for

pytest.importorskip("viser", reason="viser is not installed")

from g1_description import Robot
from g1_description.errors import MotionError
from g1_description.robot.poses import read_poses
from g1_description.sim.standing import standing_base
from g1_description.web.file_world import FileWorld, StillRobot
from g1_description.web.server.address import ServerOptions
from g1_description.web.show import Show

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools"))
from web_clients import running

from page_client import PageClient


@pytest.fixture(scope="module")
def g1():
    return Robot()


@pytest.fixture(scope="module")
def stand(g1):
    return dict(zip(g1.joint_names, g1.pose("stand").tolist()))


@pytest.fixture(scope="module")
def shown(g1):
    robot = StillRobot("g1", g1.description)
    checker = g1.checker()
    show = Show(FileWorld([robot], None), ServerOptions(port=0), lambda _: checker)
    with running(show):
        yield robot, show


@pytest.fixture
def browser(g1, shown, stand, tmp_path, monkeypatch):
    """A browser with a page on which two keyframes are taken, a second apart."""
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    robot, show = shown
    with PageClient(show.address) as one:
        one.wait_until_whole()
        while one.value("Selected") != "none":
            begin = one.value("Selected")
            one.set("Keyframe", "Delete")
            one.wait_for(lambda old=begin: one.value("Selected") != old, "one less")
        show.page.motion.motions.clear()
        robot.command_all(stand, standing_base(g1.description, stand))
        one.set("Keyframe", "Add")
        one.wait_for(lambda: one.value("Selected") == "1 at 0.00 s", "one")
        robot.command({"left_elbow_joint": -0.8})
        one.set("Seconds before", 1.0)
        one.set("Keyframe", "Add")
        one.wait_for(lambda: one.value("Selected") == "2 at 1.00 s", "another")
        yield one


def told(browser):
    """Return all texts of the page without their marks."""
    texts = (str(e.get("_markdown", "")) for e in [*browser.elements.values()])
    return "\n".join(texts).replace("\\", "").replace("*", "")


def opened(shown, count, duration):
    """Wait for the motion through keyframes."""
    robot, show = shown
    panel = show.page.motion

    def is_open():
        motion = panel.motions.get(robot)
        return (
            motion is not None
            and motion.times[-1] == pytest.approx(duration)
            and len(show.page._shown[0].keyframes.frames) == count
        )

    wait_for(is_open, f"a motion of {duration} s")
    return panel.motions[robot]


def test_two_keyframes_are_a_motion_that_is_checked(g1, shown, browser, stand):
    motion = opened(shown, 2, 1.0)
    column = motion.joint_names.index("left_elbow_joint")
    elbow = motion.positions[:, column]
    assert elbow[0] == pytest.approx(stand["left_elbow_joint"])
    assert elbow[-1] == pytest.approx(-0.8)
    half = 0.5 * (elbow[0] + elbow[-1])
    assert elbow[25] == pytest.approx(half)
    browser.wait_for(lambda: "\npassed" in told(browser), "its verdict")


def test_the_robot_stays_where_it_is_posed(shown, browser):
    """The motion begins at another keyframe, and is opened while one goes on."""
    opened(shown, 2, 1.0)
    robot, show = shown
    assert robot.state().positions_by_name["left_elbow_joint"] == pytest.approx(-0.8)
    assert show.page.motion.player.time == pytest.approx(1.0)


def test_a_selected_keyframe_is_shown_replaced_and_deleted(shown, browser, stand):
    opened(shown, 2, 1.0)
    robot, _ = shown

    def elbow():
        return robot.state().positions_by_name["left_elbow_joint"]

    browser.set("Selected", "1 at 0.00 s")
    wait_for(lambda: elbow() == pytest.approx(stand["left_elbow_joint"]), "the first")
    robot.command({"left_elbow_joint": 0.5})
    browser.set("Keyframe", "Replace")

    def begins_there():
        motion = opened(shown, 2, 1.0)
        column = motion.joint_names.index("left_elbow_joint")
        return motion.positions[0, column] == pytest.approx(0.5)

    wait_for(begins_there, "another first keyframe")
    browser.set("Keyframe", "Delete")
    left = ["1 at 0.00 s"]
    browser.wait_for(lambda: [*browser.element("Selected")["options"]] == left, "one")


def test_times_move_on_the_bar_and_as_numbers(shown, browser):
    opened(shown, 2, 1.0)
    browser.set("Times", (0.0, 1.5))
    opened(shown, 2, 1.5)
    browser.wait_for(lambda: browser.value("Selected") == "2 at 1.50 s", "the time")
    browser.set("Seconds before", 2.0)
    opened(shown, 2, 2.0)
    browser.wait_for(lambda: list(browser.value("Times")) == [0.0, 2.0], "the bar")
    browser.set("Keyframe", "Add")  # after the selected one
    opened(shown, 3, 4.0)
    browser.set("Times", (0.0, 0.004, 0.0))  # no browser sends such
    browser.wait_for(lambda: list(browser.value("Times")) == [0, 2.0, 4.0], "the bar")


def test_a_time_that_is_too_short_is_lengthened_and_told(shown, browser):
    opened(shown, 2, 1.0)
    browser.set("Seconds before", 0.02)

    sentence = "Keyframe 2 is later than set"
    browser.wait_for(lambda: sentence in told(browser), "a sentence")
    selected = browser.value("Selected")
    assert "2 at 0.02 s" < selected < "2 at 0.30 s"


def test_motions_and_poses_are_saved(g1, shown, browser, tmp_path):
    motion = opened(shown, 2, 1.0)
    browser.set("Save as", "lift")
    browser.set("Save", "Motion")
    file = tmp_path / "g1_description" / "motions" / "lift.csv"
    wait_for(file.exists, "the file")

    def is_whole():
        try:
            return len(g1.read_motion(file).times) == len(motion.times)
        except MotionError:
            return False

    wait_for(is_whole, "a whole file")
    saved = g1.read_motion(file)
    np.testing.assert_allclose(saved.positions, motion.positions, atol=1e-6)
    np.testing.assert_allclose(saved.base_poses, motion.base_poses, atol=1e-6)
    content = file.read_bytes()
    browser.set("Save", "Motion")  # once more
    refused = "lift.csv already exists"
    browser.wait_for(lambda: refused in str(browser.elements), "a refusal")
    browser.set("Save", "Poses")
    wait_for(lambda: "lift_2" in read_poses(g1.description), "the poses")
    browser.wait_for(
        lambda: "lift_2" in browser.element("Go to pose")["options"], "a button"
    )
    assert file.read_bytes() == content
    pose = read_poses(g1.description)["lift_2"]
    assert pose.positions["left_elbow_joint"] == pytest.approx(-0.8)


def test_a_deleted_motion_is_not_saved(shown, browser, tmp_path):
    opened(shown, 2, 1.0)
    browser.set("Keyframe", "Delete")
    browser.wait_for(lambda: browser.value("Selected") == "1 at 0.00 s", "one left")
    browser.set("Save as", "gone")
    browser.set("Save", "Motion")
    sentence = "There is no motion"
    browser.wait_for(lambda: sentence in str(browser.elements), "a sentence")
    assert not (tmp_path / "g1_description" / "motions").exists()


def test_a_page_of_the_motion_is_shared(shown, browser):
    opened(shown, 2, 1.0)
    robot, show = shown
    wait_for(lambda: robot in show.page.motion.verdicts, "its verdict")
    browser.press("Share")

    def is_there():
        parts = browser.others.get("FileTransferPart")
        return parts is not None and b"</html>" in bytes(parts["content"])

    browser.wait_for(is_there, "the file")
    start = browser.others["FileTransferStartDownload"]
    assert start["filename"] == "robot.html"
    text = bytes(browser.others["FileTransferPart"]["content"]).decode()
    assert "left_elbow" in text
    assert 'class="result passed"' in text


def test_keys_play_step_and_take(shown, browser):
    opened(shown, 2, 1.0)
    _, show = shown
    player = show.page.motion.player

    def press(effect):
        uuid = browser.element(effect)["uuid"]
        browser.send("CommandTriggerMessage", uuid=uuid)

    press("One sample back")
    wait_for(lambda: player.time == pytest.approx(0.98), "the sample before")
    press("One sample on")
    wait_for(lambda: player.time == pytest.approx(1.0), "the sample after")
    press("Add a keyframe")
    opened(shown, 3, 2.0)
    press("Show gizmos, or hide them")
    name = "/map/reach/g1/left_hand"
    browser.wait_for(lambda: browser.nodes[name].get("visible"), "the gizmos")
    press("Show gizmos, or hide them")
    browser.wait_for(lambda: not browser.nodes[name].get("visible"), "no gizmos")
    show.page.motion.player.play(0.0, 0.01)
    press("Play, or pause")
    wait_for(lambda: not show.page.motion.player.is_running, "the pause")
    press("Play, or pause")
    wait_for(lambda: show.page.motion.player.is_running, "the motion")
    show.page.motion.player.pause()
