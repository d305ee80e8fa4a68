"""The stand-in loads what import_model wrote."""

import numpy as np
import pytest
from conftest import VENDOR

from g1_description.core.files.load import read_model
from g1_description.core.files.uris import with_absolute_uris
from g1_description.core.robot.lumping import lump_fixed_joints
from g1_description.importer.command import run

STANDING = np.array([0.0, 0.0, 0.793, 0.0, 0.0, 0.0, 1.0])


@pytest.mark.parametrize("options", [[], ["--decimate", "500", "--convex-collisions"]])
def test_the_vendors_robot_loads_with_all_its_shapes(make_world, tmp_path, options):
    if not VENDOR.exists():
        pytest.skip("the vendor's g1_29dof.urdf is not beside the repository")
    out = tmp_path / "out"
    run([str(VENDOR), "--out", str(out), *options])
    model = read_model(str(out / "urdf" / "g1_29dof.urdf"))
    text = with_absolute_uris(model.text, model.path.parent)
    world = make_world("hold")
    assert world.spawn_urdf("g1", text, STANDING) == ()
    source = lump_fixed_joints(read_model(str(VENDOR)).description)
    lumped = world.model("g1").assembly.description
    assert lumped.link_names == source.description.link_names
    assert lumped.mass == pytest.approx(source.description.mass, abs=1e-9)
    for one, other in zip(lumped.links, source.description.links):
        assert one.inertial == other.inertial
        assert len(one.collisions) == len(other.collisions)
