"""A scene is spawned as models that are its objects again."""

import numpy as np
import pytest

pytest.importorskip("gazebo_msgs", reason="no workspace is sourced")

from g1_description.gazebo.programs.spawn_scene import models_of
from g1_description.robot.transform import compose
from g1_description.scenes.objects import model_objects
from g1_description.scenes.scene import Scene
from g1_description.sdf.world import read_sdf
from g1_description.sim.model import Model


def test_objects_are_models_and_links_of_a_model_stay_together():
    scene = Scene()
    scene.box("box", [0.1, 0.2, 0.3], [1, 2, 3], rpy=[0.1, 0.2, 0.3], mass=2)
    scene.sphere("table::top", 0.1, [3, 2, 1], rpy=[0.3, 0.2, 0.1])
    scene.plane("wall", [0, 0, 1], [0, 0, -1])
    scene.cylinder("table::leg", 0.1, 1.0, [3, 2, 0])
    found = {}
    for name, pose, text in models_of(scene):
        (model,) = read_sdf(text).models
        assert model.name == name
        placed = Model(name, model.assembly, compose(pose, model.pose))
        found.update({each.name: each for each in model_objects(placed)})
    assert {*found} == {*scene}
    for name, each in scene.items():
        np.testing.assert_allclose(found[name].pose, each.pose, atol=1e-9)
        assert found[name].mass == each.mass
        assert found[name].link.visuals[0].color == pytest.approx(
            each.link.visuals[0].color
        )
