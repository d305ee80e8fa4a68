"""From a command to the joint_states that show it.

A process without rospy publishes random configurations within the limits, from a seed,
on /joint_commands, and reads /joint_states until all joints are within 0.02 rad. It
waits 5 to 25 ms between commands, so that they arrive at any time between two steps.
States of every step are published. The largest error is that of the joint_states in
kinematic. A robot that lies on the floor gets commands for the last two joints of each
limb only, with a tolerance of 0.2 rad: other joints would push limbs into the floor,
and the contact would throw the robot.
"""

from __future__ import annotations

import time
from contextlib import closing
from typing import NamedTuple

import numpy as np
from sensor_msgs.msg import JointState
from urdf_parser_py.urdf import URDF

from .nodes import EACH_STEP, Graph, MeasurementError, wait_for
from .peer import Peer
from .standin import FALL, HANGING
from .stream import no_collector, read_urdf
from tcpros import Service, body_of, packed

TIMEOUT = 2.0  # [s]
PAUSES = (0.005, 0.025)  # [s]
APART = 0.5  # [rad] from one configuration to the next, for one joint at least


class Case(NamedTuple):
    """One way to run the simulator."""

    name: str
    arguments: tuple
    trials: int = 200
    targets: tuple = ("", "")
    near: float = 0.02
    """Largest difference of a joint in [rad]."""

    lies: bool = False


CASES = (
    Case("kinematic", ("physics:=kinematic",), 300),
    Case("limp, hanging", HANGING, targets=("< 3", "< 10")),
    Case("limp, lying", ("physics:=limp",), 200, ("< 3", "< 10"), 0.2, True),
)


class Commander:
    """Sends configurations and sees them come back."""

    def __init__(self, peer, joints, near):
        """Make the topics.

        Args:
            peer: The node that sends.
            joints: Joints of URDF that are told where to go.
            near: Largest difference in [rad] of what counts as there.
        """
        self._peer, self._near = peer, near
        self._names = [joint.name for joint in joints]
        self._bounds = np.array([(j.limit.lower, j.limit.upper) for j in joints]).T
        self._flows = False
        self._wanted, self._came, self._error = None, np.nan, np.nan
        self._commands = peer.advertise("/joint_commands", JointState)
        peer.subscribe("/joint_states", JointState, self._take)

    def wait(self):
        """Wait until the bridge listens, and states flow."""
        self._peer.wait(lambda: self._commands.callers and self._flows, "the bridge")

    def _take(self, now, body):
        """Look whether joint states are those that are wanted."""
        self._flows = True
        if self._wanted is None:
            return
        state = JointState().deserialize(body)
        position = dict(zip(state.name, state.position))
        told = np.array([position.get(name, np.nan) for name in self._names])
        error = np.abs(told - self._wanted).max()
        if error < self._near:
            self._wanted, self._came, self._error = None, now, error

    def try_one(self, wanted, pause):
        """Send one configuration.

        Args:
            wanted: Positions in [rad], shape (n_joints,).
            pause: Wait before, in [s].

        Returns:
            Time until it came back in [s] and its error in [rad]; NaN if it did not.
        """
        command = JointState(name=self._names, position=wanted.tolist())
        data = packed(body_of(command))
        self._peer.serve(time.monotonic() + pause)
        self._wanted, self._came, self._error = wanted, np.nan, np.nan
        start = time.monotonic()
        self._commands.send(data)
        self._peer.serve(start + TIMEOUT, lambda: self._wanted is None)
        return self._came - start, self._error

    def try_all(self, trials, seed):
        """Send random configurations; list what ``try_one`` gives of each."""
        random = np.random.default_rng(seed)
        wanted, tried = np.inf, []
        with no_collector():
            for _ in range(trials):
                wanted = self._elsewhere(random, wanted)
                tried.append(self.try_one(wanted, random.uniform(*PAUSES)))
        return tried

    def _elsewhere(self, random, last):
        """Draw a configuration that is clearly another than the last."""
        while True:
            wanted = random.uniform(*self._bounds)
            if np.abs(wanted - last).max() > APART:
                return wanted


def run(bench):
    """Measure each kind of physics."""
    robot = URDF.from_xml_string(read_urdf(bench.model))
    for case in CASES:
        trials = bench.count(case.trials)
        with bench.attempt(f"{case.name}, {trials} commands"):
            joints = last_joints(robot) if case.lies else revolute(robot)
            report(bench, case, *measure(bench, joints, case, trials))


def revolute(robot):
    """List the joints that turn between limits."""
    return [joint for joint in robot.joints if joint.type == "revolute"]


def last_joints(robot):
    """List the joints with one other below them at most."""
    below = dict.fromkeys(robot.link_map, 0)
    for joint in revolute(robot):
        link = joint.parent
        while link in robot.parent_map:
            below[link] += 1
            link = robot.parent_map[link][1]
    return [joint for joint in revolute(robot) if below[joint.child] <= 1]


def report(bench, case, times, errors):
    """Keep the figures of one kind of physics."""
    came = np.isfinite(times)
    if not came.any():
        raise MeasurementError("no command was seen to arrive")
    name = f"{case.name}: command to joint_states"
    bench.add_latencies(name, times[came], case.targets)
    bench.add(f"{case.name}: commands", len(times))
    bench.add(f"{case.name}: commands never seen", (~came).sum(), "", "= 0")
    if case.name == "kinematic":
        largest = errors[came].max()
        bench.add(f"{case.name}: largest error", largest, "rad", "<= 1e-9")


def measure(bench, joints, case, trials):
    """Send configurations; give times in [s] and errors in [rad], shape (2, n)."""
    launched = (bench.model, EACH_STEP, *case.arguments)
    with Graph() as graph, graph.launch(*launched), closing(Peer()) as peer:
        commander = Commander(peer, joints, case.near)
        commander.wait()
        if case.lies:
            world = Service("/gazebo/get_world_properties")
            wait_for(lambda: world().sim_time > FALL, "the robot's fall")
        return np.array(commander.try_all(trials, bench.seed)).T
