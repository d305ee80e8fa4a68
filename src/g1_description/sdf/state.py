"""The state of a world that was saved by Gazebo."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from lxml import etree

from g1_description.robot.assembly import SCOPE, WORLD
from g1_description.robot.description import Description
from g1_description.robot.joint_angles import measure, measured_joints
from g1_description.robot.transform import compose, inverse
from g1_description.robot.xml_values import name_of, pose_of, text_of, vector
from g1_description.sdf.model import SdfModel


@dataclass(frozen=True)
class SavedState:
    """Time of saving, and poses of models, links and lights."""

    time: float | None = None
    """Simulated time in [s]; None if it is not given."""

    models: dict[str, np.ndarray] = field(default_factory=dict)
    """Poses in the world by name, shape (7,), as the others."""

    links: dict[str, dict[str, np.ndarray]] = field(default_factory=dict)
    """By names of model and link; links of nested models have their prefix."""

    lights: dict[str, np.ndarray] = field(default_factory=dict)

    def then(self, later: SavedState) -> SavedState:
        """Return this state updated by a later one."""
        return SavedState(
            time=self.time if later.time is None else later.time,
            models={**self.models, **later.models},
            links={**self.links, **later.links},
            lights={**self.lights, **later.lights},
        )


def read_state(element: etree._Element) -> SavedState:
    """Read a state element of a world.

    Raises:
        DescriptionError: If a pose or the time is invalid, or a name is missing.
    """
    time = None
    if text_of(element, "sim_time"):
        seconds, nanoseconds = vector(element, "sim_time", [0, 0], "the state", 0.0)
        time = float(seconds + 1e-9 * nanoseconds)
    models = element.findall("model")
    return SavedState(
        time=time,
        models=_poses(models),
        links={name_of(model): _links(model, "") for model in models},
        lights=_poses(element.findall("light")),
    )


def _links(model: etree._Element, prefix: str) -> dict[str, np.ndarray]:
    """Read where the links of a model, and of those inside it, are in the world."""
    found = _poses(model.findall("link"), prefix)
    for inner in model.findall("model"):
        found.update(_links(inner, f"{prefix}{name_of(inner)}{SCOPE}"))
    return found


def _poses(
    elements: Iterable[etree._Element], prefix: str = ""
) -> dict[str, np.ndarray]:
    """Read where things are in the world, by name, if they are given."""
    found = {}
    for element in elements:
        name = prefix + name_of(element)
        if element.find("pose") is not None:
            found[name], _ = pose_of(element, f"the state of {name}")
    return found


def in_state(model: SdfModel, state: SavedState) -> SdfModel:
    """Apply a saved state to a model: its roots, and its joints from link poses.

    Args:
        model: As in the file.
        state: The world's state; may be partial.
    """
    links = state.links.get(model.name, {})
    assembly = model.assembly
    description = assembly.description
    pose = state.models.get(model.name, model.pose)
    # The link of the model frame moves with joints, so the pose follows from the root.
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
    positions, _, _ = measure(np.array([*known.values()]), still, joints)
    limits = {joint.name: (joint.lower, joint.upper) for joint in tree.movable_joints}
    return {
        name: float(np.clip(position, *limits[name]))
        for name, position in zip(joints.names, positions)
    }
