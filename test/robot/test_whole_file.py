"""Files that are written as a whole or not at all."""

import resource
from contextlib import contextmanager

import pytest

pytest.importorskip("rospy", reason="rospy is not installed")

from g1_description.errors import G1DescriptionError
from g1_description.robot.poses import Pose, save_pose


@contextmanager
def tiny_files():
    """Let no file grow beyond ten bytes, as on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_pose_that_cannot_be_written_leaves_nothing(tmp_path):
    told = pytest.raises(G1DescriptionError, match="cannot be written: File too large")
    with told, tiny_files():  # as short as can be: pytest writes to a file, too
        save_pose(Pose("low", {"knee": 1.0}), tmp_path / "poses.yaml")
    assert not list(tmp_path.iterdir())


def test_a_file_keeps_its_mode_when_it_is_replaced(tmp_path):
    file = tmp_path / "poses.yaml"
    file.write_text("low: {}\n")
    file.chmod(0o640)
    save_pose(Pose("low", {"knee": 1.0}), file)
    assert file.stat().st_mode & 0o777 == 0o640
    assert file.read_text() == "low:\n  knee: 1.0\n"
