"""Spoilt motions are mended to what they were; nothing else is changed."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bench import mend as faults
from scipy.interpolate import CubicSpline

from g1_description import Robot
from g1_description.cli import motion as command
from g1_description.errors import InvalidValueError
from g1_description.motion.motion import Motion

ROBOT = Robot()
ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", ["squat.csv", "step_in_place.csv"])
@pytest.mark.parametrize(
    ("way", "least"),
    [
        ("drifting", 15.0),
        ("sliding 0.25 m", 15.0),
        ("2 cm too high", 20.0),
        ("noise of 5 mrad", 3.5),
        ("one wrong frame", 100.0),
        ("beyond limits", 5.0),
        ("15 mm in the floor", 5.0),
    ],
)
def test_a_spoilt_motion_is_mended_to_what_it_was(name, way, least):
    clean = ROBOT.read_motion(name)
    spoilt = faults.WAYS[way](ROBOT, clean, np.random.default_rng(0))
    if way == "beyond limits":
        clean = faults.raised(ROBOT, clean, 0.0)
    found = ROBOT.mended(spoilt)
    before, after = (
        faults.distance(ROBOT, clean, motion) for motion in (spoilt, found.motion)
    )
    assert after < before / least
    kinds = {f.check for f in found.after.findings if f.severity == "failed"}
    assert kinds <= {"effort"}  # of the steps that the slide was faster than


def test_what_is_mended_is_not_mended_again_and_clean_motions_are_not_at_all():
    """A motion with a fault of each kind: all failures go."""
    found = ROBOT.mended("faulty.csv")
    assert found.certificate.failures == (9, 0)
    assert found.after.passed
    again = ROBOT.mended(found.motion)
    np.testing.assert_array_equal(again.motion.positions, found.motion.positions)
    np.testing.assert_array_equal(again.motion.base_poses, found.motion.base_poses)
    clean = ROBOT.read_motion("squat.csv")
    found = ROBOT.mended(clean)
    np.testing.assert_array_equal(found.motion.positions, clean.positions)
    assert found.certificate.moved == ()
    assert str(found.certificate) == "  nothing is changed."


def test_changes_stay_within_their_bounds_and_what_is_left_is_named():
    clean = ROBOT.read_motion("squat.csv")
    spoilt = faults.WAYS["drifting"](ROBOT, clean, None)
    found = ROBOT.mended(spoilt, max_base=0.05, max_change=0.05)
    moved = {one.name: one for one in found.certificate.moved}
    assert not moved or moved["base"].largest <= 0.05
    assert not moved or moved["joints"].largest <= 0.05
    assert any("larger than allowed" in text for text in found.certificate.left)


def test_joints_stay_within_the_bounds_of_accelerations():
    """The wave reaches 1.9 times the bound, in its elbow."""
    bounds = {"acceleration_bounds": {"default": 20.0}}
    found = ROBOT.mended("wave.csv", thresholds=bounds)
    assert [f.check for f in found.before.findings] == ["acceleration"]
    assert found.after.findings == ()
    joints = found.certificate.moved[0]
    assert joints.rms < 5e-3 and joints.largest < 0.1


def test_hands_keep_their_paths_if_they_should():
    found = ROBOT.mended("faulty.csv", keep_hands=True)
    moved = {one.name: one.rms for one in found.certificate.moved}
    assert found.certificate.failures == (9, 0)
    assert max(moved["left_wrist_yaw_link"], moved["right_wrist_yaw_link"]) < 5e-3
    assert moved["left_ankle_roll_link"] > 0.03


def test_noise_at_a_limit_is_smoothed_within_it():
    clean = faults.raised(ROBOT, ROBOT.read_motion("squat.csv"), 0.0)
    noisy = faults.WAYS["noise of 5 mrad"](ROBOT, clean, np.random.default_rng(0))
    clamped = replace(noisy, positions=noisy.positions.clip(ROBOT.lower, ROBOT.upper))
    found = ROBOT.mended(clamped, only=["noise"])
    assert found.certificate.moved
    assert (found.motion.positions <= ROBOT.upper).all()


def test_wrong_samples_within_the_bounds_are_mended_and_farther_ones_stay():
    spoilt = ROBOT.read_motion("squat.csv")
    spoilt.positions[50, 20] += 0.3
    spoilt.positions[90, 26] += 0.8
    found = ROBOT.mended(spoilt, only=["outliers"], max_change=0.5).motion
    changed = np.flatnonzero(np.abs(found.positions - spoilt.positions).max(axis=1))
    assert changed.tolist() == [50]


def test_sliding_joints_move_in_metres():
    robot = Robot(ROOT / "test" / "data" / "prismatic.urdf")
    slides = np.linspace(0.0, 0.7, 100)[:, np.newaxis]
    motion = Motion(np.linspace(0.0, 2.0, 100), ("slide",), slides)
    moved = robot.mended(motion).certificate.moved
    assert (moved[0].name, moved[0].unit) == ("sliding joints", "m")


def test_only_what_is_wanted_is_mended():
    found = ROBOT.mended("faulty.csv", only=["limits"])
    kinds = {finding.check for finding in found.after.findings}
    assert "position" not in kinds and {"skating", "self_collision"} <= kinds
    names = ROBOT.read_motion("faulty.csv").joint_names
    changed = np.ptp(found.motion.positions - found.before.measured.motion.positions, 0)
    assert [n for n, size in zip(names, changed) if size > 0.01] == ["left_elbow_joint"]
    found = ROBOT.mended("faulty.csv", only=["feet"])
    assert "position" in {finding.check for finding in found.after.findings}
    with pytest.raises(InvalidValueError, match="'knees' cannot be fixed; choose of"):
        ROBOT.mended("faulty.csv", only=["knees"])


def test_a_configuration_and_a_motion_without_a_base_are_fixed_too():
    spoilt = ROBOT.read_motion("faulty.csv")
    at = int(np.searchsorted(spoilt.times, 2.8))  # an elbow beyond its limit
    rows = slice(at, at + 1)
    one = replace(
        spoilt,
        times=spoilt.times[:1],
        positions=spoilt.positions[rows],
        base_poses=spoilt.base_poses[rows],
    )
    for motion in (one, replace(one, base_poses=None)):
        found = ROBOT.mended(motion, only=["limits"])
        assert found.certificate.failures[1] < found.certificate.failures[0]


@pytest.mark.parametrize("height", [0.05, -0.05])
def test_a_motion_above_or_below_the_floor_is_moved_as_a_whole(height):
    clean = ROBOT.read_motion("squat.csv")
    spoilt = replace(clean, base_poses=clean.base_poses + height * np.eye(7)[2])
    found = ROBOT.mended(spoilt)
    np.testing.assert_allclose(found.motion.base_poses, clean.base_poses, atol=2e-3)
    np.testing.assert_array_equal(found.motion.positions, clean.positions)


def test_samples_between_those_that_are_solved_for_are_changed_as_well():
    """Of a motion at 50 Hz, and then at 500 Hz."""
    clean = ROBOT.read_motion("squat.csv")
    slow = np.arange(0.0, 3.0, 0.02)
    times = np.append(slow, np.arange(3.0, clean.duration, 2e-3))
    positions, bases = (
        CubicSpline(clean.times, values)(times)
        for values in (clean.positions, clean.base_poses)
    )
    clean = replace(
        clean, times=times, positions=positions, velocities=None, base_poses=bases
    )
    spoilt = faults.WAYS["drifting"](ROBOT, clean, None)
    found = ROBOT.mended(spoilt)
    for some in (slow, times):
        before, after = (
            faults.distance(ROBOT, clean.sampled(some), motion.sampled(some))
            for motion in (spoilt, found.motion)
        )
        assert after < before / 50.0
    assert found.after.findings == ()


def test_velocities_stay_those_of_the_positions():
    spoilt = faults.WAYS["drifting"](ROBOT, ROBOT.read_motion("squat.csv"), None)
    rates = np.gradient(spoilt.positions, spoilt.times, axis=0)
    found = ROBOT.mended(replace(spoilt, velocities=rates)).motion
    np.testing.assert_allclose(
        found.positions, ROBOT.mended(spoilt).motion.positions, atol=1e-9
    )
    rates = np.gradient(found.positions, found.times, axis=0)
    np.testing.assert_allclose(found.velocities, rates, atol=1e-9)
    clean = ROBOT.read_motion("squat.csv")
    clean = replace(clean, velocities=np.gradient(clean.positions, 0.02, axis=0))
    glitch = replace(clean, positions=clean.positions.copy())
    glitch.positions[50, 20] += 1.0
    found = ROBOT.mended(glitch)
    assert found.certificate.failures == (1, 0) and found.after.findings == ()
    np.testing.assert_allclose(found.motion.velocities, clean.velocities, atol=1e-12)


def test_what_feet_do_on_the_floor_is_found_once_they_are_there():
    """In the air nothing slides: the slide is a new failure."""
    spoilt = faults.WAYS["sliding 0.25 m"](ROBOT, ROBOT.read_motion("squat.csv"), None)
    low = replace(spoilt, base_poses=spoilt.base_poses - 0.8 * np.eye(7)[2])
    found = ROBOT.mended(low, only=["floor"])
    assert "skating" in {finding.check for finding in found.after.findings}
    before, after = found.certificate.failures
    assert after < before
    row = next(row for row in found.certificate.rows if row.check == "penetration")
    assert row.failures[0] > row.failures[1] == 0


@pytest.mark.parametrize("way", ["drifting", "sliding 0.25 m"])
def test_faults_that_hide_each_other_are_mended_together(way):
    clean = ROBOT.read_motion("step_in_place.csv")
    alone = ROBOT.mended(faults.WAYS[way](ROBOT, clean, None))
    noisy = faults.WAYS["noise of 5 mrad"](ROBOT, clean, np.random.default_rng(0))
    found = ROBOT.mended(faults.WAYS[way](ROBOT, noisy, None))
    assert found.certificate.failures[1] <= alone.certificate.failures[1]


def test_feet_stand_on_a_floor_at_any_height():
    spoilt = faults.WAYS["drifting"](
        ROBOT, ROBOT.read_motion("step_in_place.csv"), None
    )
    low = replace(spoilt, base_poses=spoilt.base_poses - 0.3 * np.eye(7)[2])
    one = ROBOT.mended(spoilt).motion
    other = ROBOT.mended(low, thresholds={"floor_height": -0.3}).motion
    np.testing.assert_allclose(one.positions, other.positions, atol=1e-6)


def test_the_simulated_robot_falls_no_earlier():
    """The lean at the end of faulty.csv falls earlier in place than on sliding feet."""
    found = ROBOT.mended("faulty.csv", physics=True)
    before, after = found.certificate.falls
    assert before is not None and (after is None or after > before - 0.1)
    assert "simulated: a fall at " in str(found.certificate)


def run(monkeypatch, *words):
    """Run the command; give its exit code."""
    monkeypatch.setattr(sys, "argv", ["motion", "mend", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        command.main()
    return ended.value.code


def test_the_command_writes_the_motion_and_prints_what_was_changed(
    monkeypatch, tmp_path, capsys
):
    out = tmp_path / "mended.csv"
    assert run(monkeypatch, "faulty.csv", "--only", "limits", "--dry-run") == 0
    assert "position        1 -> 0    0 -> 0" in capsys.readouterr().out
    assert run(monkeypatch, "faulty.csv", "--only=limits", "--html", "--out", out) == 0
    assert '"before":{"times"' in out.with_suffix(".html").read_text()
    assert "mended.csv: 401 samples, 8.00 s\n  check " in capsys.readouterr().out
    assert not [f for f in ROBOT.check(out).findings if f.check == "position"]
    assert run(monkeypatch, "squat.csv", "--dry-run", "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert told.pop("file").endswith("squat.csv")
    assert told == {"findings": {}, "moved": [], "left": []}
    assert run(monkeypatch, "squat.csv") == 2
    assert "give --out, or --dry-run" in capsys.readouterr().err
