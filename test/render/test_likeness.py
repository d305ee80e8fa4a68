"""Our G1 looks like the vendor's, as drawn by the same renderer."""

import numpy as np
import pytest
from conftest import REPOSITORY, VENDOR

from g1_description.files.uris import with_absolute_uris
from g1_description.render.camera import Camera, crop_around
from g1_description.render.rasterizer import NOTHING
from g1_description.render.scene import Picture, silhouette
from g1_description.robot.transform import IDENTITY
from g1_description.robot.urdf import parse_urdf

OURS = REPOSITORY / "urdf" / "g1_29dof.urdf"
BENT = {
    f"{side}_{joint}_joint": angle
    for side in ("left", "right")
    for joint, angle in {"hip_pitch": -1.2, "knee": 1.9, "ankle_pitch": -0.7}.items()
}


@pytest.fixture(scope="module")
def scenes():
    """Give ours and the vendor's, each alone."""
    if not VENDOR.exists():
        pytest.skip("the vendor's g1_29dof.urdf is not beside the repository")
    found = [Picture(), Picture()]
    for scene, file in zip(found, (OURS, VENDOR)):
        text = with_absolute_uris(file.read_text(), file.parent)
        scene.add(parse_urdf(text))
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("view", "positions"), [((90, 0), {}), ((40, 20), BENT)], ids=["side", "bent"]
)
def test_silhouettes_cover_each_other(scenes, view, positions):
    camera = Camera(np.array([0.0, 0.0, -0.13]), *np.radians(view), 1.7)
    for scene in scenes:
        scene.place(0, np.array(IDENTITY), positions)
    ours, vendors = (silhouette(s, camera, 450, 450) != NOTHING for s in scenes)
    assert vendors.sum() > 5_000
    assert (ours & vendors).sum() / (ours | vendors).sum() >= 0.93


def test_the_whole_picture_may_show_what_is_behind_the_eye():
    camera = Camera(np.array([1.0, 2.0, 3.0]), 0.5, 0.25, 2.0)
    behind = camera.target + 1.5 * camera.range * camera.axes[2]
    found = crop_around(np.array([camera.target, behind]), camera, 640, 480)
    assert found == (slice(0, 480), slice(0, 640))
    rows, columns = crop_around(camera.target[np.newaxis], camera, 640, 480)
    assert rows.start < 240 < rows.stop and columns.start < 320 < columns.stop
    assert max(rows.stop - rows.start, columns.stop - columns.start) <= 4
