"""Decisions on the simulator, the bridge and TF; nothing is asked here."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from g1_description.bridge.estimator import JointStateEstimator
from g1_description.cli.doctor.faults import DISPLAY, Fault, fault
from g1_description.robot.assembly import SCOPE, WORLD
from g1_description.robot.description import Description
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.rotation import rotate
from g1_description.robot.transform import compose, inverse
from g1_description.text import listed

MAX_OFFSET = 0.01
"""Largest distance in [m] of a joint from where the description has it: Gazebo's
engine lets the joints of a robot that lies on the floor come apart a little."""

OWN = "g1_description"


def publishers(
    name: str, found: Sequence[str], expected: Iterable[str] = (), **words: object
) -> Fault | None:
    """Judge that a topic comes from one node only.

    Args:
        name: The fault.
        found: The nodes that publish it.
        expected: Those that are not to be ended.
        words: More of the fault's words.
    """
    if len(found) < 2:
        return None
    others = [node for node in found if node not in {*expected}] or found[1:]
    return fault(name, nodes=listed(found), other=others[-1], **words)


def cure_of_description(parameter: str, has_simulator: bool) -> str:
    """Write the command that puts the robot on the parameter server.

    Args:
        parameter: Parameter of the robot's description.
        has_simulator: Whether one runs, beside which no launch file starts another.
    """
    if not has_simulator:
        return DISPLAY
    return (
        f"rosrun {OWN} absolute_urdf.py package://{OWN}/urdf/g1_29dof.urdf "
        f"> /tmp/g1.urdf && rosparam set -t /tmp/g1.urdf {parameter}"
    )


def spawning(model: str, parameter: str) -> str:
    """Write the command that spawns a robot on its feet.

    Args:
        model: The name of its model.
        parameter: Parameter of its description.
    """
    return (
        f"rosrun {OWN} spawn_robot.py _robot_description:={parameter} "
        f"_model_name:={model} _on_floor:=true"
    )


def models_of(
    description: Description, names: Iterable[str], shown: Sequence[str]
) -> list[str]:
    """List the models that may be a robot under another name: they have links of it.

    Args:
        description: The robot.
        names: Scoped names of the simulator's links.
        shown: The models that the bridge shows: these are other robots.
    """
    parts = (name.rpartition(SCOPE) for name in names)
    links = {*description.link_names}
    found = dict.fromkeys(model for model, _, link in parts if link in links)
    return [model for model in found if model not in shown]


def model(
    wanted: str, models: Sequence[str], robots: Sequence[str], bridge: str, place: str
) -> Fault | None:
    """Judge whether the simulator has the bridge's model.

    Args:
        wanted: Its name.
        models: The names of all models.
        robots: The names of those that may be the robot under another name.
        bridge: The bridge's node.
        place: Parameter of the robot's description.
    """
    outer = wanted.partition(SCOPE)[0]
    if outer in models:
        return None
    cure = spawning(wanted, place)
    if len(robots) == 1:
        cure = (
            f"rosparam set {bridge}/model_name {robots[0]} && rosnode kill {bridge}  "
            "# its launch file starts it again"
        )
    shown = listed(models) or "none"
    return fault("no_model", model=wanted, bridge=bridge, models=shown, cure=cure)


def meshes(lost: Sequence[str], parameter: str, share: str) -> Fault | None:
    """Judge the meshes of a robot.

    Args:
        lost: URIs of those that there are none of.
        parameter: Parameter of the robot's description.
        share: The folder of this package.
    """
    if not lost:
        return None
    cure = (
        f"{DISPLAY} model:=FILE  # once what runs has been ended; FILE is the URDF "
        "beside whose folder the meshes are"
    )
    if all(name.startswith(f"file://{share}/") for name in lost):
        cure = f"git -C {share} checkout -- meshes"
    package = lost[0].partition("://")[2].partition("/")[0]
    if lost[0].startswith("package://") and not lost[0].startswith(f"package://{OWN}/"):
        cure = f"source ~/catkin_ws/devel/setup.bash  # of the workspace with {package}"
    return fault("missing_meshes", parameter=parameter, meshes=listed(lost), cure=cure)


def no_bridge(topic: str, spaces: Sequence[str]) -> Fault:
    """Tell that there is no bridge in a namespace.

    Args:
        topic: What it would publish.
        spaces: The namespaces that there is one in.
    """
    cure, others = "roslaunch g1_description bridge.launch", ""
    if spaces:
        option = f" --namespace {spaces[0]}" if spaces[0] else ""
        cure = f"rosrun g1_description doctor{option}"
        others = f", but one for the namespace {listed(f'/{s}' for s in spaces)}"
    return fault("no_bridge", topic=topic, others=others, cure=cure)


def no_state_publisher(topic: str, prefix: str = "") -> Fault:
    """Tell that nothing makes TF of joint states.

    Args:
        topic: The joint states.
        prefix: What stands before the frames, without its slash.
    """
    return fault("no_state_publisher", topic=topic, cure=_start(topic, prefix))


def _start(topic: str, prefix: str) -> str:
    """Write the command that makes TF of joint states."""
    cure = (
        "rosrun robot_state_publisher robot_state_publisher "
        f"joint_states:={topic} _ignore_timestamp:=true"
    )
    space = topic.rpartition("/")[0].strip("/")
    cure += f" __ns:={space}" if space else ""
    return f"{cure} _tf_prefix:='{prefix}'"  # the last one's may be left behind


def no_tf(
    lost: Sequence[tuple[str, str]],
    of_bridge: Sequence[tuple[str, str]],
    owners: tuple[str, str],
    start: tuple[str, str],
) -> Fault:
    """Tell that TF lacks edges.

    Args:
        lost: The edges that TF lacks: parent and child.
        of_bridge: The edges that the bridge sends.
        owners: The bridge, and what sends the edges of joints.
        start: Topic and prefix for ``no_state_publisher``.
    """
    is_base = lost[0] in of_bridge
    owner = owners[0 if is_base else 1]
    cure = f"rosnode kill {owner}  # its launch file starts it again"
    if not is_base:
        cure = f"rosnode kill {owner}; {_start(*start)}"
    edges = listed(f"{parent} -> {child}" for parent, child in lost)
    return fault("no_tf", edges=edges, owner=owner, cure=cure)


def difference(
    description: Description, model: str, names: Sequence[str], poses: np.ndarray
) -> str:
    """Tell in what a simulated model differs from a description.

    Args:
        description: What it should be.
        model: Its name.
        names: Scoped names of the simulator's links.
        poses: Their poses in the world, shape (n, 7).

    Returns:
        A clause; empty if there is no difference to be seen.
    """
    start = model + SCOPE
    seen = {n[len(start) :]: p for n, p in zip(names, poses) if n.startswith(start)}
    bodies = {*lump_fixed_joints(description).link_names} - {WORLD}
    may_be = {*lump_fixed_joints(description, is_dynamic=False).link_names}
    missing = [name for name in sorted(bodies) if name not in seen]
    extra = [name for name in sorted(seen) if name not in may_be and SCOPE not in name]
    if missing:
        return f"it has no link {listed(missing)}"
    if extra:
        return f"it has the link {listed(extra)}, which the parameter has not"
    return _displaced(description, seen) or _off_axis(description, model, names, poses)


def _displaced(description: Description, seen: Mapping[str, np.ndarray]) -> str:
    """Tell which joint is elsewhere in its parent than the description has it."""
    lumped = lump_fixed_joints(description, is_dynamic=False).description
    for joint in lumped.joints:
        if joint.kind not in ("revolute", "continuous"):
            continue
        if joint.parent not in seen or joint.child not in seen:
            continue
        found = compose(inverse(seen[joint.parent]), seen[joint.child])
        offset = _anchor(found, joint.joint_origin) - _anchor(
            joint.pose, joint.joint_origin
        )
        distance = float(np.linalg.norm(offset))
        if distance > MAX_OFFSET:
            return f"{joint.name} is {1e3 * distance:.0f} mm away from where it belongs"
    return ""


def _anchor(pose: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Give a point of a child frame in its parent, in [m], shape (3,)."""
    return pose[:3] + rotate(pose[3:], point)


def _off_axis(
    description: Description, model: str, names: Sequence[str], poses: np.ndarray
) -> str:
    """Tell which joints are turned about another axis, as the bridge judges it."""
    estimator = JointStateEstimator({model: description})
    (seen,) = estimator.update(list(names), poses, np.zeros((len(names), 6)), 0.0)
    joints = listed(seen.axis_residual)
    return f"the axes of {joints} are others" if joints else ""


def tf_owners(
    edges: Mapping[str, set[tuple[str, str]]],
    chain: Iterable[str],
    expected: Iterable[tuple[str, str]],
    shared: Mapping[tuple[str, str], Iterable[str]],
) -> Fault | None:
    """Judge that each frame of a robot has one parent, from one node.

    Args:
        edges: Who sends each edge: pairs of node and parent, by the child's frame.
        chain: The bridge and its robot_state_publisher, which both send fixed joints
            when time stands still.
        expected: The robot's edges, parent and child: other frames are not judged.
        shared: Who else may send an edge, such as the bridges of other robots, which
            all send the same static one from the world to the map.
    """
    own = {*chain}
    children = {child for _, child in expected}
    for child, found in sorted(edges.items()):
        if child not in children:
            continue
        nodes = sorted({node for node, _ in found})
        parents = sorted({parent for _, parent in found})
        allowed = own | {*shared.get((parents[0], child), ())}
        if len(parents) == 1 and (len(nodes) == 1 or {*nodes} <= allowed):
            continue
        if len(nodes) == 1:
            nodes = [f"{nodes[0]} alone"]
        others = [node for node in nodes if node not in own] or nodes
        return fault(
            "two_tf_owners",
            edge=listed(f"{parent} -> {child}" for parent in parents),
            nodes=listed(nodes),
            other=others[-1].partition(" ")[0],
        )
    return None


def missing_edges(
    edges: Mapping[str, set[tuple[str, str]]], expected: Iterable[tuple[str, str]]
) -> list[tuple[str, str]]:
    """List the edges, parent and child, that TF lacks.

    Args:
        edges: Who sends each edge: pairs of node and parent, by the child's frame.
        expected: What should be there: parent and child.
    """
    found = {(p, child) for child, pairs in edges.items() for _, p in pairs}
    return [edge for edge in expected if edge not in found]


def diagnostics(node: str, statuses: Mapping[str, tuple[int, str]]) -> Fault | None:
    """Judge what the bridge says of itself.

    What happens to commands now and then is no broken link: of those only errors count.

    Args:
        node: The bridge.
        statuses: Level and words by the name of the status, of the newest message.
    """
    for name, (level, text) in sorted(statuses.items()):
        if level > (1 if name.endswith(": commands") else 0):
            return fault("bad_diagnostics", node=node, text=f"{name}: {text}")
    return None


def reports(
    node: str, rounds: Sequence[Mapping[str, tuple[int, str]]], seconds: float
) -> Fault | None:
    """Judge several reports of the bridge: what is bad must be so in all that came.

    Args:
        node: The bridge.
        rounds: Statuses as for ``diagnostics``, one after the other; empty: none came.
        seconds: How long each was waited for, in [s].
    """
    found = [diagnostics(node, statuses) for statuses in rounds if statuses]
    if not found:
        return fault("no_diagnostics", node=node, seconds=seconds * len(rounds))
    return found[-1] if all(found) else None
