"""Run the display for long, disturb it, report. Called by tools/soak."""

import argparse
import os
import re
import shutil
import signal
import sys
import threading
import time
from collections import Counter, defaultdict
from pathlib import Path

import numpy as np
import rospy
from bench.graph import FAILURES, OWN_MODEL, Graph, free_port
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import JointState
from std_srvs.srv import Empty

NODES = ("/gazebo", "/link_states_bridge", "/web", "/checker", "/robot_state_publisher")
JOINT = "left_wrist_roll_joint"
"""Commanded here; the motion that is played leaves it alone."""
POSITIONS = (0.25, -0.25, 0.5, -0.5)
LOST = 20.0
"""Time in [s] after which a command that did not arrive is lost."""
REST = 15.0
"""Time in [s] at the end in which nothing is disturbed."""
SQUAT = Path(__file__).resolve().parents[1] / "motions" / "squat.csv"


class Probe:
    """A user's node: counts joint states and warnings, commands, resets."""

    def __init__(self):
        """Connect."""
        self.counts, self.latencies = Counter(), []
        self._desired, self._arrived = None, threading.Event()
        self._commands = rospy.Publisher("/joint_commands", JointState, queue_size=10)
        rospy.Subscriber("/joint_states", JointState, self._on_states, tcp_nodelay=True)
        rospy.Subscriber("/rosout", Log, self._on_log)

    def _on_states(self, message):
        self.counts["joint states"] += 1
        position = dict(zip(message.name, message.position)).get(JOINT)
        if None not in (position, self._desired) and (
            abs(position - self._desired) < 1e-6
        ):
            self._arrived.set()

    def _on_log(self, line):
        if line.level >= Log.WARN:
            self.counts["TF warnings" if "TF_" in line.msg else "warnings"] += 1

    def command(self, position):
        """Move the joint; wait until joint states show it."""
        self._arrived.clear()
        self._desired, begin = position, time.monotonic()
        self._commands.publish(JointState(name=[JOINT], position=[position]))
        self.counts["commands"] += 1
        if self._arrived.wait(LOST):
            self.latencies.append(time.monotonic() - begin)
        else:
            self.counts["commands lost"] += 1
        self._desired = None

    def reset(self):
        """Reset simulated time and the robot."""
        try:
            rospy.ServiceProxy("/gazebo/reset_simulation", Empty)()
            self.counts["resets"] += 1
        except (rospy.ServiceException, rospy.ROSException, OSError):
            self.counts["resets refused"] += 1


class Samples:
    """Memory in [MB] and processor time in [s] of each node, over time."""

    def __init__(self, graph, names):
        """Begin without samples."""
        self._graph, self.names = graph, names
        self.memory, self.share = defaultdict(list), defaultdict(list)
        self._before = {}

    def take(self):
        """Look at each node that is there."""
        for name in self.names:
            try:
                process = self._graph.node(name, timeout=0.0)
                now = process.pid, process.cpu_seconds(), time.monotonic()
                self.memory[name].append(process.memory())
            except (*FAILURES, ValueError):
                continue
            before = self._before.get(name)
            if before and before[0] == now[0]:
                share = (now[1] - before[1]) / (now[2] - before[2])
                self.share[name].append(100.0 * share)
            self._before[name] = now


def run(graph, names, length):
    """Disturb the display for a time in [s]; return the probe and the samples."""
    play = ["rosrun", "g1_description", "play", SQUAT, "--loop"]
    rospy.init_node("soak", disable_signals=True)
    probe, samples, player = Probe(), Samples(graph, names), graph.start(play)
    scale = min(length / 3600.0, 1.0)
    periods = {"command": 5.0, "sample": 10.0, "play": 2.0, "reset": 60.0, "kill": 600}
    periods = {kind: max(period * scale, 1.0) for kind, period in periods.items()}
    begin = time.monotonic()
    due = {kind: begin + period for kind, period in periods.items()}
    try:
        while time.monotonic() < begin + length:
            time.sleep(0.1)
            rests = time.monotonic() > begin + length - REST
            for kind in [k for k, at in due.items() if time.monotonic() >= at]:
                due[kind] = time.monotonic() + periods[kind]
                if kind == "command":
                    probe.command(POSITIONS[probe.counts["commands"] % 4])
                elif kind == "sample":
                    samples.take()
                elif kind == "play" and player.has_ended():  # as a reset ends it
                    player = graph.start(play)
                elif kind == "reset" and not rests:
                    probe.reset()
                elif kind == "kill" and not rests:
                    os.kill(graph.node("/gazebo").pid, signal.SIGKILL)
                    probe.counts["simulators killed"] += 1
                    print(f"{time.monotonic() - begin:.0f} s: killed", flush=True)
    except KeyboardInterrupt:
        print("ended early", flush=True)
    probe.counts["nodes missing"] = sum(not graph.finds(name) for name in names)
    probe.counts["tracebacks"] = len(re.findall(r"Traceback \(most", printed(graph)))
    probe.counts["seconds"] = round(time.monotonic() - begin)
    return probe, samples


def printed(graph):
    """Give the output of all programs."""
    logs = Path(graph.folder, "log").rglob("*-std*.log")
    return "\n".join(
        [graph.output(), *(log.read_text(errors="replace") for log in logs)]
    )


def report(probe, samples):
    """Print the tables; return the exit code."""
    print("\n| node | memory after 10 % of the time, MB | at the end | core, % |")
    print("| --- | ---: | ---: | ---: |")
    for name, memory in samples.memory.items():
        early = memory[len(memory) // 10]
        share = np.median(samples.share[name] or [np.nan])
        print(f"| {name} | {early:.1f} | {memory[-1]:.1f} | {share:.1f} |")
    print("\n| count | |\n| --- | ---: |")
    for name, count in probe.counts.items():
        print(f"| {name} | {count} |")
    if probe.latencies:
        median, most = np.median(probe.latencies), max(probe.latencies)
        print(f"| time until a command is seen, median, ms | {1e3 * median:.1f} |")
        print(f"| the same, longest, s | {most:.2f} |")
    faults = ("commands lost", "tracebacks", "nodes missing")
    return int(any(probe.counts[name] for name in faults))


def main():
    """Launch, disturb, report."""
    parser = argparse.ArgumentParser(prog="tools/soak")
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--no-rviz", action="store_true")
    given = parser.parse_args()
    if not given.hours >= 0.02:
        parser.error("--hours takes at least 0.02")
    has_rviz = bool(shutil.which("xvfb-run")) and not given.no_rviz
    names = [*NODES, "/rviz"] if has_rviz else [*NODES]
    words = (
        "web:=true",
        f"port:={free_port()}",
        "checks:=true",
        "respawn_gazebo:=true",
    )
    with Graph() as graph:
        (graph.launch_rviz if has_rviz else graph.launch)(OWN_MODEL, *words)
        for name in names:
            graph.node(name)
        return report(*run(graph, names, 3600.0 * given.hours))


if __name__ == "__main__":
    sys.exit(main())
