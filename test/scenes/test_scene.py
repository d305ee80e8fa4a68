"""Scenes: objects in Python, in YAML and in SDF."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from g1_description.errors import G1DescriptionError
from g1_description.scenes.scene import Scene

MESH = "package://g1_description/meshes/collision/pelvis_contour_link.stl"

TEXT = f"""
boxes:
  shelf: {{size: [0.4, 0.6, 0.03], at: [0.5, 0.4, 0.25]}}
  box: {{size: [0.2, 0.2, 0.2], at: [0.5, 0.4, 0.37], rpy: [0.1, 0.2, 0.3], mass: 1.5}}
cylinders:
  can: {{radius: 0.03, length: 0.12, at: [1, 0, 0.06], color: [1, 0, 0]}}
planes:
  wall: {{normal: [-2, 0, 0], at: [2, 0, 0]}}
meshes:
  mug: {{file: {MESH}, at: [1, 1, 1], scale: 0.5}}
models:
  ground: {{file: model://ground_plane}}
  table: {{file: table.sdf, at: [0, 3, 0], rpy: [0, 0, 1.5707963267948966]}}
attach:
  box:
    - {{link: left_hand, from: 3.5, until: 9}}
    - {{link: right_hand, from: 9}}
"""

TABLE = """<sdf version="1.6"><model name="table"><static>true</static>
  <link name="top"><collision name="c"><geometry><box><size>1 2 0.1</size></box>
  </geometry></collision></link>
  <link name="leg"><pose>0.4 0 -0.4 0 0 0</pose><collision name="c"><geometry>
  <cylinder><radius>0.05</radius><length>0.7</length></cylinder></geometry></collision>
  </link></model></sdf>"""


@pytest.fixture
def scene(tmp_path):
    Path(tmp_path, "table.sdf").write_text(TABLE)
    file = Path(tmp_path, "scene.yaml")
    file.write_text(TEXT)
    return Scene.read(file)


def test_yaml_is_read_with_models_and_attachments(scene):
    assert [*scene] == [
        "shelf",
        "box",
        "can",
        "wall",
        "mug",
        "ground",
        "table::top",
        "table::leg",
    ]
    np.testing.assert_allclose(
        scene["table::leg"].pose[:3], [0.0, 3.4, -0.4], atol=1e-9
    )
    np.testing.assert_allclose(scene["wall"].link.collisions[0].size, [-1, 0, 0])
    assert [(one.link, one.begin, one.end) for one in scene["box"].attachments] == [
        ("left_hand", 3.5, 9.0),
        ("right_hand", 9.0, np.inf),
    ]
    masses = np.diag(scene["box"].link.inertial.inertia)
    np.testing.assert_allclose(masses, 1.5 * 0.2**2 / 6)
    assert scene["can"].mass is None
    assert scene.get("mug") is scene["mug"] and scene.get("cup") is None


@pytest.mark.parametrize("ending", ["yaml", "world"])
def test_what_is_saved_is_read_again(scene, tmp_path, ending):
    if ending == "world":
        with pytest.raises(G1DescriptionError, match="attachments"):
            scene.save(tmp_path / "again.world")
        scene.detach("box")
    leg = scene["table::leg"].link
    rough = replace(leg.collisions[0], friction=0.3, restitution=0.8)
    odd = replace(leg, collisions=(rough,), gravity=False)
    touching = frozenset(["left_hand", "tall: can"])
    scene.replace(replace(scene["table::leg"], link=odd, may_touch=touching))
    scene.move("box", np.float32([0.34, 0.1, 1e-5]))
    scene.save(tmp_path / f"again.{ending}")
    again = Scene.read(tmp_path / f"again.{ending}")
    assert {*again} == {*scene}
    for name, before in scene.items():
        np.testing.assert_allclose(again[name].pose, before.pose, atol=1e-12)
        assert again[name].mass == before.mass
        assert again[name].attachments == before.attachments
        assert again[name].may_touch == before.may_touch
        assert again[name].link.has_gravity == before.link.has_gravity
        (old,), (new,) = before.link.collisions, again[name].link.collisions
        assert (new.kind, new.size, new.filename) == (old.kind, old.size, old.filename)
        bounces = new.friction, new.restitution
        assert bounces == (old.friction, old.restitution)
    if ending == "yaml":
        assert "at: [0.34, 0.1, 1.0e-05]" in (tmp_path / "again.yaml").read_text()


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("boxes: {a: {size: [0, 1, 1], at: [0, 0, 0]}}", "greater than 0"),
        ("boxes: {a: {size: [1, 1], at: [0, 0, 0]}}", "3 numbers"),
        ("boxes: {a: {size: [1, 1, .nan], at: [0, 0, 0]}}", "3 numbers"),
        ("boxes: {a: {at: [0, 0, 0]}}", "a in boxes has no size"),
        ("boxes: {a: {size: [1, 1, 1], at: [0, 0, 0], colour: 1}}", "option 'colour'"),
        ("boxes: [1]", "must be a mapping"),
        ("cones: {a: {}}", "section 'cones'"),
        ("meshes: {a: {file: no.stl, at: [0, 0, 0]}}", "does not exist"),
        ("meshes: {a: {file: ., at: [0, 0, 0]}}", "mesh of a is a folder"),
        (
            "planes: {a: {normal: [1, 0, 0], at: [0, 0, 0], quaternion: [0, 0, 0, 2]}}",
            "The a quaternion must have length 1",
        ),
        ("models: {a: {file: model://none}}", "no package 'none'"),
        ("attach: {a: {link: left_hand}}", "object 'a'"),
        ("spheres: {map: {radius: 1, at: [0, 0, 0]}}", "cannot be the name"),
    ],
)
def test_bad_files_are_refused_with_a_sentence(tmp_path, line, sentence):
    file = tmp_path / "scene.yaml"
    file.write_text(line)
    with pytest.raises(G1DescriptionError, match=sentence) as error:
        Scene.read(file)
    assert "scene.yaml" in str(error.value)


def test_worlds_say_what_they_lack(tmp_path):
    shape = "<geometry><mesh><uri>{}</uri></mesh></geometry>"
    file = tmp_path / "some.world"
    file.write_text(
        "<sdf version='1.6'><world name='w'><include><uri>model://none</uri></include>"
        + TABLE[len("<sdf version='1.6'>") : -len("</sdf>")].replace(
            "</model>",
            "<link name='hill'><collision name='c'><geometry><heightmap/></geometry>"
            "</collision><sensor name='eye' type='camera'/></link></model>",
        )
        + "</world></sdf>"
    )
    scene = Scene.read(file)
    assert [*scene] == ["table::top", "table::leg", "table::hill"]
    assert "include of model://none is ignored" in scene.notes[0]
    assert "heightmap in collision c" in scene.notes[1]
    assert len(scene.notes) == 2  # sensors do not matter
    box = "<geometry><box><size>1 2 0.1</size></box>\n  </geometry>"
    gone = shape.format("model://none/top.stl")
    file.write_text(file.read_text().replace(box, gone))
    with pytest.raises(G1DescriptionError, match="model://none/top"):
        Scene.read(file)


def test_masses_of_meshes_fill_their_boxes(tmp_path):
    corners = [[x, y, z] for x in (1, 2) for y in (0, 0.4) for z in (0, 0.2)]
    faces = [(a, b, c) for a in range(8) for b in range(a) for c in range(b)]
    lines = ["v {} {} {}".format(*corner) for corner in corners]
    lines += ["f {} {} {}".format(*(n + 1 for n in face)) for face in faces]
    file = tmp_path / "brick.obj"
    file.write_text("\n".join(lines))
    scene = Scene()
    mesh = scene.mesh("mesh", file, [0, 0, 0], scale=0.5, mass=3.0).link.inertial
    box = scene.box("box", [0.5, 0.2, 0.1], [0, 0, 0], mass=3.0).link.inertial
    np.testing.assert_allclose(mesh.center_of_mass, [0.75, 0.1, 0.05], atol=1e-6)
    np.testing.assert_allclose(mesh.inertia, box.inertia, rtol=1e-5)


def test_attachments_do_not_overlap(scene):
    with pytest.raises(G1DescriptionError, match="overlap"):
        scene.attach("box", "torso", 8.0, 10.0)
    scene.attach("can", "left_hand")
    with pytest.raises(G1DescriptionError, match="left_hand from the start to the end"):
        scene.attach("can", "right_hand", 2.0)
    with pytest.raises(G1DescriptionError, match="plane"):
        scene.attach("wall", "left_hand")


def test_a_scene_has_a_limit():
    scene = Scene()
    with pytest.raises(G1DescriptionError, match="at most"):
        for number in range(10000):
            scene.sphere(f"ball_{number}", 0.1, [0, 0, 1])
