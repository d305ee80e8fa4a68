"""Stand-in and bridge together, on a robot that hangs and swings.

A process without rospy receives /gazebo/link_states and /joint_states. It then computes
the joint positions of each link_states, as the naive node does, and finds the
joint_states with these positions. Latency runs from reading the one to reading the
other. The display publishes the states of every step and includes
robot_state_publisher.
"""

import time
from contextlib import closing

import numpy as np
from gazebo_msgs.msg import LinkStates
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState

from g1_description.ros.wire import LinkStatesDecoder

from .bridge import EXACT
from .matching import match, positions_of
from .naive_node import joints_of
from .nodes import EACH_STEP, Graph
from .peer import Peer
from .standin import HANGING
from .stream import QUIET, Answers, no_collector, read_urdf

WARM_UP = 2.0  # [s]


def run(bench):
    """Watch both topics, then compare them."""
    seconds = bench.seconds(60.0, 5.0)
    with bench.attempt(f"stand-in and bridge, {seconds:.0f} s"):
        states, answers, counts = watch(bench.model, seconds)
        bench.say("matching joint_states with link_states")
        names, seen = measured(read_urdf(bench.model), states.bodies)
        found = match(seen, positions_of(answers.bodies, names), EXACT)
        answered = np.full(len(seen), np.nan)
        answered[found[found >= 0]] = np.array(answers.times)[found >= 0]
        times = (answered - states.times)[counts]
        came = np.isfinite(times)
        bench.add_latencies("latency", times[came], ("< 0.3", "< 2"))
        bench.add("link_states seen", len(times))
        bench.add("link_states lost", (~came).sum(), "", "= 0")


def watch(model, seconds):
    """Keep both topics of a running display.

    Returns:
        Link states and joint states, and the slice of link states that count: those
        of the window, without its warm-up and without those that came last.
    """
    states, answers = Answers(), Answers()
    arguments = (EACH_STEP, *HANGING)
    with Graph() as graph, closing(Peer()) as peer, graph.launch(model, *arguments):
        links = peer.subscribe("/gazebo/link_states", LinkStates, states.take)
        joints = peer.subscribe("/joint_states", JointState, answers.take)
        peer.wait(lambda: links.sources and joints.sources, "the two topics")
        peer.wait(lambda: states.count and answers.count, "messages")
        with no_collector():
            peer.serve(time.monotonic() + WARM_UP)
            first = states.count
            peer.serve(time.monotonic() + seconds)
            last = states.count
            peer.serve(time.monotonic() + QUIET)
    return states, answers, slice(first, last)


def measured(urdf, bodies):
    """Compute the joints of link states, as the naive node does.

    Returns:
        Joint names, and positions in [rad], shape (n, n_joints).
    """
    decoder, joints = LinkStatesDecoder(), joints_of(urdf)
    names = decoder.decode(bodies[0]).names
    q_world_link = np.array([decoder.decode(body).poses[:, 3:] for body in bodies])
    links = {
        name: Rotation.from_quat(q_world_link[:, row]) for row, name in enumerate(names)
    }
    pairs = ((links[joint.parent], links[joint.child]) for joint in joints)
    positions = [joint.position(*pair) for joint, pair in zip(joints, pairs)]
    return [joint.name for joint in joints], np.array(positions).T
