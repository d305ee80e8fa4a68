"""Start and end of a node's XML-RPC server, with rospy's own threads."""

import threading
import time

import pytest
from rosgraph.xmlrpc import XmlRpcNode
from rospy.impl.masterslave import ROSHandler
from waiting import DEADLINE, wait_for

from g1_description.ros.transport import xmlrpc_node
from g1_description.ros.transport.xmlrpc_node import end_at_once, start_at_once


class Patient(threading.Condition):
    """A condition whose waits end only when somebody notifies."""

    def __init__(self):
        super().__init__()
        self.is_waiting = threading.Event()

    def wait(self, timeout=None):
        self.is_waiting.set()
        return super().wait()


@pytest.fixture(name="node")
def _node(monkeypatch):
    monkeypatch.setattr(XmlRpcNode, "shutdown", XmlRpcNode.shutdown)  # put back later
    end_at_once()
    handler = ROSHandler("/ends", "http://localhost:1")
    handler.reg_man.cond = Patient()
    return XmlRpcNode(0, handler)


def started(node):
    """Start a node; give the thread of its server."""
    thread = threading.Thread(target=node.run, daemon=True)
    thread.start()
    wait_for(lambda: node.uri, "the server")
    return thread


def test_the_server_stops_looking_at_its_closed_socket(node):
    thread = started(node)
    node.shutdown("the test")
    thread.join(DEADLINE)
    assert not thread.is_alive()


def test_who_waits_for_registrations_is_woken_when_it_may_end(node):
    started(node)
    registrations = node.handler.reg_man
    thread = threading.Thread(target=registrations.run, daemon=True)
    thread.start()
    assert registrations.cond.is_waiting.wait(DEADLINE)
    node.shutdown("the test")
    thread.join(DEADLINE)
    assert not thread.is_alive()


def test_a_node_that_has_not_started_ends_as_well(node):
    node.shutdown("the test")
    assert node.is_shutdown
    node.shutdown("again")


@pytest.fixture(name="handler")
def _handler(monkeypatch):
    original = ROSHandler._is_registered
    monkeypatch.setattr(ROSHandler, "_is_registered", original)  # put back later
    start_at_once()
    return ROSHandler("/starts", "http://localhost:1")


def test_a_look_waits_for_the_registration_and_no_longer(handler, monkeypatch):
    """Rospy sleeps after a look in vain, however soon the registration comes."""
    monkeypatch.setattr(xmlrpc_node, "MAX_WAIT", DEADLINE)
    timer = threading.Timer(0.02, setattr, (handler.reg_man, "registered", True))
    begin = time.monotonic()
    timer.start()
    assert handler._is_registered()
    assert time.monotonic() - begin < 0.5 * DEADLINE
    timer.join()


def test_a_look_in_vain_ends(handler):
    begin = time.monotonic()
    assert not handler._is_registered()
    assert time.monotonic() - begin >= xmlrpc_node.MAX_WAIT
