"""A page of viser without a browser: its messages, kept and counted.

As many of these as one likes stand for as many browsers, without their drawing.
"""

import re
import socket
import threading
import time
from collections import Counter
from importlib.metadata import version
from urllib.parse import urlsplit, urlunsplit
from uuid import uuid4

import msgspec
import numpy as np
import zstandard
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

DEADLINE = 300.0
"""Longest wait for anything in [s]."""
PART = 512 * 1024
"""Largest part of an uploaded file, in bytes."""
SIZE = (1280, 800)
"""The picture that the page is told of, in [px]."""


class PageClient:
    """A connection to a viser server, with what a page would know.

    Attributes:
        elements: GUI elements by uuid: their type, and all properties with the
            newest values, such as label, value, min, disabled.
        nodes: The same of the nodes of the scene by name, with position and wxyz.
        others: The newest of all other messages by type.
        bytes: How many came, as sent through the WebSocket.
        messages: How many came; several share a frame.
        times: When each name or uuid last changed, as of `time.monotonic`.
        counts: How often each has; by type and name, too.
        has_ended: Whether the connection has.
        error: What ended it, if it did not end in good order.
    """

    def __init__(self, address, headers=None):
        """Connect, and say what a page says first.

        Args:
            address: Of the page, http:// with path and query, such as a token.
            headers: More of the request, such as {"Cookie": "token=1"}.
        """
        self.elements, self.nodes, self.others, self.times = {}, {}, {}, {}
        self.counts = Counter()
        self.bytes = self.messages = 0
        self.has_ended, self.error = False, None
        self._news = threading.Condition()
        self._socket = connect(
            _websocket_address(address),
            subprotocols=[f"viser-v{version('viser')}"],
            additional_headers=headers,
            compression=None,
            max_size=None,
            open_timeout=DEADLINE,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        self.send("ViewerCameraMessage", **_camera())

    def __enter__(self):
        """Give itself."""
        return self

    def __exit__(self, *_):
        """Hang up."""
        self.close()

    def close(self):
        """Hang up as a page does that is closed."""
        self._socket.close()
        self._reader.join(DEADLINE)

    def vanish(self):
        """Hang up without a word, as a laptop that loses the network."""
        self._socket.socket.shutdown(socket.SHUT_RDWR)
        self._reader.join(DEADLINE)

    # --- what comes -----------------------------------------------------------

    def _read(self):
        try:
            for data in self._socket:
                messages = messages_of(data)
                with self._news:
                    self.bytes += len(data)
                    self.messages += len(messages)
                    for message in messages:
                        self._keep(message)
                    self._news.notify_all()
        except (ConnectionClosed, OSError) as error:
            self.error = error
        finally:
            with self._news:
                self.has_ended = True
                self._news.notify_all()

    def _keep(self, message):
        kind = message.pop("type")
        name = message.get("uuid", message.get("name"))
        things = self.elements if "uuid" in message else self.nodes
        self.times[kind if name is None else name] = time.monotonic()
        self.counts[kind if name is None else name] += 1
        self.counts[kind, name] += 1
        if message.get("virtual") and name in things:
            return  # stands for what is there, below something of this page's own
        if kind in ("GuiRemoveMessage", "RemoveSceneNodeMessage"):
            things.pop(name, None)
        elif name is None:
            self.others[kind] = message
        elif "props" in message:
            props = message.pop("props")
            things[name] = {"type": kind, **things.get(name, {}), **message, **props}
            things[name]["type"] = kind
        else:  # an update, or one property of a node
            news = message.pop("updates", message)
            things.setdefault(name, {"type": kind}).update(news)

    def wait_for(self, condition, what, timeout=DEADLINE):
        """Wait until a condition gives something true; give that back.

        Args:
            condition: Called after each frame from the server.
            what: Completes "waited in vain for".
            timeout: Longest wait in [s].
        """
        with self._news:
            self._news.wait_for(lambda: condition() or self.has_ended, timeout)
            result = condition()
        if not result:
            raise AssertionError(
                f"waited up to {timeout} s in vain for {what}; {self.error}"
            )
        return result

    def wait_until_whole(self, timeout=DEADLINE):
        """Wait until the server has sent all that there was before this page."""
        self.wait_for(
            lambda: "ReplayDoneMessage" in self.others, "a whole page", timeout
        )

    def element(self, label):
        """Wait for the GUI element with a label; give its properties, uuid too."""
        return self.wait_for(lambda: self.find(label), f"'{label}'")

    def find(self, label):
        """Give the properties of the element with a label; None if there is none."""
        found = (
            element
            for element in [*self.elements.values()]
            if element.get("label") == label
        )
        return next(found, None)

    def says(self, words):
        """Tell whether a text or a notice of the page has these words."""
        texts = (
            f"{element.get('_markdown', '')} {element.get('body', '')}"
            for element in [*self.elements.values()]
        )
        return any(words in re.sub(r"[\\*]", "", text) for text in texts)

    def value(self, label):
        """Give the newest value of the element with a label."""
        return self.element(label)["value"]

    # --- what goes ------------------------------------------------------------

    def send(self, kind, **fields):
        """Send a message of viser's by its type."""
        self.send_bytes(msgspec.msgpack.encode({"type": kind, **fields}))

    def send_bytes(self, data):
        """Send anything, which need not be a message."""
        self._socket.send(data)

    def set(self, label, value):
        """Set the value of the element with a label, as one who drags or types."""
        element = self.element(label)
        element["value"] = value  # the server tells all pages but this one
        self.send("GuiUpdateMessage", uuid=element["uuid"], updates={"value": value})

    def press(self, label):
        """Press the button with a label."""
        self.set(label, True)

    def upload(self, label, name, content):
        """Give a file to the upload button with a label."""
        button = self.element(label)["uuid"]
        transfer = {"source_component_uuid": button, "transfer_uuid": uuid4().hex}
        parts = [content[at : at + PART] for at in range(0, len(content), PART)]
        self.send(
            "FileTransferStartUpload",
            **transfer,
            filename=name,
            mime_type="",
            part_count=len(parts),
            size_bytes=len(content),
        )
        for number, part in enumerate(parts):
            fields = {"part_index": number, "content": part}
            self.send("FileTransferPart", **transfer, **fields)


def messages_of(data):
    """Decode a frame from the server: its messages with their arrays.

    A frame is two lengths of 8 bytes, of the inner part and of that compressed;
    the compressed part; then the arrays, each at a multiple of 8 bytes.
    """
    length = int.from_bytes(data[8:16], "little")
    inner = zstandard.ZstdDecompressor().decompress(data[16 : 16 + length])
    frame = msgspec.msgpack.decode(inner)
    start, arrays = 16 + length, []
    for size in frame["binaryBufferLengths"]:
        start += -start % 8
        arrays.append(memoryview(data)[start : start + size])
        start += size
    return [_filled(message, arrays) for message in frame["messages"]]


def _filled(value, arrays):
    if isinstance(value, list):
        return [_filled(entry, arrays) for entry in value]
    if not isinstance(value, dict):
        return value
    if "__binary_index" in value:
        return np.frombuffer(arrays[value["__binary_index"]], value["dtype"])
    return {key: _filled(entry, arrays) for key, entry in value.items()}


def _websocket_address(address):
    scheme, place, path, query, _ = urlsplit(address)
    scheme = {"http": "ws", "https": "wss"}.get(scheme, scheme)
    return urlunsplit((scheme, place, path or "/", query, ""))


def _camera():
    width, height = SIZE
    pose = {"wxyz": (0.0, 1.0, 0.0, 0.0), "position": (0.0, 0.0, 3.0)}
    view = {"fov": 1.3, "near": 0.01, "far": 1000.0, "look_at": (0.0, 0.0, 0.0)}
    size = {"image_height": height, "image_width": width}
    return {**pose, **view, **size, "up_direction": (0.0, 1.0, 0.0)}
