"""The stand-in loads what import_model wrote."""

from xml.etree import ElementTree

import numpy as np
import pytest
from conftest import VENDOR

from g1_description.files.uris import with_absolute_uris
from g1_description.importer.command import run
from g1_description.robot.load import read_model
from g1_description.robot.lumping import lump_fixed_joints

STANDING = np.array([0.0, 0.0, 0.793, 0.0, 0.0, 0.0, 1.0])


SIMPLER = ["--decimate", "500", "--convex-collisions"]
KEPT = {"left_ankle_pitch_link", "left_ankle_roll_link"}
"""Links of the simpler robot: a hull, spheres, and few triangles to look at."""


def robot(kept):
    """Write the vendor's robot, or only some of its links."""
    root = ElementTree.fromstring(with_absolute_uris(VENDOR.read_text(), VENDOR.parent))
    for element in list(root):
        names = [element.get("name")]
        if element.tag == "joint":
            names = [element.find(end).get("link") for end in ("parent", "child")]
        if kept and not kept.issuperset(names):
            root.remove(element)
    return ElementTree.tostring(root, encoding="unicode")


@pytest.mark.slow
@pytest.mark.parametrize(("kept", "options"), [(None, []), (KEPT, SIMPLER)])
def test_the_vendors_robot_loads_with_all_its_shapes(
    make_world, tmp_path, kept, options
):
    if not VENDOR.exists():
        pytest.skip("the vendor's g1_29dof.urdf is not beside the repository")
    out, given = tmp_path / "out", tmp_path / "g1_29dof.urdf"
    given.write_text(robot(kept))
    run([str(given), "--out", str(out), *options])
    model = read_model(str(out / "urdf" / "g1_29dof.urdf"))
    text = with_absolute_uris(model.text, model.path.parent)
    world = make_world("hold")
    assert world.spawn_urdf("g1", text, STANDING) == ()
    source = lump_fixed_joints(read_model(str(given)).description)
    lumped = world.model("g1").assembly.description
    assert lumped.link_names == source.description.link_names
    assert lumped.mass == pytest.approx(source.description.mass, abs=1e-9)
    for one, other in zip(lumped.links, source.description.links):
        assert one.inertial == other.inertial
        assert len(one.collisions) == len(other.collisions)
