"""The state that Gazebo writes into a world when it saves it: where all was then."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from lxml import etree

from .assembly import SCOPE, WORLD
from .description import Description
from .joints import measured_joints
from .measurement import measure
from .sdf_model import SdfModel
from .sdf_text import name_of, pose_of, vector
from .transform import compose, inverse


@dataclass
class State:
    """When a world was saved, and where its models, links and lights were."""

    time: float = 0.0
    """Simulated time in [s]."""

    models: dict[str, np.ndarray] = field(default_factory=dict)
    """Poses in the world by name, shape (7,); likewise the others."""

    links: dict[str, dict[str, np.ndarray]] = field(default_factory=dict)
    """By names of model and link; those of models inside begin with their names."""

    lights: dict[str, np.ndarray] = field(default_factory=dict)


def read_state(element: etree._Element, state: State) -> None:
    """Read a state element of a world; it wins over what was read before.

    Args:
        element: The element.
        state: Takes what it tells.

    Raises:
        DescriptionError: If a pose or the time is wrong, or a name is missing; nothing
            of the element is taken then.
    """
    found = State(state.time, {**state.models}, {**state.links}, {**state.lights})
    saved = [found.time, 0.0]
    seconds, nanoseconds = vector(element, "sim_time", saved, "the state", 0.0)
    found.time = float(seconds + 1e-9 * nanoseconds)
    for model in element.findall("model"):
        name = name_of(model)
        if model.find("pose") is not None:
            found.models[name], _ = pose_of(model, f"the state of {name}")
        found.links[name] = _links(model, "")
    for light in element.findall("light"):
        name = name_of(light)
        if light.find("pose") is not None:
            found.lights[name], _ = pose_of(light, f"the state of {name}")
    vars(state).update(vars(found))


def _links(model: etree._Element, prefix: str) -> dict[str, np.ndarray]:
    """Read where the links of a model, and of those inside it, are in the world."""
    found = {}
    for link in model.findall("link"):
        name = prefix + name_of(link)
        if link.find("pose") is not None:
            found[name], _ = pose_of(link, f"the state of {name}")
    for inner in model.findall("model"):
        found.update(_links(inner, f"{prefix}{name_of(inner)}{SCOPE}"))
    return found


def in_state(model: SdfModel, state: State) -> SdfModel:
    """Put a model where a state has it: its roots, and its joints by their links.

    Args:
        model: As the file has it.
        state: The world's state; what it does not tell stays as it is.
    """
    links = state.links.get(model.name, {})
    assembly = model.assembly
    description = assembly.description
    pose = state.models.get(model.name, model.pose)
    # Joints move what carries the model frame, so the root tells where it was.
    if description.root == WORLD:
        pose = model.pose
    elif description.root in links:
        pose = compose(links[description.root], inverse(assembly.root_pose))
    poses = {**links, WORLD: pose}
    roots = [
        compose(inverse(pose), links[root]) if root in links else placed
        for root, placed in zip(description.roots, assembly.root_poses)
    ]
    positions = dict(assembly.positions)
    for tree in description.trees:
        positions.update(_positions(tree, poses))
    moved = replace(assembly, root_poses=np.array(roots), positions=positions)
    return replace(model, pose=pose, assembly=moved)


def _positions(tree: Description, poses: dict[str, np.ndarray]) -> dict[str, float]:
    """Measure the joints of a tree by poses of its links, inside their limits."""
    known = {name: pose for name, pose in poses.items() if name in tree.link_names}
    joints = measured_joints(tree, [*known])
    if not joints.names:
        return {}
    still = np.zeros((len(known), 6))
    measured = measure(np.array([*known.values()]), still, joints)
    limits = {joint.name: (joint.lower, joint.upper) for joint in tree.movable_joints}
    return {
        name: float(np.clip(position, *limits[name]))
        for name, position in zip(joints.names, measured.position)
    }
