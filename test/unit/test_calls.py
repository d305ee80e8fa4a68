"""Which calls of clients wait for the simulator's loop, and for what else."""

import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor

import pytest
from waiting import wait_for

pytest.importorskip("rospy", reason="rospy is not installed")

import rospy

from g1_description.ros.gazebo.calls import Calls

DEADLINE = 60.0


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


def test_the_loop_lets_a_caller_finish_that_has_its_answer(calls, client):
    """A step would keep it from answering until the step is over."""
    change = calls.serve("set_model_state", double)
    is_sent = threading.Event()

    def answer_a_client():
        calls.callers.begin()
        change(21)
        is_sent.wait(DEADLINE)
        calls.callers.end()

    caller = client.submit(answer_a_client)
    wait_for(lambda: len(calls), "a call")
    assert (
        duration_of(calls.callers.let_finish, DEADLINE) < 1.0
    )  # it waits for the loop
    assert calls.answer(0.0)
    assert duration_of(calls.callers.let_finish, 0.2) >= 0.2
    threading.Timer(0.2, is_sent.set).start()
    assert 0.1 < duration_of(calls.callers.let_finish, DEADLINE) < 10.0
    caller.result(DEADLINE)


@pytest.mark.parametrize("outcome", ["answer", "error", "later", "cancelled"])
def test_no_caller_is_counted_who_has_left(calls, client, outcome):
    """The loop would wait for it before each step."""
    later = Future()

    def act(_):
        if outcome == "error":
            raise ValueError(outcome)
        return later if outcome == "later" else outcome

    def answer_a_client():
        calls.callers.begin()
        try:
            calls.serve("step", act)(None)
        finally:
            calls.callers.end()

    caller = client.submit(answer_a_client)
    wait_for(lambda: len(calls), "a call")
    if outcome == "cancelled":
        calls.cancel()
    else:
        assert calls.answer(0.0)
    later.set_result(outcome)
    caller.exception(DEADLINE)
    assert duration_of(calls.callers.let_finish, DEADLINE) < 1.0


def duration_of(act, *arguments):
    """Give how long a call takes, in [s]."""
    begin = time.monotonic()
    act(*arguments)
    return time.monotonic() - begin
