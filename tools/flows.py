"""Count the modules that three flows of data enter, by a profiler in the programs.

Called by tools/flows, which sets up the environment.
"""

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
from contextlib import ExitStack
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = "g1_description."
MOTION = ROOT / "test" / "data" / "elbow.csv"
TIMEOUT = 60.0
"""Longest wait for a program, in [s]."""

STATES = "link states to joint_states"
COMMANDS = "joint_commands to the engine"
CHECK = "check FILE.csv"

BRIDGE = {
    STATES: ("bridge.state_source:_on_stamped", "bridge.state_source:_on_unstamped"),
    COMMANDS: ("bridge.commands:_on_command", "bridge.commands:_send"),
}
GAZEBO = {COMMANDS: ("gazebo.services.joints:set_configuration",)}
"""Functions at which a flow begins, or goes on in another thread or program."""

HOPS = {COMMANDS: ("gazebo.node",)}
"""Modules that hand a flow from one thread to another, around those functions."""

ENDS = {"ros.publisher:publish"}
"""What is called after one of these is another flow's, as TF."""


class Profiler:
    """Records the modules of this package that are entered below some functions."""

    def __init__(self, begins):
        """Prepare.

        Args:
            begins: By flow, functions at which it begins, as module:function.
        """
        self._flow_of = {
            function: flow
            for flow, functions in begins.items()
            for function in functions
        }
        self.entered = {flow: [] for flow in begins}
        self.missing = set(self._flow_of)
        self._thread = threading.local()

    def start(self):
        """Record this thread and all that begin from now on."""
        threading.setprofile(self)
        sys.setprofile(self)

    def __call__(self, frame, event, _):
        """Take a call of a function, or its return."""
        here = self._thread.__dict__
        depth = here.get("depth", 0)
        if event == "return" and depth:
            here["depth"] = depth - 1
            if _name(frame) in ENDS:
                here["ended"] = True
        if event != "call":
            return
        if depth:
            here["depth"] = depth + 1
        else:
            flow = self._flow_of.get(_name(frame))
            if flow is None:
                return
            here.update(depth=1, flow=flow, ended=False)
            self.missing.discard(_name(frame))
        module = frame.f_globals.get("__name__", "")
        is_function = frame.f_code.co_flags & 1  # else a module or class being imported
        if is_function and module.startswith(PACKAGE) and not here["ended"]:
            name = module[len(PACKAGE) :]
            entered = self.entered[here["flow"]]
            if name not in entered and not name.startswith(("msg.", "srv.")):
                entered.append(name)


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
        result = {"entered": profiler.entered, "missing": sorted(profiler.missing)}
        Path(output).write_text(json.dumps(result))


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
    return {STATES: received[STATES], COMMANDS: list(dict.fromkeys(path))}


def _answers(port):
    """Whether somebody listens to a port."""
    with socket.socket() as sock:
        return sock.connect_ex(("localhost", port)) == 0


def run_check(file):
    """Check a motion; return what the command has entered."""
    return Program({CHECK: ("cli.start:run",)}, "check", str(file)).result()


def main():
    """Print the modules of each flow."""
    file = sys.argv[1] if len(sys.argv) > 1 else MOTION
    for flow, modules in {**run_nodes(), **run_check(file)}.items():
        print(f"{flow}: {len(modules)} modules\n  {', '.join(modules)}")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--run"]:
        run(*sys.argv[2:])
    else:
        main()
