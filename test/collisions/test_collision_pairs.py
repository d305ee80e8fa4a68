"""Pairs that may touch: found for small robots, and as they are for the G1."""

import os
import signal
import sys
from dataclasses import replace
from importlib import import_module
from runpy import run_path

import numpy as np
import pytest
from conftest import PROFILE, REPOSITORY, VENDOR
from forked import run_forked, run_script
from robots import link

from g1_description.collisions.allowed_pairs import (
    ADJACENT,
    ALWAYS,
    DEFAULT,
    NEVER,
    read_allowed_pairs,
)
from g1_description.collisions.find_pairs import (
    QUICK_SAMPLES,
    find_allowed_pairs,
    quick_allowed_pairs,
    random_poses,
)
from g1_description.collisions.self_collisions import SelfCollisions
from g1_description.files.uris import with_absolute_uris
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.poses import parse_poses, pose_positions
from g1_description.robot.transform import IDENTITY
from g1_description.robot.urdf import parse_urdf

pytestmark = pytest.mark.slow

SHIPPED = PROFILE / "collisions.yaml"
POSES = parse_poses(
    (PROFILE / "poses.yaml").read_text(),
    "poses.yaml",
)
SCRIPT = REPOSITORY / "scripts" / "collision_pairs"


def sphere(x, radius=0.1):
    """Write a sphere at a place along x."""
    return (
        f'<collision><origin xyz="{x} 0 0"/><geometry><sphere radius="{radius}"/>'
        "</geometry></collision>"
    )


def slider(child, lower, upper, parent="base"):
    """Write a joint along x."""
    return (
        f'<joint name="to_{child}" type="prismatic"><parent link="{parent}"/>'
        f'<child link="{child}"/><axis xyz="1 0 0"/>'
        f'<limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/></joint>'
    )


def urdf(*parts):
    """Write a robot."""
    return f'<robot name="r">{link("base", "")}{"".join(parts)}</robot>'


def reason(allowed, *names):
    """Give the reason of a pair, None where it is checked."""
    found = [pair.reason for pair in allowed.pairs if pair.links == {*names}]
    assert len(found) <= 1
    return found[0] if found else None


SLIDERS = urdf(
    link("still", sphere(0.0)),
    '<joint name="fix" type="fixed"><parent link="base"/><child link="still"/></joint>',
    link("inside", "") + slider("inside", -0.01, 0.01),
    link("overlaps", sphere(0.05)) + slider("overlaps", -0.01, 0.01, "inside"),
    link("mostly", "") + slider("mostly", -0.01, 2.0),
    link("begins", sphere(0.195)) + slider("begins", 0.0, 2.0, "mostly"),
    link("rail", "") + slider("rail", -0.001, 0.001),
    link("misses", sphere(-0.21)) + slider("misses", -0.001, 0.001, "rail"),
    link("beam", "") + slider("beam", -0.001, 0.001),
    link("far", sphere(-0.5)) + slider("far", -0.001, 0.001, "beam"),
)
"""A sphere, and others: one always in it, one only at zero, one near, one far."""


def test_reasons():
    """What hangs on a link without shapes hangs on what carries that."""
    robot = parse_urdf(SLIDERS)
    allowed = find_allowed_pairs(robot, 500)
    assert allowed.robot == "r"
    assert (allowed.samples, allowed.seed) == (500, 0)
    assert allowed.links == ("still", "overlaps", "begins", "misses", "far")
    assert reason(allowed, "still", "far") == ADJACENT
    assert reason(allowed, "overlaps", "begins") == DEFAULT
    assert reason(allowed, "overlaps", "misses") == NEVER


def test_reasons_of_links_that_are_not_adjacent():
    """A shape in between keeps the outer links from being adjacent."""
    tip = '<collision><origin xyz="0 9 0"/><geometry><sphere radius="0.1"/></geometry>'
    text = SLIDERS
    for name in ("inside", "mostly", "rail", "beam"):
        text = text.replace(link(name, ""), link(name, tip + "</collision>"))
    allowed = find_allowed_pairs(parse_urdf(text), 500)
    assert reason(allowed, "still", "inside") == ADJACENT
    assert reason(allowed, "still", "overlaps") == ALWAYS
    assert reason(allowed, "still", "begins") == DEFAULT
    assert reason(allowed, "still", "misses") is None
    assert reason(allowed, "still", "far") == NEVER
    assert reason(allowed, "inside", "rail") == ALWAYS
    assert find_allowed_pairs(parse_urdf(text), 500) == allowed
    quick = quick_allowed_pairs(parse_urdf(text))
    assert quick.samples == QUICK_SAMPLES
    assert reason(quick, "still", "far") is None
    assert reason(quick, "still", "overlaps") == ALWAYS


def test_joints_without_limits_move():
    text = SLIDERS.replace('type="prismatic"', 'type="continuous"')
    poses = random_poses(parse_urdf(text), np.random.RandomState(0), 100)
    assert np.abs(poses[..., 3:]).max() > 0.9
    assert np.isfinite(poses).all()


@pytest.fixture(
    scope="module",
    params=[REPOSITORY / "urdf" / "g1_29dof.urdf", VENDOR],
    ids=["ours", "vendor"],
)
def g1_robot(request):
    """Give each G1 that the shipped file serves, with its collisions."""
    if not request.param.exists():
        pytest.skip(f"the vendor's {request.param.name} is not beside the repository")
    text = with_absolute_uris(request.param.read_text(), request.param.parent)
    robot = parse_urdf(text)
    return robot, SelfCollisions(robot, read_allowed_pairs(SHIPPED))


def contacts(robot, collisions, positions):
    """Give the distances in one configuration, by the names of links."""
    names = [joint.name for joint in robot.movable_joints]
    row = np.array([positions.get(name, 0.0) for name in names])
    poses = Kinematics(robot).link_poses(np.array(IDENTITY), row)
    found = collisions.contacts(poses[np.newaxis])
    return {collisions.pairs[p]: d for p, d in zip(found.pair, found.distance)}


def test_the_packages_poses_hit_nothing(g1_robot):
    robot, collisions = g1_robot
    names = [joint.name for joint in robot.movable_joints]
    for pose in POSES.values():
        positions = pose_positions(pose, robot)
        assert contacts(robot, collisions, dict(zip(names, positions.tolist()))) == {}


def test_an_arm_through_the_torso_is_found(g1_robot):
    robot, collisions = g1_robot
    assert {"pelvis", "left_rubber_hand"} <= {*collisions.links}
    assert "imu_in_torso" not in collisions.links
    positions = {"left_shoulder_roll_joint": -1.5, "left_shoulder_yaw_joint": 0.0}
    found = contacts(robot, collisions, positions)
    assert found["torso_link", "left_elbow_link"] < -0.02
    assert not any("right_shoulder" in name for pair in found for name in pair)


def test_the_shipped_file_is_that_of_the_command(g1_robot):
    """With fewer samples: all that is not "never" is the same."""
    robot, _ = g1_robot
    shipped = read_allowed_pairs(SHIPPED)
    found = find_allowed_pairs(robot, 500)
    links = {*found.links}
    for kind in (ADJACENT, ALWAYS, DEFAULT):
        ours = {p.links for p in shipped.pairs if p.reason == kind and p.links <= links}
        assert ours == {pair.links for pair in found.pairs if pair.reason == kind}
    never = {p.links for p in shipped.pairs if p.reason == NEVER and p.links <= links}
    assert never <= {pair.links for pair in found.pairs if pair.reason == NEVER}


@pytest.fixture
def command(tmp_path, monkeypatch):
    """Give what runs the command in a folder with a robot of few links."""
    model = tmp_path / "r.urdf"
    model.write_text(SLIDERS)
    monkeypatch.chdir(tmp_path)

    def run(*arguments, robot=model):
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
        return run_script(SCRIPT, robot, *arguments, environment=environment)

    return run


def test_the_command_writes_a_file_and_keeps_what_is_by_hand(command, tmp_path):
    file = tmp_path / "pairs.yaml"
    run = command("--samples", 300, "--seed", 5, "-o", file)
    assert (run.returncode, run.stderr) == (0, "")
    assert "5 links; allowed pairs: 4 adjacent" in run.stdout
    first = read_allowed_pairs(file)
    assert first == replace(
        find_allowed_pairs(parse_urdf(SLIDERS), 300, 5), place=str(file)
    )
    assert reason(first, "overlaps", "begins") == DEFAULT
    file.write_text(file.read_text() + "- [overlaps, begins, user]\n")
    command("--samples", 300, "--seed", 5, "-o", file)
    assert reason(read_allowed_pairs(file), "overlaps", "begins") == "user"
    assert len(read_allowed_pairs(file).pairs) == len(first.pairs)
    out = command("--samples", 300).stdout
    assert "\nrobot: r\n" in out
    assert f"collision_pairs {tmp_path}/r.urdf --samples 300 --seed 0\n" in out


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--samples", "0"], "must be a whole number from 1"),
        (["-o", "r.urdf"], "The file of allowed collisions r.urdf: "),
    ],
)
def test_a_wrong_command_line_is_told(command, arguments, sentence):
    run = command(*arguments)
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr.startswith("collision_pairs: ")
    assert sentence in run.stderr
    assert run.stderr.count("\n") == 1


def test_an_interrupted_command_writes_nothing(command, tmp_path):
    """While it looks at random configurations."""

    def main():
        signal.signal(signal.SIGINT, signal.default_int_handler)
        command = import_module("g1_description.cli.collision_pairs")
        interrupt = lambda *_: os.kill(os.getpid(), signal.SIGINT)  # noqa: E731
        command.show_progress = interrupt
        samples = str(2**31)
        sys.argv[:] = [str(SCRIPT), "r.urdf", "--samples", samples, "-o", "pairs.yaml"]
        run_path(str(SCRIPT), run_name="__main__")

    run = run_forked(main)
    assert run.returncode == 130
    assert run.stderr == "collision_pairs: interrupted, nothing is written.\n"
    assert run.stdout == ""
    assert [path.name for path in tmp_path.iterdir()] == ["r.urdf"]
