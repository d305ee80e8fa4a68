"""Who may come in: this machine, or whoever has the token; no page of others."""

import socket
from urllib.parse import urlsplit

import pytest

pytest.importorskip("viser", reason="viser is not there")

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
from websockets.exceptions import InvalidStatus
from websockets.frames import Frame, Opcode

TOKEN = "a-token_of.tests"


@pytest.fixture(scope="module")
def local():
    with opened(texts={"pose.yaml": lambda: "pose"}) as server:
        yield server


@pytest.fixture(scope="module")
def guarded():
    texts = {"pose.yaml": lambda: "pose"}
    with opened(host="0.0.0.0", token=TOKEN, texts=texts) as server:
        yield server


def status(server, path="/", **options):
    """Try to open a websocket; return what it is answered with."""
    try:
        with join(server, path, **options):
            return 101
    except InvalidStatus as error:
        return error.response.status_code


HOSTS = [
    "localhost",
    "localhost:9",
    "127.0.0.1:8080",
    "127.9.9.9",
    "[::1]:5",
    "LOCALHOST",
]


@pytest.mark.parametrize("host", HOSTS)
def test_this_machine_comes_in_by_any_name_and_port(local, host):
    assert fetch(local, Host=host).status == 200
    assert fetch(local, Host=host, Origin=f"http://{host}").status == 200


@pytest.mark.parametrize(
    "host",
    ["evil.example", "127.0.0.1.evil.example", "10.0.0.1:8080", "", "localhost:x"],
)
def test_a_name_that_was_made_to_point_here_does_not(local, host):
    for path in ("/", "/pose.yaml", "/nothing"):
        answer = fetch(local, path, Host=host)
        assert answer.status == 403
        assert b"open it as localhost" in answer.body


def test_a_request_names_one_host(local):
    with socket.create_connection(netloc(local).split(":"), timeout=TIMEOUT) as client:
        client.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\nHost: evil\r\n\r\n")
        assert client.recv(99).startswith(b"HTTP/1.1 400")


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://localhost:1", "file://", ""]
)
@pytest.mark.parametrize("path", ["/", "/upload?name=a&size=1"])
def test_a_script_of_another_page_does_not(local, origin, path):
    assert status(local, path, additional_headers={"Origin": origin}) == 403
    assert fetch(local, "/pose.yaml", Origin=origin).status == 403


def test_the_page_itself_does(local):
    for scheme in ("http", "https"):
        assert status(local, origin=f"{scheme}://{netloc(local)}") == 101


def test_at_a_loopback_address_no_token_is_wanted(local):
    assert local.address == f"http://{netloc(local)}/"
    assert "Set-Cookie" not in fetch(local).headers


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


@pytest.mark.parametrize("path", ["/", "/pose.yaml", "/nothing", "/?token="])
def test_without_the_token_nothing_is_told(guarded, path):
    for query in ("", "?token=", "?token=wrong", f"?token={TOKEN}x", "?token=%ff"):
        answer = fetch(guarded, path.partition("?")[0] + query)
        assert answer.status == 401
        assert b"wants the token that was printed" in answer.body
        assert TOKEN.encode() not in answer.body
        assert "Set-Cookie" not in answer.headers


@pytest.mark.parametrize("path", ["/", "/upload?name=a&size=1"])
def test_without_the_token_no_websocket_opens(guarded, path):
    assert status(guarded, path) == 401
    headers = {"Cookie": f"g1_description_{urlsplit(guarded.address).port}=wrong"}
    assert status(guarded, path, additional_headers=headers) == 401


def test_the_token_opens_the_page_and_its_cookie_the_rest(guarded):
    answer = fetch(guarded, f"/?token={TOKEN}", Host="robot.example:8080")
    assert answer.status == 200
    cookie, *attributes = answer.headers["Set-Cookie"].split("; ")
    assert {"HttpOnly", "SameSite=Strict", "Path=/"} <= set(attributes)
    assert str(urlsplit(guarded.address).port) in cookie
    sent = f"other=1; {cookie}; third"
    assert fetch(guarded, "/pose.yaml", Cookie=sent).body == b"pose"
    assert fetch(guarded, "/", Cookie=sent).status == 200
    assert status(guarded, additional_headers={"Cookie": sent}) == 101
    headers = {"Cookie": sent, "Origin": "http://evil.example"}
    assert status(guarded, additional_headers=headers) == 403


def test_viser_itself_serves_nobody_else(local):
    """Somebody at this machine may find out where it listens."""
    moved = []
    slider = local.viser.gui.add_slider("s", 0, 9, 1, 0)
    slider.on_update(moved.append)
    update = message("GuiUpdateMessage", uuid=slider._impl.uuid, updates={"value": 5})
    hidden = urlsplit(local._hidden.url)
    with socket.create_connection((hidden.hostname, hidden.port), TIMEOUT) as client:
        frame = Frame(Opcode.BINARY, update).serialize(mask=True)
        client.sendall(HELLO + frame)  # at once, before it is known who this is
        answer = b""
        while b"\r\n\r\n" not in answer[:-4]:
            answer += client.recv(4096)
    head, _, rest = answer.partition(b"\r\n\r\n")
    assert b"101 Switching Protocols" in head
    assert rest == b"\x88\x02\x03\xe8"  # closed, and nothing before
    wait_until_left(local)
    assert hidden.hostname.startswith("127.")
    assert hidden.hostname != "127.0.0.1"
    assert not moved
    assert slider.value == 0
