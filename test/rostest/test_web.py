"""The robot of the simulator in a real browser: seen, moved, played, on a phone too.

What needs no browser is in test/web/test_web_page.py.
"""

import re
from dataclasses import replace
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest
import rospy
from g1_description.msg import RobotState
from g1_description.srv import GetAnchor, SetAnchor
from gazebo_msgs.msg import LinkStates
from gazebo_msgs.srv import (
    GetPhysicsProperties,
    GetPhysicsPropertiesResponse,
    GetWorldProperties,
)
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from support import browser
from support.pictures import read_picture, share_changed
from support.ros_testing import Connected, position_of, service, wait_for

import g1_description
from g1_description.cli import doctor
from g1_description.errors import G1DescriptionError
from g1_description.robot.urdf import parse_urdf
from g1_description.ros.conversions import pose_from_array, robot_state_from_message
from g1_description.ros.log import ThrottledLog
from g1_description.scenes.objects import COLOR
from g1_description.scenes.scene import Scene
from g1_description.scenes.scene_file import yaml_of
from g1_description.web.live_scene import LiveScene
from g1_description.web.live_simulator import LiveSimulator

from page_client import PageClient

pytestmark = pytest.mark.skipif(bool(browser.missing()), reason=browser.missing())

WINDOW = (640, 400)
SHARP = "?fixedDpr=1"
"""However slowly pictures come, they are as fine as others: they can be compared."""
STEP = 0.02
"""Of the simulator, in [s]."""
LEFT_FOOT = "left_ankle_roll_link"
KNEE, ELBOW = "left_knee_joint", "left_elbow_joint"
SECONDS = 2.0
"""Length of the motion that the tests make, in [s]."""
BEYOND = 9.0
"""Where its knee is at 1.5 s, in [rad]: no knee goes there."""


def write_motion(path):
    """Write a motion with times: the left knee bends, once too far."""
    rows = ["time,left_knee_joint,left_elbow_joint"]
    for number in range(41):
        time = SECONDS * number / 40
        knee = BEYOND if time == 1.5 else 0.4 * time
        rows.append(f"{time},{knee},{0.2 * time}")
    path.write_text("\n".join(rows) + "\n")
    return path


@pytest.fixture(scope="module")
def chromium():
    with browser.Browser() as one:
        yield one


@pytest.fixture(scope="module")
def window(chromium, address):
    page = chromium.open(address + SHARP, WINDOW, script=browser.JAGGED)
    page.wait_for(lambda: "Robot" in page.text(), "the panel")
    page.dismiss()
    yield page
    page.close()


@pytest.fixture
def page(window):
    """Give the page, which is left without errors."""
    yield window
    assert not window.problems


class Robot:
    """The robot: what it is commanded, and where it is."""

    def __init__(self):
        self.states = Connected("/joint_states", JointState)
        self._commands = rospy.Publisher("/joint_commands", JointState, queue_size=10)
        wait_for(self._commands.get_num_connections, "the bridge")

    def command(self, **positions):
        self._commands.publish(
            JointState(name=[*positions], position=[*positions.values()])
        )

    def is_at(self, joint, position, tolerance=1e-3):
        newest = self.states.messages[-1:]
        return newest and abs(position_of(newest[0], joint) - position) < tolerance


@pytest.fixture(scope="module")
def robot():
    return Robot()


def slider_of(page, limb, label):
    """Find a slider on the tab of its limb."""
    page.open_tab("Robot")
    page.open_tab(limb)
    page.element(label).wait_for()
    return page.slider(label)


def take(page, pose):
    """Press the button of a pose."""
    page.open_tab("Robot")
    page.press(pose)


@pytest.fixture
def zero(page, robot):
    """Let the robot stand with straight joints, and give its slider of the knee."""
    slider = slider_of(page, "Left leg", "left_knee")
    robot.command(**{KNEE: 0.5})  # so that the slider shows what is drawn
    page.wait_for(lambda: slider.value() == 0.5, "the slider")
    take(page, "zero")
    page.wait_for(lambda: robot.is_at(KNEE, 0.0), "the pose")
    page.wait_for(lambda: slider.value() == 0.0, "the slider at zero")
    return slider


def is_dark(picture):
    """Mark the pixels that are dark as only the robot is."""
    return picture.max(axis=2) < 90


def shows_robot(page):
    return is_dark(page.scene()).mean() > 0.005


def test_the_anchor_is_shown_and_chosen(address):
    """Before other tests open the page: it looks once, when it is opened."""
    get = service("/gazebo/get_anchor", GetAnchor)
    assert service("/set_anchor", SetAnchor)(link_name=LEFT_FOOT).success
    with PageClient(address) as client:
        client.wait_for(lambda: client.value("Anchor") == LEFT_FOOT, "the anchor")
        for chosen, anchor in (("lowest_foot", "lowest_foot"), ("none", "")):
            client.set("Anchor", chosen)
            wait_for(lambda: get("g1_robot").link_name == anchor, chosen)  # noqa: B023


def test_the_robot_is_seen_and_hidden(page):
    page.wait_for(lambda: shows_robot(page), "the robot")
    page.open_tab("View")
    page.check("Visual shapes", False)
    page.wait_for(lambda: not shows_robot(page), "an empty floor")
    page.check("Visual shapes")
    page.wait_for(lambda: shows_robot(page), "the robot again")


def test_sliders_move_the_robot_and_follow_it(page, robot, zero):
    before = page.still()
    zero.drag(1.2)
    page.wait_for(lambda: robot.is_at(KNEE, 1.2, 0.1), "the dragged knee")
    page.wait_for(lambda: share_changed(before, page.scene()) > 0.005, "a bent knee")
    page.wait_for(lambda: robot.is_at(KNEE, zero.value()), "the slider's value")
    # Again, should an update of the robot have come between.
    page.wait_for(lambda: zero.type(0.7) or robot.is_at(KNEE, 0.7), "the typed value")
    assert zero.value() == 0.7
    robot.command(**{KNEE: 0.3})
    page.wait_for(lambda: zero.value() == 0.3, "the slider")
    assert float(zero.shown()) == 0.3


def test_a_hand_is_dragged_and_the_feet_stay(address, robot):
    robot.command(**{KNEE: 0.0})  # both feet are to be on the floor
    wait_for(lambda: robot.is_at(KNEE, 0.0), "straight knees")
    model, states = g1_description.Robot(), Connected("/robot_state", RobotState)

    def places():
        wait_for(lambda: states.messages, "a state")
        state = states.messages[-1]
        positions = dict(zip(state.name, state.position))
        place = robot_state_from_message(state).base_pose
        return model.link_poses(positions, place)

    before = places()
    hand = before["left_rubber_hand"]
    goal = hand[:3] + np.array([0.1, 0.05, 0.1])

    def is_at(place):
        return np.allclose(places()["left_rubber_hand"][:3], place, atol=1e-3)

    with PageClient(address) as client:
        client.set("Gizmos", True)
        client.wait_until_whole()
        (name,) = (n for n in list(client.nodes) if n.endswith("/left_hand"))
        # Gizmos are at the centres of mass of their links.
        inertials = {link.name: link.inertial for link in model.description.links}
        center = inertials["left_rubber_hand"].center_of_mass
        place = (goal + Rotation.from_quat(hand[3:]).apply(center)).tolist()
        turn = hand[[6, 3, 4, 5]].tolist()
        client.send(
            "TransformControlsUpdateMessage",
            name=name,
            wxyz=tuple(turn),
            position=tuple(place),
            owner="",
        )
        wait_for(lambda: is_at(goal), "the hand where it was dragged")
        after = places()
        for foot in (LEFT_FOOT, "right_ankle_roll_link"):
            np.testing.assert_allclose(after[foot], before[foot], rtol=0, atol=1e-3)
        client.set("Change", "Undo")
        wait_for(lambda: is_at(hand[:3]), "the hand where it was")
        client.set("Gizmos", False)
    states.close()


def test_the_simulator_pauses_steps_and_goes_on(address):
    # Not of /clock: its last messages may be under way.
    world = rospy.ServiceProxy("/gazebo/get_world_properties", GetWorldProperties)
    with PageClient(address) as client:
        client.set("Gantry", True)
        refusal = "nothing falls in kinematic physics"
        client.wait_for(
            lambda: any(refusal in str(e) for e in [*client.elements.values()]), refusal
        )
        client.press("Pause")
        client.wait_for(lambda: client.find("Go on"), "a pause")
        before = world().sim_time
        client.set("Steps", 25)
        client.press("Step")
        done = before + 25 * STEP
        wait_for(lambda: world().sim_time > done - 1e-6, "the steps")
        client.wait_for(
            lambda: any(
                "paused" in str(element.get("_markdown"))
                for element in [*client.elements.values()]
            ),
            "the word",
        )
        client.wait_for(lambda: client.find("Go on"), "the pause again")
        assert world().sim_time == pytest.approx(done, abs=1e-6)
        client.press("Go on")
        wait_for(lambda: world().sim_time > before + 0.5, "time that runs")


def test_a_simulator_without_steps_is_not_the_stand_in():
    is_running = GetPhysicsPropertiesResponse(success=True)
    other = rospy.Service(
        "/other/get_physics_properties", GetPhysicsProperties, lambda _: is_running
    )
    simulators = LiveSimulator("other"), LiveSimulator("gazebo")
    for simulator in simulators:
        simulator.watch(True)
        wait_for(lambda one=simulator: "answer" not in one.status(), "an answer")
    assert [simulator.is_stand_in for simulator in simulators] == [False, True]
    for simulator in simulators:
        simulator.watch(False)
    other.shutdown()


def test_objects_of_the_simulator_come_move_and_go():
    world = LiveScene(LiveSimulator("other"), Event(), ThrottledLog())
    world.watch(True)
    scene, states = (
        rospy.Publisher(f"/other/{name}", kind, queue_size=1, latch=True)
        for name, kind in (("scene", String), ("object_states", LinkStates))
    )
    given = Scene()
    given.box("box", [0.1, 0.2, 0.3], [1, 2, 3], mass=2.0)
    given.plane("wall", [1, 0, 0], [0, 0, 0])
    scene.publish(yaml_of([*given.values()]))
    wait_for(lambda: [*world.shown()[0]] == ["box", "wall"], "two objects")
    look = world.shown()[0]["box"].patches
    pose = np.array([4.0, 5.0, 6.0, 0.0, 0.0, 0.6, 0.8])
    message = LinkStates(name=["box", "unknown"], pose=2 * [pose_from_array(pose)])
    states.publish(message)
    wait_for(lambda: world.shown()[1]["box"][0] == 4.0, "a move")
    np.testing.assert_array_equal(world.shown()[1]["box"], pose)
    np.testing.assert_array_equal(world.scene()["box"].pose, pose)
    scene.publish("<nonsense")
    scene.publish(yaml_of([given["box"]]))
    wait_for(lambda: [*world.shown()[0]] == ["box"], "one object")
    assert world.shown()[0]["box"].patches is look  # so nothing is sent again
    world.watch(False)


def test_objects_of_a_page_are_models_of_the_simulator():
    models = service("/gazebo/get_world_properties", GetWorldProperties)
    description = parse_urdf(rospy.get_param("/robot_description"))
    robot = SimpleNamespace(name="g1_robot", description=description)
    given = LiveSimulator("gazebo"), Event(), ThrottledLog(), [robot]
    world = LiveScene(*given)
    world.watch(True)
    scene, touching = Scene(), ["right_hand"]
    at = [2.0, 3.0, 0.5]
    box = scene.box("page_box", [0.1, 0.1, 0.1], at, may_touch=touching)
    world.add(box)

    def is_at(name, place):
        poses = world.shown()[1]
        return name in poses and np.allclose(poses[name][:3], place)

    wait_for(lambda: is_at("page_box", [2.0, 3.0, 0.5]), "a box")
    world.move("page_box", np.array([1.0, 3.0, 0.5, 0.0, 0.0, 0.0, 1.0]))
    wait_for(lambda: is_at("page_box", [1.0, 3.0, 0.5]), "a move")
    world.change("page_box", replace(box, link=replace(box.link, name="brick")))
    wait_for(lambda: is_at("brick", [1.0, 3.0, 0.5]), "another name")
    assert "page_box" not in world.shown()[0]
    with pytest.raises(G1DescriptionError, match="no link left_hnad"):
        world.attach("brick", "left_hnad")
    world.attach("brick", "left_hand")
    wait_for(lambda: world.carrier("brick") == "left_hand", "a hand that carries it")
    brick = world.scene()["brick"]
    assert [one.link for one in brick.attachments] == ["left_hand"]
    assert (brick.may_touch, brick.link.collisions[0].color) == ({*touching}, COLOR)
    world.attach("brick", "")
    wait_for(lambda: not world.carrier("brick"), "a brick that is let go")
    world.remove("brick")
    wait_for(lambda: not world.shown()[0], "no objects")
    assert {"page_box", "brick"}.isdisjoint(models().model_names)
    world.watch(False)


def test_a_motion_is_opened_played_scrubbed_and_judged(page, robot, tmp_path):
    page.open_tab("Motion")
    with page.raw.expect_file_chooser() as chooser:
        page.press("Open a motion")
    chooser.value.set_files(write_motion(tmp_path / "bend.csv"))
    page.wait_for(lambda: "Findings: bend.csv" in page.text(), "the findings")
    line = page.slider("Time")
    assert line.limits() == (0.0, SECONDS)
    line.type(1.0)
    page.wait_for(lambda: robot.is_at(ELBOW, 0.2), "the moment")
    assert robot.is_at(KNEE, 0.4)
    robot.states.clear()
    page.press("Play")
    # Of all states: the page may be looked at too seldom to meet it there.
    robot.states.wait(
        lambda state: abs(position_of(state, ELBOW) - 0.3) < 0.05,
        "the motion on its way",
    )
    page.wait_for(lambda: line.value() == SECONDS, "the end")
    page.wait_for(lambda: robot.is_at(ELBOW, 0.4), "the last sample")
    page.raw.get_by_role("button", name="Play", exact=True).wait_for()
    found = re.compile(r"^1\.50 s\s+position left_knee")
    page.raw.get_by_role("button", name=found).click()
    page.wait_for(lambda: robot.is_at(ELBOW, 0.3), "the finding")
    page.wait_for(lambda: line.value() == 1.5, "the time line")


def test_a_picture_is_saved(page, tmp_path):
    page.open_tab("View")
    path = page.download(lambda: page.press("Save a picture"), tmp_path)
    assert path.name == "robot.png"
    assert path.read_bytes().startswith(b"\x89PNG")
    pixels = read_picture(path)
    assert pixels.shape[:2] == page.scene().shape[:2]
    assert is_dark(pixels).mean() > 0.005


def test_a_phone_shows_the_robot_and_moves_it(chromium, window, address, robot):
    window.close()  # two pages of the G1 are much for two cores
    phone = chromium.open(address, phone=True, script=browser.JAGGED)
    title = phone.raw.get_by_text("g1_29dof: tap to fold or open", exact=True)
    title.wait_for()
    phone.dismiss()
    view = phone.raw.get_by_role("tab", name="View")
    phone.wait_for(lambda: shows_robot(phone), "the robot")
    slider = slider_of(phone, "Left leg", "left_knee")
    slider.tap()
    middle = sum(slider.limits()) / 2
    phone.wait_for(lambda: robot.is_at(KNEE, middle, 0.1), "the touched slider")
    title.tap()
    phone.wait_for(lambda: not view.is_visible(), "a folded panel")
    title.tap()
    view.wait_for()
    assert phone.problems == []
    phone.close()


def test_the_doctor_takes_the_page_for_a_picture_of_the_robot(address):
    names = doctor.CHECK_NAMES[: doctor.CHECK_NAMES.index("picture") + 1]
    *_, picture = doctor.run_checks("", names)
    assert (picture.name, picture.state) == ("picture", doctor.OK), picture
    assert picture.remark == "/web"
