"""Robots that are not the G1 of this package: nothing of it is in what they do.

One has five links and is nobody's, one is from a public package, PyBullet's own data.
test/rostest/test_other_robot.py displays one.
"""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pybullet_data
import pytest
from conftest import REPOSITORY
from web_clients import running

from g1_description.api import Robot
from g1_description.cli import check, web
from g1_description.collisions.find_pairs import collisions_of
from g1_description.command_line import parse
from g1_description.motion.motion import Motion
from g1_description.motion.motors import motors_of
from g1_description.robot.urdf import parse_urdf
from g1_description.sim.rollout import rollout
from g1_description.web.page import Page
from g1_description.web.server.address import ServerOptions

from page_client import PageClient

G1 = parse_urdf((REPOSITORY / "urdf" / "g1_29dof.urdf").read_text())
ITS_NAMES = {"g1", *G1.link_names, *(joint.name for joint in G1.joints)}

STRANGERS = {
    "strider": REPOSITORY / "test" / "data" / "five_links.urdf",
    "a1_description": Path(pybullet_data.getDataPath(), "a1", "a1.urdf"),
}


@pytest.fixture(params=STRANGERS)
def stranger(request):
    """Give the file of each robot without a profile."""
    return STRANGERS[request.param]


def standing(robot):
    """Make a motion of 0.2 s in which a robot stands."""
    times = np.array([0.0, 0.1, 0.2])
    positions = np.tile(robot.neutral, (3, 1))
    base = np.tile([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], (3, 1))
    motion = Motion(times, robot.joint_names, positions, base_poses=base)
    return robot.on_floor(motion)


def test_it_is_checked_with_its_own_links_and_motors(stranger):
    robot = Robot(stranger)
    verdict = robot.checker(physics=True).check(standing(robot))
    assert "self_collision" in verdict.checked
    assert not [f for f in verdict.findings if f.check == "self_collision"]
    links = {*robot.link_names}
    assert {name for pair in robot.collision_pairs for name in pair} <= links
    played = rollout(robot.description, standing(robot))
    np.testing.assert_array_equal(played.effort_limits, robot.effort_limits)


def test_pairs_of_a_robot_without_a_file_are_found_once(
    stranger, tmp_path, monkeypatch
):
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    first = collisions_of(Robot(stranger).description)
    (file,) = (tmp_path / "g1_description" / "collisions").iterdir()
    assert first.notes[0].endswith(f" and are kept in {file}.")
    a, b = first.pairs[0]
    text = file.read_text().replace("pairs:\n", f"pairs:\n- [{a}, {b}, user]\n")
    file.write_text(text)
    assert collisions_of(Robot(stranger).description).pairs == first.pairs[1:]
    file.write_text("damaged")
    assert collisions_of(Robot(stranger).description).pairs == first.pairs
    assert [*file.parent.iterdir()] == [file]


def test_pairs_of_a_robot_whose_mesh_changed_are_found_again(tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    source = STRANGERS["a1_description"]
    for file in (source, *source.parent.glob("meshes/*")):
        copy = tmp_path / file.relative_to(source.parent)
        copy.parent.mkdir(exist_ok=True)
        copy.write_bytes(file.read_bytes())
    for _ in range(2):
        collisions_of(Robot(tmp_path / "a1.urdf").description)
    with (tmp_path / "meshes" / "hip.obj").open("a") as mesh:
        mesh.write("# changed\n")
    collisions_of(Robot(tmp_path / "a1.urdf").description)
    assert len([*(tmp_path / "g1_description" / "collisions").iterdir()]) == 2


def test_pairs_that_cannot_be_kept_are_used(stranger, tmp_path, monkeypatch):
    (tmp_path / "g1_description").write_text("in the way")
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    notes = collisions_of(Robot(stranger).description).notes
    assert notes[0].endswith(" were found in 1000 random configurations.")


def test_a_profile_that_lacks_links_is_told_and_pairs_are_found():
    text = (REPOSITORY / "urdf" / "g1_29dof.urdf").read_text()
    described = parse_urdf(text.replace('"left_rubber_hand"', '"left_claw"'))
    found = collisions_of(described)
    assert "lack links of 'g1_29dof': left_claw. " in found.notes[0]
    assert "The allowed collisions of g1_29dof were found in " in found.notes[0]


def test_the_page_has_no_pose_and_no_name_of_the_g1(stranger):
    args = parse(web.WebOptions, "web", ["--model", str(stranger)])
    world, _ = web.make_world(args)
    show = Page(world, ServerOptions(port=0), lambda robot: Robot(stranger).checker())
    with running(show), PageClient(show.address) as client:
        client.wait_until_whole()
        assert [*client.element("Go to pose")["options"]] == ["zero"]
        words = {w for e in [*client.elements.values()] for w in str(e).split("'")}
        assert not words & ITS_NAMES


def test_the_command_check_says_nothing_of_the_g1(tmp_path):
    stranger = STRANGERS["strider"]
    robot = Robot(stranger)
    file = tmp_path / "stand.csv"
    robot.write_motion(file, standing(robot))
    command = "from g1_description.cli.start import run; run('check')"
    run = subprocess.run(
        [
            sys.executable,
            "-c",
            command,
            str(file),
            "--model",
            str(stranger),
            "--physics",
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.stderr == ""
    assert run.returncode in (0, 1), run.stdout
    assert not {*run.stdout.replace(",", " ").replace(":", " ").split()} & ITS_NAMES


def test_motors_and_collisions_may_be_given(tmp_path):
    """To Python and to the command alike; those of a profile are not used then."""
    (tmp_path / "motors.yaml").write_text("'.*': {effort: 7}\n")
    robot = Robot(motors=tmp_path / "motors.yaml")
    assert motors_of(robot.description).of("left_knee_joint").effort == 7.0
    text = Robot().profile.collisions.read_text()
    pair = "[left_hip_roll_link, right_hip_roll_link, never]"
    assert pair in text
    (tmp_path / "collisions.yaml").write_text(text.replace(f"- {pair}\n", ""))
    robot = Robot(allowed_collisions=tmp_path / "collisions.yaml")
    extra = {*robot.collision_pairs} - {*Robot().collision_pairs}
    assert extra == {("left_hip_roll_link", "right_hip_roll_link")}
    words = ["a.csv", "--physics"]
    for name in ("motors", "collisions"):
        words += [f"--{name}", str(tmp_path / f"{name}.yaml")]
    checker = check.file_checker(parse(check.CheckOptions, "check", words)).checker
    assert checker.collisions.pairs == robot.collision_pairs
    limits = motors_of(checker.description)
    assert limits.of("left_knee_joint").effort == 7.0
