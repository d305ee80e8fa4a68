"""Count the modules that the flows of data enter, by a profiler in the programs.

Called by tools/flows, which sets up the environment.
"""

import inspect
import json
import os
import runpy
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from contextlib import ExitStack
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = "g1_description."
GENERATED = (f"{PACKAGE}msg.", f"{PACKAGE}srv.")
MOTION = ROOT / "test" / "data" / "elbow.csv"
TIMEOUT = 60.0
"""Longest wait for a program, in [s]."""

STATES = "link states to joint_states"
COMMANDS = "joint_commands to the engine"
CHECK = "check FILE.csv"
VERDICT = "FILE.csv to its verdict, once the robot is known"

BRIDGE = {
    STATES: ("bridge.state_source:_on_stamped",),
    COMMANDS: ("bridge.commands:_on_command", "bridge.commands:_send"),
}
GAZEBO = {COMMANDS: ("gazebo.services.joints:set_configuration",)}
"""Functions at which a flow begins, or goes on in another thread or program."""

HOPS = {COMMANDS: ("gazebo.node",)}
"""Modules that hand a flow from one thread to another, around those functions."""

ENDS = {"ros.publisher:publish"}
"""What is called after one of these is another flow's, as TF."""


class Profiler:
    """Records which modules of this package are entered below some functions.

    The commonest way of each function counts: the first message also prepares things.
    """

    def __init__(self, begins):
        """Prepare.

        Args:
            begins: By flow, functions at which it begins, as module:function.
        """
        self._begins = begins
        self._ways = {name: Counter() for names in begins.values() for name in names}
        self._thread = threading.local()

    def start(self):
        """Record this thread and all that begin from now on."""
        threading.setprofile(self)
        sys.setprofile(self)

    def __call__(self, frame, event, _):
        """Take a call of a function, or its return."""
        stack = self._thread.__dict__.setdefault("stack", [])
        if event == "call" and (stack or _name(frame) in self._ways):
            if not stack:
                self._thread.way, self._thread.is_over = {}, False
            # The body of a module or class, which is being imported, is no function.
            is_import = not frame.f_code.co_flags & inspect.CO_OPTIMIZED
            stack.append(is_import or bool(stack and stack[-1]))
            module = frame.f_globals.get("__name__", "")
            if not stack[-1] and not self._thread.is_over and _is_own(module):
                self._thread.way[module[len(PACKAGE) :]] = None
        elif event == "return" and stack:
            stack.pop()
            if _name(frame) in ENDS:
                self._thread.is_over = True
            if not stack:
                self._ways[_name(frame)][tuple(self._thread.way)] += 1

    def result(self):
        """Return the modules by flow, and the functions that were not called."""
        entered = {
            flow: [
                module
                for name in names
                for way, _ in self._ways[name].most_common(1)
                for module in way
            ]
            for flow, names in self._begins.items()
        }
        missing = [name for name, ways in self._ways.items() if not ways]
        return {"entered": entered, "missing": missing}


def _is_own(module):
    """Whether a module is of this package, and not a message."""
    return module.startswith(PACKAGE) and not module.startswith(GENERATED)


def _name(frame):
    """Name the function of a frame: module:function."""
    module = frame.f_globals.get("__name__", "")
    return f"{module[len(PACKAGE) :]}:{frame.f_code.co_name}"


def run(output, begins, program, *arguments):
    """Run a program of the package here, and write what it entered to a file."""
    profiler = Profiler(json.loads(begins))
    sys.argv = [program, *arguments]
    sys.path[0] = str(Path(program).parent)
    profiler.start()
    try:
        runpy.run_path(program, run_name="__main__")
    finally:
        sys.setprofile(None)
        Path(output).write_text(json.dumps(profiler.result()))


class Program:
    """A program of the package in a process with a profiler."""

    def __init__(self, begins, script, *arguments):
        """Start it."""
        self._output = tempfile.NamedTemporaryFile()  # noqa: SIM115  (read at the end)
        profiled = [sys.executable, __file__, "--run"]
        profiled += [self._output.name, json.dumps(begins)]
        self.process = subprocess.Popen(
            [*profiled, str(ROOT / "scripts" / script), *arguments],
            stdout=subprocess.DEVNULL,
        )

    def end(self, signum=signal.SIGINT):
        """End it; return what it has entered.

        Raises:
            SystemExit: If it did not call one of the functions.
        """
        self.process.send_signal(signum)
        return self.result()

    def result(self):
        """Wait for its end; return what it has entered."""
        self.process.wait(TIMEOUT)
        result = json.loads(Path(self._output.name).read_text())
        if result["missing"]:
            raise SystemExit(f"tools/flows: not called: {', '.join(result['missing'])}")
        return result["entered"]


def wait_for(condition, what):
    """Wait until something is true.

    Raises:
        SystemExit: If it is not in time.
    """
    end = time.monotonic() + TIMEOUT
    while not condition():
        if time.monotonic() > end:
            raise SystemExit(f"tools/flows: no {what} after {TIMEOUT:.0f} s")
        time.sleep(0.02)


def free_port():
    """Find a port that nobody listens to."""
    with socket.create_server(("localhost", 0)) as server:
        return server.getsockname()[1]


def run_nodes():
    """Command a simulated robot; return what stand-in and bridge have entered."""
    import rospy
    from sensor_msgs.msg import JointState

    master = f"http://localhost:{free_port()}"
    with ExitStack() as stack:
        home = stack.enter_context(tempfile.TemporaryDirectory())
        os.environ.update(ROS_MASTER_URI=master, ROS_HOME=home)
        port = master.rpartition(":")[2]
        core = subprocess.Popen(
            ["rosmaster", "--core", "-p", port], stdout=subprocess.DEVNULL
        )
        stack.callback(core.wait)
        stack.callback(core.terminate)
        wait_for(lambda: _answers(int(port)), "ROS master")
        urdf = (ROOT / "urdf" / "g1_29dof.urdf").read_text()
        rospy.set_param("/robot_description", urdf)
        rospy.set_param("/use_sim_time", True)
        gazebo = Program(
            GAZEBO, "gazebo_stand_in.py", "_robot_description:=robot_description"
        )
        stack.callback(gazebo.process.kill)
        bridge = Program(BRIDGE, "link_states_bridge.py")
        stack.callback(bridge.process.kill)
        rospy.init_node("flows", disable_signals=True)
        seen = []
        rospy.Subscriber("/joint_states", JointState, seen.append)
        commands = rospy.Publisher("/joint_commands", JointState, queue_size=1)
        wait_for(lambda: seen and commands.get_num_connections(), "joint states")
        commands.publish(JointState(name=["left_elbow_joint"], position=[0.5]))
        wait_for(lambda: max(seen[-1].position) > 0.4, "joint state as commanded")
        received, simulated = bridge.end(), gazebo.end()
    path = [*received[COMMANDS], *HOPS[COMMANDS], *simulated[COMMANDS]]
    return {STATES: received[STATES], COMMANDS: path}


def _answers(port):
    """Whether somebody listens to a port."""
    with socket.socket() as sock:
        return sock.connect_ex(("localhost", port)) == 0


def run_check(file):
    """Check a motion; return what the command has entered, and its second half."""
    flows = {CHECK: "cli.start:run", VERDICT: "checks.batch:outcome"}
    found = {}
    for flow, begin in flows.items():
        found.update(Program({flow: (begin,)}, "check", str(file)).result())
    return found


def main():
    """Print the modules of each flow."""
    file = sys.argv[1] if len(sys.argv) > 1 else MOTION
    for flow, modules in {**run_nodes(), **run_check(file)}.items():
        once = list(dict.fromkeys(modules))
        print(f"{flow}: {len(once)} modules\n  {', '.join(once)}")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--run"]:
        run(*sys.argv[2:])
    else:
        main()
