"""Measure what the package costs on this machine. Called by tools/benchmark."""

from __future__ import annotations

import argparse
import gc
import inspect
import json
import operator
import os
import platform
import signal
import struct
import sys
import time
import xml.etree.ElementTree as ET
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

import genpy
import numpy as np
import tf2_py
from g1_description.msg import MotorStates, SimulatorState
from gazebo_msgs.msg import LinkStates, ModelState
from geometry_msgs.msg import Point, Pose, Quaternion, Twist
from rosgraph import MasterException
from rosgraph_msgs.msg import Clock
from rosservice import ROSServiceException
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

from g1_description import Robot, Scene
from g1_description.ros.conversions import model_trajectory

from .browser import browser, burners, is_open
from .causes import causes
from .clutter import clutter
from .commands import commands
from .folder import folder
from .forces import forces
from .graph import (
    FAILURES,
    OWN_MODEL,
    Graph,
    MeasurementError,
    Process,
    free_port,
    wait_for,
)
from .history import kept
from .html import html
from .ik import ik
from .mend import fixes
from .objects import objects
from .peer import Peer
from .physics import physics
from .rewind import rewind
from .trajectories import trajectories
from processes import marked_processes
from tcpros import ANSWER, Service, body_of, packed, received

ROOT = Path(__file__).resolve().parents[2]
CLIENTS = ROOT.parent / "shared" / "clients"
ORIGINAL = CLIENTS / "link_states_bridge_original.py"
OURS = ("rosrun", "g1_description", "link_states_bridge.py")
MODEL = "g1_robot"
EACH_STEP = "rate:=1000"
STEP_NS = 1_000_000
SETTLE = 2.0  # [s] before a measurement
TIMEOUT = 2.0  # [s] after which a command is lost
ARM = "left_elbow_joint"
ARM_LINK = "left_elbow_link"
FOOT = "left_ankle_roll_link"
SQUAT = {"hip_pitch": -1.0, "knee": 2.0, "ankle_pitch": -1.0}
CODE = 1e-4  # [rad] from one recorded step to the next, of the last joint
STAMP = struct.Struct("<II")
HEADER = struct.Struct("<IIII5s")  # seq, seconds, nanoseconds, frame
ONE = struct.pack("<I", 1)
COMPARISONS = {"<": operator.lt, "<=": operator.le, ">=": operator.ge}
CAUTION = (
    "Times of virtual machines differ by up to three between hours, and grow when the "
    "machine does other work: compare ratios within one run."
)

BUSY = (
    "**The machine was busy with other work while this was measured:** times are far "
    "longer than on a quiet one, promises may not be kept, and shares of a core are "
    "low where simulated time runs slowly."
)


@dataclass(frozen=True)
class Figure:
    """A number, and what is promised of it, such as ``<= 0.4``."""

    part: str
    name: str
    value: float
    unit: str = ""
    promise: str = ""
    beside: str = ""
    """The same of Gazebo or of the original client; with it a figure is a headline."""

    @property
    def kept(self):
        """Whether the promise is kept; None where there is none."""
        comparison, _, bound = self.promise.partition(" ")
        return COMPARISONS[comparison](self.value, float(bound)) if bound else None

    @property
    def words(self):
        """The value with its unit, to three digits."""
        whole = abs(self.value) >= 100.0 or self.value == int(self.value)
        number = f"{self.value:.0f}" if whole else f"{self.value:.3g}"
        return f"{number} {self.unit}".strip()


class Bench:
    """A run: what is measured, how long, and the figures."""

    def __init__(self, model, quick, files=0):
        """Begin; ``quick`` makes everything short."""
        self.model, self.quick, self.part, self.files = model, quick, "", files
        self.figures, self.left_out = [], []
        self.command = f"tools/benchmark{' --quick' if quick else ''}"
        self.command += f" --files {files}" if files else ""
        self.robot = Robot(model)
        self.load = os.getloadavg()[0]
        self._start = time.monotonic()

    def length(self, usual, quick):
        """Choose a time in [s] or a number of trials."""
        return quick if self.quick else usual

    def say(self, text):
        """Print a line of progress."""
        minutes, seconds = divmod(int(time.monotonic() - self._start), 60)
        print(f"[{minutes:2d}:{seconds:02d}] {self.part}: {text}", flush=True)

    def add(self, name, value, unit="", promise="", beside=""):
        """Keep a figure."""
        figure = Figure(self.part, name, float(value), unit, promise, beside)
        self.figures.append(figure)

    def add_times(self, name, times, beside=""):
        """Keep median and 99th percentile of times in [s], as [ms]."""
        if not len(times):
            raise MeasurementError(f"{name}: nothing arrived")
        median, late = 1e3 * np.percentile(times, (50, 99))
        self.add(f"{name}, median", median, "ms", "", beside)
        self.add(f"{name}, 99th percentile", late, "ms")

    def leave_out(self, text):
        """Keep and print why something is not measured."""
        self.left_out.append(f"{self.part}: {text}")
        self.say(f"not measured: {text}")

    @contextmanager
    def attempt(self, what):
        """Go on where something can't be measured, and report it."""
        self.say(what)
        try:
            yield
        except FAILURES as error:
            self.leave_out(f"{what}: {error}")


@contextmanager
def no_collector():
    """Keep Python's garbage collector from interrupting a measurement."""
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def share(meter):
    """Read a meter as a share of a core in [%]."""
    cpu, wall = meter()
    return 100.0 * cpu / wall


# --- start ----------------------------------------------------------------------------


def start(bench):
    """From the start of roslaunch display.launch to joint_states of the robot.

    The master runs, RViz does not. A first launch is not counted, so that files are in
    the system's cache.
    """
    runs = bench.length(5, 2)
    with bench.attempt(f"{runs + 1} launches"), Graph() as graph:
        times = [first_states(graph, bench.model) for _ in range(runs + 1)][1:]
        bench.add(f"display.launch, median of {runs}", np.median(times), "s", "", "-")
        bench.add("display.launch, slowest", max(times), "s")


def first_states(graph, model):
    """Launch once; return the time to the first joint_states in [s]."""
    came = []

    def take(now, body):
        if JointState().deserialize(body).name:
            came.append(now)

    with closing(Peer()) as peer:
        peer.subscribe("/joint_states", JointState, take)
        begin = time.monotonic()
        with graph.launch(model):
            peer.wait(lambda: came, "joint_states", 60.0)
    return came[0] - begin


# --- display --------------------------------------------------------------------------


def display(bench):
    """Processor time, memory and rate of display.launch while the robot is at rest.

    RViz does not run, and nobody listens but the nodes of the launch file. "In all"
    includes the master and roslaunch. Rates are per simulated second, read from stamps;
    a step is missing if no joint_states have its stamp. Memory is the peak of the
    resident memory.
    """
    with bench.attempt("at rest"), Graph() as graph:
        nodes = launched(graph, bench.model)
        processes = [Process(pid) for pid in marked_processes(graph.mark)]
        meters = [process.meter() for process in processes]
        own = {name: node.meter() for name, node in nodes.items()}
        time.sleep(bench.length(20.0, 5.0))
        total = sum(share(meter) for meter in meters)
        bench.add("at rest, all processes", total, "% of a core", "<= 35", "-")
        for name, meter in own.items():
            bench.add(f"at rest, {name}", share(meter), "% of a core")
        for name, node in nodes.items():
            bench.add(f"memory of {name}", node.memory("VmHWM"), "MB")
        bench.add("memory of all", sum(p.memory() for p in processes), "MB")
        rate, _ = stamps(bench.length(10.0, 3.0))
        bench.add("joint_states", rate, "Hz", "", "1000 Hz, each step")
    with bench.attempt(EACH_STEP), Graph() as graph:
        launched(graph, bench.model, EACH_STEP)
        rate, missing = stamps(bench.length(10.0, 3.0))
        bench.add(f"joint_states with {EACH_STEP}", rate, "Hz")
        bench.add(f"steps missing with {EACH_STEP}", missing, "", "<= 0")


def launched(graph, model, *arguments):
    """Launch the display; return its nodes when they are at rest."""
    graph.launch(model, *arguments)
    names = ("gazebo", "link_states_bridge", "robot_state_publisher")
    nodes = {name: graph.node(f"/{name}") for name in names}
    time.sleep(SETTLE)
    return nodes


def stamps(seconds):
    """Watch joint_states; return their rate in [Hz] and the steps without any."""
    came = []
    with closing(Peer()) as peer:
        peer.subscribe("/joint_states", JointState, lambda _, body: came.append(body))
        peer.wait(lambda: came, "joint_states")
        peer.serve(time.monotonic() + 1.0)
        came.clear()
        peer.serve(time.monotonic() + seconds)
    times = [JointState().deserialize(body).header.stamp.to_nsec() for body in came]
    passed = times[-1] - times[0]
    return 1e9 * (len(times) - 1) / passed, passed // STEP_NS + 1 - len({*times})


# --- latency --------------------------------------------------------------------------


def latency(bench):
    """From /gazebo/set_model_configuration or /joint_commands to joint_states and TF.

    A process without rospy requests random configurations within the limits, from a
    seed, in kinematic, 5 to 25 ms after the last one was seen. It has arrived in
    joint_states when all joints are within 1e-3 rad, and in TF when the transform of
    left_elbow_link, which robot_state_publisher makes from joint_states, has moved. The
    error is that of these joint_states.
    """
    for words, arguments in (("", ()), (f"{EACH_STEP}, ", (EACH_STEP,))):
        with bench.attempt(f"{words}commands"), Graph() as graph:
            launched(graph, bench.model, "physics:=kinematic", *arguments)
            with closing(Peer()) as peer:
                measure_latency(bench, words, Commander(peer, bench.robot))


class Commander:
    """Requests configurations, and sees them arrive."""

    def __init__(self, peer, robot):
        """Connect."""
        self._peer, self._robot = peer, robot
        self._target, self._seen, self._quaternion = None, {}, None
        self.error = 0.0
        self._topic = peer.advertise("/joint_commands", JointState)
        peer.subscribe("/joint_states", JointState, self._take_states)
        peer.subscribe("/tf", TFMessage, self._take_tf)
        self._service = Service("/gazebo/set_model_configuration")
        self._socket = self._service.connect()
        peer.wait(lambda: self._topic.callers and self._quaternion is not None, "TF")

    def _take_states(self, now, body):
        if self._target is not None and "states" not in self._seen:
            state = JointState().deserialize(body)
            place = dict(zip(state.name, state.position))
            told = np.array([place[name] for name in self._robot.joint_names])
            error = np.abs(told - self._target).max()
            if error < 1e-3:
                self._seen["states"] = now
                self.error = max(self.error, error)

    def _take_tf(self, now, body):
        for transform in TFMessage().deserialize(body).transforms:
            if transform.child_frame_id == ARM_LINK:
                q = transform.transform.rotation
                q, old = np.array([q.x, q.y, q.z, q.w]), self._quaternion
                if old is not None and np.abs(q - old).max() > 1e-3:
                    self._seen.setdefault("tf", now)
                self._quaternion = q

    def request(self, target, by_service):
        """Request positions in [rad]; return the times to joint_states and TF in [s].

        A time is infinite if nothing arrived.
        """
        names = self._robot.joint_names
        if by_service:
            data = self._service.request(MODEL, "", names, target.tolist())
        else:
            data = body_of(JointState(name=names, position=target.tolist()))
        self._target, self._seen = target, {}
        begin = time.monotonic()
        if by_service:
            self._socket.sendall(packed(data))
        else:
            self._topic.send(packed(data))
        self._peer.serve(begin + TIMEOUT, lambda: len(self._seen) == 2)
        if by_service:
            _, length = ANSWER.unpack(received(self._socket, ANSWER.size))
            received(self._socket, length)
        self._target = None
        return [self._seen.get(key, np.inf) - begin for key in ("states", "tf")]

    def serve(self, seconds):
        """Pass time."""
        self._peer.serve(time.monotonic() + seconds)


def measure_latency(bench, words, commander):
    """Request configurations both ways."""
    random, robot = np.random.default_rng(1), bench.robot
    arm = robot.joint_names.index(ARM)
    lost = 0
    for way in ("set_model_configuration", "joint_commands"):
        times, last = [], np.inf
        with no_collector():
            for _ in range(bench.length(300, 30)):
                target = random.uniform(robot.lower, robot.upper)
                while abs(target[arm] - last) < 0.5:
                    target[arm] = random.uniform(robot.lower[arm], robot.upper[arm])
                last = target[arm]
                commander.serve(random.uniform(0.005, 0.025))
                times.append(commander.request(target, way[0] == "s"))
        states, tf = np.array(times).T
        lost += np.count_nonzero(np.isinf(states))
        is_headline = not words and way[0] == "j"
        for topic, taken in (("joint_states", states), ("TF", tf)):
            name = f"{words}{way} to {topic}"
            beside = "-" if is_headline else ""
            bench.add_times(name, taken[np.isfinite(taken)], beside)
    bench.add(f"{words}requests lost", lost, "", "<= 0")
    bench.add(f"{words}error of joint_states", commander.error, "rad", "<= 1e-9")


# --- bridge ---------------------------------------------------------------------------


def bridge(bench):
    """The bridge at 1 kHz, compared with the original client.

    A process without rospy plays link states of the G1, computed from random smooth
    motions of all joints, to the node: /clock, then the states, on sockets without
    delay, one message per millisecond; the node's joint_states come back. The bridge
    takes /gazebo/simulator_state, the original client /gazebo/link_states. A message is
    found in joint_states by its last joint, which differs in each. Latency runs from
    just before the states are written until joint_states are read. Processor time is
    that of all threads of the node, per answered message: the original client drops
    what it cannot follow. robot_state_publisher does not run. The original client is
    the script that the bridge replaces; it is not part of the repository.
    """
    recording = record(bench.robot, bench.model)
    if ORIGINAL.exists():
        nodes = (("original client", (sys.executable, ORIGINAL), 10.0),)
    else:
        nodes = ()
        bench.leave_out("original client: it is not here")
    costs = {}
    with Graph() as graph:
        graph.master.setParam("/use_sim_time", True)
        graph.master.setParam("/robot_description", bench.model.read_text("utf-8"))
        for name, command, seconds in (*nodes, ("bridge", OURS, 30.0)):
            with bench.attempt(name):
                played = feed(graph, command, recording, bench.length(seconds, 4.0))
                costs[name] = report_bridge(bench, name, played, recording)
    if len(costs) == 2:
        ratio = costs["bridge"] / costs["original client"]
        beside = f"{costs['original client']:.0f} us per message"
        bench.add("processor time, bridge / original", ratio, "", "<= 0.4", beside)


@dataclass(frozen=True)
class Recording:
    """Link states with the positions they were computed from, in [rad]."""

    positions: np.ndarray
    messages: list
    motors: bytes
    """Those of the robot, which stay the same."""


@dataclass(frozen=True)
class Played:
    """What was sent and answered."""

    rows: np.ndarray
    """Steps of the recording that were sent, and when, in [s]; shape (n,)."""
    sent: np.ndarray
    answers: list
    """Times in [s], and joint_states as bytes."""
    cpu: float


def record(robot, model, steps=5000):
    """Let all joints swing, the last one slowly up."""
    random = np.random.default_rng(1)
    count, t = len(robot.joint_names), 1e-3 * np.arange(steps)[:, np.newaxis]
    middle, reach = 0.5 * (robot.lower + robot.upper), robot.upper - robot.lower
    size = reach * random.uniform(0.1, 0.45, count)
    phases = random.uniform(0.0, 6.3, count), random.uniform(0.5, 6.0, count)
    positions = middle + size * np.sin(phases[0] + phases[1] * t)
    positions[:, -1] = middle[-1] + CODE * (np.arange(steps) - steps // 2)
    joints = ET.parse(model).getroot().iter("joint")
    moved = {j.find("child").get("link") for j in joints if j.get("type") != "fixed"}
    # Gazebo lumps links behind fixed joints into their parents.
    links = [n for n in robot.link_names if n in moved or n == robot.base_link]
    rows = [robot.link_row(link) for link in links]
    base = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    poses = robot.forward_kinematics(positions, base)[:, rows]
    names = ["ground_plane::link", *(f"{MODEL}::{link}" for link in links)]
    ground, still = Pose(orientation=Quaternion(w=1.0)), Twist()
    messages = []
    for row in poses.tolist():
        placed = [Pose(Point(*p[:3]), Quaternion(*p[3:])) for p in row]
        twists = [still] * len(names)
        messages.append(body_of(LinkStates(names, [ground, *placed], twists)))
    motors = MotorStates(model_name=MODEL, joint_names=robot.joint_names)
    motors.q = motors.dq = motors.commanded = [0.0] * count
    return Recording(positions, messages, body_of(motors))


class Feed:
    """Plays a recording at 1 kHz, as Gazebo or as the simulator, and takes answers."""

    def __init__(self, peer, recording, is_stamped):
        """Publish; ``is_stamped`` is for nodes that take simulator states."""
        self._peer, self._messages = peer, recording.messages
        self._is_stamped, self._motors = is_stamped, ONE + recording.motors
        self._clock = peer.advertise("/clock", Clock)
        links = peer.advertise("/gazebo/link_states", LinkStates)
        world = peer.advertise("/gazebo/simulator_state", SimulatorState)
        peer.offer("/gazebo/set_model_configuration")
        self._source = world if is_stamped else links
        self._states = peer.subscribe("/joint_states", JointState, self._take)
        self.answers, self.step = [], 0

    def _take(self, now, body):
        self.answers.append((now, body))

    def is_connected(self):
        """Tell whether a node listens, and answers."""
        return self._clock.callers and self._source.callers and self._states.sources

    def play(self, seconds):
        """Send, then wait for late answers; return the times of sending in [s]."""
        sent, due = [], time.monotonic()
        for _ in range(round(1000 * seconds)):
            self._peer.serve(due)
            now = divmod((self.step + 1) * STEP_NS, 1_000_000_000)
            data = self._messages[self.step % len(self._messages)]
            if self._is_stamped:
                data = HEADER.pack(self.step, *now, 5, b"world") + data + self._motors
            self._clock.send(packed(STAMP.pack(*now)))
            data = packed(data)
            sent.append(time.monotonic())
            self._source.send(data)
            self.step += 1
            # What is late is not made up for by a burst.
            due = max(due, sent[-1] - 1e-3) + 1e-3
        self._peer.serve(due + 0.5)
        return np.array(sent)


def feed(graph, command, recording, seconds):
    """Start a node, play to it, and end it."""
    with closing(Peer()) as peer, graph.start(command) as program:
        player = Feed(peer, recording, command == OURS)
        peer.wait(lambda: program.check() and player.is_connected(), "the node")
        player.play(SETTLE)
        player.answers.clear()
        first, meter = player.step, program.meter()
        with no_collector():
            sent = player.play(seconds)
        cpu, _ = meter()
        rows = np.arange(first, player.step) % len(recording.messages)
        return Played(rows, sent, player.answers, cpu)


def report_bridge(bench, name, played, recording):
    """Keep the figures of a node; return its processor time per message in [us]."""
    if not played.answers:
        raise MeasurementError("no joint_states came")
    states = [JointState().deserialize(body) for _, body in played.answers]
    order = [states[0].name.index(joint) for joint in bench.robot.joint_names]
    told = np.array([state.position for state in states])[:, order]
    start, count = recording.positions[0, -1], len(recording.positions)
    codes = np.rint((told[:, -1] - start) / CODE).astype(int)
    # Messages that share a code are a whole recording apart.
    ahead = np.cumsum(np.diff(codes, prepend=played.rows[0]) % count)
    found = np.clip(ahead, 0, len(played.rows) - 1)
    error = np.abs(told - recording.positions[played.rows[found]]).max()
    times = np.array([moment for moment, _ in played.answers]) - played.sent[found]
    cost = 1e6 * played.cpu / len(times)
    lost = len(played.sent) - len({*found.tolist()})
    is_ours = name == "bridge"
    bench.add(f"{name}: processor time per message", cost, "us")
    bench.add_times(f"{name}: states to joint_states", times)
    bench.add(f"{name}: messages sent", len(played.sent))
    kept = [f for f in bench.figures if f.name.startswith("original client: ")]
    others = {f.name.partition(": ")[2]: f.words for f in kept}
    promises = ("<= 0", "<= 1e-9") if is_ours else ("", "")
    rows = (("messages lost", lost, ""), ("error of joint_states", error, "rad"))
    for (what, value, unit), promise in zip(rows, promises):
        beside = others.get(what, "-") if is_ours else ""
        bench.add(f"{name}: {what}", value, unit, promise, beside)
    return cost


# --- history --------------------------------------------------------------------------


def history(bench):
    """What the bridge's history costs: memory of ten minutes, and processor time.

    Memory is that of 600 s at 200 Hz, while all joints and the base of the G1 move:
    measured from link poses as in the bridge, with velocities and twists, then also
    with efforts, and commanded positions and base. Processor time is that
    of two more bridges of a display at the same time, one of them with `~history` 0,
    while the robot plays a motion, per simulated time; in `hold` the history has the
    efforts.
    """
    kept(bench)
    for kind in ("kinematic", "hold"):
        with bench.attempt(f"bridges in {kind}"), Graph() as graph:
            launched(graph, bench.model, f"physics:={kind}")
            bridges = {}
            for name, seconds in (("on", 600), ("off", 0)):
                graph.start([*OURS, f"__ns:=/{name}", f"_history:={seconds}"])
                bridges[name] = graph.node(f"/{name}/link_states_bridge")
            motion = model_trajectory(MODEL, clip(bench.robot, 1))
            with closing(Service("/gazebo/set_model_trajectory")) as service:
                service.send(service.request(motion))
            shares = shares_of(bridges, bench.length(20.0, 5.0))
            for name, value in shares.items():
                bench.add(f"{kind}: bridge, history {name}", value, "% of a core")
            cost = shares["on"] - shares["off"]
            bench.add(f"{kind}: history", cost, "% of a core", "<= 3", "-")
            rate, _ = stamps(bench.length(5.0, 3.0))
            bench.add(f"{kind}: states", rate, "Hz")


def shares_of(processes, seconds):
    """Measure processor time of processes per simulated time, in [%]."""
    times = []
    with closing(Peer()) as peer:
        peer.subscribe("/clock", Clock, lambda _, body: times.append(body))
        peer.wait(lambda: times, "/clock")
        peer.serve(time.monotonic() + SETTLE)
        times.clear()
        before = {name: one.cpu_seconds() for name, one in processes.items()}
        peer.serve(time.monotonic() + seconds)
        spent = {n: one.cpu_seconds() - before[n] for n, one in processes.items()}
    first, last = (Clock().deserialize(times[row]).clock for row in (0, -1))
    return {name: 100.0 * cpu / (last - first).to_sec() for name, cpu in spent.items()}


# --- foot -----------------------------------------------------------------------------


def foot(bench):
    """How still a standing foot is in TF while base and joints move together.

    A process moves the pelvis up and down 100 times per second so that the feet stand
    still: the base by /gazebo/set_model_state, the joints by /joint_commands, with the
    default display. Every 20 ms it looks up map -> left_ankle_roll_link.
    """
    runs = bench.length(5, 2)
    with bench.attempt(f"{runs} motions"), Graph() as graph:
        launched(graph, bench.model)
        rms, largest = np.array([squat(bench.robot) for _ in range(runs)]).T
        bench.add("standing foot in TF, rms, worst run", rms.max(), "mm", "<= 1", "-")
        bench.add("standing foot in TF, largest", largest.max(), "mm")


class Transforms:
    """TF as a plain listener has it."""

    def __init__(self, peer):
        """Listen."""
        self._buffer = tf2_py.BufferCore(genpy.Duration(10.0))
        peer.subscribe("/tf", TFMessage, self._taker(self._buffer.set_transform))
        take_static = self._taker(self._buffer.set_transform_static)
        peer.subscribe("/tf_static", TFMessage, take_static)

    def _taker(self, keep):
        def take(_, body):
            for transform in TFMessage().deserialize(body).transforms:
                keep(transform, "benchmark")

        return take

    def place(self, link):
        """Return where a link is in the map in [m], None if it is not known."""
        try:
            found = self._buffer.lookup_transform_core("map", link, genpy.Time())
        except tf2_py.TransformException:
            return None
        place = found.transform.translation
        return np.array([place.x, place.y, place.z])


def squat(robot):
    """Move up and down; return the foot's rms and largest error in [mm]."""
    depth = 0.4 + 0.3 * np.sin(np.pi * 0.01 * np.arange(500))
    sides = [f"{side}_{joint}" for side in ("left", "right") for joint in SQUAT]
    angles = {f"{name}_joint": SQUAT[name.partition("_")[2]] * depth for name in sides}
    positions = robot.positions(angles)
    stood = np.array([0.0, 0.0, 0.05])
    bases = stood - robot.link_poses(positions)[FOOT][:, :3]
    with closing(Peer()) as peer:
        commands = peer.advertise("/joint_commands", JointState)
        base = peer.advertise("/gazebo/set_model_state", ModelState)
        tf = Transforms(peer)
        peer.wait(lambda: commands.callers and base.callers, "the bridge")
        peer.wait(lambda: tf.place(FOOT) is not None, "TF")
        errors, due = [], time.monotonic()
        for number, (place, position) in enumerate(zip(bases, positions)):
            pose = Pose(Point(*place), Quaternion(w=1.0))
            base.send(packed(body_of(ModelState(MODEL, pose, Twist(), "world"))))
            state = JointState(name=robot.joint_names, position=position)
            commands.send(packed(body_of(state)))
            due = max(due + 0.01, time.monotonic())
            peer.serve(due)
            if number > 50 and number % 2 == 0:
                errors.append(np.linalg.norm(tf.place(FOOT) - stood))
    errors = 1e3 * np.array(errors)
    return np.sqrt((errors**2).mean()), errors.max()


# --- checks ---------------------------------------------------------------------------


def checks(bench):
    """How many samples of a motion, and how many single configurations, are checked.

    Clips of 30 s at 60 Hz are synthetic: the robot stands, and its arms swing.
    Samples per second are those of one core, all checks made. Objects are boxes,
    cylinders and balls of 5 to 40 cm, 0.5 to 3 m from the robot, some of which its
    hands hit. `check_state` is called one call after the other: `Robot.check_state`,
    and the service of a checker alone.
    """
    robot = bench.robot
    clips = [clip(robot, seed) for seed in range(bench.length(6, 2))]
    counts = (0, 20, 200)
    among = [
        robot.checker(scene=some_objects(count) if count else None) for count in counts
    ]
    spent = np.zeros(len(counts))
    for motion in clips:  # the first one prepares what is needed once
        for row, checker in enumerate(among):
            begin = time.process_time()
            checker.check(motion)
            spent[row] += 0.0 if motion is clips[0] else time.process_time() - begin
    rates = sum(len(motion.times) for motion in clips[1:]) / spent
    bench.add("check, samples of a synthetic motion", rates[0], "1/s", "", "-")
    for count, rate in zip(counts[1:], rates[1:]):
        what = f"check, samples among {count} objects"
        bench.add(what, rate, "1/s", "", "-")
    bench.add("speed among 20 objects", 100.0 * rates[1] / rates[0], "%", ">= 50")
    drawn = robot.neutral + 0.1 * robot.random_configuration(1, size=200)
    drawn = np.clip(drawn, robot.lower, robot.upper)
    base, count = [0.0, 0.0, 0.793, 0.0, 0.0, 0.0, 1.0], bench.length(1000, 200)
    begin = time.monotonic()
    for number in range(count):
        robot.check_state(drawn[number % len(drawn)], base=base)
    bench.add("Robot.check_state", count / (time.monotonic() - begin), "1/s")
    with bench.attempt("check_state of a checker alone"), Graph() as graph:
        text = bench.model.read_text("utf-8")
        graph.master.setParam("/robot_description", text.replace("../", f"{ROOT}/"))
        graph.start(["rosrun", "g1_description", "checker.py", "_rate:=0"])
        graph.node("/checker")
        rate = service_rate(
            robot.joint_names, drawn, Pose(Point(*base[:3]), Quaternion(w=1.0)), count
        )
        bench.add("the service check_state", rate, "1/s", ">= 300")


def some_objects(count):
    """Make up objects."""
    random, scene = np.random.default_rng(0), Scene()
    for number in range(count):
        turn, away = random.uniform(-np.pi, np.pi), random.uniform(0.5, 3.0)
        at = [away * np.cos(turn), away * np.sin(turn), random.uniform(0.1, 1.8)]
        size, rpy = random.uniform(0.05, 0.4, 3), random.uniform(-1.0, 1.0, 3)
        name, kind = f"object {number}", number % 3
        if kind == 0:
            scene.box(name, size, at, rpy=rpy)
        elif kind == 1:
            scene.cylinder(name, size[0] / 2, size[1], at, rpy=rpy)
        else:
            scene.sphere(name, size[0] / 2, at)
    return scene


def clip(robot, seed):
    """Make up a motion."""
    random, times = np.random.default_rng(seed), np.arange(1800) / 60.0
    names = [n for n in robot.joint_names if "shoulder" in n or "elbow" in n]
    swing = {n: 0.3 * np.sin(random.uniform(0.5, 3.0) * times) for n in names}
    base = np.tile([0.0, 0.0, 0.793, 0.0, 0.0, 0.0, 1.0], (len(times), 1))
    return robot.trajectory(times, swing, base=base)


def service_rate(names, drawn, pose, count):
    """Call the service again and again; return calls per second."""
    wait_for(lambda: is_offered("/checker/check_state"), "the service")
    with closing(Service("/checker/check_state")) as service:
        requests = [
            service.request(JointState(name=names, position=row), True, pose, [])
            for row in drawn
        ]
        service.send(requests[0])
        begin = time.monotonic()
        for number in range(count):
            service.send(requests[number % len(requests)])
        return count / (time.monotonic() - begin)


def is_offered(name):
    """Tell whether the master knows a service."""
    try:
        return Service(name)
    except (MasterException, ROSServiceException, OSError):
        return None


# --- page -----------------------------------------------------------------------------


def page(bench):
    """The page in a browser: its frame rate and processor time.

    The display runs with `web:=true`. A client speaks the page's protocol in place of a
    browser and counts how often the left forearm moves, while 100 joint_commands per
    second move the robot. What a browser needs to draw is not part of it.
    """
    try:
        from page_client import PageClient
    except ImportError as error:
        bench.leave_out(f"the page: {error}")
        return
    seconds, port = bench.length(20.0, 5.0), free_port()
    with bench.attempt("the page"), Graph() as graph, closing(Peer()) as peer:
        launched(graph, bench.model, "web:=true", f"port:={port}")
        node = graph.node("/web")
        wait_for(lambda: is_open(port), "the page")
        meter = node.meter()
        time.sleep(seconds)
        bench.add("at rest, no browser", share(meter), "% of a core")
        with PageClient(f"http://127.0.0.1:{port}/") as client:
            client.wait_until_whole()
            (link,) = (name for name in client.nodes if name.endswith(f"/{ARM_LINK}"))
            meter = node.meter()
            time.sleep(seconds)
            bench.add("at rest, 1 browser", share(meter), "% of a core")
            topic = peer.advertise("/joint_commands", JointState)
            peer.wait(lambda: topic.callers, "the bridge")
            before, meter, begin = client.counts[link], node.meter(), time.monotonic()
            for number in range(round(100 * seconds)):
                angle = 0.5 + 0.4 * np.sin(0.03 * number)
                topic.send(packed(body_of(JointState(name=[ARM], position=[angle]))))
                peer.serve(begin + 0.01 * (number + 1))
            moves = (client.counts[link] - before) / (time.monotonic() - begin)
            bench.add("moving, 1 browser, frame rate", moves, "Hz")
            bench.add("moving, 1 browser", share(meter), "% of a core")
            bench.add("memory of web", node.memory("VmHWM"), "MB")
            count = bench.length(300, 40)
            bench.add_times("drag to picture", drag_times(client, link, count))
            with burners(os.cpu_count()):
                times = drag_times(client, link, count)
                bench.add_times("drag to picture, all cores busy", times)


def drag_times(client, link, count):
    """Drag a hand on a circle; measure how long until its forearm moves, in [s]."""
    client.set("Gizmos", True)
    (name,) = (n for n in client.nodes if n.endswith("/left_hand"))
    client.wait_for(lambda: client.nodes[name].get("visible"), "the gizmo")
    client.wait_for(lambda: "position" in client.nodes[name], "its place")
    place = np.array(client.nodes[name]["position"], dtype=float)
    turn = tuple(map(float, client.nodes[name]["wxyz"]))
    times = []
    for number in range(count):
        angle = 0.1 * (number + 1)
        offset = 0.05 * np.array([np.sin(angle), 0.0, 1.0 - np.cos(angle)])
        before, begin = client.counts[link], time.monotonic()
        client.send(
            "TransformControlsUpdateMessage",
            name=name,
            owner="",
            wxyz=turn,
            position=tuple((place + offset).tolist()),
        )
        client.wait_for(lambda old=before: client.counts[link] > old, "the forearm")
        times.append(client.times[link] - begin)
    return times


PARTS = {
    part.__name__: part
    for part in (
        start,
        commands,
        display,
        latency,
        bridge,
        history,
        foot,
        physics,
        ik,
        clutter,
        trajectories,
        checks,
        forces,
        causes,
        fixes,
        folder,
        page,
        browser,
        objects,
        html,
        rewind,
    )
}


# --- report ---------------------------------------------------------------------------


def facts(bench):
    """List what the figures depend on."""
    lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
    names = [line.split(": ")[1] for line in lines if "model name" in line]
    system = f"{platform.system()}, Python {platform.python_version()}"
    return {
        "command": bench.command,
        "day": time.strftime("%Y-%m-%d"),
        "machine": f"{(names or [platform.machine()])[0]}, {os.cpu_count()} cores",
        "system": system,
        "load before, 1 min": f"{bench.load:.1f}",
    }


def print_table(bench):
    """Print all on the terminal."""
    print()
    for name, fact in facts(bench).items():
        print(f"{name}: {fact}")
    part = None
    for figure in bench.figures:
        if figure.part != part:
            part = figure.part
            print(f"\n{part}")
        kept = {True: "", False: "NOT KEPT", None: ""}[figure.kept]
        row = f"  {figure.name:58} {figure.words:>18}  {figure.promise:8} {kept}"
        print(row.rstrip())
    for text in bench.left_out:
        print(f"\nnot measured: {text}")


def write_json(bench, file):
    """Write all for programs."""
    figures = [{**asdict(figure), "kept": figure.kept} for figure in bench.figures]
    content = {**facts(bench), "figures": figures, "left_out": bench.left_out}
    file.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def write_page(bench, file):
    """Write all as Markdown, the figures that users care about first."""
    note = f"<!-- {bench.command} writes this page, down to Measured by hand. -->"
    lines = ["# Performance", "", note, ""]
    first = [figure for figure in bench.figures if figure.beside]
    titles = ("figure", "measured", "Gazebo, or the original client")
    lines += table(titles, [(*cells(f), f.beside) for f in first])
    lines += ["", "| | |", "| --- | --- |"]
    lines += [f"| {name} | {fact} |" for name, fact in facts(bench).items()]
    lines += ["", CAUTION]
    if bench.load > 0.5 * os.cpu_count():
        lines += ["", BUSY]
    if bench.quick:
        lines += ["", "These are short measurements, of `--quick`."]
    for name, part in PARTS.items():
        own = [cells(figure) for figure in bench.figures if figure.part == name]
        if own:
            lines += ["", f"## {name}", "", inspect.getdoc(part), ""]
            lines += table(titles[:2], own)
    if bench.left_out:
        lines += ["", "## Not measured", ""]
        lines += [f"- {text}" for text in bench.left_out]
    before = file.read_text(encoding="utf-8") if file.exists() else ""
    _, head, by_hand = before.partition("\n## Measured by hand\n")
    text = "\n".join(lines) + "\n" + head + by_hand
    file.write_text(text, encoding="utf-8")


def cells(figure):
    """Give the cells of a figure's row."""
    promise = f" (promised: {figure.promise})" if figure.promise else ""
    return figure.name, f"{figure.words}{promise}"


def table(titles, rows):
    """Give the lines of a table."""
    lines = [titles, ["---", "---:", *["---"] * (len(titles) - 2)], *rows]
    return [f"| {' | '.join(line)} |".replace("  ", " ") for line in lines]


def parts_of(text):
    """Read a list of parts."""
    names = text.split(",")
    for name in names:
        if name not in PARTS:
            known = ", ".join(PARTS)
            raise argparse.ArgumentTypeError(f"no part '{name}'; there are {known}")
    return names


def main():
    """Measure, print, write."""
    parser = argparse.ArgumentParser(prog="tools/benchmark")
    parser.add_argument("--only", type=parts_of, metavar="PART[,PART]")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--files", type=int, default=0, metavar="N")
    parser.add_argument("--model", type=Path, metavar="FILE", default=OWN_MODEL)
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--page", type=Path, metavar="FILE")
    given = parser.parse_args()
    if not given.model.is_file():
        parser.error(f"there is no model {given.model}")
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    bench = Bench(given.model.resolve(), given.quick, given.files)
    try:
        for name in given.only or PARTS:
            bench.part = name
            PARTS[name](bench)
    finally:
        print_table(bench)
    if given.json:
        write_json(bench, given.json)
    if given.page:
        bench.command += f" --page {given.page}"
        write_page(bench, given.page)


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        sys.exit("tools/benchmark: interrupted")
