"""Keyframes and keys, as a browser sends and sees them."""

from __future__ import annotations

import numpy as np
import pytest
from waiting import wait_for

pytest.importorskip("viser", reason="viser is not installed")

from shown_pages import delete_keyframes, standing_g1

from g1_description.errors import MotionError
from g1_description.robot.poses import read_poses

from page_client import PageClient

pytestmark = pytest.mark.slow


@pytest.fixture
def page():
    return standing_g1()


@pytest.fixture
def browser(page, tmp_path, monkeypatch):
    """A browser with a page on which two keyframes are taken, a second apart."""
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    with PageClient(page.show.address) as one:
        one.wait_until_whole()
        delete_keyframes(one)
        page.show.motion.motions.clear()
        page.stand()
        one.set("Keyframe", "Add")
        one.wait_for(lambda: one.value("Selected") == "1 at 0.00 s", "one")
        page.robot.command({"left_elbow_joint": -0.8})
        one.set("Seconds before", 1.0)
        one.set("Keyframe", "Add")
        one.wait_for(lambda: one.value("Selected") == "2 at 1.00 s", "another")
        yield one


def opened(page, browser, count, duration):
    """Wait for the motion through keyframes."""

    def is_open():
        motion = page.show.motion.motions.get(page.robot)
        return (
            motion is not None
            and motion.times[-1] == pytest.approx(duration)
            and len(browser.element("Selected")["options"]) == count
            and motion
        )

    return wait_for(is_open, f"a motion of {duration} s")


def elbow(page):
    return page.robot.state().positions_by_name["left_elbow_joint"]


def test_two_keyframes_are_a_motion_that_is_checked(page, browser):
    motion = opened(page, browser, 2, 1.0)
    column = motion.joint_names.index("left_elbow_joint")
    bent = motion.positions[:, column]
    assert bent[0] == pytest.approx(page.model.named_configuration("stand")[column])
    assert bent[-1] == pytest.approx(-0.8)
    assert bent[25] == pytest.approx(0.5 * (bent[0] + bent[-1]))
    browser.wait_for(lambda: browser.says("passed"), "its verdict")


def test_the_robot_stays_where_it_is_posed(page, browser):
    """The motion begins at another keyframe, and is opened while one goes on."""
    opened(page, browser, 2, 1.0)
    assert elbow(page) == pytest.approx(-0.8)
    assert page.show.motion.player.time == pytest.approx(1.0)


def test_a_selected_keyframe_is_shown_replaced_and_deleted(page, browser):
    opened(page, browser, 2, 1.0)
    row = page.robot.state().names.index("left_elbow_joint")
    first = page.model.named_configuration("stand")[row]
    browser.set("Selected", "1 at 0.00 s")
    wait_for(lambda: elbow(page) == pytest.approx(first), "the first")
    page.robot.command({"left_elbow_joint": 0.5})
    browser.set("Keyframe", "Replace")

    def begins_there():
        motion = opened(page, browser, 2, 1.0)
        column = motion.joint_names.index("left_elbow_joint")
        return motion.positions[0, column] == pytest.approx(0.5)

    wait_for(begins_there, "another first keyframe")
    browser.set("Keyframe", "Delete")
    left = ["1 at 0.00 s"]
    browser.wait_for(lambda: [*browser.element("Selected")["options"]] == left, "one")


def test_times_move_on_the_bar_and_as_numbers(page, browser):
    opened(page, browser, 2, 1.0)
    browser.set("Times", (0.0, 1.5))
    opened(page, browser, 2, 1.5)
    browser.wait_for(lambda: browser.value("Selected") == "2 at 1.50 s", "the time")
    browser.set("Seconds before", 2.0)
    opened(page, browser, 2, 2.0)
    browser.wait_for(lambda: list(browser.value("Times")) == [0.0, 2.0], "the bar")
    browser.set("Keyframe", "Add")  # after the selected one
    opened(page, browser, 3, 4.0)
    browser.set("Times", (0.0, 0.004, 0.0))  # no browser sends such
    browser.wait_for(lambda: list(browser.value("Times")) == [0, 2.0, 4.0], "the bar")


def test_a_time_that_is_too_short_is_lengthened_and_told(page, browser):
    opened(page, browser, 2, 1.0)
    browser.set("Seconds before", 0.02)

    sentence = "Keyframe 2 is later than set"
    browser.wait_for(lambda: browser.says(sentence), "a sentence")
    selected = browser.value("Selected")
    assert "2 at 0.02 s" < selected < "2 at 0.30 s"


def test_motions_and_poses_are_saved(page, browser, tmp_path):
    motion = opened(page, browser, 2, 1.0)
    browser.set("Save as", "lift")
    browser.set("Save", "Motion")
    file = tmp_path / "g1_description" / "motions" / "lift.csv"
    wait_for(file.exists, "the file")

    def is_whole():
        try:
            return len(page.model.read_motion(file).times) == len(motion.times)
        except MotionError:
            return False

    wait_for(is_whole, "a whole file")
    saved = page.model.read_motion(file)
    np.testing.assert_allclose(saved.positions, motion.positions, atol=1e-6)
    np.testing.assert_allclose(saved.base_poses, motion.base_poses, atol=1e-6)
    content = file.read_bytes()
    browser.set("Save", "Motion")  # once more
    refused = "lift.csv already exists"
    browser.wait_for(lambda: browser.says(refused), "a refusal")
    browser.set("Save", "Poses")
    wait_for(lambda: "lift_2" in read_poses(page.model.description), "the poses")
    browser.wait_for(
        lambda: "lift_2" in browser.element("Go to pose")["options"], "a button"
    )
    assert file.read_bytes() == content
    keys = page.model.read_keyframes(name="lift")
    assert keys.times == (0.0, 1.0)
    np.testing.assert_allclose(keys.motion.positions, motion.positions, atol=1e-5)
    np.testing.assert_allclose(keys.motion.base, motion.base, atol=1e-5)


def test_a_deleted_motion_is_not_saved(page, browser, tmp_path):
    opened(page, browser, 2, 1.0)
    browser.set("Keyframe", "Delete")
    browser.wait_for(lambda: browser.value("Selected") == "1 at 0.00 s", "one left")
    browser.set("Save as", "gone")
    browser.set("Save", "Motion")
    sentence = "There is no motion"
    browser.wait_for(lambda: browser.says(sentence), "a sentence")
    assert not (tmp_path / "g1_description" / "motions").exists()


def test_a_page_of_the_motion_is_shared(page, browser):
    opened(page, browser, 2, 1.0)
    motion = page.show.motion
    wait_for(lambda: page.robot in motion.verdicts, "its verdict")
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


def test_keys_play_step_and_take(page, browser):
    opened(page, browser, 2, 1.0)
    motion = page.show.motion
    player = motion.player

    def press(effect):
        uuid = browser.element(effect)["uuid"]
        browser.send("CommandTriggerMessage", uuid=uuid)

    press("One sample back")
    wait_for(lambda: player.time == pytest.approx(0.98), "the sample before")
    press("One sample on")
    wait_for(lambda: player.time == pytest.approx(1.0), "the sample after")
    press("Add a keyframe")
    opened(page, browser, 3, 2.0)
    press("Show gizmos, or hide them")
    name = "/map/reach/g1/left_hand"
    browser.wait_for(lambda: browser.nodes[name].get("visible"), "the gizmos")
    press("Show gizmos, or hide them")
    browser.wait_for(lambda: not browser.nodes[name].get("visible"), "no gizmos")
    motion.player.play(0.0, 0.01)
    press("Play, or pause")
    wait_for(lambda: not motion.player.is_running, "the pause")
    press("Play, or pause")
    wait_for(lambda: motion.player.is_running, "the motion")
    motion.player.pause()
