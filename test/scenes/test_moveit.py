"""Scenes by MoveIt's messages, here of the same fields, and for its files."""

import copy
from types import SimpleNamespace as Message

import numpy as np
import pytest
from moveit_messages import (
    ADD,
    APPEND,
    MOVE,
    REMOVE,
    can,
    collision_object,
    point,
    pose,
    primitive,
)

from g1_description import Robot, Scene
from g1_description.errors import G1DescriptionError
from g1_description.robot.transform import compose
from g1_description.scenes.moveit import frames_of


def attach(body, link, touching=(), weight=0.0):
    return Message(link_name=link, object=body, touch_links=[*touching], weight=weight)


def test_objects_are_added_moved_and_removed(tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    scene = Scene()
    scene.apply(can())
    (shape,) = scene["can"].link.collisions
    assert (shape.kind, shape.size) == ("cylinder", (0.03, 0.12))
    np.testing.assert_allclose(scene["can"].pose[:3], [1, 2, 0.5])
    np.testing.assert_allclose(shape.pose[:3], [0, 0, 0.06])
    triangle = Message(vertex_indices=[0, 1, 2])
    mesh = Message(
        vertices=[point(0, 0, 0), point(1, 0, 0), point(0, 1, 0)], triangles=[triangle]
    )
    more = {"meshes": [mesh], "mesh_poses": [pose(0, 0, 0)], "at": pose(1, 2, 1.5)}
    scene.apply(collision_object("can", operation=APPEND, **more))
    mesh_shape = scene["can"].link.collisions[1]
    np.testing.assert_allclose(mesh_shape.pose[:3], [0, 0, 1.0])
    wall = Message(coef=[0.0, 2.0, 0.0, -4.0])
    scene.apply(collision_object("wall", planes=[wall], plane_poses=[pose(0, 0, 0)]))
    np.testing.assert_allclose(scene["wall"].link.collisions[0].pose[:3], [0, 2, 0])
    scene.apply(collision_object("can", operation=MOVE, at=pose(3, 0, 0)))
    np.testing.assert_allclose(scene["can"].pose[:3], [3, 0, 0])
    scene.apply(collision_object("can", operation=REMOVE))
    assert [*scene] == ["wall"]
    # A shape without a pose, as of moveit_commander, or an object without one.
    box = {"primitives": [primitive(1, 0.1, 0.2, 0.3)]}
    scene.apply(collision_object("box", at=pose(1, 2, 3), **box))
    np.testing.assert_allclose(scene["box"].pose[:3], [1, 2, 3])
    scene.apply(collision_object("box", primitive_poses=[pose(4, 5, 6)], **box))
    np.testing.assert_allclose(scene["box"].pose[:3], [4, 5, 6])
    np.testing.assert_allclose(scene["box"].link.collisions[0].pose[:3], 0.0)


def test_an_attached_object_is_where_its_link_is():
    robot = Robot()
    frames = robot.link_poses(robot.neutral, [0.1, 0.2, 0.8, 0, 0, 0, 1])
    scene = Scene()
    link = "left_rubber_hand"
    message = Message(
        is_diff=False,
        world=Message(collision_objects=[]),
        robot_state=Message(
            attached_collision_objects=[
                attach(can(frame=link), link, ["torso_link"], 0.5)
            ]
        ),
        object_colors=[Message(id="can", color=Message(r=1.0, g=0.0, b=0.0, a=1.0))],
    )
    with pytest.raises(G1DescriptionError, match="frame left_rubber_hand"):
        scene.apply(message)
    assert not scene
    scene.apply(message, frames)
    expected = compose(frames[link], np.array([1, 2, 0.5, 0, 0, 0, 1.0]))
    np.testing.assert_allclose(scene["can"].pose, expected)
    assert scene["can"].attachments[0].link == link
    assert scene["can"].may_touch == {"torso_link"}
    assert scene["can"].mass == 0.5
    assert scene["can"].link.visuals[0].color == (1.0, 0.0, 0.0, 1.0)
    let_go = attach(collision_object("", operation=REMOVE), link)
    assert frames_of(let_go, scene) == frames_of(message, {}) == {link}
    with pytest.raises(G1DescriptionError, match="frame left_rubber_hand"):
        scene.apply(let_go)
    moved = robot.link_poses(robot.neutral, [3.0, 0.2, 0.8, 0, 0, 0, 1])
    scene.apply(let_go, moved)
    assert scene["can"].attachments == ()
    np.testing.assert_allclose(scene["can"].pose, expected + np.eye(7)[0] * 2.9)


@pytest.mark.parametrize(
    ("message", "sentence"),
    [
        (collision_object("a"), "no shapes"),
        (collision_object("a", frame="camera"), "frame camera"),
        (collision_object("a", operation=MOVE), "no object 'a'"),
        (can(operation=ADD).header, "moveit_msgs"),
        (
            collision_object(
                "a", primitives=[primitive(4, 1, 1)], primitive_poses=[pose(0, 0, 0)]
            ),
            "type 4",
        ),
    ],
)
def test_bad_messages_change_nothing(message, sentence):
    scene = Scene()
    scene.sphere("ball", 0.1, [0, 0, 1])
    before = copy.copy(dict(scene))
    with pytest.raises(G1DescriptionError, match=sentence):
        scene.apply(message)
    assert dict(scene) == before


def test_files_for_moveit_have_its_lines(tmp_path):
    scene = Scene()
    scene.box("box", [0.1, 0.2, 0.3], [1, 2, 3], color=[1, 0, 0])
    scene.cylinder("can", 0.03, 0.12, [0, 0, 0.06])
    scene.save(tmp_path / "objects.scene")
    lines = (tmp_path / "objects.scene").read_text().splitlines()
    one = ["0 0 0", "0 0 0 1"]
    assert lines == [
        *["scene", "* box", "1 2 3", "0 0 0 1", "1", "box", "0.1 0.2 0.3", *one],
        *["1 0 0 1", "0", "* can", "0 0 0.06", "0 0 0 1", "1", "cylinder"],
        *["0.03 0.12", *one, "0.76 0.6 0.42 1", "0", "."],
    ]
