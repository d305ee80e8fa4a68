"""One bridge for many robots.

The same as for the bridge, with 1, 10, 50 and 200 robots in each message, at rates that
the bridge can follow. Each message is 1 ms of simulated time after the previous one at
any rate, so map -> base_link is sent equally often per message. The process receives
the joint_states of all robots.
"""

from contextlib import closing

from . import stream
from .bridge import OURS, play, prepare
from .nodes import Graph, MeasurementError
from .peer import Peer

RATES = {1: 1000.0, 10: 200.0, 50: 50.0, 200: 10.0}  # [Hz] by number of robots
BYTES = 1 << 26  # of messages made ready


def run(bench):
    """Measure the cost for each number of robots."""
    urdf = stream.read_urdf(bench.model)
    recording = stream.record(urdf, bench.seed, 1000)
    costs = {}
    for count, rate in RATES.items():
        seconds = bench.seconds(10.0, 3.0)
        with bench.attempt(f"{label(count)} at {rate:.0f} Hz, {seconds:.0f} s"):
            fed = feed(urdf, recording, count, seconds)
            costs[count] = report(bench, count, fed, len(recording.joint_names))
        if not costs:
            bench.leave_out("more robots, as there is no bridge for one of them")
            break
    if {1, 200} <= set(costs):
        bench.add("processor time, 200 / 1 robots", costs[200] / costs[1], "", "< 60")


def label(count):
    """Write a number of robots."""
    return f"{count} robot{'s' * (count > 1)}"


def feed(urdf, recording, count, seconds):
    """Play so many robots to a bridge; give the ``Run``."""
    size = len(recording.poses[0]) * count * 13 * 8
    steps = min(len(recording.poses), BYTES // size)
    messages = stream.encoded(stream.crowd(recording, count, steps))
    answers = stream.Answers(keep=False)
    with Graph() as graph, closing(Peer()) as peer:
        prepare(graph, urdf, recording)
        graph.master.setParam("/bridge/robots", robots(count))
        with graph.start([*OURS, "__name:=bridge"]) as program:
            player = stream.Feed(peer, messages, answers, is_stamped=True)
            for number in range(count):
                player.listen(f"/robot_{number}/joint_states")
            player.wait_for(program)
            return play(program, player, len(messages), seconds, RATES[count])


def robots(count):
    """Write the bridge's parameter ~robots."""
    return [
        {
            "name": f"robot_{number}",
            "namespace": f"robot_{number}",
            "description": "/robot_description",
            "frame_prefix": f"robot_{number}/",
        }
        for number in range(count)
    ]


def report(bench, count, fed, n_joints):
    """Keep the figures of one number of robots; give the cost of a message in [us]."""
    sent = len(fed.sent)
    if not fed.answers.count:
        raise MeasurementError("no joint_states came")
    cost = 1e6 * fed.cpu_seconds / sent
    name = label(count)
    bench.add(f"{name}: processor time per message", cost, "us")
    bench.add(f"{name}: processor time per joint", cost / (count * n_joints), "us")
    share = 100.0 * fed.cpu_seconds / fed.wall_seconds
    bench.add(f"{name}: share of a core at {RATES[count]:.0f} Hz", share, "%")
    bench.add(f"{name}: joint_states lost", count * sent - fed.answers.count)
    return cost
