"""viser gets what browsers send, if the page is not read-only."""

import gc
import threading

import pytest

pytest.importorskip("viser", reason="viser is not there")

import numpy as np
from viser import infra
from viser import transforms as tf
from web_clients import TIMEOUT, join, message, opened, wait_until, wait_until_left
from websockets.exceptions import ConnectionClosed

CAMERA = {
    "wxyz": [1, 0, 0, 0],
    "position": [1.5, 2, 3],
    "fov": 1,
    "near": 0.1,
    "far": 100,
    "image_height": 480.5,  # of a page that is zoomed
    "image_width": 640,
    "look_at": [0, 0, 0],
    "up_direction": [0, 0, 1],
}
CLASSES = {cls.__name__: cls for cls in infra.Message.get_subclasses()}


class Scene:
    """A page with what a person moves, and what came of it."""

    def __init__(self, server):
        self.server = server
        self.slider = server.viser.gui.add_slider("angle", -3.0, 3.0, 0.01, 0.0)
        self.gizmo = server.viser.scene.add_transform_controls("/gizmo")
        self.last = server.viser.gui.add_number("count", 0)
        self.count = 0
        self.joined = []
        server.viser.on_client_connect(self.joined.append)

    def update(self, **updates):
        return message("GuiUpdateMessage", uuid=self.slider._impl.uuid, updates=updates)

    def send(self, *messages):
        """Send messages, and wait until they have been dealt with."""
        uuid = self.last._impl.uuid
        self.count += 1
        with join(self.server) as page:
            for data in messages:
                page.send(data)
            updates = {"value": self.count}
            page.send(message("GuiUpdateMessage", uuid=uuid, updates=updates))
            wait_until(lambda: self.last.value == self.count, "the last message")


@pytest.fixture(scope="module")
def scene():
    with opened() as server:
        yield Scene(server)


@pytest.fixture(scope="module")
def shown():
    with opened(read_only=True) as server:
        yield Scene(server)


def test_a_person_moves_a_slider_and_a_gizmo(scene):
    moved = message(
        "TransformControlsUpdateMessage",
        name="/gizmo",
        wxyz=[0, 1, 0, 0],
        position=[1, 2, 3],
        owner="",
    )
    scene.send(scene.update(value=2), moved)
    assert scene.slider.value == 2.0
    assert list(scene.gizmo.position) == [1.0, 2.0, 3.0]
    assert tf.SO3(scene.gizmo.wxyz).as_matrix()[0, 0] == 1.0


def test_viser_knows_a_browser_by_its_camera(scene):
    before = len(scene.joined)
    with join(scene.server) as page:
        page.send(message("ViewerCameraMessage", **CAMERA))
        wait_until(lambda: len(scene.joined) == before + 1, "the callback")
        assert scene.joined[-1].camera.image_width == 640


def test_a_picture_of_some_megabytes_comes_through(scene):
    """As the answer to get_render."""
    got = threading.Event()
    wait_until_left(scene.server)
    with join(scene.server) as page:
        page.send(message("ViewerCameraMessage", **CAMERA))
        wait_until(lambda: scene.server.viser.get_clients(), "the browser")
        client = next(iter(scene.server.viser.get_clients().values()))
        client._websock_connection.register_handler(
            CLASSES["GetRenderResponseMessage"],
            lambda _, m: len(m.payload) == 5 * 2**20 and got.set(),
        )
        picture = bytes(5 * 2**20)
        page.send(message("GetRenderResponseMessage", payload=picture, render_uuid="1"))
        assert got.wait(TIMEOUT)


def test_nobody_opens_a_tunnel(scene):
    handlers = scene.server.viser._websock_server._incoming_handlers
    assert CLASSES["GuiUpdateMessage"] in handlers
    assert CLASSES["ShareUrlRequest"] not in handlers


def test_a_value_of_the_wrong_kind_changes_nothing(scene, capfd, caplog):
    scene.send(scene.update(value=1), scene.update(value="x"), scene.update(value={}))
    assert scene.slider.value == 1.0
    gc.collect()  # viser's tasks, whose errors asyncio would tell now
    assert not caplog.records
    assert capfd.readouterr() == ("", "")


def test_a_message_that_is_too_large_ends_the_connection(scene):
    with join(scene.server) as page:
        with pytest.raises(ConnectionClosed):
            page.send(bytes(17 * 2**20))
            while True:
                page.recv(timeout=TIMEOUT)
        assert page.protocol.close_code == 1009


def test_read_only_nothing_of_a_browser_reaches_viser(shown):
    """The scene comes all the same."""
    with join(shown.server) as page:
        assert len(page.recv(timeout=TIMEOUT)) > 100  # so both ways are open
        page.send(message("ViewerCameraMessage", **CAMERA))
        page.send(shown.update(value=2))
        page.send("text")
        page.send(b"garbage")
        points = np.zeros((2**15, 3))
        shown.server.viser.scene.add_point_cloud("/late", points, (9, 9, 9))
        wait_until(lambda: len(page.recv(timeout=TIMEOUT)) > 2**16, "it goes on")
    wait_until_left(shown.server)
    assert shown.slider.value == 0.0
    assert shown.joined == []
