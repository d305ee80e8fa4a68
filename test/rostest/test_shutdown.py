"""The simulator ends when it is told to, whatever it is doing."""

import signal
import socket
import subprocess
import sys
import threading
import unittest

from gazebo_msgs.msg import LinkStates
from rosgraph_msgs.msg import Clock
from support.ros_testing import DEADLINE, Listener, wait_for
from support.stand_in import Node

from tcpros import Service

NODE = """
import os, signal, threading, rospy
from g1_description.ros.lifecycle import at_shutdown, start_node

start_node("twice")
begun, goes_on, called = threading.Event(), threading.Event(), threading.Event()

def hold_up():
    begun.set()
    goes_on.wait()

rospy.on_shutdown(hold_up)
answers = next(t for t in threading.enumerate() if t.name.startswith("Thread-1"))
os.kill(os.getpid(), signal.SIGINT)
begun.wait()
threading.Timer(0.2, goes_on.set).start()  # until then rospy holds its lock
at_shutdown(called.set)
answers.join()
print("heard" if called.is_set() else "lost")
os.kill(os.getpid(), signal.SIGINT)
print("ended")
"""
"""Wants to hear of its end when that has begun, and is interrupted again after it."""


class TestShutdown(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        # A node that publishes a thousand times a second has more to end than an
        # idle one.
        for topic, kind in (("/clock", Clock), ("/gazebo/link_states", LinkStates)):
            cls.addClassCleanup(Listener(topic, kind).close)

    def end(self, prepare, number, has_callers=False):
        """Start the node, prepare it, end it.

        Args:
            prepare: Called with the node; gives what to do at the end, if anything.
            number: Signal that ends it.
            has_callers: Whether calls are to be answered while it ends. A busy machine
                takes longer for them than the node waits; then it says what ended it.
        """
        node = Node("_physics:=limp", "_z:=0.793")
        self.addCleanup(node.kill)
        wait = prepare(node)
        node.end(number)
        codes = (0, 128 + number) if has_callers else (0,)
        self.assertIn(node.process.returncode, codes)
        self.assertEqual(node.trouble(), [])
        if wait:
            wait()

    def test_while_it_runs_and_a_client_says_nothing(self):
        def prepare(node):
            sock = socket.create_connection(node.services["step"].place)
            self.addCleanup(sock.close)
            held = Service("/gazebo/step").connect()
            self.addCleanup(held.close)
            begin = node.time()
            wait_for(lambda: node.time() > begin + 0.2, "simulated time")

        self.end(prepare, signal.SIGTERM)

    def test_while_a_million_steps_are_asked_for(self):
        def prepare(node):
            node.services.call("pause_physics")
            before = node.time()
            return self.callers(node, 1, "step", 1_000_000, until=before)

        self.end(prepare, signal.SIGINT, has_callers=True)

    def test_while_fifty_clients_call(self):
        bend = "set_model_configuration", "g1_robot", "", ["left_knee_joint"], [0.5]
        look = "get_model_state", "g1_robot", ""

        def prepare(node):
            waits = self.callers(node, 40, *bend), self.callers(node, 10, *look)
            return lambda: [wait() for wait in waits]

        self.end(prepare, signal.SIGTERM, has_callers=True)

    def callers(self, node, count, name, *args, until=None):
        """Call a service in threads; give what waits for the end of them all."""
        started = threading.Barrier(count + 1)

        def call():
            service = Service(f"/gazebo/{name}", timeout=DEADLINE)
            service.connect().close()
            started.wait(DEADLINE)
            while True:
                try:
                    service(*args)
                except ConnectionError:
                    return

        threads = [threading.Thread(target=call, daemon=True) for _ in range(count)]
        for thread in threads:
            thread.start()
        started.wait(DEADLINE)
        if until is not None:
            wait_for(lambda: node.time() != until, "a step")

        def wait():
            for thread in threads:
                thread.join(DEADLINE)
                self.assertFalse(thread.is_alive(), "a caller waits for ever")

        return wait


def test_a_node_hears_of_its_end_and_bears_a_second_signal():
    done = subprocess.run(
        [sys.executable, "-c", NODE], capture_output=True, timeout=DEADLINE, text=True
    )
    assert (done.stdout, done.stderr) == ("heard\nended\n", "")
