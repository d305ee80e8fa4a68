"""The page's server: what it serves and to whom, its limits and messages."""

import gc
import gzip
import io
import os
import socket
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from urllib.parse import urlsplit

import pytest

pytest.importorskip("viser", reason="viser is not there")

import numpy as np
import viser
from PIL import Image
from viser import infra
from viser import transforms as tf
from waiting import wait_for
from web_clients import (
    HELLO,
    TIMEOUT,
    fetch,
    join,
    message,
    netloc,
    opened,
    wait_until_left,
)
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.frames import Frame, Opcode

from g1_description.errors import PageServerError
from g1_description.web.server import gateway
from g1_description.web.server.address import ServerOptions
from g1_description.web.server.page_server import PageServer

from page_client import PageClient

SOURCE = Path(__file__).parents[2] / "src"
INDEX = Path(viser.__file__).parent / "client" / "build" / "index.html"
TOKEN = "a-token_of.tests"


class Scene:
    """A page with what a person moves, and what came of it."""

    def __init__(self, server):
        self.server, self._uuids = server, {}
        self.slider = server.viser.gui.add_slider("angle", -3.0, 3.0, 0.01, 0.0)
        self.gizmo = server.viser.scene.add_transform_controls("/gizmo")
        self.last = server.viser.gui.add_number("count", 0)
        self.count = 0
        self.joined = []
        server.viser.on_client_connect(self.joined.append)

    def update(self, label="angle", **updates):
        """Give the message of a browser that changes an element."""
        if not self._uuids:
            with PageClient(self.server.address) as client:
                for one in ("angle", "count"):
                    self._uuids[one] = client.element(one)["uuid"]
        uuid = self._uuids[label]
        return message("GuiUpdateMessage", uuid=uuid, updates=updates)

    def send(self, *messages):
        """Send messages, and wait until they have been dealt with."""
        self.count += 1
        with join(self.server) as page:
            for data in messages:
                page.send(data)
            page.send(self.update("count", value=self.count))
            wait_for(lambda: self.last.value == self.count, "the last message")


@pytest.fixture(scope="module")
def server():
    """Give a page at this machine, for five browsers."""
    with opened(max_browsers=5) as server:
        server.viser.scene.add_box("/box", dimensions=(1, 1, 1), color=(9, 9, 9))
        yield server


@pytest.fixture(scope="module")
def guarded():
    with opened(host="0.0.0.0", token=TOKEN) as server:
        yield server


@pytest.fixture(scope="module")
def scene(server):
    return Scene(server)


@pytest.fixture(scope="module")
def shown():
    with opened(read_only=True) as server:
        yield Scene(server)


# --- what is served ---


def test_the_page_is_visers_with_our_script(server):
    answer = fetch(server)
    page = answer.body.decode()
    assert answer.status == 200
    assert answer.headers["Content-Type"] == "text/html; charset=utf-8"
    before, _, after = page.partition("<script>// Spares browsers")
    script, _, rest = after.rpartition("</script></body>")
    assert "g1_slow=1" in script
    assert before + "</body>" + rest == INDEX.read_text(encoding="utf-8")


def test_the_page_is_packed_for_whom_takes_that(server):
    answer = fetch(server, Accept_Encoding="br, gzip")
    assert answer.headers["Content-Encoding"] == "gzip"
    assert gzip.decompress(answer.body) == fetch(server).body


def test_the_page_is_not_sent_again_to_who_has_it(server):
    tag = fetch(server).headers["ETag"]
    assert fetch(server, If_None_Match=tag)[::2] == (304, b"")
    assert fetch(server, If_None_Match='"other"').status == 200


def test_others_can_neither_frame_the_page_nor_be_told_its_address(server):
    headers = fetch(server).headers
    policy = headers["Content-Security-Policy"]
    assert "frame-ancestors 'none'" in policy
    assert f"connect-src 'self' ws://{netloc(server)} blob: data:;" in policy
    assert headers["X-Frame-Options"] == "DENY"
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Referrer-Policy"] == "no-referrer"


@pytest.mark.parametrize(
    "path",
    ["/index.html", "/../../etc/passwd", "/%2e%2e/x", "//", "/upload"],
)
def test_there_is_nothing_else(server, path):
    answer = fetch(server, path)
    assert answer[::2] == (404, b"There is nothing at this address.")


def test_a_browser_gets_the_scene_and_is_counted(server):
    wait_until_left(server)
    with join(server) as page:
        assert len(page.recv(timeout=TIMEOUT)) > 100
        assert server.browsers == 1
    wait_until_left(server)


def test_a_page_of_another_version_is_told_to_reload(server):
    for subprotocols in (["viser-v0.0.1"], None):
        with join(server, subprotocols=subprotocols) as page, pytest.raises(
            ConnectionClosed, match="reload the page"
        ):
            page.recv(timeout=TIMEOUT)


def test_a_port_that_is_taken_is_named(server):
    port = int(netloc(server).split(":")[1])
    with pytest.raises(PageServerError, match=rf"port {port} of .* is in use"):
        PageServer(ServerOptions(port=port))


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"host": "no.such.host.invalid"}, "cannot listen on 'no.such.host.invalid'"),
        ({"host": "192.0.2.1"}, "use an address of this machine"),
        ({"port": 65536}, "port must be from 0 to 65535 .got 65536"),
    ],
)
def test_a_host_or_port_that_cannot_be_is_named(options, sentence):
    with pytest.raises(PageServerError, match=sentence):
        PageServer(ServerOptions(**{"port": 0, **options}))


def test_it_closes_its_port_and_may_close_twice():
    with opened() as server, join(server) as page:
        page.recv(timeout=TIMEOUT)
        host, port = netloc(server).split(":")
        server.close()
        with pytest.raises(OSError, match="refused"):
            socket.create_connection((host, int(port)), timeout=TIMEOUT)
        with opened(port=int(port)) as again:
            assert fetch(again).status == 200


def test_a_server_that_cannot_begin_says_why(monkeypatch):
    # As websockets another robot or version, which does not know an option.
    strange = partial(gateway.serve, no_such_option=True)
    monkeypatch.setattr(gateway, "serve", strange)
    with pytest.raises(PageServerError, match=r"cannot serve the page: .*no_such_opt"):
        PageServer(ServerOptions(port=0))


def run(code):
    """Run Python code in a process of its own; return what it prints, to both."""
    environment = {**os.environ, "PYTHONPATH": str(SOURCE)}
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        timeout=TIMEOUT,
        check=True,
    )
    return done.stdout.decode()


START = """
import logging, sys
logging.basicConfig(level=logging.INFO)
from g1_description.web.server.address import ServerOptions
from g1_description.web.server.page_server import PageServer
"""


@pytest.mark.slow
def test_nothing_is_printed_even_if_nobody_closes_it():
    code = "import websockets.sync.client as c\ns = PageServer(ServerOptions(port=0))\n"
    code += "w = c.connect(s.address.replace('http', 'ws'), "
    code += f"subprotocols=['viser-v{viser.__version__}'])\nw.recv(timeout={TIMEOUT})\n"
    assert run(START + code) == ""


@pytest.mark.parametrize("missing", ["trimesh", "viser", "websockets.asyncio.server"])
def test_what_is_not_installed_is_named_when_the_page_opens(monkeypatch, missing):
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(
        PageServerError, match=f"needs {missing.split('.')[0]}; install it "
    ):
        PageServer(ServerOptions(port=0))


# --- who may come in ---


def status(server, path="/", **options):
    """Try to open a websocket; return what it is answered with."""
    try:
        with join(server, path, **options):
            return 101
    except InvalidStatus as error:
        return error.response.status_code


@pytest.mark.parametrize("host", ["LOCALHOST", "localhost:9", "127.9.9.9", "[::1]:5"])
def test_this_machine_comes_in_by_any_name_and_port(server, host):
    assert fetch(server, Host=host).status == 200
    assert fetch(server, Host=host, Origin=f"http://{host}").status == 200


@pytest.mark.parametrize(
    "host",
    ["evil.example", "127.0.0.1.evil.example", "10.0.0.1:8080", "", "localhost:x"],
)
def test_a_name_that_was_made_to_point_here_does_not(server, host):
    for path in ("/", "/nothing"):
        answer = fetch(server, path, Host=host)
        assert answer.status == 403
        assert b"open it as localhost" in answer.body


def test_a_request_names_one_host(server):
    with socket.create_connection(netloc(server).split(":"), timeout=TIMEOUT) as client:
        client.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\nHost: evil\r\n\r\n")
        assert client.recv(99).startswith(b"HTTP/1.1 400")


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://localhost:1", "file://", ""]
)
def test_a_script_of_another_page_does_not(server, origin):
    assert status(server, additional_headers={"Origin": origin}) == 403
    assert fetch(server, Origin=origin).status == 403


def test_the_page_itself_does(server):
    for scheme in ("http", "https"):
        assert status(server, origin=f"{scheme}://{netloc(server)}") == 101


def test_at_a_loopback_address_no_token_is_wanted(server):
    assert server.address == f"http://{netloc(server)}/"
    assert "Set-Cookie" not in fetch(server).headers


def test_a_token_of_the_program_is_wanted_there_too():
    with opened(token=TOKEN) as server:
        assert server.address.endswith(f"/?token={TOKEN}")
        assert fetch(server).status == 401


def test_elsewhere_a_token_is_made_each_time():
    with opened(host="0.0.0.0") as one, opened(host="0.0.0.0") as other:
        tokens = {urlsplit(server.address).query for server in (one, other)}
        assert len(tokens) == 2
        assert all(len(token) > len("token=") + 40 for token in tokens)
        assert {urlsplit(server.address).hostname for server in (one, other)} != {
            "0.0.0.0"
        }


@pytest.mark.parametrize("path", ["/", "/nothing"])
def test_without_the_token_nothing_is_told(guarded, path):
    for query in ("", "?token=", "?token=wrong", f"?token={TOKEN}x", "?token=%ff"):
        answer = fetch(guarded, path + query)
        assert answer.status == 401
        assert b"needs the token that was printed" in answer.body
        assert TOKEN.encode() not in answer.body
        assert "Set-Cookie" not in answer.headers


def test_without_the_token_no_websocket_opens(guarded):
    assert status(guarded) == 401
    headers = {"Cookie": f"g1_description_{urlsplit(guarded.address).port}=wrong"}
    assert status(guarded, additional_headers=headers) == 401


def test_the_token_opens_the_page_and_its_cookie_the_rest(guarded):
    answer = fetch(guarded, f"/?token={TOKEN}", Host="robot.example:8080")
    assert answer.status == 200
    cookie, *attributes = answer.headers["Set-Cookie"].split("; ")
    assert {"HttpOnly", "SameSite=Strict", "Path=/"} <= set(attributes)
    assert str(urlsplit(guarded.address).port) in cookie
    sent = f"other=1; {cookie}; third"
    assert fetch(guarded, "/", Cookie=sent).status == 200
    assert status(guarded, additional_headers={"Cookie": sent}) == 101
    headers = {"Cookie": sent, "Origin": "http://evil.example"}
    assert status(guarded, additional_headers=headers) == 403


def test_viser_itself_serves_nobody_else(scene):
    """Somebody at this machine may find out where it listens."""
    server, before = scene.server, scene.slider.value
    update = scene.update(value=before + 1.0)
    host, port = server.viser.get_host(), server.viser.get_port()
    with socket.create_connection((host, port), TIMEOUT) as client:
        frame = Frame(Opcode.BINARY, update).serialize(mask=True)
        client.sendall(HELLO + frame)  # at once, before it is known who this is
        answer = b""
        while b"\r\n\r\n" not in answer[:-4]:
            answer += client.recv(4096)
    head, _, rest = answer.partition(b"\r\n\r\n")
    assert b"101 Switching Protocols" in head
    assert rest == b"\x88\x02\x03\xe8"  # closed, and nothing before
    wait_until_left(server)
    assert host.startswith("127.")
    assert host != "127.0.0.1"
    assert scene.slider.value == before


# --- limits ---


def raw(server, data=b""):
    """Open a connection, and send something."""
    host, port = netloc(server).split(":")
    client = socket.create_connection((host, int(port)), timeout=TIMEOUT)
    client.sendall(data)
    return client


def test_one_more_than_may_be_is_told(server):
    wait_until_left(server)
    pages = [join(server) for _ in range(5)]
    with pytest.raises(InvalidStatus) as caught:
        join(server)
    assert caught.value.response.status_code == 503
    assert caught.value.response.body == b"5 pages are open, the limit: close one."
    pages[0].close()
    wait_for(lambda: server.browsers == 4, "one has left")
    pages[0] = join(server)
    for page in pages:
        assert page.recv(timeout=TIMEOUT)
        page.close()
    wait_until_left(server)


GARBAGE = [
    b"",
    b"\r\n\r\n",
    b"GET",
    b"POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9\r\n\r\n",
    b"GET / HTTP/1.0\r\n\r\n",
    b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(range(256)),
    bytes(range(256)) * 64,
    b"GET /" + b"a" * 100000 + b" HTTP/1.1\r\n\r\n",
    b"GET / HTTP/1.1\r\n" + b"A: b\r\n" * 500 + b"\r\n",
    HELLO[:60],
    HELLO + b"\xff" * 99,
    HELLO + b"\x82\x05abcde",  # not masked
    HELLO.replace(b"Version: 13", b"Version: 99"),
    HELLO.replace(b"dGhlIHNhbXBsZSBub25jZQ==", b"short"),
]


def test_garbage_is_not_even_told_about(server, capfd, caplog):
    for data in GARBAGE:
        client = raw(server)
        try:
            client.sendall(data)
            client.shutdown(socket.SHUT_WR)
            while client.recv(65536):
                pass
        except OSError:  # it has closed already
            pass
        client.close()
    for _ in range(40):
        raw(server, HELLO[:40]).close()
        raw(server, HELLO).close()
    wait_until_left(server)
    assert fetch(server).status == 200
    with join(server) as page:
        assert page.recv(timeout=TIMEOUT)
    assert capfd.readouterr() == ("", "")
    assert len(caplog.records) <= 1


def test_warnings_are_few(caplog):
    with opened() as server:
        for _ in range(20):
            fetch(server, Host="evil.example")
    assert len(caplog.records) == 1
    assert "a request was refused" in caplog.text


def test_who_says_nothing_is_cut_off(monkeypatch):
    monkeypatch.setattr(gateway, "OPEN_TIMEOUT", 0.2)
    with opened() as server, raw(server, HELLO[:60]) as client:
        assert client.recv(99) == b""


def test_who_does_not_take_an_answer_is_cut_off(monkeypatch):
    monkeypatch.setattr(gateway, "PAGE_TIMEOUT", 0.2)
    with opened() as server, raw(server) as client:
        client.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
        assert client.recv(12) == b"HTTP/1.1 200"
        n_open = n_files()
        wait_for(lambda: n_files() < n_open, "it is cut off")


def n_files():
    """Count the files and sockets of this process."""
    return len(os.listdir("/proc/self/fd"))


@contextmanager
def with_lazy(server):
    """Open a page that reads nothing."""
    with raw(server) as lazy:
        lazy.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        lazy.sendall(HELLO)
        assert lazy.recv(12) == b"HTTP/1.1 101"
        wait_for(lambda: server.browsers == 1, "it is there")
        yield


def send_points(server, number):
    """Send a new state of the scene to all; return its size."""
    points = np.full((2**16, 3), number, np.float32)
    server.viser.scene.add_point_cloud("/p", points, (9, 9, 9))
    return points.nbytes / 2  # viser halves the precision


def memory():
    """Measure the memory of this process, in bytes."""
    pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[1]
    return int(pages) * os.sysconf("SC_PAGE_SIZE")


def test_who_does_not_read_costs_little_and_holds_up_nobody():
    """40 MB are sent to the one who reads."""
    with opened() as server, with_lazy(server), join(server) as reader:
        for number in range(100):
            size = send_points(server, number)
            while len(reader.recv(timeout=TIMEOUT)) < size:
                pass
            if number == 20:
                before = memory()
        assert server.browsers == 2
        assert memory() - before < 16 * 2**20


def test_who_does_not_read_is_cut_off(monkeypatch):
    monkeypatch.setattr(gateway, "STALL_TIMEOUT", 0.1)
    with opened() as server, with_lazy(server):
        for number in range(40):
            send_points(server, number)
            server.viser.flush()
        wait_for(lambda: server.browsers == 0, "it is cut off")


# --- messages ---

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
        wait_for(lambda: len(scene.joined) == before + 1, "the callback")
        assert scene.joined[-1].camera.image_width == 640


def test_a_picture_of_some_megabytes_comes_through(scene):
    """As the answer to get_render."""
    pixels = np.random.default_rng(1).integers(0, 256, (1300, 1300, 3), np.uint8)
    picture = io.BytesIO()
    Image.fromarray(pixels).save(picture, "PNG", compress_level=0)
    wait_until_left(scene.server)
    with PageClient(scene.server.address) as page, ThreadPoolExecutor(1) as pool:
        clients = wait_for(scene.server.viser.get_clients, "the browser")
        (client,) = clients.values()
        found = pool.submit(client.get_render, 1300, 1300, timeout=TIMEOUT)
        kind = "GetRenderRequestMessage"
        request = page.wait_for(lambda: page.others.get(kind), "a request")
        page.send(
            "GetRenderResponseMessage",
            payload=picture.getvalue(),
            render_uuid=request["render_uuid"],
        )
        np.testing.assert_array_equal(found.result(), pixels)


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
        wait_for(lambda: len(page.recv(timeout=TIMEOUT)) > 2**16, "it goes on")
    wait_until_left(shown.server)
    assert shown.slider.value == 0.0
    assert shown.joined == []
