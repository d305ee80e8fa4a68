"""What came on joint_states and TF, and what others complain of."""

import os
import re
import signal
import subprocess
import tempfile

import rosgraph
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

from .ros_testing import DEADLINE, Listener, program, wait_for

SECOND = 1_000_000_000
"""[ns]"""
JUMP = SECOND // 2
"""Stamps that go back by more than this, in [ns], tell that the time did."""
TROUBLE = re.compile(r"TF_(?:REPEATED|OLD)_DATA .* for frame (\S+) at time ([\d.]+)")
NOTICED = "Detected jump back in time"
"""What a listener to TF says when it forgets the frames of before a reset."""
LISTENERS = {
    "tf_echo": ["map", "pelvis"],
    "tf_monitor": [],
}
"""Programs of tf, which listen each in its own way, and their arguments. None is a
rospy node: in a hurry rospy connects twice, and what is sent until then comes twice."""


def subscribers(topic):
    """Count who listens to a topic."""
    _, subscribed, _ = rosgraph.Master("/test").getSystemState()
    return len(dict(subscribed).get(topic, ()))


def splits(stamps):
    """Split stamps where the time went back."""
    lives = [stamps[:1]]
    for one, other in zip(stamps, stamps[1:]):
        if other < one - JUMP:
            lives.append([])
        lives[-1].append(other)
    return lives


class Others:
    """Nodes that know nothing of the bridge, and what they print about TF."""

    def __init__(self, topic="/tf"):
        already = subscribers(topic)
        self._outputs = [tempfile.TemporaryFile() for _ in LISTENERS]  # noqa: SIM115
        self._processes = [
            subprocess.Popen(
                [program(name, "tf"), *arguments, f"/tf:={topic}"],
                stdout=output,
                stderr=subprocess.STDOUT,
            )
            for (name, arguments), output in zip(LISTENERS.items(), self._outputs)
        ]
        wait_for(
            lambda: subscribers(topic) == already + len(LISTENERS),
            f"those who listen to {topic}",
        )

    def trouble(self):
        """List the frames and stamps that are complained of, by who does.

        What a listener says before it has noticed that time went back is left out: on
        a busy machine it may hear the new time only after transforms of it.
        """
        found = {
            name: TROUBLE.findall(text.rpartition(NOTICED)[2])
            for name, text in zip(LISTENERS, self._texts())
        }
        return {name: trouble for name, trouble in found.items() if trouble}

    def jumps(self):
        """Count the jumps of time that each has noticed."""
        return [text.count(NOTICED) for text in self._texts()]

    def _texts(self):
        """Read what each has printed so far."""
        for output in self._outputs:
            descriptor = output.fileno()
            data = os.pread(descriptor, os.fstat(descriptor).st_size, 0)
            yield data.decode("utf-8", "replace")

    def close(self):
        for process in self._processes:
            process.send_signal(signal.SIGINT)
        for process in self._processes:
            process.wait(DEADLINE)


class Record:
    """The stamps in [ns] of all that came."""

    def __init__(self):
        self._joints = Listener("/joint_states", JointState)
        self._frames = Listener("/tf", TFMessage)
        self._log = Listener("/rosout", Log)
        self._listeners = self._joints, self._frames, self._log

    def joints(self):
        """Give the stamps of joint states."""
        return [m.header.stamp.to_nsec() for m in list(self._joints.messages)]

    def frames(self):
        """Give the stamps of each child frame."""
        found = {}
        for message in list(self._frames.messages):
            for transform in message.transforms:
                stamps = found.setdefault(transform.child_frame_id, [])
                stamps.append(transform.header.stamp.to_nsec())
        return found

    def not_rising(self):
        """Count the stamps that are no newer than those before, by topic or frame."""
        found = {}
        for name, stamps in {"joint_states": self.joints(), **self.frames()}.items():
            for life in splits(stamps):
                count = sum(new <= old for old, new in zip(life, life[1:]))
                if count:
                    found[name] = found.get(name, 0) + count
        return found

    def trouble(self):
        """List the frames and stamps that the log complains of."""
        lines = [message.msg for message in list(self._log.messages)]
        return TROUBLE.findall("\n".join(lines))

    def clear(self):
        for listener in self._listeners:
            listener.clear()

    def close(self):
        for listener in self._listeners:
            listener.close()
