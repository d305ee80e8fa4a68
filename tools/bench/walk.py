"""The way of a message through the bridge's own code, counted.

A profiler in the bridge's process writes down each call of a function of this package:
from the bytes of link_states, or of world_state, until joint_states is on the socket
of a subscriber, with and without a map -> base_link that is due; and from a joint
command to the request to the simulator. Changes are those from one of our modules to
another, in the order of the calls. The commonest way of each kind counts. What numpy
and rospy do between is not counted.
"""

from __future__ import annotations

import json
import sys
from contextlib import closing
from pathlib import Path

from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

from . import stream
from .bridge import prepare
from .nodes import Graph, MeasurementError, wait_for
from .peer import Peer
from tcpros import body_of, packed

HERE = Path(__file__).resolve().parent
NODE = (sys.executable, HERE / "walk_node.py")
SERVICE = "/gazebo/set_model_configuration"
SIMULATOR = (sys.executable, HERE / "answering_node.py")
RATE = 200.0  # [Hz]; the profiler makes all slow
COMMANDS = 50
TARGETS = ("<= 8", "<= 25", "<= 9")
SOURCE = "ros.bridge.state_source:"
SENT = "ros.wire.joint_states:serialize"
BASE = "ros.wire.conversions:transform"
COMMAND = ("ros.bridge.sender:put", "ros.bridge.sender:_send")


def run(bench):
    """Count each kind of way."""
    urdf = stream.read_urdf(bench.model)
    recording = stream.record(urdf, bench.seed, 1000)
    seconds = bench.seconds(5.0, 3.0)
    for topic in ("link_states", "world_state"):
        with bench.attempt(f"{topic}, {seconds:.0f} s"):
            walks = feed(urdf, recording, topic, seconds)
            report_states(bench, topic, walks)
            if topic == "world_state":
                report_command(bench, walks)


def feed(urdf, recording, topic, seconds):
    """Play states and commands to a bridge.

    Returns:
        How often each walk was taken, by its calls.
    """
    with Graph() as graph, closing(Peer()) as peer:
        prepare(graph, urdf, recording)
        is_stamped = topic == "world_state"
        player = stream.Feed(
            peer, stream.encoded(recording), stream.Answers(False), is_stamped
        )
        if not is_stamped:
            player.withdraw_world_state()
        offered = graph.master.lookupService(SERVICE)
        graph.start(SIMULATOR)
        wait_for(lambda: graph.master.lookupService(SERVICE) != offered, "a service")
        with graph.start(NODE) as program:
            commands = peer.advertise("/joint_commands", JointState)
            player.listen("/joint_states")
            player.listen("/tf_joint_states")
            tf = peer.subscribe("/tf", TFMessage, lambda *_: None)
            player.wait_for(program)
            peer.wait(lambda: commands.callers and tf.sources, "topics of the bridge")
            player.play(RATE, seconds)
            command(player, commands, recording.joint_names[:2])
            player.drain()
        return read(program)


def command(player, commands, names):
    """Send commands for some joints, one after the other has been answered."""
    message = packed(body_of(JointState(name=names, position=[0.1] * len(names))))
    for _ in range(COMMANDS):
        commands.send(message)
        player.play(RATE, 0.02)


def read(program):
    """Read what the node has printed at its end."""
    lines = program.output().strip().splitlines()
    if not lines or not lines[-1].startswith("["):
        raise MeasurementError(f"the node printed no walks: {' | '.join(lines[-3:])}")
    return {tuple(path): count for count, path in json.loads(lines[-1]) if path}


def report_states(bench, topic, walks):
    """Keep the figures of states, with a base that is due and without."""
    for kind, marks in (("", {SENT}), (" with map -> base_link", {SENT, BASE})):
        fitting = {
            path: count
            for path, count in walks.items()
            if path[0].startswith(SOURCE) and {SENT, BASE} & set(path) == marks
        }
        path = commonest(fitting, f"{topic}{kind}")
        report(bench, f"{topic} to joint_states{kind}", path, TARGETS)


def report_command(bench, walks):
    """Keep the figures of a command: the callback's way and the sending thread's."""
    parts = [
        commonest({p: n for p, n in walks.items() if p[-1] == last}, last)
        for last in COMMAND
    ]
    report(bench, "joint command to request", sum(parts, ()))


def commonest(walks, what):
    """Find the commonest of some walks.

    Raises:
        MeasurementError: If there is none.
    """
    if not walks:
        raise MeasurementError(f"no walk of {what} was seen")
    return max(walks, key=walks.get)


def report(bench, name, path, targets=("", "", "")):
    """Keep the figures of a way, and print it."""
    modules = [call.split(":")[0] for call in path]
    changes = [new for old, new in zip(["", *modules], modules) if new != old]
    bench.say(f"{name}: {' > '.join(changes)}")
    bench.add(f"{name}: modules", len(set(modules)), "", targets[0])
    bench.add(f"{name}: own calls", len(path), "", targets[1])
    bench.add(f"{name}: changes of module", len(changes) - 1, "", targets[2])
