"""Ctrl-C ends a command at its work, and a node, quietly."""

import os
import signal
import subprocess
import sys

from sensor_msgs.msg import JointState
from support.ros_testing import DEADLINE, Connected, position_of, program

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


def test_a_command_at_its_work_ends_quietly_with_130():
    states = Connected("/joint_states", JointState)
    process = subprocess.Popen(
        [program("pose"), "squat", "--seconds", "60"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    rest = position_of(states.wait(), "left_knee_joint")
    states.wait(lambda m: position_of(m, "left_knee_joint") != rest, "the squat")
    os.killpg(process.pid, signal.SIGINT)
    out, errors = process.communicate(timeout=DEADLINE)
    states.close()
    assert (process.returncode, out, errors) == (130, "", "pose: interrupted.\n")


def test_a_node_hears_of_its_end_and_bears_a_second_signal():
    done = subprocess.run(
        [sys.executable, "-c", NODE], capture_output=True, timeout=DEADLINE, text=True
    )
    assert (done.stdout, done.stderr) == ("heard\nended\n", "")
