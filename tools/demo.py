"""Launch the display, say what runs, and end all of it on Ctrl-C.

Called by tools/demo, which sets up the environment.
"""

import json
import math
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import xmlrpc.client
from pathlib import Path
from xml.etree import ElementTree

from processes import (
    end_processes,
    marked_environment,
    marked_processes,
    new_mark,
    wait_for_end,
)

ROOT = Path(__file__).resolve().parents[1]
SIMULATOR = "/gazebo"
TERMINAL_CODE = re.compile("\x1b(\\][^\a]*\a|[^a-zA-Z]*[a-zA-Z])")
# Warnings and errors of the nodes, but not what robot_state_publisher says of
# every robot whose root link has a mass.
WORTH_SHOWING = re.compile(r"\[ ?(WARN|ERROR|FATAL)(?!.*KDL does not support a root)")
# Longest time in [s] in which roslaunch may clean up after all the nodes.
ALONE = 1.0
ROSLAUNCH = re.compile(r"/roslaunch |/rosmaster ")
# Where the browser view is: its token is told nowhere else.
ADDRESS = re.compile(r"open http://\S+|Anyone with this address .*")


def say(text):
    """Print one line of progress."""
    print(f"tools/demo: {text}", flush=True)


class Demo:
    """One roslaunch, from its start to the end of its last process."""

    def __init__(self, arguments):
        """Start it.

        Args:
            arguments: Arguments of the launch file, value by name.
        """
        self.stopping = False
        self.first_errors = []
        self.screen = threading.Lock()
        self.is_ending = threading.Event()
        self.meter = None
        self.mark = new_mark()
        handle, self.log_name = tempfile.mkstemp(prefix="g1_demo_", suffix=".log")
        self.log = os.fdopen(handle, "w")
        for number in (signal.SIGHUP, signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self.stop)
        words = [f"{name}:={value}" for name, value in arguments.items()]
        self.roslaunch = self.start(
            "roslaunch", "g1_description", "display.launch", *words
        )
        self.readers = [
            threading.Thread(target=self.read, args=(self.roslaunch.stdout, False)),
            threading.Thread(target=self.read, args=(self.roslaunch.stderr, True)),
        ]
        for reader in self.readers:
            reader.start()

    def start(self, *command):
        """Start a process that no Ctrl-C in the terminal reaches but ours."""
        return subprocess.Popen(
            command,
            env=marked_environment(self.mark),
            start_new_session=True,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
        )

    def read(self, stream, is_errors):
        """Write what roslaunch prints to the log, and errors on the screen."""
        for line in stream:
            plain = TERMINAL_CODE.sub("", line)
            if "killing on exit" in plain:
                self.is_ending.set()
            self.log.write(plain)
            self.log.flush()
            address = ADDRESS.search(plain)
            if address and not is_errors:
                with self.screen:
                    say(address.group())
            if is_errors:
                self.first_errors += [plain] if len(self.first_errors) < 10 else []
                self.show(plain)

    def show(self, line):
        """Show a line that is worth it."""
        with self.screen:
            if not self.stopping and WORTH_SHOWING.match(line):
                sys.stderr.write(line)

    def advise(self, block):
        """Print what to try next."""
        with self.screen:
            sys.stderr.flush()
            print(block, flush=True)

    def stop(self, *_):
        """Remember that the end was asked for."""
        self.stopping = True

    def runs(self):
        """Tell whether to go on."""
        return not self.stopping and self.roslaunch.poll() is None

    def joint_states(self, timeout):
        """Measure joint states as soon as they flow.

        Args:
            timeout: How long to wait for the first message, in [s].

        Returns:
            What tools/joint_states.py prints, or None if they do not flow.
        """
        while self.runs() and not master_runs():
            time.sleep(0.05)
        self.meter = meter = self.start(
            sys.executable, f"{ROOT}/tools/joint_states.py", f"--timeout={timeout}"
        )
        while self.runs() and meter.poll() is None:
            time.sleep(0.05)
        if meter.poll() != 0:
            return None
        return json.loads(meter.stdout.read().splitlines()[-1])

    def __enter__(self):
        """Run until the end of a block."""
        return self

    def __exit__(self, *_):
        """End every process, gently first."""
        self.stopping = True
        if self.meter is not None and self.meter.poll() is None:
            self.meter.kill()  # it may wait for long
        if self.roslaunch.poll() is None:
            self.interrupt()
        end_processes(self.mark)
        for reader in self.readers:
            reader.join()
        self.log.close()

    def interrupt(self):
        """Interrupt roslaunch until it listens, and wait until all has ended.

        While it starts, it may lose an interrupt, wait ten seconds for the master that
        it has just ended, or hang. So it has a moment once its nodes are gone.
        """
        now = time.monotonic()
        end, due, alone_since = now + 30.0, now, math.inf
        while self.roslaunch.poll() is None and now < end:
            if now >= due and not self.is_ending.is_set():
                self.roslaunch.send_signal(signal.SIGINT)
                due = now + 1.0
            time.sleep(0.05)
            now = time.monotonic()
            others = marked_processes(self.mark).values()
            is_alone = all(ROSLAUNCH.search(command) for command in others)
            alone_since = min(alone_since, now) if is_alone else math.inf
            if now > alone_since + ALONE:
                self.roslaunch.kill()
                return
        wait_for_end(self.mark, end - now)

    def refusal(self):
        """Give the sentence with which arguments were refused, if they were.

        It is alone above what roslaunch says of the command that ended with it.
        """
        lines = [line.strip() for line in self.first_errors if line.strip()]
        refused = len(lines) > 1 and lines[1].startswith("RLException: ")
        return lines[0] if refused else ""

    def failed(self, reason):
        """Show why it failed, and end the program."""
        for reader in self.readers:
            reader.join(1.0)
        told = self.refusal()
        if told:
            os.remove(self.log_name)
            sys.exit(f"tools/demo: {told}")
        lines = Path(self.log_name).read_text().splitlines()
        print(*lines[-20:], sep="\n", file=sys.stderr)
        sys.exit(f"tools/demo: {reason}; all of its output is in {self.log_name}")


def master():
    """Reach the ROS master, which need not run yet."""
    return xmlrpc.client.ServerProxy(os.environ["ROS_MASTER_URI"])


def master_runs():
    """Tell whether the ROS master answers."""
    try:
        master().getPid("/demo")
    except (OSError, xmlrpc.client.Error):
        return False
    return True


def check_master():
    """Refuse to start next to another simulator."""
    try:
        socket.setdefaulttimeout(3.0)
        _, _, node = master().lookupNode("/demo", SIMULATOR)
        xmlrpc.client.ServerProxy(node).getPid("/demo")
    except (OSError, ValueError, xmlrpc.client.Error):
        return
    sys.exit(
        f"tools/demo: A node {SIMULATOR} is already running at "
        f"{os.environ['ROS_MASTER_URI']}. Stop it, or use another master: "
        "ROS_MASTER_URI=http://localhost:11411 tools/demo"
    )


def check_host_name():
    """Let ROS talk to itself on a machine that does not know its own name."""
    if os.environ.get("ROS_HOSTNAME") or os.environ.get("ROS_IP"):
        return
    try:
        socket.getaddrinfo(socket.gethostname(), None)
    except OSError:
        name = socket.gethostname()
        say(f"Cannot resolve the host name {name}; using ROS_HOSTNAME=localhost")
        os.environ["ROS_HOSTNAME"] = "localhost"


def example(description, names):
    """Choose a joint and a position that show well.

    Args:
        description: The robot description, URDF text.
        names: Names of the joints whose state flows.

    Returns:
        Name of the joint, an elbow if there is one, and a position at three
        quarters of its range, in [rad] or [m]; None if no joint has a state.
    """
    joints = [
        joint
        for joint in ElementTree.fromstring(description).iter("joint")
        if joint.get("name") in names and joint.find("mimic") is None
    ]
    if not joints:
        return None
    joint = min(joints, key=lambda joint: "elbow" not in joint.get("name"))
    if joint.get("type") == "continuous":
        return joint.get("name"), 1.0
    limit = joint.find("limit")
    lower, upper = (float(limit.get(side, 0.0)) for side in ("lower", "upper"))
    return joint.get("name"), round(lower + 0.75 * (upper - lower), 3)


def block_of(states, model, log):
    """Say what runs and what to try next."""
    _, _, description = master().getParam("/demo", "/robot_description")
    robot = ElementTree.fromstring(description).get("name")
    lines = [
        "",
        f"  Robot    {robot}{f', from {model}' if model else ''}",
        f"  Joints   {len(states['names'])}, {states['rate']:.0f} times a second"
        " on /joint_states",
        f"  Log      {log}, INFO too",
        "",
        "  Try next, in another shell:",
        "",
        f"    source {ROOT}/.ws/devel/setup.bash",
    ]
    for name in ("ROS_MASTER_URI", "ROS_HOSTNAME"):
        if os.environ.get(name) not in (None, "http://localhost:11311"):
            lines.append(f"    export {name}={os.environ[name]}")
    shown = example(description, states["names"])
    if shown:
        lines.append(
            "    rostopic pub -1 /joint_commands sensor_msgs/JointState "
            f"'{{name: [{shown[0]}], position: [{shown[1]}]}}'"
        )
    lines += [
        "    rostopic echo -n1 /joint_states",
        "",
        "  Ctrl-C ends everything.",
        "",
    ]
    return "\n".join(lines)


def main():
    """Run the demo."""
    arguments = dict(word.split(":=", 1) for word in sys.argv[1:])
    model = arguments.get("model", "")
    check_master()
    check_host_name()
    if not os.environ.get("DISPLAY"):
        say("DISPLAY is not set: RViz is not started")
    say(
        "starting "
        + " ".join(["roslaunch g1_description display.launch", *sys.argv[1:]])
    )
    with Demo(arguments) as demo:
        timeout = 60.0
        if arguments.get("paused", "").lower() in ("true", "1"):
            say("paused; resume with: rosservice call /gazebo/unpause_physics")
            timeout = 86400.0
        say("waiting for /joint_states")
        states = demo.joint_states(timeout)
        if states:
            demo.advise(block_of(states, model, demo.log_name))
        elif demo.runs():
            demo.failed(f"no joint states within {timeout:.0f} s")
        while demo.runs():
            time.sleep(0.1)
        if demo.roslaunch.poll() is not None:
            demo.failed("roslaunch ended by itself")
        say("ending every process")
    os.remove(demo.log_name)


main()
