"""The master dies and another takes its place: the bridge goes on, and is known."""

import os
import signal
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

import rosgraph
import rospy
from gazebo_msgs.msg import LinkStates
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from support.bridge.arm import JOINTS, URDF, arm_states, shows
from support.bridge.process import Bridge
from support.ros_testing import Repeated, program, wait_for
from support.wire.raw_publisher import RawPublisher
from support.wire.raw_service import Simulator
from support.wire.raw_subscriber import RawSubscriber

from ports import free_port
from tcpros import body_of

AWAY = 100
"""Messages that come while there is no master."""
BEGIN = time.monotonic() - 100.0
"""When the simulated time was zero, on the monotonic clock."""
OWN = {"/joint_states", "/tf", "/tf_static", "/diagnostics", "/rosout"}
QUIET = 1.5
"""Time in [s] without registrations after which nodes have started."""

OTHERS = ("gazebo_stand_in.py", "checker.py", "web.py", "replay.py")
"""Programs of the other nodes that run for long."""


class Core:
    """A master as a process of this test; killed and started again on one port."""

    def __init__(self):
        self._port = str(free_port())
        self.uri = f"http://localhost:{self._port}"
        self.master = rosgraph.Master("/test", self.uri)
        self.start()

    def start(self):
        """Start it as roscore does, and set what a launch file would."""
        self._process = subprocess.Popen(
            ["rosmaster", "--core", "-p", self._port],
            env={**os.environ, "ROS_MASTER_URI": self.uri},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        wait_for(self.master.is_online, "the master")
        self.master.setParam("/use_sim_time", True)
        self.master.setParam("/robot_description", URDF)

    def send_signal(self, number):
        self._process.send_signal(number)

    def kill(self):
        self._process.kill()
        self._process.wait()


class Sides:
    """What is around the bridge: the time, a simulator, who commands and who reads."""

    def __init__(self, uri, name):
        """Register all with a master under names of their own.

        Args:
            uri: The master's address.
            name: What their names begin with.
        """
        self._clock = RawPublisher("/clock", Clock, f"{name}/clock", uri)
        self.states = RawPublisher(
            "/gazebo/link_states", LinkStates, f"{name}/simulator", uri
        )
        self.commands = RawPublisher(
            "/joint_commands", JointState, f"{name}/planner", uri
        )
        self.simulator = Simulator(master_uri=uri)
        self._ticking = Repeated(self._tick, 0.002)

    def _tick(self):
        now = rospy.Time.from_sec(time.monotonic() - BEGIN)
        self._clock.send(body_of(Clock(now)))

    def wait_for_bridge(self):
        """Wait until the bridge has connected to all topics."""
        topics = (self._clock, self.states, self.commands)
        wait_for(lambda: all(topic.sockets for topic in topics), "the bridge")

    def send_command(self, **positions):
        message = JointState(name=[*positions], position=[*positions.values()])
        self.commands.send(body_of(message))

    def command(self, **positions):
        """Send a command; it must reach the simulator."""
        self.send_command(**positions)
        self.simulator.wait_for_request(**positions)

    def close(self):
        self._ticking.close()
        for side in (self._clock, self.states, self.commands, self.simulator):
            side.close()


class WaitingBridge(Bridge):
    """A bridge without a robot, which waits for it."""

    def _is_up(self):
        assert self.process.poll() is None, self.output()
        return b"Waiting for" in self.output()


class TestBridgeMaster(unittest.TestCase):
    def setUp(self):
        self.core = Core()
        self.addCleanup(lambda: self.core.kill())
        self.number, self.shown = 0, 0.0

    def sides(self):
        """Make all that is around the bridge anew."""
        self.number += 1
        sides = Sides(self.core.uri, f"/life_{self.number}")
        self.addCleanup(sides.close)
        return sides

    def reader(self):
        """Subscribe to joint states through the master."""
        name = f"/reader_{self.number}"
        uris = wait_for(
            lambda: rosgraph.Master(name, self.core.uri).registerSubscriber(
                "/joint_states", JointState._type, "http://localhost:1/"
            ),
            "the master to know who publishes joint states",
        )
        self.assertEqual(uris, [self.bridge.uri])
        reader = RawSubscriber(uris[0], "/joint_states", JointState, name)
        self.addCleanup(reader.close)
        return reader

    def show(self, sides):
        """Show the arm in a new position."""
        self.shown = (self.shown + 1e-3) % 1.0
        positions = [self.shown, -self.shown, 0.5 * self.shown]
        self.wanted = dict(zip(JOINTS, positions))
        sides.states.send(body_of(arm_states(*positions)))

    def check(self, sides, *readers):
        """Show the arm in a new position; each reader must get it next, and once."""
        self.show(sides)
        for reader in readers:
            self.assertTrue(self.is_wanted(reader.read()))

    def is_wanted(self, data):
        """Tell whether joint states are those of the last link states."""
        return shows(JointState().deserialize(data), self.wanted)

    def begin(self, sides, *readers):
        """Show the arm until the last reader is taken up and all have the newest."""
        wait_for(lambda: self.show(sides) or readers[-1].has_data(0.02), "joint states")
        self.show(sides)
        for reader in readers:
            reader.read_until(self.is_wanted)

    def live(self):
        """Begin with a bridge, what is around it, and a reader."""
        sides = self.sides()
        self.bridge = Bridge("_model_name:=arm", master_uri=self.core.uri)
        self.addCleanup(self.bridge.kill)
        sides.wait_for_bridge()
        readers = [self.reader()]
        self.begin(sides, *readers)
        sides.command(elbow=0.125)
        return sides, readers

    def go_on(self, sides, *readers):
        """Without a master, what is connected stays so for a while."""
        for _ in range(AWAY):
            self.check(sides, *readers)
        sides.command(elbow=0.25 + self.number)

    def start_again(self, *readers):
        """Start another master and new nodes, which the bridge must find soon."""
        self.core.start()
        begin = time.monotonic()
        sides = self.sides()
        sides.wait_for_bridge()
        newest = self.reader()
        self.begin(sides, *readers, newest)
        elapsed = time.monotonic() - begin
        print(f"bridge_master: known after {elapsed:.2f} s", file=sys.stderr)
        return sides, newest

    def test_the_master_hangs_and_dies_twice_and_nothing_stops(self):
        """Not even where there is something to log: rospy asks the master for it."""
        old, readers = self.live()
        self.core.send_signal(signal.SIGSTOP)
        self.addCleanup(self.core.send_signal, signal.SIGCONT)
        old.states.send(body_of(arm_states(model="leg")))
        old.states.send(b"no message")
        self.go_on(old, *readers)
        self.core.send_signal(signal.SIGCONT)
        self.assert_known()
        self.core.kill()
        self.go_on(old, *readers)
        new, newest = self.start_again(*readers)
        readers.append(newest)
        for sides in (new, old):
            self.check(sides, *readers)
        old.close()
        new.command(elbow=0.5 + self.number)
        self.check(new, *readers)
        self.assert_known()
        # Now without a simulator, too: a command arrives when both are back.
        self.core.kill()
        new.simulator.close()
        for number in range(10):
            new.send_command(elbow=0.1 * number, slide=0.01 * number)
        self.check(new, *readers)
        last, _ = self.start_again(*readers)
        last.simulator.wait_for_request(elbow=0.1 * 9, slide=0.01 * 9)
        self.assertEqual(len(last.simulator.requests), 1)
        self.assert_known()

    def test_the_master_dies_while_the_bridge_waits_for_the_robot(self):
        self.core.master.deleteParam("/robot_description")
        self.bridge = WaitingBridge("_model_name:=arm", master_uri=self.core.uri)
        self.addCleanup(self.bridge.kill)
        self.core.kill()
        sides, newest = self.start_again()
        self.check(sides, newest)
        self.assert_known()

    def test_all_other_nodes_are_known_to_a_new_master(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.errors = Path(folder.name, "errors")
        self.last_known, self.known_since = None, 0.0
        motion = Path(folder.name, "motion.csv")
        motion.write_text(f"time,{JOINTS[0]}\n0.0,0.0\n1.0,0.1\n")
        self.core.master.setParam("/replay/motion", str(motion))
        self.core.master.setParam("/web/port", 0)
        for name in OTHERS:
            self.start_node(name)
        before = wait_for(self.known_when_all_are_up, "all nodes")
        self.core.kill()
        self.core.start()
        try:
            wait_for(lambda: self.known() >= before, "all nodes to be known again")
        except AssertionError as error:
            lost = sorted(before - self.known())
            self.fail(f"{error}: {lost}; {self.errors.read_text()}")

    def start_node(self, name):
        """Start one of our nodes."""
        process = subprocess.Popen(
            [program(name), "/clock:=/no_clock"],
            env={**os.environ, "ROS_MASTER_URI": self.core.uri},
            stdout=subprocess.DEVNULL,
            stderr=self.errors.open("a"),
        )
        self.addCleanup(process.wait)
        self.addCleanup(process.kill)

    def known(self):
        """List what the master knows: kinds of thing, their names, their nodes."""
        state = self.core.master.getSystemState()
        return {
            (kind, name, node)
            for kind, rows in zip(("topic", "reader", "service"), state)
            for name, nodes in rows
            for node in nodes
        }

    def known_when_all_are_up(self):
        """Give ``known`` if each node is up, and has offered nothing new for a while.

        rospy does not repeat what fails because the master dies meanwhile.
        """
        known, now = self.known(), time.monotonic()
        if known != self.last_known:
            self.last_known, self.known_since = known, now
        if now < self.known_since + QUIET:
            return None
        wanted = (
            ("service", "/gazebo/set_parameters", "/gazebo"),
            ("topic", "/checker/markers", "/checker"),
            ("topic", "/joint_commands", "/web"),
            ("topic", "/joint_states", "/replay"),
        )
        return known if {*wanted} <= known else None

    def assert_known(self):
        """The master knows all topics of the bridge, once."""
        published, subscribed, services = self.core.master.getSystemState()
        topics = {topic for topic, nodes in published if nodes == [self.bridge.name]}
        self.assertLessEqual(OWN, topics)
        for topic in ("/clock", "/gazebo/link_states", "/joint_commands"):
            self.assertEqual(dict(subscribed)[topic], [self.bridge.name])
        for service in ("get_loggers", "set_logger_level"):
            offered = dict(services).get(f"{self.bridge.name}/{service}")
            self.assertEqual(offered, [self.bridge.name])
        self.assertTrue(self.bridge.is_alive())
        self.assertEqual(self.bridge.trouble(), [])
