"""A world with what tests write often."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import REPOSITORY

from g1_description.files.uris import with_absolute_uris
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.urdf import parse_urdf
from g1_description.sdf.world import read_sdf
from g1_description.sim.engine import PhysicsProperties
from g1_description.sim.entities import seen_from
from g1_description.sim.world import World

OUR_G1 = with_absolute_uris(
    (REPOSITORY / "urdf" / "g1_29dof.urdf").read_text(), REPOSITORY / "urdf"
)


class Bench(World):
    """A world, with URDF text, names of frames, and a look behind it."""

    def __init__(
        self,
        physics="kinematic",
        gravity=(0.0, 0.0, -9.8),
        content=None,
        motors=None,
        engine="bullet",
        **numbers,
    ):
        properties = PhysicsProperties(
            **dict(zip(("gravity_x", "gravity_y", "gravity_z"), gravity)), **numbers
        )
        super().__init__(physics, properties, content, motors, engine)

    def skip_unless_bullet(self):
        """Skip a test that looks into PyBullet, where another engine runs."""
        if not hasattr(self.engine, "_client"):
            pytest.skip("looks into PyBullet")

    @property
    def client(self):
        self.skip_unless_bullet()
        self.engine._write_moved()
        return self.engine._client

    def bodies(self, name):
        self.skip_unless_bullet()
        return self.engine._woken(self.model(name))

    def body(self, name):
        (body,) = self.bodies(name)
        return body

    def joint_numbers(self, name):
        """Map the joints of a model to PyBullet's numbers for them."""
        body = self.body(name)
        joint = {j.child: j.name for j in body.model.assembly.description.joints}
        numbers = range(self.client.getNumJoints(body.number))
        return {joint[body.link_names[number]]: number for number in numbers}

    def read_back(self):
        """Give the models the state that PyBullet has, as a step does."""
        self.skip_unless_bullet()
        self.engine._write_moved()
        self.engine._sort()
        self.engine._moving.read()
        self.engine._moving.update_models()

    def spawn_urdf(self, name, text, pose, fixed_base=False):
        assembly = lump_fixed_joints(parse_urdf(text), self.is_dynamic)
        return self.spawn(name, assembly, pose, fixed_base)

    def spawn_sdf(self, name, text, pose):
        (model,) = read_sdf(text).models
        return self.spawn(name, model.assembly, np.array(pose, dtype=float))

    def put(self, name, pose, twist, frame=""):
        model = self.model(name)
        self.set_model_state(model, pose, twist, self.entities.frame(frame))

    def model_state(self, name, frame=""):
        return seen_from(self.entities.frame(frame), self.model(name))

    def link_state(self, name, frame=""):
        return seen_from(self.entities.frame(frame), self.entities.link(name))

    def change(self, **numbers):
        self.set_properties(replace(self.properties, **numbers))

    def run(self, seconds):
        for _ in range(round(seconds / self.properties.time_step)):
            self.step()
