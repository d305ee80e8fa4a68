"""Ctrl-C ends the commands quietly, at whatever moment."""

import contextlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

from sensor_msgs.msg import JointState
from support.ros_testing import (
    DEADLINE,
    REPOSITORY,
    Connected,
    children_time,
    processor_time,
    program,
    wait_for,
)

ENDS = (0, 130, -signal.SIGINT)
"""Exit codes: too late, interrupted, and interrupted before Python runs, which shells
show as 130 too."""
OURS = "g1_description/ros/"
"""In tracebacks of what we import; before that Python itself answers signals."""
STEPS = 4
"""Moments from a command's start to its end."""
SEED = 1
NODES = ("gazebo_stand_in.py", "link_states_bridge.py", "checker.py", "web.py")
"""Programs that run until they are interrupted; tools/interrupts takes all."""
APART = ("__ns:=/apart", "/clock:=/apart/clock", "_port:=0")
"""Arguments of a node beside one of its name."""
LATE = """
import threading, rospy
from g1_description.ros.lifecycle import at_shutdown, start_node

start_node("late")
begun, goes_on, called = threading.Event(), threading.Event(), threading.Event()

def hold_up():
    begun.set()
    goes_on.wait()

rospy.on_shutdown(hold_up)
shutdown = threading.Thread(target=rospy.signal_shutdown, args=("test",))
shutdown.start()
begun.wait()
threading.Timer(0.2, goes_on.set).start()
at_shutdown(called.set)
shutdown.join()
print(called.is_set())
"""
"""Wants to hear of the end after that has begun."""
TWICE = """
import os, signal, threading, rospy
from g1_description.ros.lifecycle import start_node

start_node("twice")
answers = next(t for t in threading.enumerate() if t.name.startswith("Thread-1"))
os.kill(os.getpid(), signal.SIGINT)
rospy.spin()
answers.join()
os.kill(os.getpid(), signal.SIGINT)
print("ended")
"""
"""Is interrupted again after it has ended as a node."""


def start(*words):
    return subprocess.Popen(
        [program(words[0]), *map(str, words[1:])],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


class TestInterrupts(unittest.TestCase):
    def setUp(self):
        Connected("/joint_states", JointState).close()
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def interrupt(self, *words):
        """Interrupt a command at moments from its start to its end.

        They are told by its processor time, whatever else the machine does.
        """
        before = children_time()
        _, errors = start(*words).communicate(timeout=DEADLINE)
        self.assertNotIn("Traceback", errors)
        length = children_time() - before
        codes = {n / STEPS: self.code(n / STEPS * length, words) for n in range(STEPS)}
        for _ in range(STEPS):
            if 130 in codes.values():
                break
            # It took more or less time than before: look between too early and late.
            early = max(part for part, code in codes.items() if code != 0)
            late = min([part for part, code in codes.items() if code == 0] or [2.0])
            between = 0.5 * (early + late)
            codes[between] = self.code(between * length, words)
        print(f"{words[0]} of {length:.1f} s: {codes}", file=sys.stderr)
        self.assertIn(130, codes.values())

    def code(self, delay, words):
        """Interrupt a command when it has used some processor time, in [s].

        Returns:
            Its exit code.
        """
        process = start(*words)
        self.addCleanup(process.kill)
        wait_for(
            lambda: process.poll() is not None or processor_time(process.pid) >= delay,
            "the moment of the interrupt",
        )
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGINT)
        _, errors = process.communicate(timeout=DEADLINE)
        self.assertNotIn(OURS, errors, delay)
        if "Traceback" not in errors:
            self.assertIn(process.returncode, ENDS, (delay, errors))
        return process.returncode

    def test_nodes_while_they_start(self):
        draw = random.Random(SEED)
        for name in NODES:
            self.code(draw.uniform(0.1, 0.9), (name, *APART))

    def test_what_wants_to_hear_of_the_end_too_late_hears_it(self):
        done = subprocess.run(
            [sys.executable, "-c", LATE],
            stdout=subprocess.PIPE,
            timeout=DEADLINE,
            text=True,
        )
        self.assertEqual(done.stdout, "True\n")

    def test_a_second_signal_is_as_quiet(self):
        done = subprocess.run(
            [sys.executable, "-c", TWICE],
            capture_output=True,
            timeout=DEADLINE,
            text=True,
        )
        self.assertEqual((done.stdout, done.stderr), ("ended\n", ""))

    def test_pose(self):
        self.interrupt("pose", "squat", "--seconds", "0.5")

    def test_a_list_of_poses(self):
        self.interrupt("pose", "--list")

    def test_snapshot(self):
        self.interrupt("snapshot", self.folder / "a.png", "--size", "320x240")

    def test_snapshot_of_a_file(self):
        model = REPOSITORY / "urdf" / "g1_29dof.urdf"
        picture = self.folder / "a.png"
        self.interrupt("snapshot", picture, "--size", "320x240", "--model", model)
