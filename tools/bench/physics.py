"""The physics engines: their steps alone, in a node, and in checks of motions."""

from __future__ import annotations

import copy
import time
from contextlib import closing
from itertools import product

import mujoco
import numpy as np
from g1_description.msg import MotorCommands, MotorStates
from rosgraph_msgs.msg import Clock

from g1_description.choices import ENGINES
from g1_description.motion.motion import Motion
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.ros.conversions import model_trajectory
from g1_description.sim.rollout import Conditions, rollout
from g1_description.sim.world import World

from .graph import Graph
from .peer import Peer, stamp_of
from tcpros import Service, body_of, packed

STEPS = 5
"""Between two states at the default rate of 200 Hz."""

STANDING = np.array([0.0, 0.0, 0.793, 0.0, 0.0, 0.0, 1.0])
SWUNG = ("left_shoulder_pitch_joint", "right_knee_joint")
CASES = {
    "lying, limp": ("limp", False, False),
    "standing, hold": ("hold", False, False),
    "hanging and moved, hold": ("hold", True, True),
}
"""Physics, whether the base is fixed, and whether two joints swing."""


def physics(bench):
    """Steps of 1 ms with each engine, of the robot alone in its world.

    Each figure of a step is the median of ten runs of 100 steps, the engines in turns,
    as many steps together as between two states of the default rate; without ROS, of
    one thread. How fast time passes is that of a node without a limit of speed, at the
    default rate of states and with one state per step, while a program listens to
    /clock; get_link_state is called at the usual speed, each time through a new
    connection. A check of physics simulates the package's squat. A controller sends
    motor_commands of all joints a thousand times a second to a robot that hangs, with a
    state per step, in real time.
    """
    steps = bench.length(100, 20)
    for name, case in CASES.items():
        with bench.attempt(name):
            worlds = [_settled(bench, engine, *case) for engine in ENGINES]
            times = {engine: [] for engine in ENGINES}
            for _, (engine, (_, advance)) in product(range(10), zip(ENGINES, worlds)):
                begin = time.process_time()
                advance(steps)
                times[engine].append((time.process_time() - begin) / steps)
            for engine, found in times.items():
                bench.add(f"{name}, {engine}", 1e3 * np.median(found), "ms per step")
            bench.add(f"{name}, mj_step alone", 1e3 * _alone(worlds[1][0], steps), "ms")
    for engine in ENGINES:
        with bench.attempt(f"check --physics with {engine}"):
            _check(bench, engine)
    for engine, rate in product(ENGINES, (200, 1000)):
        with bench.attempt(f"a node with {engine}, lying, rate:={rate}"):
            _in_a_node(bench, engine, rate)
    for engine in ENGINES:
        with bench.attempt(f"a node with {engine}, hanging and moved"):
            _in_a_node(bench, engine, 200, is_moved=True)
    for engine in ENGINES:
        with bench.attempt(f"a controller at 1 kHz with {engine}"):
            _controlled(bench, engine)


def _settled(bench, engine, physics, fixed, moved):
    """Let the robot come to rest; return the world, and what steps it on."""
    begin = time.process_time()
    world = World(physics, engine=engine)
    assembly = lump_fixed_joints(bench.robot.description)
    pose = STANDING.copy()
    pose[2] += 0.5 * fixed
    world.spawn("g1", assembly, pose, fixed)
    world.step()
    if not (fixed or physics == "limp"):
        bench.add(f"world and first step, {engine}", time.process_time() - begin, "s")
    model = world.model("g1")
    rows = np.array(model.joint_rows(SWUNG))

    def advance(steps):
        end_ns = world.time_ns + steps * world.properties.step_ns
        while world.time_ns < end_ns:
            if moved:
                turn = 0.3 * np.sin(3e-9 * world.time_ns)
                world.engine.follow(model, rows, np.full(2, turn), np.zeros(2))
            # Else it sleeps.
            world.engine.apply_effort(model, 0, 0.0)
            world.advance(STEPS)

    advance(bench.length(4000, 1500))
    return world, advance


def _alone(world, steps):
    """Measure MuJoCo's own step where a world is now, in [s]."""
    model, times = world.engine._model, []
    data = copy.copy(world.engine._data)
    for _ in range(10):
        begin = time.process_time()
        for _ in range(steps):
            mujoco.mj_step(model, data)
        times.append((time.process_time() - begin) / steps)
    return np.median(times)


def _check(bench, engine):
    """Simulate a motion without ROS."""
    motion = bench.robot.read_motion("squat.csv")
    begin = time.process_time()
    played = rollout(bench.robot.description, motion, Conditions(engine=engine))
    factor = (time.process_time() - begin) / (played.times[-1] - played.times[0])
    bench.add(f"check --physics, {engine}", factor, "s per second of motion")


def _in_a_node(bench, engine, rate, is_moved=False):
    """Measure how fast time passes while the robot lies, and the node's memory.

    Instead it may hang and swing two joints.
    """
    words = ("physics:=limp", f"engine:={engine}", f"rate:={rate}")
    if is_moved:
        words = ("physics:=hold", "fixed_base:=true", *words[1:])
    with Graph() as graph, closing(Peer()) as peer:
        graph.launch(bench.model, *words)
        node, came = graph.node("/gazebo"), []
        peer.subscribe("/clock", Clock, lambda now, body: came.append((now, body)))
        peer.wait(lambda: came, "/clock")
        with closing(Service("/gazebo/set_real_time_factor")) as service:
            service(0.0)
        if is_moved:
            with closing(Service("/gazebo/set_model_trajectory")) as service:
                service(model_trajectory("g1_robot", _swing()))
        peer.serve(time.monotonic() + bench.length(5.0, 2.0))
        came.clear()
        peer.serve(time.monotonic() + bench.length(10.0, 2.0))
        (first, begin), (last, end) = came[0], came[-1]
        times = [Clock().deserialize(body).clock.to_sec() for body in (begin, end)]
        factor = (times[1] - times[0]) / (last - first)
        name = "hanging and moved" if is_moved else "lying"
        bench.add(f"{name}, {engine}, rate:={rate}", factor, "x real time")
        if is_moved:
            return
        memory = node.memory("VmHWM")
        bench.add(f"memory, {engine}, rate:={rate}", memory, "MB")
        with closing(Service("/gazebo/set_real_time_factor")) as service:
            service(1.0)
        peer.serve(time.monotonic() + 1.0)
        waits = []
        for _ in range(bench.length(200, 20)):
            begin = time.monotonic()
            with closing(Service("/gazebo/get_link_state")) as service:
                service("g1_robot::pelvis", "")
            waits.append(time.monotonic() - begin)
        wait = 1e3 * np.median(waits)
        bench.add(f"get_link_state, {engine}, rate:={rate}", wait, "ms")


def _swing():
    """Make a motion that lasts."""
    times = np.arange(0.0, 300.0, 0.02)
    turns = 0.3 * np.sin(3.0 * times)
    return Motion(times, SWUNG, np.stack([turns, turns], axis=1))


def _controlled(bench, engine):
    """Measure how fast time passes, and states, under commands at 1 kHz."""
    words = ("physics:=hold", f"engine:={engine}", "rate:=1000")
    with Graph() as graph, closing(Peer()) as peer:
        graph.launch(bench.model, *words)
        node, came = graph.node("/gazebo"), []
        peer.subscribe("/gazebo/motor_states", MotorStates, lambda *it: came.append(it))
        topic = peer.advertise("/gazebo/motor_commands", MotorCommands)
        peer.wait(lambda: came and topic.callers, "the simulator")
        with closing(Service("/gazebo/set_gantry")) as service:
            service("g1_robot", "", True, 1.0)
        n = len(bench.robot.joint_names)
        command = MotorCommands(
            model_name="g1_robot", joint_names=[*bench.robot.joint_names]
        )
        command.q, command.dq, command.tau = [0.0] * n, [0.0] * n, [0.0] * n
        command.kp, command.kd = [60.0] * n, [2.0] * n
        message = packed(body_of(command))
        seconds = bench.length(10.0, 3.0)

        def send(seconds):
            begin = time.monotonic()
            for number in range(round(1000 * seconds)):
                topic.send(message)
                peer.serve(begin + 1e-3 * (number + 1))

        send(2.0)
        came.clear()
        meter = node.meter()
        send(seconds)
        cpu, wall = meter()
        stamps = [stamp_of(body) for _, body in (came[0], came[-1])]
        passed = came[-1][0] - came[0][0]
        factor = (stamps[1] - stamps[0]) / passed
        bench.add(
            f"controller at 1 kHz, {engine}", factor, "x real time", ">= 0.99", "-"
        )
        bench.add(f"its states, {engine}", (len(came) - 1) / passed, "Hz")
        bench.add(f"its simulator, {engine}", 100.0 * cpu / wall, "% of a core")
