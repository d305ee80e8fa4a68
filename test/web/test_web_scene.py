"""Frames of a robot in a scene, read back through the wire, and its limbs' ends."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import assert_poses_close, forward_kinematics
from robots import chains, robot, world_poses

pytest.importorskip("viser", reason="viser is not installed")

import viser

from g1_description.checks.marks import GREEN, ORANGE, RED
from g1_description.robot.assembly import WORLD, root_in_base
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.transform import IDENTITY, compose
from g1_description.robot.urdf import parse_urdf
from g1_description.scenes.scene import Scene
from g1_description.web.scene.marks import SceneMarks
from g1_description.web.scene.objects import Looks, SceneObjects
from g1_description.web.scene.trails import last_links
from g1_description.web.scene.tree import LinkTree, pose_of

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools"))
from page_client import PageClient

REPOSITORY = Path(__file__).resolve().parents[2]
DATA = REPOSITORY / "test" / "data"
PRECISION = 1e-3
"""In [m] and [rad], for robots of some metres: viser sends no change below 1e-5 of a
number."""


class Seen:
    """A scene, and what a page knows of it."""

    def __init__(self):
        self.server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        self.client = PageClient(f"http://127.0.0.1:{self.server.get_port()}")
        self._marker = self.server.scene.add_frame("/marker")
        self._count = self._robots = 0

    def close(self):
        self.client.close()
        self.server.stop()

    def nodes(self):
        """Give all nodes, once the page knows what was done up to now."""
        self._count += 1
        self._marker.position = (self._count, 0.0, 0.0)
        marker = self.client.nodes
        self.client.wait_for(
            lambda: marker.get("/marker", {}).get("position") == [self._count, 0, 0],
            "the newest frames",
            10.0,
        )
        return self.client.nodes

    def made(self, name):
        """Count how often lines were made."""
        return self.client.counts["LineSegmentsMessage", name]

    def updates(self, name):
        """Count changes of a node, but those of its pose."""
        return self.client.counts["SceneNodeUpdateMessage", name]

    def add_root(self):
        """Add a frame for a robot: no two have the same name."""
        self._robots += 1
        return self.server.scene.add_frame(f"/robot_{self._robots}", show_axes=False)

    def poses(self, path):
        """Compose the frames of links along their names, by link."""
        nodes = self.nodes()
        found = {}
        for name in sorted(n for n in nodes if n.startswith(f"{path}/")):
            node, above = nodes[name], found.get(name.rpartition("/")[0], IDENTITY)
            local = pose_of(
                np.array(node.get("position", (0, 0, 0))),
                np.array(node.get("wxyz", (1, 0, 0, 0))),
            )
            found[name] = compose(above, local)
        return {name.rpartition("/")[2]: pose for name, pose in found.items()}


@pytest.fixture(scope="module")
def seen():
    one = Seen()
    yield one
    one.close()


def drawn(seen, description, *steps):
    """Draw a robot, move it, and give the frames of its links as the page has them."""
    root = seen.add_root()
    try:
        tree = LinkTree(seen.server.scene, root.name, description)
        for base, positions in steps:
            if base is not None:
                tree.place(base)
            tree.bend(positions)
        return seen.poses(root.name)
    finally:
        root.remove()


def wanted(description, base, positions):
    """Place all links as the rest of the package does."""
    bent = [positions.get(joint.name, 0.0) for joint in description.movable_joints]
    poses = Kinematics(description).link_poses(
        compose(base, root_in_base(description)), np.array(bent)
    )
    names = [name for name in description.link_names if name != WORLD]
    return dict(zip(names, poses))


def check(found, expected, precision=PRECISION):
    assert {*found} - {WORLD} == {*expected}
    for link, pose in expected.items():
        assert_poses_close(found[link], pose, precision)


@settings(max_examples=15)
@given(chains(), world_poses(), st.randoms(use_true_random=False))
def test_frames_are_where_scipy_puts_the_links(seen, chain, base, random):
    text, positions = chain
    before = {name: value * random.random() for name, value in positions.items()}
    steps = (None, before), (base, {}), (base, positions)
    found = drawn(seen, parse_urdf(text), *steps)
    check(found, forward_kinematics(text, base, positions))


@settings(max_examples=8)
@given(chains(), world_poses(), st.randoms(use_true_random=False))
def test_joints_may_have_origins_of_their_own(seen, chain, base, random):
    text, positions = chain
    read = parse_urdf(text)
    joints = tuple(
        replace(joint, joint_origin=np.array([random.uniform(-1, 1) for _ in "xyz"]))
        for joint in read.joints
    )
    description = replace(read, joints=joints)
    found = drawn(seen, description, (base, positions))
    check(found, wanted(description, base, positions))


def test_the_base_of_a_robot_that_floats_in_the_world_is_what_floats(seen):
    description = parse_urdf((DATA / "floating_base.urdf").read_text())
    base = np.array([0.3, -0.2, 0.8, 0.0, 0.0, np.sin(0.4), np.cos(0.4)])
    found = drawn(seen, description, (base, {"hip": 0.5}))
    check(found, wanted(description, base, {"hip": 0.5}))
    assert_poses_close(found["pelvis"], base, PRECISION)


@pytest.mark.parametrize("name", ["world_root", "rail", "skew_axes", "planar"])
def test_robots_of_files(seen, name):
    text = (DATA / f"{name}.urdf").read_text()
    description = parse_urdf(text)
    base = np.array([0.3, -0.2, 0.8, 0.5, 0.5, -0.5, 0.5])
    positions = {
        joint.name: float(np.clip(0.7, joint.lower, joint.upper))
        for joint in description.movable_joints
    }
    found = drawn(seen, description, (base, positions))
    check(found, wanted(description, base, positions))


def test_joints_that_are_not_named_stay_and_others_are_passed_over(seen):
    text = (DATA / "tree.urdf").read_text()
    description = parse_urdf(text)
    first, second = (joint.name for joint in description.movable_joints[:2])
    steps = (None, {first: 0.4, "of_somebody_else": 9.0}), (None, {second: -0.3})
    found = drawn(seen, description, *steps)
    check(found, wanted(description, IDENTITY, {first: 0.4, second: -0.3}))


def test_only_what_moved_is_sent(seen):
    description = robot("a", "b", "c", "d")
    root = seen.add_root()
    tree = LinkTree(seen.server.scene, root.name, description)
    tree.bend({"to_b": 0.1, "to_c": 0.2, "to_d": 0.3})
    seen.nodes()
    times, before = seen.client.times, dict(seen.client.times)
    tree.place(IDENTITY)
    tree.bend({"to_b": 0.1, "to_c": 0.2 + 1e-9, "to_d": 0.31})
    seen.nodes()
    sent = {name for name in times if times[name] != before.get(name)}
    assert {name for name in sent if "/" in name} == {"/marker", f"{root.name}/a/b/c/d"}
    root.remove()


def test_names_with_slashes_are_one_frame(seen):
    text = '<robot name="r"><link name="left/hand"/></robot>'
    assert [*drawn(seen, parse_urdf(text))] == ["left_hand"]


# --- the ends of limbs ---


def test_the_limbs_of_the_g1_end_in_feet_and_wrists(g1_text):
    ends = last_links(parse_urdf(g1_text))
    sides = ("left", "right")
    assert sorted(ends) == sorted(
        [f"{side}_ankle_roll_link" for side in sides]
        + [f"{side}_wrist_yaw_link" for side in sides]
    )


@pytest.mark.parametrize(
    ("name", "ends"),
    [
        ("gripper", ["hand"]),  # not its fingers
        ("no_joints", []),
        ("revolute", 1),
    ],
)
def test_limbs_of_others_end_in(name, ends):
    found = last_links(parse_urdf((DATA / f"{name}.urdf").read_text()))
    assert (len(found) if isinstance(ends, int) else found) == ends


def test_a_limb_ends_in_the_last_link_that_moves():
    assert last_links(robot("a", "b", "c")) == ["c"]


# --- marks ---


def points_of(nodes, name, key):
    """Give the points of a mark where they are, shape (n, 3)."""
    node = nodes[f"/marks/{name}"]
    points = np.asarray(node[key], dtype=float).reshape(-1, 3)
    return points + node["position"]


def test_marks_are_moved_and_formed_and_go(seen):
    marks = SceneMarks(seen.server.scene, "/marks")
    random = np.random.default_rng(5)
    for number in range(3):
        ball, line, corners = (random.normal(size=(n, 3)) for n in (1, 3, 6))
        marks.ball("mass", ball[0], 0.1 + number, ORANGE, 0.5)
        marks.line("mass", line, 0.01, RED)
        marks.triangles("area", corners, GREEN, 0.4)
        marks.text("area", ball[0], f"{number} mm", 0.03, RED)
        marks.show()
        nodes = seen.nodes()
        assert nodes["/marks/mass/ball_0"]["position"] == pytest.approx(ball[0])
        assert nodes["/marks/mass/ball_0"]["radius"] == pytest.approx(0.05 + number / 2)
        np.testing.assert_allclose(
            points_of(nodes, "mass/line_0", "points"), line[[0, 1, 1, 2]], atol=1e-4
        )
        np.testing.assert_allclose(
            points_of(nodes, "area/triangles_6_0", "vertices"), corners, atol=1e-4
        )
        assert nodes["/marks/area/text_0"]["text"] == f"{number} mm"
    assert seen.made("/marks/mass/line_0") == 1, "the same one is used again"
    marks.line("mass", line, 0.01, RED)
    marks.line("mass", line + 1.0, 0.01, RED)
    marks.show()
    left = {name for name in seen.nodes() if name.startswith("/marks/")}
    assert left - {"/marks/mass", "/marks/area"} == {
        "/marks/mass/line_0",
        "/marks/mass/line_1",
    }


def test_what_keeps_its_form_is_only_moved(seen):
    marks = SceneMarks(seen.server.scene, "/marks/still")
    corners = np.random.default_rng(7).normal(size=(6, 3))
    for shift in (0.0, 0.1, 0.7):
        marks.triangles("area", corners + shift, GREEN, 0.4)
        marks.line("area", corners + shift, 0.01, GREEN)
        marks.show()
        nodes = seen.nodes()
    np.testing.assert_allclose(
        points_of(nodes, "still/area/triangles_6_0", "vertices"),
        corners + 0.7,
        atol=1e-4,
    )
    assert seen.updates("/marks/still/area/triangles_6_0") == 0
    assert seen.updates("/marks/still/area/line_0") == 0


def test_objects_come_move_change_and_go(seen):
    scene, looks = Scene(), Looks()
    objects = SceneObjects(seen.server.scene, seen.add_root().name + "/objects")

    def shown():
        there = looks.of([*scene.values()])
        objects.show(there, {name: each.object.pose for name, each in there.items()})
        below = {
            name: node
            for name, node in seen.nodes().items()
            if name.startswith(f"{objects.path}/")
        }
        frames = [node for name, node in below.items() if name.count("/") == 3]
        return [node["position"] for node in frames], len(below) - len(frames)

    scene.box("a/b", [0.1, 0.2, 0.3], [1.0, 2.0, 3.0], color=[1.0, 0.0, 0.0])
    scene.plane("wall", [0.0, -3.0, 0.0], [0.0, 2.0, 0.0])
    assert shown() == ([[1.0, 2.0, 3.0], [0.0, 2.0, 0.0]], 2)
    messages = seen.client.messages
    assert shown()[1] == 2
    assert seen.client.messages == messages + 1  # the marker only
    scene.move("a/b", [4.0, 5.0, 6.0])
    scene.remove("wall")
    assert shown() == ([[4.0, 5.0, 6.0]], 1)
    scene.remove("a/b")
    ball = scene.sphere("a/b", 0.2, [7.0, 8.0, 9.0])
    assert shown() == ([[7.0, 8.0, 9.0]], 1)
    (patch,) = looks.of([ball])["a/b"].patches
    np.testing.assert_allclose(np.linalg.norm(patch.vertices, axis=1), 0.2, atol=1e-6)
