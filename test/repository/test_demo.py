"""The demo: what its terminal shows of roslaunch's and the nodes' words."""

import os
import signal
import subprocess
import threading

import pytest
from conftest import REPOSITORY
from waiting import wait_for

from ports import free_port

pytest.importorskip("rospy", reason="rospy is not installed")


@pytest.mark.slow
def test_a_wrong_argument_ends_it_with_its_sentence_alone():
    run = subprocess.run(
        ["/usr/bin/python3", REPOSITORY / "tools" / "demo.py", "physics:=holdd"],
        env={**os.environ, "ROS_MASTER_URI": f"http://localhost:{free_port()}"},
        capture_output=True,
        text=True,
    )
    assert run.returncode == 1
    (line,) = run.stderr.splitlines()
    assert line.startswith("tools/demo: Unknown physics 'holdd'. Known values: h")


def test_an_unknown_argument_is_told_with_the_most_similar_ones_first():
    demo = REPOSITORY / "tools" / "demo"
    run = subprocess.run([demo, "phisics:=hold"], capture_output=True, text=True)
    assert run.returncode == 1
    (line,) = run.stderr.splitlines()
    assert "no argument 'phisics'; it has physics, " in line
    assert "included" not in line
    assert line.count("model") == 1


class Running:
    """A demo, and the lines that its terminal shows."""

    def __init__(self, *arguments):
        uri = f"http://localhost:{free_port()}"
        self.environment = {**os.environ, "ROS_MASTER_URI": uri, "DISPLAY": ""}
        self.process = subprocess.Popen(
            ["/usr/bin/python3", REPOSITORY / "tools" / "demo.py", *arguments],
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.lines = []
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self):
        self.lines.extend(self.process.stdout)

    def shows(self, words):
        return self.count(words) > 0

    def count(self, words):
        return sum(words in line for line in self.lines)

    def __enter__(self):
        """Leave it running."""
        return self

    def __exit__(self, *_):
        """End it by Ctrl-C."""
        self.process.send_signal(signal.SIGINT)
        self.process.wait()
        self._reader.join()


@pytest.mark.slow
def test_each_mistake_is_shown_below_the_advice():
    with Running("rviz:=false", "web:=true", "host:=0.0.0.0", "port:=0") as demo:
        wait_for(lambda: demo.shows("Ctrl-C ends everything"), "the advice")
        wait_for(lambda: demo.shows("Anyone with this address"), "who has the token")
        words = "{name: [left_knee], position: [1.2]}"
        command = ["rostopic", "pub", "-r", "20", "/joint_commands"]
        with subprocess.Popen(
            [*command, "sensor_msgs/JointState", words], env=demo.environment
        ) as wrong:
            try:
                wait_for(lambda: demo.count("unknown joint") > 1, "another warning")
            finally:
                wrong.kill()
    assert demo.process.returncode == 0
    assert not demo.shows("[INFO]")
