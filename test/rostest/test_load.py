"""Fifty clients at once, while physics runs and somebody listens."""

import multiprocessing
import os
import sys
import time
import unittest

import numpy as np
from gazebo_msgs.msg import LinkStates
from support.ros_testing import DEADLINE, Listener, wait_for
from support.stand_in import Node

from tcpros import ANSWER, Service, body_of, packed, received

CLIENTS = 50
PROCESSES = 2
SECONDS = 5.0
WANTED = float(os.environ.get("LOAD_RATE", "2000"))
"""Calls per second of all clients together."""
LEAST = float(os.environ.get("LOAD_LEAST", "500"))
"""Calls per second of its processor time that must be reached on any machine; how long
each takes is printed, as that depends on what else the machine does."""


def requests():
    """Give connections to two services in turn, with the bytes of a request."""
    state = Service("/gazebo/get_model_state")
    joints = Service("/gazebo/set_model_configuration")
    lists = ["left_elbow_joint"], [0.5]
    bodies = (
        (state, body_of(state.request_class("g1_robot", ""))),
        (joints, body_of(joints.request_class("g1_robot", "", *lists))),
    )
    return [(service, packed(body)) for service, body in bodies]


def call(count, start, results):
    """Be some of the clients: each calls in its turn, at the rate that is wanted."""
    pairs = requests()
    sockets = [(pairs[n % 2][0].connect(), pairs[n % 2][1]) for n in range(count)]
    start.wait()
    period = CLIENTS / WANTED
    begin = time.monotonic()
    sent = [begin + period * n / count for n in range(count)]
    latencies = []
    while time.monotonic() < begin + SECONDS:
        now = time.monotonic()
        due = [n for n in range(count) if sent[n] <= now]
        for n in due:
            sockets[n][0].sendall(sockets[n][1])
        asked = time.monotonic()
        for n in due:
            ok, length = ANSWER.unpack(received(sockets[n][0], ANSWER.size))
            received(sockets[n][0], length)
            assert ok
            latencies.append(time.monotonic() - asked)
            sent[n] = max(sent[n] + period, now)
        if not due:
            time.sleep(max(0.0, min(sent) - time.monotonic()))
    results.put(latencies)


class TestLoad(unittest.TestCase):
    def test_fifty_clients(self):
        node = Node()
        self.addCleanup(node.kill)
        cost = node.cost()
        listener = Listener("/gazebo/link_states", LinkStates)
        self.addCleanup(listener.close)
        start = multiprocessing.Barrier(PROCESSES + 1)
        results = multiprocessing.Queue()
        arguments = CLIENTS // PROCESSES, start, results
        callers = [
            multiprocessing.Process(target=call, args=arguments, daemon=True)
            for _ in range(PROCESSES)
        ]
        for caller in callers:
            caller.start()
        start.wait()
        processor, wall = node.seconds_of_processor(), time.monotonic()
        factor = node.real_time_factor(SECONDS * 0.9)
        share = (node.seconds_of_processor() - processor) / (time.monotonic() - wall)
        latencies = np.concatenate([results.get(timeout=DEADLINE) for _ in callers])
        for caller in callers:
            caller.join(DEADLINE)
            self.assertEqual(caller.exitcode, 0)
        median, late = np.percentile(latencies, (50, 99)) * 1e3
        print(
            f"load: {len(latencies) / SECONDS:.0f} calls/s of {WANTED:.0f}, median "
            f"{median:.1f} ms, p99 {late:.1f} ms, real-time factor {factor:.2f}, "
            f"processor share {share:.2f}, {node.threads()} threads",
            file=sys.stderr,
        )
        self.assertGreater(len(latencies) / (share * SECONDS), LEAST)
        # A robot that lies on the floor costs more than one that begins to fall.
        wait_for(lambda: node.cost() < 3.0 * cost, "steps that cost what they did")
        self.assertEqual(node.trouble(), [])
