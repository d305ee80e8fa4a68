"""Which calls of clients wait for the simulator's loop, and for what else."""

import itertools
import socket
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor

import pytest
from waiting import DEADLINE, wait_for

pytest.importorskip("rospy", reason="rospy is not installed")

import rospy
from rospy.impl.tcpros_base import TCPROSTransport
from rospy.impl.tcpros_service import TCPROSServiceClient
from std_srvs.srv import SetBool, SetBoolRequest

from g1_description.ros.gazebo.calls import Calls
from g1_description.ros.transport.prompt_service import PromptService

NUMBERS = itertools.count()


@pytest.fixture
def lock():
    return threading.Lock()


@pytest.fixture
def calls(lock):
    return Calls(lock)


@pytest.fixture
def client():
    with ThreadPoolExecutor(1) as pool:
        yield pool


def double(number):
    return 2 * number


def test_what_reads_is_answered_without_a_loop(calls):
    assert calls.serve("get_model_state", double)(21) == 42


def test_what_reads_waits_until_a_change_is_over(calls, lock, client):
    read = calls.serve("get_model_state", lambda _: lock.locked())
    with lock:
        answer = client.submit(read, None)
        wait_for(answer.running, "a reader")
        assert not answer.done()
    assert answer.result(DEADLINE)


def test_what_changes_waits_for_the_loop(calls, lock, client):
    change = calls.serve("set_model_state", lambda n: (double(n), lock.locked()), int)
    answer = client.submit(change, "21")
    wait_for(lambda: len(calls), "a call")
    assert not answer.done()
    assert calls.answer(0.0)
    assert answer.result(DEADLINE) == (42, True)
    assert not calls.answer(0.0)


def test_what_goes_wrong_is_the_callers(calls, client):
    answer = client.submit(calls.serve("delete_model", int), "none")
    wait_for(lambda: len(calls), "a call")
    assert calls.answer(0.0)
    with pytest.raises(ValueError, match="none"):
        answer.result(DEADLINE)


def test_nobody_waits_for_a_loop_that_is_over(calls, client):
    change = calls.serve("set_model_state", double)
    before = client.submit(change, 1)
    wait_for(lambda: len(calls), "a call")
    calls.cancel()
    for answer in (before, client.submit(change, 1)):
        with pytest.raises(rospy.ServiceException, match="shutting down"):
            answer.result(DEADLINE)


@pytest.fixture
def request_of(calls):
    """Send a request to a service of rospy's, through a pair of sockets."""
    here, there = socket.socketpair()

    def send(handler):
        name = f"served_{next(NUMBERS)}"  # rospy keeps names for ever
        service = PromptService(name, SetBool, handler, calls.callers)
        server = TCPROSTransport(service.protocol, name)
        server.set_socket(there, "client")
        arguments = server, {"persistent": "1"}
        threading.Thread(target=service.handle, args=arguments, daemon=True).start()
        client = TCPROSTransport(TCPROSServiceClient(name, SetBool), name)
        client.set_socket(here, "server")
        client.send_message(SetBoolRequest(True), 0)
        return client.receive_once

    with here, there:
        yield send
        here.shutdown(socket.SHUT_RDWR)


def test_the_loop_lets_those_finish_who_answer(calls, request_of):
    """A step would stop their threads until it is over."""
    is_answering, go_on = threading.Event(), threading.Event()

    def answer(_):
        is_answering.set()
        assert go_on.wait(DEADLINE)
        return True, ""

    answered = request_of(calls.serve("get_model_state", answer))
    assert is_answering.wait(DEADLINE)
    assert waits(calls, 0.2)
    threading.Timer(0.2, go_on.set).start()
    assert not waits(calls, DEADLINE)
    assert answered()[0].success


@pytest.mark.parametrize("outcome", ["answer", "error", "later", "cancelled"])
def test_the_loop_waits_for_nobody_who_waits_for_it(calls, request_of, outcome):
    later = Future()

    def act(_):
        if outcome == "error":
            raise ValueError(outcome)
        return later if outcome == "later" else (True, "")

    def prepare(request):
        assert not waits(calls, DEADLINE)  # parsing may take a second
        return request

    answered = request_of(calls.serve("set_model_state", act, prepare))
    wait_for(lambda: len(calls), "a call")
    assert not waits(calls, DEADLINE)
    if outcome == "cancelled":
        calls.cancel()
    else:
        assert calls.answer(0.0)
    if outcome == "later":
        assert not waits(calls, DEADLINE)
    later.set_result((True, ""))
    if outcome in ("answer", "later"):
        assert answered()[0].success
    else:
        with pytest.raises(rospy.ServiceException):
            answered()
    assert not waits(calls, DEADLINE)
    calls.callers.begin()  # nobody has been counted off twice
    assert waits(calls, 0.2)


def waits(calls, seconds):
    """Whether the loop waits for callers as long as it may."""
    end = time.monotonic() + seconds
    calls.callers.let_finish(end)
    return time.monotonic() >= end
