"""The page's script in a real browser, and what drives pages in the tests."""

import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("viser", reason="viser is not installed")
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "rostest"))
from support import browser
from support.pictures import share_changed
from waiting import DEADLINE, wait_for
from web_clients import opened

from page_client import PageClient
from processes import marked_environment, marked_processes, new_mark

WINDOW = (480, 420)
SLIDER = "left_knee"
needs_browser = pytest.mark.skipif(bool(browser.missing()), reason=browser.missing())
pytestmark = pytest.mark.slow


class Small:
    """A box, a slider that moves it, and one of each of the rest."""

    def __init__(self, server):
        self.address, viser = server.address, server.viser
        self.viser, gui, self.been = viser, viser.gui, []
        viser.scene.configure_environment_map(None)
        viser.initial_camera.position = (3.0, 3.0, 2.0)
        self.box = viser.scene.add_box("/box", (200, 0, 0), (1.0, 1.0, 1.0))
        self.walk = gui.add_button_group("", ["Previous", "Next", "Undecided"])
        tabs = gui.add_tab_group()
        with tabs.add_tab("Robot"):
            with gui.add_folder("legs"):
                self.slider = gui.add_slider(SLIDER, -2.5, 2.5, 0.001, 0.0)
            self.place = gui.add_vector3("x y z", (0.0, 0.0, 1.0), step=0.01)
            self.seconds = gui.add_number("Seconds", 0.0, step=0.1)
            self.name = gui.add_text("Name", "walk")
            self.reset = gui.add_button("Reset")
        with tabs.add_tab("View"):
            self.switch = gui.add_checkbox("Frames", False)
        self.slider.on_update(lambda _: self._move())
        self.reset.on_click(lambda _: setattr(self.slider, "value", 0.0))

    def _move(self):
        self.been.append(self.slider.value)
        self.box.position = (self.slider.value, 0.0, 0.0)


@pytest.fixture(scope="module")
def small():
    with opened() as server:
        yield Small(server)


@pytest.fixture(scope="module")
def chromium():
    with browser.Browser() as one:
        yield one


@pytest.fixture(scope="module")
def window(small, chromium):
    page = chromium.open(small.address, WINDOW, script=browser.JAGGED)
    page.wait_for(lambda: SLIDER in page.text(), "the panel")
    page.dismiss()
    yield page
    page.close()


@pytest.fixture
def page(window):
    """Give the page, which is left without errors."""
    yield window
    assert not window.problems


@pytest.fixture
def slider(page, small):
    """Give the slider, which stands at 0.2."""
    one = page.slider(SLIDER)
    small.slider.value = 0.2
    page.wait_for(lambda: one.value() == 0.2 and one.shown() == "0.2", "ours")
    small.been.clear()
    return one


@needs_browser
def test_a_slider_is_dragged_typed_and_set_back_and_moves_what_is_seen(
    page, slider, small
):
    assert slider.limits() == (-2.5, 2.5)
    before = page.still()
    assert before.shape == (*WINDOW[::-1], 3)
    assert before.std() > 10, "the box is seen"
    slider.drag(1.0)
    page.wait_for(lambda: abs(small.slider.value - 1.0) < 0.1, "the dragged slider")
    page.wait_for(lambda: share_changed(before, page.scene()) > 0.01, "a moved box")
    slider.type(-0.7)
    page.wait_for(lambda: small.slider.value == -0.7, "the typed value")
    page.press("Reset")
    page.wait_for(lambda: slider.value() == 0.0, "the pressed button")


@needs_browser
def test_folders_tabs_and_switches(page, small):
    page.toggle_folder("legs")
    page.wait_for(lambda: SLIDER not in page.text(), "a closed folder")
    page.toggle_folder("legs")
    page.open_tab("View")
    page.check("Frames")
    page.wait_for(lambda: small.switch.value and page.is_checked("Frames"), "a check")
    page.open_tab("Robot")
    page.wait_for(lambda: SLIDER in page.text(), "the folder again")


@needs_browser
def test_who_brought_the_token_once_is_let_in(chromium):
    with opened(host="0.0.0.0") as server:
        server.viser.gui.add_button("Stand")
        address, _, token = server.address.partition("?token=")
        page = chromium.open(address, WINDOW)
        assert "needs the token" in page.text()
        assert token not in page.raw.content()
        for place in (server.address, address):
            page.raw.goto(place)
            page.wait_for(lambda: "Stand" in page.text(), "the page")
        page.close()


@needs_browser
def test_problems_of_a_page_are_kept(chromium):
    page = chromium.open("data:,", WINDOW, script="window.early = 1")
    assert page.raw.evaluate("early") == 1, "a script runs before the page's own"
    page.raw.evaluate(
        "console.error('red'); setTimeout(() => { throw Error('thrown') })"
    )
    page.wait_for(lambda: len(page.problems) == 2, "two problems")
    assert "red" in page.problems[0] and "thrown" in page.problems[1]
    with pytest.raises(AssertionError, match="in vain for the moon"):
        page.wait_for(lambda: False, "the moon", timeout=0.1)
    page.close()


LAUNCH = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # which a shell may ignore
sys.path.insert(0, sys.argv[1])
from support.browser import Browser
with Browser() as browser:
    page = browser.open("about:blank")
    print(os.getpid(), flush=True)
    page.wait_for(lambda: False, "nothing")
"""


@needs_browser
def test_no_browser_stays_behind():
    # Chromium's socket lies in it, and names of sockets have at most 107 characters.
    with tempfile.TemporaryDirectory() as name:
        mark, folder = new_mark(), Path(name)
        support = browser.__file__.rpartition("/support/")[0]
        with subprocess.Popen(
            [sys.executable, "-c", LAUNCH, support],
            env={**marked_environment(mark), "TMPDIR": name},
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        ) as process:
            pid = int(process.stdout.readline())
            assert len(marked_processes(mark)) > 2
            assert list(folder.iterdir())
            os.kill(pid, signal.SIGINT)
            process.wait(DEADLINE)
        wait_for(lambda: not marked_processes(mark), "the end of the browser")
        wait_for(lambda: not list(folder.iterdir()), "the end of its files")


def test_a_client_without_a_browser_sees_and_sets(small):
    points = np.arange(12, dtype=np.float32).reshape(4, 3)
    faces = np.array([[0, 1, 2], [1, 2, 3]])
    small.viser.scene.add_mesh_simple("/mesh", points, faces)
    with PageClient(small.address) as client, PageClient(small.address) as other:
        client.wait_until_whole()
        other.wait_until_whole()
        mesh = client.nodes["/mesh"]
        assert (mesh["vertices"].reshape(-1, 3) == points).all()
        assert (mesh["faces"].reshape(-1, 3) == faces).all()
        count = other.counts["/box"]
        assert client.element(SLIDER)["max"] == 2.5
        client.set(SLIDER, 1.25)
        other.wait_for(lambda: other.value(SLIDER) == 1.25, "the value")
        other.wait_for(
            lambda: other.nodes["/box"].get("position", (0.0,))[0] == 1.25, "the box"
        )
        assert other.counts["/box"] == count + 1
        client.press("Reset")
        client.wait_for(lambda: client.value(SLIDER) == 0.0, "the reset")
        small.name.remove()
        client.wait_for(lambda: not client.find("Name"), "the removal")


def test_a_client_vanishes_and_is_told_of_an_end(small):
    before = {*small.viser.get_clients()}
    gone = PageClient(small.address)
    (new,) = wait_for(lambda: {*small.viser.get_clients()} - before, "the client")
    gone.vanish()
    wait_for(lambda: new not in small.viser.get_clients(), "its end")
    assert gone.has_ended
    with pytest.raises(AssertionError, match="in vain for anything"):
        gone.wait_for(lambda: False, "anything")  # at once
