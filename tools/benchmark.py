"""Measure start-up and cost of the display on this machine.

Called by tools/benchmark, which sets up the environment.
"""

import argparse
import json
import os
import platform
import signal
import socket
import subprocess
import sys
import threading
import time
from xml.etree import ElementTree
from xmlrpc.client import ServerProxy

import numpy as np
import rosgraph
import rosnode
import rospy
import rosservice
from processes import end_processes, marked_environment, new_mark
from sensor_msgs.msg import JointState

PHYSICS = ("kinematic", "hold", "limp")
NODES = ("/gazebo", "/link_states_bridge")
PATIENCE = 60.0  # [s]
TICKS = os.sysconf("SC_CLK_TCK")
SEED = 1


def free_port():
    """Find a port that nobody listens on."""
    with socket.socket() as listener:
        listener.bind(("localhost", 0))
        return listener.getsockname()[1]


class Display:
    """One launch of the display, and the joint states it publishes."""

    def __init__(self, port, *arguments):
        """Launch it, and wait for the first joint states.

        Args:
            port: Port of the master, which runs already.
            arguments: Arguments for display.launch.
        """
        self._changed = threading.Condition()
        self._came = None
        self.message = None
        self.mark = new_mark()
        self._subscriber = rospy.Subscriber(
            "/joint_states", JointState, self._take, tcp_nodelay=True
        )
        start = time.monotonic()
        command = ["roslaunch", "-p", str(port), "g1_description", "display.launch"]
        self._process = subprocess.Popen(
            [*command, "rviz:=false", *arguments],
            env=marked_environment(self.mark),
            start_new_session=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        self.wait(lambda message: True)
        self.start_up = self._came - start

    def _take(self, message):
        """Keep the newest joint states."""
        with self._changed:
            self.message, self._came = message, time.monotonic()
            self._changed.notify_all()

    def wait(self, accept):
        """Wait for joint states that are accepted; give the time they came."""
        deadline = time.monotonic() + PATIENCE
        with self._changed:
            while self.message is None or not accept(self.message):
                if not self._changed.wait(deadline - time.monotonic()):
                    self.end()
                    sys.exit("tools/benchmark: the joint states stayed away")
            return self._came

    def forget(self):
        """Let the next wait see only what comes from now on."""
        with self._changed:
            self.message = None

    def end(self):
        """End every process of the launch."""
        self._subscriber.unregister()
        self._process.send_signal(signal.SIGINT)
        self._process.wait(PATIENCE)
        end_processes(self.mark)


def cpu_seconds(pid):
    """Read how long a process has used a core, in [s]."""
    with open(f"/proc/{pid}/stat") as file:
        fields = file.read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def process_ids(master):
    """Find the processes of simulator and bridge."""
    uris = {node: rosnode.get_api_uri(master, node, skip_cache=True) for node in NODES}
    return {node: ServerProxy(uri).getPid("/b")[2] for node, uri in uris.items()}


def measure_cpu(master, seconds=10.0):
    """Measure the share of a core that simulator and bridge take, in [%]."""
    pids = process_ids(master)
    before = {node: cpu_seconds(pid) for node, pid in pids.items()}
    start = time.monotonic()
    time.sleep(seconds)
    passed = time.monotonic() - start
    return {
        node: 100.0 * (cpu_seconds(pid) - before[node]) / passed
        for node, pid in pids.items()
    }


def service(name):
    """Give what calls a service of the simulator, on one connection."""
    kind = rosservice.get_service_class_by_name(f"/gazebo/{name}")
    return rospy.ServiceProxy(f"/gazebo/{name}", kind, persistent=True)


def measure_real_time_factor(seconds=5.0):
    """Compare simulated time with wall time."""
    world = service("get_world_properties")
    begin, start = world().sim_time, time.monotonic()
    time.sleep(seconds)
    return (world().sim_time - begin) / (time.monotonic() - start)


def measure_highest_real_time_factor():
    """Let time run as fast as can be, and as on the wall again."""
    set_factor = service("set_real_time_factor")
    set_factor(0.0)
    highest = measure_real_time_factor()
    set_factor(1.0)
    return highest


def measure_calls(count=2000):
    """Time calls on one connection while physics runs; give [us] per call."""
    state, configure = service("get_model_state"), service("set_model_configuration")
    wanted = [["left_elbow_joint"], [0.5]]
    calls = {
        "get_model_state": lambda: state("g1_robot", ""),
        "set_model_configuration": lambda: configure("g1_robot", "", *wanted),
    }
    costs = {}
    for name, call in calls.items():
        start = time.monotonic()
        for _ in range(count):
            call()
        costs[name] = 1e6 * (time.monotonic() - start) / count
    return costs


def limits():
    """Read the limits of the loaded robot's joints, by name."""
    urdf = ElementTree.fromstring(rospy.get_param("/robot_description"))
    bounds = {}
    for joint in urdf.iter("joint"):
        limit = joint.find("limit")
        if joint.get("type") == "revolute" and limit is not None:
            bounds[joint.get("name")] = [
                float(limit.get(s)) for s in ("lower", "upper")
            ]
    return bounds


def measure_commands(display, trials):
    """Send random configurations, and see when and how exactly they come back.

    Returns:
        Times from command to joint states in [s], and the largest error in [rad].
    """
    publisher = rospy.Publisher(
        "/joint_commands", JointState, queue_size=10, tcp_nodelay=True
    )
    while not publisher.get_num_connections():
        time.sleep(0.01)
    bounds = limits()
    names = [name for name in display.message.name if name in bounds]
    low, high = np.array([bounds[name] for name in names]).T
    random = np.random.default_rng(SEED)
    times, errors = [], []
    for _ in range(trials):
        wanted = random.uniform(low, high)

        def error(message, wanted=wanted):
            position = dict(zip(message.name, message.position))
            return np.abs([position[name] for name in names] - wanted).max()

        display.forget()
        start = time.monotonic()
        publisher.publish(JointState(name=names, position=wanted.tolist()))
        times.append(display.wait(lambda message: error(message) < 1e-3) - start)
        errors.append(error(display.message))
    publisher.unregister()
    return np.array(times), max(errors)


def run(arguments, port):
    """Measure everything; give rows of name, value and unit."""
    master = rosgraph.Master("/benchmark")
    model = [f"model:={os.path.abspath(arguments.model)}"] if arguments.model else []
    rows = []
    start_ups = []
    for number in range(arguments.runs):
        print(f"start-up {number + 1} of {arguments.runs} ...", flush=True)
        display = Display(port, *model)
        start_ups.append(display.start_up)
        display.end()
    rows.append(("roslaunch to first joint_states, median", np.median(start_ups), "s"))
    rows.append(("roslaunch to first joint_states, slowest", max(start_ups), "s"))
    for physics in PHYSICS:
        print(f"physics {physics} ...", flush=True)
        display = Display(port, *model, f"physics:={physics}")
        share = measure_cpu(master)
        rows += [(f"{physics}: CPU of {node}", share[node], "%") for node in NODES]
        factor = measure_real_time_factor()
        rows.append((f"{physics}: real-time factor at the defaults", factor, ""))
        highest = measure_highest_real_time_factor()
        rows.append((f"{physics}: highest real-time factor", highest, ""))
        rows += [
            (f"{physics}: a call of {name}", cost, "us")
            for name, cost in measure_calls().items()
        ]
        if physics == "kinematic":
            times, error = measure_commands(display, 300)
            rows.append(
                ("command to joint_states, median", np.median(times) * 1e3, "ms")
            )
            slow = np.percentile(times, 99) * 1e3
            rows.append(("command to joint_states, 99th percentile", slow, "ms"))
            rows.append(("largest error of 300 configurations", error, "rad"))
        display.end()
    return rows


def main():
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description="Measure start-up and cost.")
    parser.add_argument("--model", help="URDF file; default: the package's own G1")
    parser.add_argument("--json", help="file to write the figures to")
    parser.add_argument("--runs", type=int, default=5, help="start-ups to time")
    arguments = parser.parse_args()
    port = free_port()
    os.environ["ROS_MASTER_URI"] = f"http://localhost:{port}"
    mark = new_mark()
    core = subprocess.Popen(
        ["roscore", "-p", str(port)],
        env=marked_environment(mark),
        start_new_session=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        while not rosgraph.is_master_online():
            time.sleep(0.05)
        rospy.init_node("benchmark", disable_signals=True)
        rows = run(arguments, port)
    finally:
        core.send_signal(signal.SIGINT)
        core.wait(PATIENCE)
        end_processes(mark)
    machine = f"{os.cpu_count()} cores, {platform.machine()}, Python "
    machine += f"{platform.python_version()}, seed {SEED}"
    print(f"\n{machine}")
    for name, value, unit in rows:
        print(f"  {name:45s} {value:10.3g} {unit}")
    if arguments.json:
        figures = {name: {"value": float(value), "unit": u} for name, value, u in rows}
        with open(arguments.json, "w") as file:
            json.dump({"machine": machine, "figures": figures}, file, indent=2)


if __name__ == "__main__":
    main()
