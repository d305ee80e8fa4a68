"""What the node replay refuses, and what it logs."""

import pytest

pytest.importorskip("rospy", reason="rospy is not installed")

from conftest import REPOSITORY

from g1_description.bridge import replay
from g1_description.bridge.replay import ReplayParameters
from g1_description.errors import InvalidValueError
from g1_description.motion.files.formats import read_motion
from g1_description.robot.urdf import parse_urdf

G1 = REPOSITORY / "urdf" / "g1_29dof.urdf"
MOTION = REPOSITORY / "test" / "data" / "elbow.csv"


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({}, "No motion file; give motion:=FILE or bag:=FILE."),
        ({"motion": "/a", "bag": "/b"}, "motion:= and bag:= cannot be combined."),
        ({"motion": "a.csv"}, "absolute path (got 'a.csv'); try $PWD/a.csv."),
        ({"bag": "a.bag"}, "absolute path (got 'a.bag'); try $PWD/a.bag."),
        ({"motion": "/a", "speed": 0.0}, "~speed must be from 0.001 to 1000.0"),
        ({"motion": "/a", "fps": -1.0}, "~fps must be from 0.0"),
        ({"motion": "/a", "publish_rate": 0.0}, "~publish_rate must be from 0.1"),
    ],
)
def test_wrong_parameters_are_told(given, told):
    with pytest.raises(InvalidValueError) as caught:
        ReplayParameters(**given)
    assert told in str(caught.value)


def test_a_file_of_either_kind():
    assert ReplayParameters(motion="/a").file == "/a"
    assert ReplayParameters(bag="/b", speed=1e-3, publish_rate=0.1).file == "/b"


@pytest.mark.parametrize("has_base", [True, False])
def test_joints_that_do_not_move_and_a_missing_base_are_told_once(
    monkeypatch, tmp_path, has_base
):
    rows = [line.split(",") for line in MOTION.read_text().splitlines()]
    for row in rows[1:]:
        row[0] = str(100.0 + float(row[0]))
    kept = [n for n, name in enumerate(rows[0]) if has_base or "base" not in name]
    file = tmp_path / "a.csv"
    file.write_text("\n".join(",".join(row[n] for n in kept) for row in rows))
    told = []
    for name in ("logwarn", "loginfo"):
        monkeypatch.setattr(replay.rospy, name, lambda text, *a: told.append(text % a))
    replay.report(read_motion(file, parse_urdf(G1.read_text())))
    assert "".join(told).count("left_hip_pitch_joint") == 1
    assert ("shown at the origin of the map" in "".join(told)) != has_base
    assert told[-1] == "11 samples, 1.00 s."
