"""Files that are dropped into the page: taken, told on, and gone afterwards."""

import json
import re
import threading
from urllib.parse import urlencode

import pytest

pytest.importorskip("viser", reason="viser is not there")

from hypothesis import given
from hypothesis import strategies as st
from web_clients import TIMEOUT, fetch, join, opened, wait_until
from websockets.exceptions import ConnectionClosed, InvalidStatus

from g1_description.errors import MotionError
from g1_description.web.server.uploads import MAX_AT_ONCE, clean_name

MAX_UPLOAD = 3 * 2**20


class Reader:
    """What takes files in these tests, and what it was given."""

    def __init__(self):
        self.paths = []
        self.go = threading.Event()
        self.waiting = 0

    def __call__(self, name, path):
        self.paths.append(path)
        content = path.read_bytes()
        if content == b"bad":
            raise MotionError(f"{name} has no joints")
        if content == b"worse":
            raise ValueError("line 3\nline 4")
        if content == b"slow":
            self.waiting += 1
            assert self.go.wait(TIMEOUT)
        return f"{name}: {len(content)} bytes, {sum(content)}"


@pytest.fixture(scope="module")
def reader():
    return Reader()


@pytest.fixture(scope="module")
def server(reader):
    with opened(on_file=reader, max_upload=MAX_UPLOAD) as server:
        yield server


def begin(server, name, size):
    return join(server, "/upload?" + urlencode({"name": name, "size": size}))


def receive(page):
    return json.loads(page.recv(timeout=TIMEOUT))


def upload(server, name, pieces, size=None):
    """Upload a file; return the answer."""
    size = sum(map(len, pieces)) if size is None else size
    with begin(server, name, size) as page:
        answer = receive(page)
        if answer["state"] == "ready":
            for piece in pieces:
                page.send(piece)
            answer = receive(page)
        return answer


def test_a_file_arrives_whole_and_is_deleted(server, reader):
    pieces = [bytes([number]) * 2**18 for number in range(1, 9)]
    answer = upload(server, "walk.csv", pieces)
    total = 36 * 2**18
    assert answer == {"state": "done", "text": f"walk.csv: {2**21} bytes, {total}"}
    path = reader.paths[-1]
    assert path.suffix == ".csv"
    wait_until(lambda: not path.parent.exists(), "deleted")


def test_an_empty_file_is_one_too(server):
    assert upload(server, "a.npz", [])["text"] == "a.npz: 0 bytes, 0"


def test_an_error_is_told_in_its_sentence(server, reader):
    bad = upload(server, "a.csv", [b"bad"])
    assert bad == {"state": "failed", "text": "a.csv has no joints"}
    worse = upload(server, "a.csv", [b"worse"])
    assert worse == {"state": "failed", "text": "a.csv cannot be read: line 3"}
    wait_until(lambda: not reader.paths[-1].parent.exists(), "deleted")


def test_a_file_that_is_too_large_is_refused_unread(server, reader):
    before = len(reader.paths)
    with begin(server, "big.npz", MAX_UPLOAD + 1) as page:
        answer = receive(page)
    text = "big.npz is larger than the 3 MiB that the page takes"
    assert answer == {"state": "failed", "text": text}
    assert upload(server, "fits.npz", [bytes(MAX_UPLOAD)])["state"] == "done"
    assert len(reader.paths) == before + 1


def test_more_than_was_announced_is_refused(server, reader):
    before = len(reader.paths)
    answer = upload(server, "a.csv", [b"12", b"345"], size=4)
    assert answer["state"] == "failed"
    assert "not the one that was announced" in answer["text"]
    assert upload(server, "a.csv", ["text"], size=9)["state"] == "failed"
    assert len(reader.paths) == before


@pytest.mark.parametrize("size", ["", "-1", "1e9", "9" * 99, "x"])
def test_a_size_is_wanted(server, size):
    with begin(server, "a.csv", size) as page:
        text = "the browser does not say how large a.csv is"
        assert receive(page) == {"state": "failed", "text": text}


def test_who_leaves_on_the_way_leaves_nothing(server, reader):
    before = len(reader.paths)
    with begin(server, "a.csv", 9) as page:
        receive(page)
        page.send(b"123")
    assert upload(server, "b.csv", [b"1"])["state"] == "done"
    assert len(reader.paths) == before + 1


@pytest.mark.parametrize(
    "name", ["../../etc/passwd", "/etc/cron.d/x", "..\\..\\x", "..", "a/..", "\0"]
)
def test_a_path_of_the_browser_is_not_used(server, reader, name):
    answer = upload(server, name, [b"1"])
    assert answer["text"].endswith(": 1 bytes, 49")
    assert re.fullmatch("upload_[0-9a-f]{8}", reader.paths[-1].name)
    assert reader.paths[-1].parent.name.startswith("g1_description_upload_")


@given(st.text())
def test_a_name_can_be_shown(name):
    cleaned = clean_name(name)
    assert cleaned.isprintable()
    assert 0 < len(cleaned) <= 120
    assert not set("/\\") & set(cleaned)


def test_only_a_few_are_taken_at_once(server, reader):
    pages = [begin(server, "a.csv", 4) for _ in range(MAX_AT_ONCE)]
    for page in pages:
        assert receive(page) == {"state": "ready"}
        page.send(b"slow")
    wait_until(lambda: reader.waiting == MAX_AT_ONCE, "all are being read")
    assert "again later" in upload(server, "one.csv", [b"1"])["text"]
    assert fetch(server).status == 200
    reader.go.set()
    for page in pages:
        assert receive(page)["state"] == "done"
        page.close()
    assert upload(server, "one.csv", [b"1"])["state"] == "done"


def test_a_page_may_take_none():
    with opened() as server:
        text = "this page takes no files"
        assert upload(server, "a", [b"1"]) == {"state": "failed", "text": text}


def test_a_page_that_only_shows_takes_none(reader):
    before = len(reader.paths)
    with opened(on_file=reader, read_only=True) as server:
        with pytest.raises(InvalidStatus) as caught:
            begin(server, "a", 1)
        assert caught.value.response.status_code == 403
        assert b"only shows" in caught.value.response.body
        assert b"const readOnly = true;" in fetch(server).body
    assert len(reader.paths) == before


def test_the_connection_ends_with_the_answer(server):
    with begin(server, "a", 1) as page:
        receive(page)
        page.send(b"1")
        receive(page)
        with pytest.raises(ConnectionClosed):
            page.recv(timeout=TIMEOUT)
