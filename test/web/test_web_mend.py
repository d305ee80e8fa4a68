"""The open motion is fixed on the page, and that is undone."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest
from waiting import DEADLINE, wait_for

pytest.importorskip("viser", reason="viser is not installed")

from web_clients import running

from g1_description.checks.checker import Checker
from g1_description.mend.certificate import Certificate
from g1_description.motion.files.formats import read_motion
from g1_description.motion.files.source import ReadOptions
from g1_description.robot.load import read_description
from g1_description.web.file_world import FileWorld, StillRobot
from g1_description.web.mend_buttons import MAX_LEFT, summary
from g1_description.web.page import Page
from g1_description.web.server.address import ServerOptions

from page_client import PageClient

pytestmark = pytest.mark.slow
ROBOT = read_description("g1_29dof")
FAULTY = (Path(__file__).parents[2] / "motions" / "faulty.csv").read_bytes()
LINES = FAULTY.splitlines(keepends=True)
HEAD = next(n for n, line in enumerate(LINES) if line.startswith(b"time")) + 1
LIMIT, BOTH = (
    b"".join([*LINES[:HEAD], *LINES[HEAD + begin : HEAD + 150]]) for begin in (130, 80)
)
"""Parts of it: the left elbow is beyond its limit; the right arm in the torso, too."""


class Opened:
    """A page of the G1 with one browser."""

    def __init__(self, show, client):
        self.show, self.client = show, client
        self.robot = show.motion.world.robots[0]

    @property
    def motion(self):
        return self.show.motion.motions[self.robot]

    def sees(self, label):
        """Tell whether a button can be seen."""
        return self.client.element(label)["visible"]

    def open(self, name, content):
        """Open a file, and wait for the button that fixes it."""
        self.client.upload("Open a motion", name, content)
        self.client.wait_for(
            lambda: self.client.find(f"Findings: {name}") and self.sees("Fix"), "Fix"
        )

    def wait_for_words(self, *words):
        for some in words:
            self.client.wait_for(lambda w=some: self.client.says(w), some)


def read(path, robot, rate):
    return read_motion(path, robot, ReadOptions(rate))


@pytest.fixture
def make():
    """Give a list of what is done before a checker is made, once each."""
    return []


@pytest.fixture
def page(make):
    def checker(robot):
        if make:
            make.pop(0)()
        return Checker(robot)

    world = FileWorld([StillRobot("g1", ROBOT)], read)
    show = Page(world, ServerOptions(port=0), checker)
    with running(show), PageClient(show.address) as client:
        client.wait_until_whole()
        yield Opened(show, client)


def test_a_motion_is_fixed_downloaded_and_given_back(page, tmp_path):
    client = page.client
    page.open("walk.csv", FAULTY)
    given = page.motion
    assert client.says("failed: 6 failures") and not page.sees("Undo")
    client.set("Time", 5.2)
    wait_for(lambda: page.show.motion.player.time == 5.2, "the time")
    client.press("Fix")
    page.wait_for_words("Fixing ... failures left: 6")
    page.wait_for_words("Fixed. Failures: 6 before, 0 after.", "Changes")
    client.wait_for(lambda: not client.says("failed: "), "no failures")
    wait_for(lambda: page.robot in page.show.motion.verdicts, "its verdict")
    assert page.show.motion.verdicts[page.robot].passed
    assert page.sees("Undo") and not page.sees("Fix")
    fixed = page.motion
    shown = page.robot.state().base_pose
    row = int(np.searchsorted(fixed.times, 5.2))
    np.testing.assert_allclose(shown, fixed.base_poses[row], atol=1e-6)

    client.press("Download")
    client.wait_for(lambda: "FileTransferPart" in client.others, "the file")
    assert client.others["FileTransferStartDownload"]["filename"] == "walk_fixed.csv"
    file = tmp_path / "walk_fixed.csv"
    file.write_bytes(bytes(client.others["FileTransferPart"]["content"]))
    read = read_motion(file, ROBOT)
    assert read.joint_names == fixed.joint_names
    for name in ("times", "positions", "base_poses"):
        ours, theirs = getattr(read, name), getattr(fixed, name)
        np.testing.assert_allclose(ours, theirs, atol=1e-6)

    client.press("Undo")
    page.wait_for_words("failed: 6 failures")
    assert page.motion is given
    client.wait_for(lambda: page.sees("Fix") and not page.sees("Undo"), "Fix")
    assert not client.says("Fixed.")


def test_a_motion_that_is_opened_meanwhile_stays(page, make):
    page.open("limit.csv", LIMIT)
    gate = threading.Event()
    make.append(lambda: gate.wait(DEADLINE))
    page.client.press("Fix")
    page.wait_for_words("Fixing ...")
    page.open("other.csv", BOTH)
    other = page.motion
    assert not page.client.says("Fixing ...")
    gate.set()
    page.client.press("Fix")  # is done after what was begun before
    page.wait_for_words("Fixed. Failures: 2 before, 0 after.")
    assert page.show.motion.opened == 3
    page.client.press("Undo")
    wait_for(lambda: page.motion is other, "the other motion")


def test_after_an_error_it_can_be_tried_again(page, make):
    page.open("limit.csv", LIMIT)
    make.append(lambda: 1 / 0)
    page.client.press("Fix")
    page.wait_for_words("could not be fixed")
    page.client.press("Fix")
    page.wait_for_words("Fixed.")


def test_who_may_only_look_is_not_offered_it(tmp_path):
    file, robot = tmp_path / "limit.csv", StillRobot("g1", ROBOT)
    file.write_bytes(LIMIT)
    show = Page(
        FileWorld([robot], read), ServerOptions(port=0, read_only=True), Checker
    )
    show.motion.open("limit.csv", robot, read_motion(file, ROBOT))
    with running(show), PageClient(show.address) as client:
        client.wait_for(lambda: client.says("failed: 1 failure"), "the findings")
        for label in ("Fix", "Undo", "Download"):
            assert client.find(label) is None


def test_what_is_left_is_listed():
    rows = [f"link_{number}: stays" for number in range(MAX_LEFT + 2)]
    text = summary(Certificate((), (), tuple(rows)), (9, 9))
    assert "Nothing was changed" in text and "Fixed" not in text
    assert text.count("\n- ") == MAX_LEFT + 1
    assert text.endswith("- and 2 more")
    assert "link\\_0\\: stays" in text
