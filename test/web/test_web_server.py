"""The page is served, with what belongs to it, and says in a sentence why not."""

import gzip
import os
import socket
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest

pytest.importorskip("viser", reason="viser is not there")

import viser
from web_clients import (
    TIMEOUT,
    fetch,
    join,
    netloc,
    opened,
    wait_until,
    wait_until_left,
)
from websockets.exceptions import ConnectionClosed

from g1_description.errors import G1DescriptionError, PageServerError
from g1_description.web.server import gateway
from g1_description.web.server.address import ServerOptions
from g1_description.web.server.page_server import PageServer

SOURCE = Path(__file__).parents[2] / "src"
INDEX = Path(viser.__file__).parent / "client" / "build" / "index.html"


def no_pose():
    raise G1DescriptionError("no robot is there yet")


@pytest.fixture(scope="module")
def server():
    texts = {"configuration.yaml": lambda: "größe: 1\n", "none.txt": no_pose}
    with opened(texts=texts) as server:
        server.viser.scene.add_box("/box", dimensions=(1, 1, 1), color=(9, 9, 9))
        yield server


def test_the_page_is_visers_with_our_script(server):
    answer = fetch(server)
    page = answer.body.decode()
    assert answer.status == 200
    assert answer.headers["Content-Type"] == "text/html; charset=utf-8"
    before, _, after = page.partition("<script>// What the page does")
    script, _, rest = after.rpartition("</script></body>")
    assert "window.g1 = { upload, copy, toast };" in script
    assert "const readOnly = false;" in script
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


def test_texts_are_as_they_are_now(server):
    answer = fetch(server, "/configuration.yaml")
    assert answer.body.decode() == "größe: 1\n"
    assert answer.headers["Content-Type"] == "text/plain; charset=utf-8"
    assert answer.headers["Cache-Control"] == "no-store"
    assert fetch(server, "/none.txt")[::2] == (503, b"no robot is there yet")


@pytest.mark.parametrize(
    "path",
    ["/index.html", "/../../etc/passwd", "/%2e%2e/x", "//", "/configuration.yaml/x"],
)
def test_there_is_nothing_else(server, path):
    answer = fetch(server, path)
    assert answer[::2] == (404, b"There is nothing at this address.")


def test_a_browser_gets_the_scene_and_is_counted(server):
    before = server.bytes_sent
    assert not server.watched.is_set()
    with join(server) as page:
        assert len(page.recv(timeout=TIMEOUT)) > 100
        assert server.browsers == 1
        assert server.watched.is_set()
        wait_until(lambda: server.bytes_sent > before + 100, "bytes counted")
    wait_until_left(server)
    assert not server.watched.is_set()


def test_a_page_of_another_version_is_told_to_reload(server):
    for subprotocols in (["viser-v0.0.1"], None):
        with join(server, subprotocols=subprotocols) as page, pytest.raises(
            ConnectionClosed, match="reload the page"
        ):
            page.recv(timeout=TIMEOUT)


def test_a_port_that_is_taken_is_named(server):
    port = int(netloc(server).split(":")[1])
    with pytest.raises(PageServerError, match=rf"port {port} .*or 0 for a free one"):
        PageServer(ServerOptions(port=port))


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"host": "no.such.host.invalid"}, "cannot open at 'no.such.host.invalid'"),
        ({"host": "192.0.2.1"}, "name an address of this machine"),
        ({"port": 65536}, "port is 65536, but ports are 0 to 65535"),
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


@pytest.mark.slow
@pytest.mark.parametrize("missing", ["viser", "websockets", "msgspec"])
def test_what_is_not_installed_is_named_when_the_page_opens(missing):
    code = "try: PageServer(ServerOptions(port=0))\n"
    code += "except Exception as error: print(type(error).__name__, error)\n"
    text = run(f"import sys\nsys.modules['{missing}'] = None\n" + START + code)
    assert text.startswith(f"PageServerError the browser view needs {missing}")
    assert "pip install viser==1.1.1" in text
    assert text.count("\n") == 1
