"""Every robot of test/data is measured exactly, whichever of its links are told.

Links are placed by scipy, and trees are read by ElementTree: nothing of ours.
"""

import xml.etree.ElementTree as ET

import numpy as np
import pytest
from conftest import REPOSITORY
from oracle import assert_poses_close
from scipy.spatial.transform import Rotation

from g1_description.bridge.estimator import JointStateEstimator
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.urdf import parse_urdf

ROBOTS = sorted((REPOSITORY / "test" / "data").glob("*.urdf"))
MODELS = ("g1", "outer::inner")
N = 20
FURTHEST = 100.0
"""How far from the world's origin a robot may stand, in [m]."""
WIDE = 6.0
"""A range from which on, in [rad], a position is where continuity has it."""
STEP = 1.5
"""How far such a joint goes from one message to the next, in [rad]."""


def read(joint, tag, attribute, default):
    element = joint.find(tag)
    value = None if element is None else element.get(attribute)
    return np.array([float(part) for part in (value or default).split()])


def ends(joint):
    return joint.find("parent").get("link"), joint.find("child").get("link")


def rigid_groups(text):
    """List the links that fixed joints hold together, the uppermost first."""
    robot = ET.fromstring(text)
    carrier = {ends(joint)[1]: joint for joint in robot.findall("joint")}

    def way_up(link):
        if link not in carrier or carrier[link].get("type") != "fixed":
            return [link]
        return [link, *way_up(ends(carrier[link])[0])]

    groups = {}
    for link in robot.findall("link"):
        way = way_up(link.get("name"))
        groups.setdefault(way[-1], []).append((len(way), way[0]))
    return [[link for _, link in sorted(group)] for group in groups.values()]


def random_poses(random, furthest):
    rotations = random.normal(size=(N, 4))
    rotations /= np.linalg.norm(rotations, axis=1)[:, np.newaxis]
    return np.hstack([random.uniform(-furthest, furthest, (N, 3)), rotations])


def random_positions(text, random):
    """Draw positions inside the limits for each joint that has a single one.

    Where the limits do not tell one turn from the next the joint walks, from the turn
    nearest zero: any turn but the first guess is reached by continuity.
    """
    drawn = {}
    for joint in ET.fromstring(text).findall("joint"):
        kind = joint.get("type")
        if kind not in ("revolute", "continuous", "prismatic"):
            continue
        lower, upper = -np.inf, np.inf
        if kind != "continuous":
            lower, upper = (
                read(joint, "limit", side, "0")[0] for side in ("lower", "upper")
            )
        if kind == "prismatic" or upper - lower <= WIDE:
            values = random.uniform(lower, upper, N)
            values[:2] = lower, upper
        else:
            values = np.zeros(N)
            value = np.clip(0.0, lower + np.pi, upper - np.pi)
            for row, step in enumerate(random.uniform(-STEP, STEP, N)):
                value = values[row] = np.clip(value + step, lower, upper)
        drawn[joint.get("name")] = values
    return drawn


def place(text, roots, positions, random):
    """Place every link by scipy; what floats or glides is anywhere.

    Returns:
        Poses by link name in the order of the file, each of shape (N, 7).
    """
    robot = ET.fromstring(text)
    carrier = {ends(joint)[1]: joint for joint in robot.findall("joint")}
    placed, poses = {}, {}

    def frame(link):
        if link not in placed:
            placed[link] = below(link) if link in carrier else split(roots)
        return placed[link]

    def below(link):
        joint = carrier[link]
        position, rotation = frame(ends(joint)[0])
        position = position + rotation.apply(read(joint, "origin", "xyz", "0 0 0"))
        rpy = read(joint, "origin", "rpy", "0 0 0")
        rotation = rotation * Rotation.from_euler("xyz", rpy)
        kind = joint.get("type")
        if kind in ("floating", "planar"):
            moved, turned = split(random_poses(random, 1.0))
            return position + rotation.apply(moved), rotation * turned
        if kind == "fixed":
            return position, rotation
        axis = read(joint, "axis", "xyz", "1 0 0")
        way = np.outer(positions[joint.get("name")], axis / np.linalg.norm(axis))
        if kind == "prismatic":
            return position + rotation.apply(way), rotation
        return position, rotation * Rotation.from_rotvec(way)

    for link in [link.get("name") for link in robot.findall("link")]:
        position, rotation = frame(link)
        poses[link] = np.hstack([position, rotation.as_quat()])
    return poses


def split(poses):
    return poses[:, :3], Rotation.from_quat(poses[:, 3:])


def all_links(text, groups, random):
    return [link for group in groups for link in group]


def as_gazebo_lumps_them(text, groups, random):
    assembly = lump_fixed_joints(parse_urdf(text))
    if assembly.left_out:  # it floats or glides, and has no masses
        return [group[0] for group in groups]
    return list(assembly.link_names)


def some_of_each_rigid_group(text, groups, random):
    kept = [random.permutation(group) for group in groups]
    return [link for group in kept for link in group[: random.integers(len(group)) + 1]]


def messages(links, placed, random, shuffled):
    """Write messages of some links, quaternions of either sign.

    Args:
        links: Names of the links to tell of, for each model.
        placed: Poses by link name in the order of the file, for each model.
        random: Numbers.
        shuffled: Whether the links are in any order.

    Returns:
        Scoped names, and poses of shape (N, n_links, 7).
    """
    scoped = [("ground_plane::link", np.tile([0.0] * 6 + [1.0], (N, 1)))]
    for model, told, poses in zip(MODELS, links, placed):
        scoped += [(f"{model}::{link}", poses[link]) for link in poses if link in told]
    order = random.permutation(len(scoped)) if shuffled else range(len(scoped))
    poses = np.stack([scoped[row][1] for row in order], axis=1)
    poses[..., 3:] *= random.choice([-1.0, 1.0], poses.shape[:2])[..., np.newaxis]
    return tuple(scoped[row][0] for row in order), poses


FLYING = {"floating_base": "pelvis", "free_bodies": "base"}
"""Robots whose root is the world, and what floats in it."""

WAYS = (
    all_links,
    as_gazebo_lumps_them,
    some_of_each_rigid_group,
)


def assert_seen(estimator, states, drawn):
    """All joints that have a single position are there, and keep to their axes."""
    for state, positions in zip(states, drawn):
        assert state.names == tuple(positions)
    assert not any(problems.are_any for problems in estimator.problems)


@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.__name__)
@pytest.mark.parametrize("file", ROBOTS, ids=lambda file: file.stem)
def test_every_robot_reads_as_it_was_placed(file, way):
    """Two of it at once, twenty configurations, ten sets of links in turn."""
    text, random = file.read_text(), np.random.default_rng(ROBOTS.index(file))
    groups = rigid_groups(text)
    drawn = [random_positions(text, random) for _ in MODELS]
    roots = [random_poses(random, FURTHEST) for _ in MODELS]
    placed = [place(text, *given, random) for given in zip(roots, drawn)]
    told = [
        messages([way(text, groups, random) for _ in MODELS], placed, random, shuffled)
        for shuffled in [False, True] * 5
    ]
    estimator = JointStateEstimator({model: parse_urdf(text) for model in MODELS})
    positions, bases = [], []
    for row in range(N):
        names, poses = told[row % len(told)]
        still = np.zeros((len(names), 6))
        states = estimator.update(names, poses[row], still, 10_000_000 * row)
        assert_seen(estimator, states, drawn)
        positions.append([state.positions for state in states])
        bases += [state.base_pose for state in states]
    expected = np.array([list(joints.values()) for joints in drawn]).reshape(2, -1, N)
    errors = np.array(positions) - expected.transpose(2, 0, 1)
    largest = np.abs(errors).max(initial=0.0)
    print(f"{file.stem}, {way.__name__}: {largest:.1e}")
    assert largest < 1e-9
    if file.stem in FLYING:
        roots = [poses[FLYING[file.stem]] for poses in placed]
    assert_poses_close(np.array(bases), np.stack(roots, axis=1).reshape(-1, 7), 1e-9)


OFF = {
    "a hinge, across": ("revolute", "arm", [1.0, 0.0, 0.0]),
    "a slide, across": ("prismatic", "slider", [1.0, 0.0, 0.0]),
    "a slide, along": ("prismatic", "slider", [0.0, 0.6, 0.8]),
}


@pytest.mark.parametrize(("angle", "is_told"), [(0.11, True), (0.056, False)])
@pytest.mark.parametrize("kind", OFF)
def test_a_link_turned_as_its_joint_cannot_is_told_by_how_much(kind, angle, is_told):
    name, turned, axis = OFF[kind]
    text = (REPOSITORY / "test" / "data" / f"{name}.urdf").read_text()
    random = np.random.default_rng(1)
    positions = random_positions(text, random)
    placed = place(text, random_poses(random, FURTHEST), positions, random)
    off = split(placed[turned])[1] * Rotation.from_rotvec(angle * np.array(axis))
    placed[turned][:, 3:] = off.as_quat()
    estimator = JointStateEstimator({"g1": parse_urdf(text)})
    names = tuple(f"g1::{link}" for link in placed)
    poses = np.stack([*placed.values()], axis=1)
    (joint,) = positions
    expected = {joint: pytest.approx(angle, abs=1e-6)} if is_told else {}
    for row in range(N):
        for stamp in (2 * row, 2 * row + 2):  # it is reported once it has lasted 2 s
            estimator.update(names, poses[row], np.zeros((2, 6)), round(1e9 * stamp))
        assert estimator.problems[0].axis_residual == expected
