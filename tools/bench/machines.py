"""Fifty robots in one world, from four bridges on two hosts.

The stand-in is on a host with the master, two bridges each are on two others, and a
node on a fourth subscribes to the joint states of all robots. Hosts are network
namespaces of this machine: its cores do the work of all of them. The world is
kinematic, with steps of 1 ms and 50 states per second.
"""

import sys
import time
from pathlib import Path

from .growth import robots
from .nodes import Process, wait_for
from hosts import HostsError
from machines import Machines

HERE = Path(__file__).resolve().parent
ROBOTS = 50
BRIDGES = (13, 12, 13, 12)
"""Robots of each; two bridges share a host."""
RATE = 50.0
"""States per second."""
STAND_IN = (
    *("rosrun", "g1_description", "gazebo_stand_in.py", "__name:=gazebo"),
    *(f"_link_states_rate:={RATE}", f"_pub_clock_frequency:={RATE}"),
)
BRIDGE = ("rosrun", "g1_description", "link_states_bridge.py")
LONGEST = 300.0  # [s] that spawning and all else may take


def run(bench):
    """Measure rates and processor time."""
    seconds = bench.seconds(20.0, 5.0)
    what = f"{ROBOTS} robots, {len(BRIDGES)} bridges, {seconds:.0f} s"
    with bench.attempt(what):
        try:
            machines = Machines("world", "left", "right", "reader")
        except HostsError as error:
            bench.leave_out(f"{what}: {error}")
            return
        try:
            measure(bench, machines, seconds)
        finally:
            machines.close()


def measure(bench, machines, seconds):
    """Start all, and keep the figures."""
    world, left, right, reader = machines.network.hosts
    machines.start_master(bench.model)
    nodes = {"simulator": machines.start(world, "gazebo", STAND_IN)}
    begin = time.monotonic()
    node_on(machines, world, "spawning_node.py", ROBOTS)
    bench.add("spawning 50 robots", time.monotonic() - begin, "s")
    entries = robots(ROBOTS)
    for number, count in enumerate(BRIDGES):
        name, own = f"bridge_{number}", entries[:count]
        del entries[:count]
        host = left if number < len(BRIDGES) / 2 else right
        text = "[{}]".format(", ".join(map(as_yaml, own)))
        machines.run(["rosparam", "set", f"/{name}/robots", text])
        command = (*BRIDGE, f"__name:={name}")
        nodes[name.replace("_", " ")] = machines.start(host, name, command)

    program = start_node(machines, reader, "crowd_node.py", ROBOTS, seconds)
    wait_for(lambda: "begin" in machines.output("crowd_node.py"), "states", LONGEST)
    meters = {name: Process(node.pid).meter() for name, node in nodes.items()}
    program.wait(LONGEST)
    report(bench, meters, machines.output("crowd_node.py"))


def as_yaml(entry):
    """Write a robot for rosparam."""
    return "{{{}}}".format(", ".join(f"{key}: {text}" for key, text in entry.items()))


def start_node(machines, host, name, *arguments):
    """Start a program of this folder on a host; give its Popen."""
    return machines.start(host, name, [sys.executable, HERE / name, *arguments])


def node_on(machines, host, name, *arguments):
    """Run a program of this folder on a host to its end."""
    start_node(machines, host, name, *arguments).wait(LONGEST)


def report(bench, meters, text):
    """Keep the figures."""
    rates = sorted(float(word) for word in text.split("begin")[1].split())
    bench.add("joint states of a robot, slowest", rates[0], "Hz")
    bench.add("joint states of a robot, median", rates[len(rates) // 2], "Hz")
    for name, meter in meters.items():
        cpu, wall = meter()
        bench.add(f"{name}'s share of a core", 100.0 * cpu / wall, "%")
