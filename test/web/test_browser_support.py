"""What drives and compares pages in the tests, on a small page of viser."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

viser = pytest.importorskip("viser", reason="viser is not installed")
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "rostest"))
from support import browser  # noqa: E402
from support.pictures import share_changed  # noqa: E402
from waiting import DEADLINE, wait_for  # noqa: E402

from page_client import PageClient  # noqa: E402
from processes import marked_environment, marked_processes, new_mark  # noqa: E402

WINDOW = (640, 480)
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
needs_browser = pytest.mark.skipif(bool(browser.missing()), reason=browser.missing())
pytestmark = pytest.mark.slow


class SmallPage:
    """A box, a slider that moves it, and one of each of the rest."""

    def __init__(self):
        """Serve it on a free port."""
        self.server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        self.address = f"http://127.0.0.1:{self.server.get_port()}"
        self.server.scene.configure_environment_map(None)
        self.server.initial_camera.position = (3.0, 3.0, 2.0)
        self.box = self.server.scene.add_box("/box", (200, 0, 0), (1.0, 1.0, 1.0))
        gui = self.server.gui
        tabs = gui.add_tab_group()
        with tabs.add_tab("Joints"):
            with gui.add_folder("legs"):
                self.slider = gui.add_slider("left_knee_joint", -2.5, 2.5, 0.001, 0.0)
            self.switch = gui.add_checkbox("frames", False)
            self.reset = gui.add_button("Reset")
        with tabs.add_tab("Motion"):
            self.name = gui.add_text("name", "walk")
            self.file = gui.add_upload_button("Open")
        self.slider.on_update(lambda _: self._move())
        self.reset.on_click(lambda _: setattr(self.slider, "value", 0.0))

    def _move(self):
        self.box.position = (self.slider.value, 0.0, 0.0)


@pytest.fixture
def small():
    page = SmallPage()
    yield page
    page.server.stop()


@pytest.fixture(scope="module")
def chromium():
    with browser.Browser() as one:
        yield one


@needs_browser
def test_a_slider_is_read_dragged_and_typed(small, chromium):
    page = chromium.open(small.address, WINDOW)
    slider = page.slider("left_knee_joint")
    assert (slider.value(), slider.limits()) == (0.0, (-2.5, 2.5))
    slider.drag(1.0)
    page.wait_for(lambda: abs(small.slider.value - 1.0) < 0.1, "the dragged slider")
    slider.type(-0.7)
    page.wait_for(lambda: small.slider.value == -0.7, "the typed value")
    small.slider.value = 2.0
    page.wait_for(lambda: slider.value() == 2.0 and slider.shown() == "2", "ours")
    page.press("Reset")
    page.wait_for(lambda: slider.value() == 0.0, "the pressed button")
    page.close()
    assert not page.problems


@needs_browser
def test_the_rest_of_a_panel(small, chromium, tmp_path):
    page = chromium.open(small.address, WINDOW)
    page.check("frames")
    page.wait_for(lambda: small.switch.value and page.is_checked("frames"), "a check")
    page.toggle_folder("legs")
    page.wait_for(lambda: "left_knee_joint" not in page.text(), "a closed folder")
    page.open_tab("Motion")
    page.type_into("name", "run")
    page.wait_for(lambda: small.name.value == "run", "the typed text")
    (tmp_path / "walk.csv").write_text("0,1\n")
    page.choose_file("Open", tmp_path / "walk.csv")
    page.wait_for(lambda: small.file.value.content == b"0,1\n", "the file")
    page.raw.evaluate("navigator.clipboard.writeText('copied')")
    assert page.clipboard() == "copied"
    page.close()


@needs_browser
def test_a_file_is_dropped_and_another_saved(chromium, tmp_path):
    page = chromium.open("about:blank", WINDOW)
    page.raw.set_content("<a download='b.txt' href='data:,saved'>Save</a>")
    page.raw.evaluate(
        "document.body.addEventListener('drop', async event => {"
        " document.title = await event.dataTransfer.files[0].text(); })"
    )
    (tmp_path / "a.txt").write_text("dropped")
    page.drop_file(tmp_path / "a.txt")
    page.wait_for(lambda: page.raw.title() == "dropped", "the dropped file")
    saved = page.download(lambda: page.raw.get_by_text("Save").click(), tmp_path)
    assert (saved.name, saved.read_text()) == ("b.txt", "saved")
    page.close()


@needs_browser
def test_pictures_of_a_scene_differ_where_it_moved(small, chromium):
    page = chromium.open(small.address, WINDOW)
    before = page.still()
    assert before.shape == (*WINDOW[::-1], 3)
    assert before.std() > 10, "the box is seen"
    assert share_changed(before, page.still()) == 0.0
    page.slider("left_knee_joint").type(2)
    page.wait_for(lambda: share_changed(before, page.scene()) > 0.01, "a moved box")
    page.close()


@needs_browser
def test_a_phone_shows_the_page_too(small, chromium):
    page = chromium.open(small.address, phone=True)
    assert page.still().shape == (844, 390, 3)
    assert page.raw.evaluate("navigator.maxTouchPoints") > 0
    page.close()


@needs_browser
def test_problems_of_a_page_are_kept(chromium):
    page = chromium.open("about:blank", WINDOW)
    page.raw.evaluate(
        "console.error('red'); setTimeout(() => { throw Error('thrown') })"
    )
    page.wait_for(lambda: len(page.problems) == 2, "two problems")
    assert "red" in page.problems[0] and "thrown" in page.problems[1]
    with pytest.raises(AssertionError, match="in vain for the moon"):
        page.wait_for(lambda: False, "the moon", timeout=0.1)
    page.close()


@needs_browser
def test_a_script_runs_before_those_of_the_page(chromium):
    page = chromium.open("data:,", WINDOW, script="window.early = 1")
    assert page.raw.evaluate("early") == 1
    page.close()


@needs_browser
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_no_browser_stays_behind(number):
    # Chromium's socket lies in it, and names of sockets have at most 107 characters.
    with tempfile.TemporaryDirectory() as folder:
        check_that_nothing_stays(number, Path(folder))


def check_that_nothing_stays(number, folder):
    mark = new_mark()
    command = [
        sys.executable,
        "-c",
        LAUNCH,
        browser.__file__.rpartition("/support/")[0],
    ]
    environment = {**marked_environment(mark), "TMPDIR": str(folder)}
    with subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as process:
        pid = int(process.stdout.readline())
        assert len(marked_processes(mark)) > 2
        assert list(folder.iterdir())
        os.kill(pid, number)
        process.wait(DEADLINE)
    wait_for(lambda: not marked_processes(mark), "the end of the browser")
    # Where Chromium takes long to end the driver kills it, and its socket stays.
    kept = "org.chromium.*" if number == signal.SIGKILL else "nothing"
    wait_for(
        lambda: all(file.match(kept) for file in folder.iterdir()),
        "the end of its files",
    )


def test_a_client_without_a_browser_sees_and_sets(small):
    with PageClient(small.address) as client, PageClient(small.address) as other:
        client.wait_until_whole()
        other.wait_until_whole()
        count = other.counts["/box"]
        assert client.element("left_knee_joint")["max"] == 2.5
        assert client.nodes["/box"]["dimensions"] == [1.0, 1.0, 1.0]
        client.set("left_knee_joint", 1.25)
        other.wait_for(lambda: other.value("left_knee_joint") == 1.25, "the value")
        other.wait_for(
            lambda: other.nodes["/box"].get("position", (0.0,))[0] == 1.25, "the box"
        )
        assert other.counts["/box"] == count + 1
        client.press("Reset")
        client.wait_for(lambda: client.value("left_knee_joint") == 0.0, "the reset")
        small.name.remove()
        client.wait_for(lambda: not client._labelled("name"), "the removal")
        assert client.bytes > 0 and client.messages > 10


def test_a_client_decodes_arrays(small):
    points = np.arange(12, dtype=np.float32).reshape(4, 3)
    faces = np.array([[0, 1, 2], [1, 2, 3]])
    small.server.scene.add_mesh_simple("/mesh", points, faces)
    with PageClient(small.address) as client:
        client.wait_until_whole()
        mesh = client.nodes["/mesh"]
        assert (mesh["vertices"].reshape(-1, 3) == points).all()
        assert (mesh["faces"].reshape(-1, 3) == faces).all()


def test_a_client_vanishes_and_is_told_of_an_end(small):
    clients = small.server.get_clients
    gone = PageClient(small.address)
    wait_for(lambda: len(clients()) == 1, "the first client")
    gone.vanish()
    wait_for(lambda: not clients(), "its end")
    start = time.monotonic()
    with pytest.raises(AssertionError, match="in vain for anything"):
        gone.wait_for(lambda: False, "anything")
    assert time.monotonic() - start < 0.5 * DEADLINE
