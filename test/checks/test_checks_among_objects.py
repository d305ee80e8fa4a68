"""Checks know the objects of a scene: what collides with them, and what is on them."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from g1_description import Robot, Scene
from g1_description.choices import ENGINES
from g1_description.errors import UnknownNameError
from g1_description.robot.rotation import from_rpy, rotate

STILTS = """<robot name="stilts"><link name="body"><inertial><mass value="10"/>
  <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision></link>
  {}</robot>"""
LEG = """<link name="{0}_slide"><inertial><mass value="0.1"/>
  <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="{0}"><inertial><mass value="0.1"/>
  <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><geometry><box size="0.3 0.1 0.04"/></geometry></collision></link>
  <joint name="{0}_x" type="prismatic"><parent link="body"/><child link="{0}_slide"/>
  <origin xyz="0 {1} 0"/><axis xyz="1 0 0"/>
  <limit lower="-2" upper="2" effort="99" velocity="9"/></joint>
  <joint name="{0}_z" type="prismatic"><parent link="{0}_slide"/><child link="{0}"/>
  <origin xyz="0 0 -0.48"/><axis xyz="0 0 1"/>
  <limit lower="-2" upper="2" effort="99" velocity="9"/></joint>"""
ROBOT = Robot(STILTS.format(LEG.format("left", 0.2) + LEG.format("right", -0.2)))
TIMES = np.arange(301) / 50.0
ON_STEP = np.tile([0.0, 0.0, 0.65, 0.0, 0.0, 0.0, 1.0], (2, 1))
NAMES = ("left_x", "left_z", "right_x", "right_z")


def eased(begin, end):
    """Rise smoothly from 0 to 1 between two times."""
    phase = np.clip((TIMES - begin) / (end - begin), 0.0, 1.0)
    return phase**3 * (10.0 - 15.0 * phase + 6.0 * phase**2)


def climb(rise=0.15, clearance=0.1, slide=0.0, slide_time=1.0):
    """Step with one foot after the other onto a step half a metre ahead."""
    columns = []
    for begin in (0.5, 2.5):
        lift = (rise + clearance) * eased(begin, begin + 0.6)
        lift -= clearance * eased(begin + 1.0, begin + 1.6)
        way = 0.5 * eased(begin + 0.5, begin + 1.1)
        way += slide * eased(4.8, 4.8 + slide_time)
        columns += [way, lift]
    forward = 0.5 * eased(2.0, 4.0)
    columns = np.stack(columns, axis=1) - np.outer(forward, [1.0, 0.0, 1.0, 0.0])
    base = np.tile([0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0], (len(TIMES), 1))
    base[:, 0] = forward
    return ROBOT.trajectory(TIMES, dict(zip(NAMES, columns.T)), base=base)


def steps(height=0.15):
    scene = Scene()
    scene.box("step", [0.5, 1.0, height], [0.5, 0.0, height / 2])
    return scene


def found(verdict):
    return {(finding.check, finding.subject) for finding in verdict.findings}


ONLY = ("collision", "penetration", "floating", "skating", "drift")


@pytest.mark.parametrize(
    ("motion", "expected"),
    [
        (climb(), set()),
        (climb(slide=0.2), {"skating"}),
        (climb(slide=0.03), {"drift"}),
        (climb(rise=0.138), {"penetration"}),
        (climb(rise=0.168), {"floating"}),
    ],
)
def test_feet_stand_on_a_step_as_on_the_floor(motion, expected):
    verdict = ROBOT.check(motion, ONLY, scene=steps())
    assert {finding.check for finding in verdict.findings} == expected
    for finding in verdict.findings:
        assert "step" in finding.text
    without = ROBOT.check(motion, (*ONLY, "contact_forces"))
    assert "its lowest link, is 0.0" in without.findings[0].text
    assert without.skipped["collision"] == "no scene is given"


def test_links_that_go_through_an_object_have_one_finding_each():
    scene = steps()
    scene.box("plate", [0.5, 1.0, 0.02], [0.5, 0.0, 0.2])  # above the step
    verdict = ROBOT.check(climb(), ONLY, scene=scene)
    pairs = [("left", "plate"), ("right", "plate")]
    assert found(verdict) == {("collision", pair) for pair in pairs}


def test_collisions_with_objects_are_found_and_distances_known():
    scene, motion = steps(), climb()
    scene.box("beam", [0.1, 1.0, 0.1], [0.58, 0.0, 0.5])  # the body ends at x = 0.6
    scene.box("wall", [0.1, 2.0, 2.0], [0.68, 0.0, 1.0], may_touch=["left", "right"])
    verdict = ROBOT.check(motion, scene=scene)
    (finding,) = verdict.of("collision")
    assert finding.subject == ("body", "beam")
    assert finding.worst == pytest.approx(0.07, abs=1e-4)
    assert not verdict.of("penetration")
    assert verdict.skipped["clearance"].startswith("disabled")
    scene.remove("beam")
    limits = {"clearance": {"failure": 0.04}}
    verdict = pickle.loads(pickle.dumps(ROBOT.checker(limits, scene=scene))).check(
        motion
    )
    (finding,) = verdict.of("clearance")
    assert finding.subject == ("body", "wall")
    assert finding.worst == pytest.approx(0.03, abs=1e-4)
    assert verdict.figures["least_clearance"] == finding.worst
    assert not ROBOT.check(motion, ["collision"], scene=Scene()).findings
    at_rest = ROBOT.check_state(np.zeros(4), motion.base_poses[-1], scene=scene)
    assert "least_clearance" in at_rest.figures
    without = ROBOT.check_state(np.zeros(4), scene=scene)
    assert "place of the robot" in without.skipped["collision"]


def test_objects_collide_while_they_are_carried():
    scene, motion = steps(), climb()
    scene.box("tray", [0.2, 0.2, 0.1], [0.2, 0.0, 0.5])
    scene.box("below", [0.2, 0.2, 0.1], [0.2, 0.0, 0.402])  # 2 mm deep in the tray
    scene.box("post", [0.1, 0.1, 2.0], [0.82, 0.0, 1.0])
    scene.attach("tray", "body", begin=1.9, end=3.5)
    verdict = ROBOT.check(motion, scene=scene)
    subjects = {finding.subject: finding for finding in verdict.of("collision")}
    assert subjects.keys() >= {("tray", "below")}
    assert subjects["tray", "below"].first_time == pytest.approx(1.9, abs=0.05)
    scene.attach("tray", "left_hand", begin=4.0)
    with pytest.raises(UnknownNameError, match="left_hand"):
        ROBOT.check(motion, scene=scene)


@pytest.mark.parametrize(
    ("thing", "begin", "end", "expected"),
    [
        (0.69, 0.0, 5.0, {("thing", "step"): 0.45}),
        (0.69, 0.0, np.inf, {}),
        (0.69, -np.inf, 6.0, {("thing", "step"): 0.45}),
        (0.68, 0.5, 1.5, {("thing", "the floor"): 0.59}),
        (0.95, 1.0, np.inf, {("body", "thing"): 0.26}),
        (0.69, -1.0, np.inf, {("body", "thing"): 1.0}),
        (0.69, 7.0, 9.0, {("body", "thing"): 1.0}),
    ],
)
def test_grasps_and_releases_are_where_objects_are(thing, begin, end, expected):
    scene = steps()
    scene.box("thing", [0.1, 0.1, 0.18], [0.0, 0.0, thing])
    scene.attach("thing", "body", begin, end)
    verdict = ROBOT.check(climb(), ["grasp"], scene=scene)
    found = {finding.subject: finding.worst for finding in verdict.findings}
    assert found == pytest.approx(expected, abs=1e-3)


def test_what_is_put_down_is_near_its_support():
    """A box is lifted from a stand and put on another one."""
    height = 0.2 * (eased(0.5, 2.0) - eased(4.0, 5.5))
    still = {name: np.zeros(len(TIMES)) for name in NAMES}
    base = np.tile([0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0], (len(TIMES), 1))
    base[:, 2] += height
    base[:, 0] += eased(2.0, 4.0)
    motion, scene = ROBOT.trajectory(TIMES, still, base=base), Scene()
    for number in range(2):
        scene.box(f"stand_{number}", [0.2, 0.2, 0.2], [number, 0.0, 0.5])
    scene.box("box", [0.1, 0.1, 0.1], [0.0, 0.0, 0.65])
    scene.attach("box", "body", 0.0, 5.98)
    only, limits = ["clearance", "grasp"], {"clearance": {"failure": 0.03}}
    for name in ("stand_0", "stand_1"):  # the body passes through them
        scene.replace(replace(scene[name], may_touch=frozenset(["body"])))
    checker = ROBOT.checker(limits, scene=scene)
    verdict = checker.check(motion, only)
    assert not verdict.findings
    scene.box("bar", [0.1, 0.1, 0.1], [0.5, 0.0, 0.74], may_touch=["body"])
    (finding,) = ROBOT.checker(limits, scene=scene).check(motion, only).findings
    assert finding.subject == ("box", "bar")
    assert finding.worst == pytest.approx(0.01, abs=1e-4)
    scene.move("box", [0.0, 0.0, 0.02])  # 0.03 m deep in the floor
    scene.remove("stand_0")
    verdict = ROBOT.check(motion, ["collision"], scene=scene)
    found = {finding.subject: finding.worst for finding in verdict.findings}
    assert found["box", "the floor"] == pytest.approx(0.03, abs=1e-4)


@pytest.mark.parametrize("tilt", [0.0, 0.001, 0.05, 0.17, 0.2])
@pytest.mark.parametrize("kind", ["box", "plane"])
def test_robots_stand_on_what_is_flat_within_ten_degrees(kind, tilt):
    scene, rpy = Scene(), [0.0, tilt, 0.0]
    turn, top = from_rpy(np.array(rpy)), np.array([0.0, 0.0, 0.5])
    if kind == "box":
        middle = top - rotate(turn, np.array([0.0, 0.0, 0.05]))
        scene.box("table", [2.0, 2.0, 0.1], middle, rpy=rpy)
    else:
        scene.plane("table", [0, 0, 1], top, rpy=rpy)
    place = top + rotate(turn, np.array([0.0, 0.0, 0.5]))
    verdict = ROBOT.check_state(np.zeros(4), [*place, *turn], ONLY[:3], scene=scene)
    assert verdict.passed == (tilt < 0.174)
    if verdict.passed:
        assert not verdict.findings
        assert verdict.floor_contacts.keys() == {"left", "right"}


@pytest.mark.parametrize("at", [-0.02, 0.03, 0.07])
def test_soles_of_balls_stand_on_what_is_between_these(at):
    robot, scene = Robot(), Scene()
    scene.box("bar", [0.01, 1.0, 0.3], [at, 0.0, 0.15])
    base = [0.0, 0.0, 0.7634 + 0.3, 0.0, 0.0, 0.0, 1.0]
    standing = robot.named_configuration("stand")
    verdict = robot.check_state(standing, base, ONLY[:3], scene=scene)
    assert not verdict.findings
    assert {name[-16:] for name in verdict.floor_contacts} == {"_ankle_roll_link"}


def test_what_is_carried_has_its_mass():
    scene, motion = Scene(), climb(rise=0.0)
    scene.box("tray", [0.2, 0.2, 0.1], [1.0, 0.0, 0.5], mass=10.4)  # as the robot
    scene.attach("tray", "body", begin=5.0)
    alone, loaded = (ROBOT.check(motion, scene=one) for one in (Scene(), scene))
    moved = (loaded.measured.balance.center - alone.measured.balance.center)[:, 0]
    assert (moved[TIMES < 5.0] == 0.0).all()
    place = alone.measured.balance.center[-1, 0]
    assert moved[TIMES > 5.0] == pytest.approx(0.5 * (1.0 - place), abs=1e-6)
    assert "center_of_mass" in {finding.check for finding in loaded.findings}
    fixed = ROBOT.check(motion, fixed_base=True, scene=scene).measured.efforts
    assert fixed[-1] == pytest.approx(fixed[0])  # the legs do not carry it
    scene.detach("tray")
    scene.attach("tray", "left")
    fixed = ROBOT.check(motion, fixed_base=True, scene=scene).measured.efforts
    assert abs(fixed[0, 1] - fixed[0, 3]) == pytest.approx(10.4 * 9.8, rel=1e-6)


@pytest.mark.parametrize("engine", ENGINES)
def test_the_simulation_has_the_objects(engine):
    scene = Scene()
    scene.box("step", [1.0, 1.0, 0.15], [0.0, 0.0, 0.075])
    scene.box("bag", [0.1, 0.1, 0.1], [0.0, 0.0, 0.75], mass=3.0)
    scene.box("cube", [0.1, 0.1, 0.1], [0.4, 0.0, 0.2], mass=1.0)
    scene.attach("bag", "body")
    legs = {name: np.zeros(2) for name in NAMES}
    still = ROBOT.trajectory([0.0, 0.5], legs, base=ON_STEP)
    checker = ROBOT.checker(physics=True, scene=scene, engine=engine)
    verdict = checker.check(still)
    assert verdict.passed
    played = verdict.measured.played
    assert played.base_poses[-1] == pytest.approx(ON_STEP[-1], abs=2e-3)
    on_legs = played.efforts[-1, [1, 3]].sum()
    assert abs(on_legs) == pytest.approx(13.2 * 9.8, rel=0.05)  # body, slides and bag
    assert played.left_out == ()
    legs = {"left_z": [0.0, 0.0, -0.2, -0.2], "right_z": [0.0, 0.0, -0.2, -0.2]}
    bases = ON_STEP[0] + np.outer([0.0, 0.0, 0.2, 0.2], np.eye(7)[2])
    rising = ROBOT.trajectory([0.0, 0.2, 0.8, 0.9], legs, base=bases)
    for end, height in ((9.0, 0.4), (0.9, 0.2)):  # carried up, then let go
        scene.attach("cube", "body", begin=0.1, end=end)
        checker = ROBOT.checker(physics=True, scene=scene, engine=engine)
        place = checker.check(rising).measured.played.object_poses["cube"]
        assert place[:3] == pytest.approx([0.4, 0.0, height], abs=0.01)
        scene.detach("cube")
    scene.remove("cube")
    scene.box("cube", [0.1, 0.1, 0.1], [0.4, 0.0, 0.2])
    scene.attach("cube", "body", begin=0.2)
    notes = ROBOT.checker(physics=True, scene=scene, engine=engine).check(still).notes
    assert any("without a mass" in note and "cube" in note for note in notes)


def test_what_touches_a_plate_from_below_is_not_on_it():
    scene = Scene()
    scene.box("plate", [1.0, 1.0, 0.03], [0.0, 0.0, 0.053])  # 2 mm deep in the feet
    verdict = ROBOT.check_state(np.zeros(4), [0.0, 0.0, 0.5, 0, 0, 0, 1], scene=scene)
    pairs = [("left", "plate"), ("right", "plate")]
    assert found(verdict) == {("collision", pair) for pair in pairs}


@pytest.mark.parametrize("width", [0.05, 0.22])
def test_a_foot_stands_on_what_is_narrower_than_itself(width):
    scene = Scene()
    scene.box("beam", [width, 1.0, 0.15], [0.01, 0.0, 0.075])
    verdict = ROBOT.check_state(np.zeros(4), ON_STEP[0], scene=scene)
    assert verdict.passed
    assert verdict.floor_contacts.keys() == {"left", "right"}
    margin = width / 2.0 - 0.01  # the centre of mass is above x = 0
    assert verdict.figures["least_center_margin"] == pytest.approx(margin, abs=0.02)
