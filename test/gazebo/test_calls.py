"""Which calls of clients wait for the simulator's loop, and for what else."""

import threading
from concurrent.futures import Future, ThreadPoolExecutor

import pytest
from waiting import DEADLINE, wait_for

pytest.importorskip("rospy", reason="rospy is not installed")

import rospy

from g1_description.gazebo.node import Calls


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


@pytest.mark.parametrize("outcome", ["answer", "error", "cancelled"])
def test_an_answer_may_come_later_than_the_loops(calls, client, outcome):
    later = Future()
    answer = client.submit(calls.serve("step", lambda _: later), None)
    wait_for(lambda: len(calls), "a call")
    assert calls.answer(0.0)
    assert not answer.done()
    if outcome == "answer":
        later.set_result(42)
        assert answer.result(DEADLINE) == 42
    elif outcome == "error":
        later.set_exception(ValueError(outcome))
        with pytest.raises(ValueError, match=outcome):
            answer.result(DEADLINE)
    else:
        later.cancel()
        with pytest.raises(rospy.ServiceException, match="shutting down"):
            answer.result(DEADLINE)
