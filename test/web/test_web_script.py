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

from g1_description.errors import MotionError

from page_client import PageClient
from processes import marked_environment, marked_processes, new_mark

WINDOW = (480, 420)
SLIDER = "left_knee"
LASTING = """
const later = window.setTimeout;
window.setTimeout = (act, time) => later(act, time === 6000 ? 1e9 : time);
"""
"""JavaScript for a page whose messages stay, however late somebody looks."""
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


def read(name, path):
    """Take a dropped file."""
    if b"none" in path.read_bytes():
        raise MotionError(f"{name} has no joints.")
    return f"Opened {name}."


@pytest.fixture(scope="module")
def small():
    with opened(read, {"pose.yaml": lambda: "knee: 0.5\n"}) as server:
        yield Small(server)


@pytest.fixture(scope="module")
def chromium():
    with browser.Browser() as one:
        yield one


@pytest.fixture(scope="module")
def window(small, chromium):
    page = chromium.open(small.address, WINDOW, script=browser.JAGGED + LASTING)
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
def test_numbers_count_when_they_are_typed_to_the_end(page, slider, small):
    for text, value in (("-0.05", -0.05), ("1.05", 1.05), ("-0.5", -0.5)):
        slider.type_keys(text, "Enter")
        page.wait_for(lambda v=value: small.slider.value == v, "what was typed")
        page.wait_for(lambda v=value: slider.value() == v, "the slider")
    for text in ("knee", "-", "1e-3", "0x1", "0,5"):
        slider.type_keys(text, "Tab")
        assert slider.shown() == "-0.5", text
    for keys in (("", "Delete"), ("0.3", "Escape")):
        slider.type_keys(*keys, "Tab")
        assert slider.shown() == "-0.5", keys
    slider.type_keys("0.75", "Tab")
    page.wait_for(lambda: 0.75 in small.been, "a field that was left")
    assert {*small.been} == {-0.05, 1.05, -0.5, 0.75}


@needs_browser
def test_what_is_typed_is_not_mixed_with_what_comes(page, slider, small):
    slider.type_keys("-0")
    small.slider.value = 0.7
    page.wait_for(lambda: slider.value() == 0.7, "the slider elsewhere")
    page.raw.evaluate(
        "addEventListener('pointerdown', () => { window.pressed = true }, true)"
    )
    page.raw.mouse.move(5, 5)  # where it will rest
    page.wait_for(lambda: page.raw.evaluate("window.pressed"), "a mouse that rests")
    assert slider.shown() == "-0"
    page.raw.keyboard.type(".25")
    page.raw.keyboard.press("Enter")
    page.wait_for(lambda: small.slider.value == -0.25, "what was typed")


@needs_browser
def test_fields_are_left_as_people_leave_them(page, small):
    fields = page.element("x y z").locator("input")
    fields.nth(0).click(click_count=3)
    for text in ("0.5", "-0.25", "1.5"):
        page.raw.keyboard.type(text)
        page.raw.keyboard.press("Tab")
    page.wait_for(lambda: small.place.value == (0.5, -0.25, 1.5), "the fields")
    shown = [fields.nth(number).input_value() for number in range(3)]
    assert shown == ["0.5", "-0.25", "1.5"]
    fields.nth(0).click(click_count=3)
    page.raw.keyboard.type("0")
    page.field("Name").click(click_count=3)
    page.raw.keyboard.type("pose_1")
    assert page.field("Name").input_value() == "pose_1"
    page.wait_for(lambda: small.place.value == (0.0, -0.25, 1.5), "the first again")
    page.wait_for(lambda: small.name.value == "pose_1", "the text")


@needs_browser
def test_a_typed_number_is_stepped(page, small):
    field = page.field("Seconds")
    field.click(click_count=3)
    page.raw.keyboard.type("5")
    page.element("Seconds").locator("button").first.click()
    page.wait_for(lambda: field.input_value() == "5.1", "a step on from it")
    page.wait_for(lambda: small.seconds.value == pytest.approx(5.1), "the number")


@needs_browser
def test_keys_press_buttons_where_nobody_types(page, small):
    came = []
    small.walk.on_click(lambda event: came.append(event.target.value))
    page.field("Name").fill("")
    page.field("Name").press("n")
    page.wait_for(lambda: small.name.value == "n", "the typed letter")
    page.raw.locator("label", has_text="Name").first.click()
    page.raw.evaluate("document.activeElement.blur()")
    page.raw.keyboard.press("p")
    page.raw.keyboard.press("Control+n")
    page.raw.keyboard.press("n")
    page.wait_for(lambda: came == ["Previous", "Next"], "both buttons")


@needs_browser
def test_files_are_dropped_and_what_came_of_them_is_said(page, tmp_path):
    for name, text, told in (
        ("broken.csv", "none", "broken.csv has no joints."),
        ("walk.csv", "0,1\n" * 300_000, "Opened walk.csv."),  # several pieces
    ):
        (tmp_path / name).write_text(text)
        page.drop_file(tmp_path / name)
        kind = ".g1-failed" if text == "none" else ".g1-toast:not(.g1-failed)"
        page.raw.locator(kind, has_text=told).wait_for()


@needs_browser
def test_a_text_is_copied(page):
    page.raw.evaluate("g1.copy('/pose.yaml')")
    page.raw.get_by_text("Copied pose.yaml.").wait_for()
    assert page.clipboard() == "knee: 0.5\n"


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
        client.wait_for(lambda: not client._labelled("Name"), "the removal")


def test_a_client_vanishes_and_is_told_of_an_end(small):
    before = {*small.viser.get_clients()}
    gone = PageClient(small.address)
    (new,) = wait_for(lambda: {*small.viser.get_clients()} - before, "the client")
    gone.vanish()
    wait_for(lambda: new not in small.viser.get_clients(), "its end")
    assert gone.has_ended
    with pytest.raises(AssertionError, match="in vain for anything"):
        gone.wait_for(lambda: False, "anything")  # at once
