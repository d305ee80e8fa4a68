"""The stand-in, with the display around it.

The display runs without RViz and, unless a case is of the default rate, publishes the
states of every step; the bridge receives them, and robot_state_publisher receives the
bridge's. There is no other listener: the real-time factor comes from
get_world_properties before and after a window, processor time from the system, and the
number of received states from the bridge. For the highest real-time factor,
~set_real_time_factor is 0. All but kinematic start five simulated seconds after the
robot is released: in hold it stands and rests by then. "hold, moved" sets a joint
twenty times a second. Service calls are timed on one connection while physics runs: in
kinematic, and while a robot lies, where the simulator is busy all the time. The figure
of "display.launch" is of all that it starts, with master and roslaunch, at default
rates.
"""

from __future__ import annotations

import time
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .nodes import EACH_STEP, Graph, Process, wait_for
from .start_up import VENDOR
from processes import marked_processes
from tcpros import Service

CALLS = 2000
FALL = 5.0  # [s] of simulated time; it lies after one, and stands still after two
MOVES = 0.05  # [s] from one move of a joint to the next
RATE = 1000.0  # [Hz]
SETTLE = 1.0  # [s]
CALLED = ("kinematic", "limp, lying", "vendor's, lying")
HANGING = ("physics:=limp", "fixed_base:=true", "z:=1.5")


class Case(NamedTuple):
    """One way to run it."""

    name: str
    arguments: tuple
    share: str = ""
    """Target for the simulator's share of a core."""

    highest: str = ""
    """Target for the highest real-time factor."""

    moved: bool = False
    """Whether a joint is set again and again, so that it never rests."""

    model: Path | None = None
    """Another model than that which is measured."""

    rate: tuple = (EACH_STEP,)
    """Arguments for the states' rate; none: as many as display.launch has."""


CASES = (
    Case("kinematic", ("physics:=kinematic",), share="<= 30"),
    Case("hold", ("physics:=hold",), share="<= 45"),
    Case("hold, moved", ("physics:=hold",), moved=True),
    Case("limp, hanging", HANGING, highest="> 3.6"),
    Case("limp, lying", ("physics:=limp",), highest=">= 4"),
    Case("vendor's, lying", ("physics:=limp",), model=VENDOR),
    Case(
        "vendor's, lying, default rate",
        ("physics:=limp",),
        highest=">= 2.5",
        model=VENDOR,
        rate=(),
    ),
)
SERVICES = (
    ("get_model_state", ("g1_robot", "")),
    ("set_model_configuration", ("g1_robot", "", ["left_elbow_joint"], [0.5])),
)


class Display:
    """A display that was launched, and what it is doing."""

    def __init__(self, graph):
        """Wait until its states flow."""
        self._graph = graph
        self.simulator = graph.node("/gazebo")
        self.bridge = graph.node("/link_states_bridge")
        wait_for(self.taken, "the first states")
        self._world = Service("/gazebo/get_world_properties")

    def taken(self):
        """Count the states that the bridge has taken."""
        return self._graph.messages_taken("/link_states_bridge", "/gazebo/world_state")

    def now(self):
        """Tell the simulated time in [s]."""
        return self._world().sim_time

    def move(self, seconds):
        """Set a joint again and again for some time."""
        names = ["left_elbow_joint"]
        with closing(Service("/gazebo/set_model_configuration")) as service:
            end = time.monotonic() + seconds
            while time.monotonic() < end:
                angle = 0.5 + 0.1 * np.sin(time.monotonic())
                service("g1_robot", "", names, [angle])
                time.sleep(MOVES)

    def watch(self, seconds, pass_time=time.sleep):
        """Let time pass.

        Args:
            seconds: How much.
            pass_time: What to do in the meantime, for so long.

        Returns:
            Simulated, wall, the simulator's and the bridge's processor time in [s],
            and how many states were taken.
        """
        begin, taken = self.now(), self.taken()
        simulator, bridge = self.simulator.meter(), self.bridge.meter()
        pass_time(seconds)
        spent, wall = simulator()
        passed = self.now() - begin
        return Watched(passed, wall, spent, bridge()[0], self.taken() - taken)


class Watched(NamedTuple):
    """What happened in a window, times in [s]."""

    simulated: float
    wall: float
    simulator: float
    bridge: float
    states: int


def run(bench):
    """Measure each kind of physics."""
    peaks = []
    for case in CASES:
        if case.model and not case.model.exists():
            bench.leave_out(f"{case.name}: the model is not here")
            continue
        with bench.attempt(case.name):
            peaks.append(measure_case(bench, case))
    with bench.attempt("display.launch"):
        measure_display(bench)
    for name, peak in zip(("simulator", "bridge"), zip(*peaks)):
        bench.add(f"{name}: peak of memory, the largest of these", max(peak), "MB")


def measure_display(bench):
    """Measure all processes of display.launch at its default rate, without RViz."""
    with Graph() as graph, graph.launch(bench.model):
        Display(graph)
        time.sleep(SETTLE)
        meters = [Process(pid).meter() for pid in marked_processes(graph.mark)]
        time.sleep(bench.seconds(10.0))
        shares = [100.0 * cpu / wall for cpu, wall in (meter() for meter in meters)]
    bench.add("display.launch: all its processes", sum(shares), "%", "<= 35")


def measure_case(bench, case):
    """Run one; give the peaks of memory of simulator and bridge in [MB]."""
    launched = (case.model or bench.model, *case.rate, *case.arguments)
    with Graph() as graph, graph.launch(*launched):
        display = Display(graph)
        measure(bench, case, display)
        nodes = display.simulator, display.bridge
        return [node.memory("VmHWM") for node in nodes]


def measure(bench, case, display):
    """Measure in real time, as fast as can be, and, once, calls."""
    if case.name != "kinematic":
        wait_for(lambda: display.now() > FALL, "the robot's fall")
    pass_time = display.move if case.moved else time.sleep
    seen = display.watch(bench.seconds(10.0), pass_time)
    measure_real_time(bench, case, seen)
    if case.name in CALLED:
        measure_calls(bench, case.name)
    with closing(Service("/gazebo/set_real_time_factor")) as set_factor:
        set_factor(0.0)
        time.sleep(SETTLE)
        fast = display.watch(bench.seconds(5.0), pass_time)
        set_factor(1.0)
    factor = fast.simulated / fast.wall
    bench.add(f"{case.name}: highest real-time factor", factor, "", case.highest)
    rate = fast.states / fast.simulated
    bench.add(f"{case.name}: states per simulated second then", rate, "1/s")


def measure_real_time(bench, case, seen):
    """Keep the figures of a window in real time."""
    share = 100.0 * seen.simulator / seen.wall
    bench.add(f"{case.name}: simulator's share of a core", share, "%", case.share)
    bench.add(
        f"{case.name}: bridge's share of a core", 100.0 * seen.bridge / seen.wall, "%"
    )
    step = 1e6 * seen.simulator / (seen.simulated * RATE)
    bench.add(f"{case.name}: simulator's processor time per step", step, "us")
    factor = seen.simulated / seen.wall
    bench.add(f"{case.name}: real-time factor, 1 is wanted", factor)


def measure_calls(bench, case):
    """Time calls of two services.

    Args:
        bench: Where the figures go.
        case: Its name.
    """
    for name, values in SERVICES:
        with closing(Service(f"/gazebo/{name}")) as service:
            request = service.request(*values)
            times = [time.monotonic()]
            for _ in range(CALLS):
                service.send(request)
                times.append(time.monotonic())
        median, late = np.percentile(np.diff(times), (50, 99))
        bench.add(f"{case}: a call of {name}, median", 1e6 * median, "us")
        bench.add(f"{case}: a call of {name}, 99th percentile", 1e6 * late, "us")
