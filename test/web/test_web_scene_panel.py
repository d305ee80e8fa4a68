"""The panel of objects on a page without ROS, used over the wire."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("viser", reason="viser is not installed")

from shown_pages import Open, ramp
from waiting import wait_for

from g1_description.scenes.scene import Scene
from g1_description.web import scene_panel
from g1_description.web.panel import PageContext

pytestmark = pytest.mark.slow


@pytest.fixture
def page(tmp_path, monkeypatch):
    monkeypatch.setattr(scene_panel, "folder", lambda: tmp_path / "scenes")
    one = Open()
    yield one
    one.close()


def test_objects_are_added_changed_attached_saved_and_opened(page, tmp_path):
    client, (around,) = page.client(), page.world.scenes

    def wait(condition, what):
        wait_for(lambda: condition(around.scene()), what)

    def gizmo():
        return next(n for n in client.nodes if n.endswith("/selected/gizmo"))

    client.set("Add object", "Box")
    wait(lambda scene: "box" in scene, "a box")
    client.wait_for(lambda: client.value("Object") == "box", "its selection")
    client.wait_for(lambda: client.nodes[gizmo()].get("visible"), "its gizmo")
    client.wait_for(lambda: client.value("Box size") == [0.2, 0.2, 0.2], "its size")
    client.set("Box size", [0.1, 0.2, 0.3])
    wait(lambda s: s["box"].link.collisions[0].size == (0.1, 0.2, 0.3), "its new size")
    client.set("Mass", 2.0)
    wait(lambda s: s["box"].mass == 2.0, "its mass")
    client.set("Box size", [0.0, 0.2, 0.3])
    client.wait_for(lambda: client.says("must be greater than 0"), "a sentence")
    client.set("Place", [1.0, 2.0, 3.0])
    wait(lambda s: s["box"].pose[:3].tolist() == [1.0, 2.0, 3.0], "its place")
    pose = {"wxyz": (0.8, 0.0, 0.0, 0.6), "position": (0.5, 0.4, 0.3)}
    client.send("TransformControlsUpdateMessage", name=gizmo(), **pose)
    wait(
        lambda s: np.allclose(s["box"].pose, [0.5, 0.4, 0.3, 0, 0, 0.6, 0.8]), "a drag"
    )
    client.set("Object name", "brick")
    wait(lambda s: [*s] == ["brick"], "its name")
    client.wait_for(lambda: client.value("Object") == "brick", "its selection")
    client.set("Attach to", "left_arm")
    wait(lambda s: s["brick"].attachments, "a link")
    assert around.carrier("brick") == "left_arm"
    page.robot.command({"left_elbow_joint": 1.0})
    wait(lambda s: s["brick"].pose[2] > 0.32, "a move with its link")
    # Gizmos avoid objects where they are seen: next to those of another robot.
    page.robot.offset = np.array([0.0, -1.0, 0.0])
    context = PageContext(None, None, page.world, None, None, None, False)
    seen, place = context.scene_now(page.robot)["brick"], around.shown()[1]["brick"]
    page.robot.offset = np.zeros(3)
    np.testing.assert_allclose(seen.pose[:3], place[:3] - [0.0, 1.0, 0.0])
    assert [one.link for one in seen.attachments] == ["left_arm"]
    client.press("Save scene")
    client.wait_for(lambda: client.says("Saved "), "a notice")
    file = tmp_path / "scenes" / "scene.yaml"
    saved = Scene.read(file)
    np.testing.assert_allclose(saved["brick"].pose, around.scene()["brick"].pose)
    client.set("Add object", "Sphere")
    client.wait_for(lambda: client.value("Object") == "sphere", "a sphere")
    client.press("Delete object")
    wait(lambda s: [*s] == ["brick"], "one object less")
    around.remove("brick")
    client.upload(
        "Open a scene", "a.yaml", b"boxes: {a: {size: [1, 1, 0], at: [0, 0]}}"
    )
    client.wait_for(lambda: client.says("The scene a.yaml cannot be used"), "why")
    client.upload("Open a scene", "scene.yaml", file.read_bytes())
    wait(lambda s: [*s] == ["brick"], "the saved scene")
    assert around.carrier("brick") == "left_arm"


def test_motions_are_checked_among_the_objects(page):
    client, (around,) = page.client(), page.world.scenes
    scene = Scene()
    scene.box("wall", [0.1, 0.1, 2.0], page.robot.state().base_pose[:3])
    around.load(scene)
    page.world.read = lambda *_: replace(
        ramp(1.0), base_poses=np.tile(page.robot.state().base_pose, (31, 1))
    )
    client.upload("Open a motion", "a.csv", b"x")
    verdicts = page.show.motion.verdicts
    wait_for(lambda: page.robot in verdicts, "a verdict")
    found = [one.subject for one in verdicts[page.robot].findings]
    assert ("trunk", "wall") in found


def test_a_page_to_look_at_has_no_panel_of_objects():
    one = Open(read_only=True)
    try:
        assert one.client().find("Add object") is None
    finally:
        one.close()
