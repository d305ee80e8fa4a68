"""The cases about names, types and topics: what each sees, by the case's id."""

import contextlib
import socket
from io import BytesIO
from xmlrpc.client import ServerProxy

import numpy as np
import rospy
import rosservice
from gazebo_msgs.msg import LinkState, LinkStates, ModelState, ModelStates
from genpy.message import fill_message_args
from rosgraph.network import encode_ros_handshake_header, read_ros_handshake_header
from rosgraph_msgs.msg import Clock

from ..ros_testing import Connected, wait_for
from ..wire.raw_subscriber import RawSubscriber
from .cases import plain
from .simulator import QUARTER, UP, pose_fields, twist_fields

TOPICS = {
    "clock": ("/clock", Clock),
    "link_states": ("/gazebo/link_states", LinkStates),
    "model_states": ("/gazebo/model_states", ModelStates),
}


LUMPED = ("::imu_in_torso", "::imu_in_pelvis", "::logo_link", "::head_link")
"""Some links of the G1 that are fixed to others."""


def _absolute(name):
    return f"/{name}" if name in ("clock", "rosout") else f"/gazebo/{name}"


def service_offered(simulator, name):
    """Shake hands with a service."""
    address = simulator.master.lookupService(f"/gazebo/{name}")
    header = rosservice.get_service_headers(f"/gazebo/{name}", address)
    node = rosservice.get_service_node(f"/gazebo/{name}")
    return {"offered": True, "node": node, **header}


def topic_published(simulator, name):
    """Shake hands with the publisher of a topic."""
    topic = _absolute(name)
    assert "/gazebo" in dict(simulator.master.getSystemState()[0]).get(topic, [])
    node = ServerProxy(simulator.master.lookupNode("/gazebo"))
    _, _, (_, host, port) = node.requestTopic("/handshake", topic, [["TCPROS"]])
    asked = {"callerid": "/handshake", "topic": topic, "type": "*", "md5sum": "*"}
    with socket.create_connection((host, port), 5.0) as connection:
        connection.sendall(encode_ros_handshake_header(asked))
        header = read_ros_handshake_header(connection, BytesIO(), 65536)
    header["sends_definition"] = bool(header.get("message_definition"))
    return {"published": True, "latching": header.get("latching", "0"), **header}


def topic_subscribed(simulator, name):
    """Ask the master for the subscribers of a topic."""
    topic = _absolute(name)
    subscribers = dict(simulator.master.getSystemState()[1]).get(topic, [])
    assert "/gazebo" in subscribers, subscribers
    return {"subscribed": True, "type": dict(simulator.master.getTopicTypes())[topic]}


def node_registered(simulator, _):
    """Ask the master for the node."""
    uri = simulator.master.lookupNode("/gazebo")
    return {"node_registered_as_namespace": bool(uri)}


def parameters(simulator, _):
    """Read the parameters that dynamic_reconfigure keeps."""
    simulator.proxy("set_parameters")
    names = rospy.get_param_names()
    values = {
        name: rospy.get_param(name) for name in names if name.startswith("/gazebo/")
    }
    return {"use_sim_time": rospy.get_param("/use_sim_time"), "values": values}


def silent_while_paused(simulator, name):
    """Listen for a second of wall time."""
    listener = Connected(*TOPICS[name])
    before = simulator.time()
    with contextlib.suppress(AssertionError):
        listener.wait(deadline=1.0)
    assert simulator.time() == before
    listener.close()
    count = len(listener.messages)
    return {"messages_in_one_second": count, "messages_on_connecting": count}


def one_per_step(simulator, name):
    """Count the messages of some steps; a step waits for whom listens.

    On a socket of our own: where several messages of /clock come at once rospy keeps
    the newest alone, as its simulated time wants it.
    """
    reader = RawSubscriber(simulator.master.lookupNode("/gazebo"), *TOPICS[name])
    steps = 60
    wait_for(  # what connected on our side may not yet have on theirs
        lambda: simulator.call("step", steps=1)["success"] and reader.read_all(),
        "the first message",
    )
    assert simulator.call("step", steps=steps)["success"]
    count = len(reader.read_all())
    reader.close()
    return {"messages_per_step": count / steps}


def first_message(simulator, name):
    """Let time run until there is a message; give it as a dict by names."""
    listener = Connected(*TOPICS[name])
    simulator.call("unpause_physics")
    message = listener.wait()
    simulator.call("pause_physics")
    listener.close()
    states = zip(plain(message.pose), plain(message.twist))
    return dict(zip(message.name, states))


def names_robot(simulator, _):
    """List the links of the G1 as they come."""
    states = first_message(simulator, "link_states")
    lumped = [name for name in states if name.endswith(LUMPED)]
    poses, twists = zip(*states.values())
    counts = {"poses": len(poses), "twists": len(twists)}
    return {"names": list(states), "lumped_present": lumped, **counts}


def names_arm_and_pendulum(simulator, _):
    """List the links of two models."""
    simulator.spawn("pendulum", "<pendulum>", [0.0, 0.0, 0.0, *UP])
    return {"names": list(first_message(simulator, "link_states"))}


def twist_axes(simulator, _):
    """Move a box that is turned: the twist stays along the world's axes."""
    pose = [0.0, 0.0, 1.0, *QUARTER]
    simulator.put("box", pose, [0.5, 0.0, 0.0, 0.0, 0.0, 0.2])
    return {"twist": first_message(simulator, "link_states")["box::body"][1]}


def twist_point(simulator, name):
    """Spin a box about its center of mass, which is not its frame's origin."""
    simulator.put("obox", [0.0, 0.0, 1.0, *UP], [0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    key = {"link_states": "obox::body", "model_states": "obox"}[name]
    twist = first_message(simulator, name)[key][1]
    speed, spin = np.linalg.norm(np.reshape(twist, (2, 3)), axis=1).tolist()
    return {"linear_speed": speed, "spin": spin}


def state_as_topic(simulator, case):
    """Publish a state instead of calling the service."""
    name = case["id"].split(".")[0]
    kind = {"set_model_state": ModelState, "set_link_state": LinkState}[name]
    publisher = rospy.Publisher(f"/gazebo/{name}", kind, queue_size=1)
    wait_for(publisher.get_num_connections, "the simulator to listen")
    pose = pose_fields([4.0, 5.0, 6.0, *UP])
    twist = twist_fields(case["effect"]["twist"])
    what = {"link_name": "box::body"} if kind is LinkState else {"model_name": "box"}
    message = kind()
    fill_message_args(message, [{**what, "pose": pose, "twist": twist}])
    publisher.publish(message)
    state = wait_for(
        lambda: simulator.state("box")["pose"][0] > 3.0 and simulator.state("box"),
        "the box to be put there",
    )
    publisher.unregister()
    return {"pose": state["pose"], "twist": state["twist"]}


def resubscribe(simulator, _):
    """Subscribe twenty times while time runs."""
    simulator.call("unpause_physics")
    got = 0
    for _ in range(20):
        listener = Connected(*TOPICS["link_states"])
        got += bool(listener.wait())
        listener.close()
    return {"got_data": got}


def by_topic(prefix):
    """Let a function that is given a topic's name see several cases."""
    return {
        f"{topic}.{prefix.__name__}": lambda simulator, _, topic=topic: prefix(
            simulator, topic
        )
        for topic in TOPICS
    }


BUILT = {
    **by_topic(silent_while_paused),
    **by_topic(one_per_step),
    **by_topic(twist_point),
    "link_states.names_robot": names_robot,
    "link_states.names_arm_and_pendulum": names_arm_and_pendulum,
    "link_states.twist_axes": twist_axes,
    "link_states.resubscribe_many_times": resubscribe,
    "set_model_state.as_topic": state_as_topic,
    "set_link_state.as_topic": state_as_topic,
    "contract.node": node_registered,
    "contract.params": parameters,
}
"""What sees the effects of cases without requests."""

CONTRACT = {
    "service": service_offered,
    "published": topic_published,
    "subscribed": topic_subscribed,
}


def builder(case_id):
    """Find what sees a case about names, types or topics; None if nothing does."""
    words = case_id.split(".")
    if words[0] == "contract" and len(words) == 3:
        return lambda simulator, _: CONTRACT[words[1]](simulator, words[2])
    return BUILT.get(case_id)
