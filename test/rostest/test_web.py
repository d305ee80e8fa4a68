"""The robot of the simulator in a real browser: seen, moved, played, on a phone too."""

import os
import re
import shlex
import shutil
import signal
import subprocess
import tempfile
import threading
import unittest
from pathlib import Path

import numpy as np
import rospy
import yaml
from gazebo_msgs.srv import GetWorldProperties
from sensor_msgs.msg import JointState
from std_srvs.srv import Empty
from support import browser
from support.pictures import read_picture, share_changed
from support.ros_testing import (
    DEADLINE,
    REPOSITORY,
    SHARED,
    Connected,
    position_of,
    program,
    wait_for,
)

from page_client import PageClient

WINDOW = (800, 640)
SHARP = "?fixedDpr=1"
"""However slowly pictures come, they are as fine as others: they can be compared."""
KNEE, ELBOW = "left_knee_joint", "left_elbow_joint"
WHITE = 50
"""Pixels of a name that are white, at least, and of others at most."""
LEG, ARM = "Left leg", "Left arm"
SECONDS = 4.0
"""Length of the motion that the tests make, in [s]."""
BEYOND = 9.0
"""Where its knee is at 3 s, in [rad]: no knee goes there."""
RED = (217, 13, 13)
"""Colour of links that collide."""
ARM_IN_TORSO = {"right_shoulder_roll_joint": 0.4, "right_shoulder_yaw_joint": 0.8}
MOTION = SHARED / "data" / "motions" / "B_HandsUp.csv"


class Command:
    """A program that opens a page, and the address that it tells."""

    def __init__(self, *arguments, home=None):
        command = arguments if home else [program("web"), *arguments]
        self._process = subprocess.Popen(
            command,
            env={**os.environ, **({"ROS_HOME": str(home)} if home else {})},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        self._told, found = [], None
        for line in self._process.stdout:
            self._told.append(line.decode())
            found = re.search(r"open (http://\S+)", self._told[-1])
            if found:
                break
        if found is None:
            raise AssertionError("".join(self._told) or "the command said nothing")
        self.address = found.group(1)
        threading.Thread(target=self._drain, daemon=True).start()

    def _drain(self):
        """Read on: who cannot write stops."""
        self._told += [line.decode() for line in self._process.stdout]

    def __enter__(self):
        """Give itself."""
        return self

    def __exit__(self, *_):
        """End it."""
        self.close()

    def close(self):
        self._process.send_signal(signal.SIGINT)
        self._process.wait(DEADLINE)


def write_motion(path):
    """Write a motion with times: the left knee bends, once too far."""
    rows = ["time,left_knee_joint,left_elbow_joint"]
    for number in range(41):
        time = SECONDS * number / 40
        knee = BEYOND if time == 3.0 else 0.4 * time
        rows.append(f"{time},{knee},{0.1 * time}")
    path.write_text("\n".join(rows) + "\n")
    return path


def shows_robot(page):
    """Whether so much is dark as only the robot is."""
    return (page.scene().max(axis=2) < 90).mean() > 0.005


@unittest.skipIf(browser.missing(), browser.missing())
class TestWeb(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = Path(tempfile.mkdtemp(prefix="test_web_"))
        cls.addClassCleanup(shutil.rmtree, str(cls.folder))
        pictures = rospy.get_param("~pictures", "")
        cls.pictures = Path(pictures) if pictures else None
        cls.states = Connected("/joint_states", JointState)
        launch = "roslaunch --wait g1_description web.launch port:=0 ghost:=true"
        cls.server = Command(*launch.split(), home=cls.folder)
        cls.addClassCleanup(cls.server.close)
        cls.commands = rospy.Publisher("/joint_commands", JointState, queue_size=10)
        wait_for(cls.commands.get_num_connections, "the bridge")
        cls.chromium = browser.Browser()
        cls.addClassCleanup(cls.chromium.close)
        cls.page = cls.chromium.open(
            cls.server.address + SHARP, WINDOW, script=browser.JAGGED
        )
        cls.page.wait_for(lambda: "Robot" in cls.page.text(), "the panel")
        cls.page.dismiss()

    def setUp(self):
        self.states.clear()

    def keep(self, page, name):
        """Write what a window shows, if somebody wants to see it."""
        if self.pictures is not None:
            page.save_picture(self.pictures / f"{name}.png")

    def command(self, **positions):
        self.commands.publish(
            JointState(name=[*positions], position=[*positions.values()])
        )

    def wait_at(self, joint, position, tolerance=1e-3):
        self.page.wait_for(
            lambda: self.is_at(joint, position, tolerance), f"{joint} at {position}"
        )

    def now(self):
        """Give states that came after this was called."""
        self.states.clear()
        wait_for(lambda: len(self.states.messages) > 10, "more states")
        return self.states.messages

    def is_at(self, joint, position, tolerance=1e-3):
        newest = self.states.messages[-1:]
        return newest and abs(position_of(newest[0], joint) - position) < tolerance

    def slider(self, folder, label, page=None):
        """Find a slider, in a folder that is opened if it is closed."""
        page = page or self.page
        page.open_tab("Robot")
        page.raw.get_by_text(folder, exact=True).wait_for()
        if not page.element(label).is_visible():
            page.toggle_folder(folder)
        page.element(label).wait_for()
        return page.slider(label)

    def take(self, pose):
        """Press the button of a pose."""
        self.page.open_tab("Robot")
        self.page.raw.get_by_text(pose, exact=True).click()

    def open_motion(self):
        """Open the motion of the tests, unless it is open already."""
        page = self.page
        page.open_tab("Motion")
        if "bend.csv" not in page.text():
            file = write_motion(self.folder / "bend.csv")
            page.raw.locator("input[type=file]").set_input_files(str(file))
        page.wait_for(lambda: "Findings: bend.csv" in page.text(), "the findings")

    # --- the robot ---

    def test_the_robot_is_seen_and_hidden(self):
        page = self.page
        page.wait_for(lambda: shows_robot(page), "the robot")
        self.keep(page, "page")
        page.open_tab("View")
        page.check("Visual shapes", False)
        page.wait_for(lambda: not shows_robot(page), "an empty floor")
        page.check("Visual shapes")
        page.wait_for(lambda: shows_robot(page), "the robot again")

    def test_a_link_is_named_where_the_mouse_rests(self):
        page = self.page
        slider = self.slider(LEG, "left_knee")
        self.command(**{KNEE: 0.5})  # so that the slider shows what is drawn
        page.wait_for(lambda: slider.value() == 0.5, "the slider")
        self.take("zero")
        page.wait_for(lambda: slider.value() == 0.0, "the slider at zero")
        toasts = page.raw.locator(".g1-toast")
        page.wait_for(lambda: not toasts.count(), "a picture without messages")
        before = page.still()
        dark = np.argwhere(before.max(axis=2) < 90)
        off = np.abs(dark - np.median(dark, axis=0)).sum(axis=1)
        row, column = dark[off.argmin()].tolist()
        corner = page.canvas().bounding_box()
        x, y = corner["x"] + column, corner["y"] + row

        def light():
            """Count the pixels near the mouse that are white where the robot was."""
            is_light = ((page.scene() > 230) & (before < 200)).all(axis=2)
            return is_light[row - 40 : row + 40, column - 60 : column + 60].sum()

        def is_named():
            page.raw.mouse.move(0, 0)  # or the name would not come twice
            page.raw.mouse.move(x, y)
            page.raw.wait_for_timeout(500)
            return light() > WHITE

        page.wait_for(is_named, "the name on white")
        self.keep(page, "named")
        page.wait_for(lambda: light() < WHITE, "no name any more")
        page.raw.mouse.move(0, 0)

    def test_a_slider_moves_the_robot(self):
        slider = self.slider(LEG, "left_knee")
        before = self.page.still()
        slider.drag(1.2)
        self.wait_at(KNEE, 1.2, 0.1)
        self.page.wait_for(
            lambda: share_changed(before, self.page.scene()) > 0.005, "a bent knee"
        )
        self.wait_at(KNEE, slider.value())
        slider.type(0.7)
        self.wait_at(KNEE, 0.7)
        self.assertEqual(slider.value(), 0.7)

    def test_numbers_count_when_they_are_typed_to_the_end(self):
        slider = self.slider(ARM, "left_elbow")
        self.command(**{ELBOW: 0.2})
        self.page.wait_for(lambda: slider.value() == 0.2, "the slider")
        self.states.clear()
        for text, position in (("-0.05", -0.05), ("1.05", 1.05), ("-0.5", -0.5)):
            slider.type_keys(text, "Enter")
            self.wait_at(ELBOW, position)
            self.page.wait_for(lambda p=position: slider.value() == p, "the slider")
        been = {round(position_of(m, ELBOW), 6) for m in self.states.messages}
        self.assertLessEqual(been, {0.2, -0.05, 1.05, -0.5})
        for text in ("knee", "-", "1e-3", "0x1", "0,5"):
            slider.type_keys(text, "Tab")
            self.assertEqual(slider.shown(), "-0.5", text)
        for keys in (("", "Delete"), ("0.3", "Escape")):
            slider.type_keys(*keys, "Tab")
            self.assertEqual(slider.shown(), "-0.5", keys)
        self.assertEqual({round(position_of(m, ELBOW), 6) for m in self.now()}, {-0.5})

    def test_what_is_typed_is_not_mixed_with_where_the_robot_is(self):
        slider = self.slider(ARM, "left_elbow")
        self.command(**{ELBOW: 0.2})
        self.page.wait_for(lambda: slider.value() == 0.2, "the slider")
        slider.type_keys("-0")
        self.command(**{ELBOW: 0.7})
        self.page.wait_for(lambda: slider.value() == 0.7, "the slider elsewhere")
        self.page.raw.evaluate(
            "addEventListener('pointerdown', () => { window.pressed = true }, true)"
        )
        corner = self.page.canvas().bounding_box()
        self.page.raw.mouse.move(corner["x"] + 5, corner["y"] + 5)
        self.page.wait_for(
            lambda: self.page.raw.evaluate("window.pressed"), "a mouse that rests"
        )
        self.assertEqual(slider.shown(), "-0")
        self.page.raw.keyboard.type(".25")
        self.page.raw.keyboard.press("Enter")
        self.wait_at(ELBOW, -0.25)

    def test_fields_are_left_as_people_leave_them(self):
        page = self.page
        page.open_tab("Robot")
        page.toggle_folder("Base")
        self.addCleanup(page.toggle_folder, "Base")
        fields = page.element("x y z").locator("input")
        fields.nth(2).wait_for()
        before = [fields.nth(n).input_value() for n in range(3)]
        fields.nth(0).click(click_count=3)
        for text in ("0.5", "-0.25", "1.5"):
            page.raw.keyboard.type(text)
            page.raw.keyboard.press("Tab")
        page.wait_for(
            lambda: (
                [fields.nth(n).input_value() for n in range(3)]
                == ["0.5", "-0.25", "1.5"]
            ),
            "what was typed",
        )
        with PageClient(self.server.address) as client:
            client.wait_for(
                lambda: client.value("x y z") == [0.5, -0.25, 1.5], "the base"
            )
            fields.nth(0).click(click_count=3)
            page.raw.keyboard.type("0")
            page.field("Name").click()
            page.raw.keyboard.type("pose_1")
            self.assertEqual(page.field("Name").input_value(), "pose_1")
            client.wait_for(lambda: client.value("x y z")[0] == 0.0, "the base again")
        page.type_into("Name", "")
        for number, text in enumerate(before):
            page.raw.keyboard.press("Escape")
            fields.nth(number).click(click_count=3)
            page.raw.keyboard.type(text)
            page.raw.keyboard.press("Enter")

    def test_a_typed_number_is_stepped(self):
        self.page.open_tab("Robot")
        field = self.page.field("Seconds")
        self.addCleanup(self.page.type_into, "Seconds", 0)
        field.click(click_count=3)
        self.page.raw.keyboard.type("5")
        self.page.element("Seconds").locator("button").first.click()
        self.page.wait_for(lambda: field.input_value() == "5.1", "a step on from it")

    def test_a_command_moves_the_slider(self):
        slider = self.slider(ARM, "left_elbow")
        for position in (0.8, -0.3):
            self.command(**{ELBOW: position})
            self.page.wait_for(lambda p=position: slider.value() == p, "the slider")
            self.assertEqual(float(slider.shown()), position)

    def test_poses_are_taken_and_saved(self):
        page = self.page
        slider = self.slider(LEG, "left_knee")
        slider.type(0.3)
        self.wait_at(KNEE, 0.3)  # else nobody sees when the next pose is taken
        self.take("zero")
        self.wait_at(KNEE, 0.0)
        self.page.wait_for(lambda: slider.value() == 0.0, "the slider")
        self.command(**{KNEE: 1.5})  # so that the slider shows what the node knows
        self.page.wait_for(lambda: slider.value() == 1.5, "the slider")
        page.type_into("Name", "knee_up")
        page.press("Save pose")
        file = self.folder / "g1_description" / "poses.yaml"
        page.wait_for(file.exists, "the file of poses")
        self.assertEqual(yaml.safe_load(file.read_text())["knee_up"][KNEE], 1.5)
        self.take("zero")
        self.wait_at(KNEE, 0.0)
        self.take("knee_up")
        self.wait_at(KNEE, 1.5)
        page.wait_for(lambda: slider.value() == 1.5, "the slider")

    def test_links_that_collide_are_red(self):
        with PageClient(self.server.address) as client:
            client.wait_until_whole()

            def red():
                return {
                    name.split("/")[-2]
                    for name, node in list(client.nodes.items())
                    if "/visual_" in name and tuple(node["color"]) == RED
                }

            self.assertEqual(red(), set())
            before = self.page.scene()
            self.command(**ARM_IN_TORSO)
            client.wait_for(red, "red links")
            self.assertIn("torso_link", red())
            self.page.wait_for(
                lambda: is_red(self.page.scene()).sum() > is_red(before).sum() + 500,
                "red in the picture",
            )
            self.keep(self.page, "collision")
            self.take("zero")
            client.wait_for(lambda: not red(), "links in their own colours")

    # --- the simulator ---

    def test_the_simulator_pauses_steps_and_goes_on(self):
        page = self.page
        page.toggle_folder("Simulator")
        self.addCleanup(page.toggle_folder, "Simulator")
        page.press("Pause")
        self.addCleanup(rospy.ServiceProxy("/gazebo/unpause_physics", Empty))
        page.raw.get_by_role("button", name="Go on").wait_for()
        # Not of /clock: its last messages may be under way.
        world = rospy.ServiceProxy("/gazebo/get_world_properties", GetWorldProperties)
        before = world().sim_time
        page.type_into("Steps", 250)
        page.press("Step")
        done = before + 0.25
        page.wait_for(lambda: world().sim_time > done - 1e-6, "the steps")
        page.raw.get_by_text("paused").wait_for()
        page.raw.get_by_role("button", name="Go on").wait_for()
        self.assertAlmostEqual(world().sim_time, done, 6)
        page.press("Go on")
        page.wait_for(lambda: world().sim_time > before + 0.5, "time that runs")

    # --- motions ---

    def test_a_motion_plays_and_is_scrubbed(self):
        page = self.page
        self.open_motion()
        line = page.slider("Time")
        self.assertEqual(line.limits(), (0.0, SECONDS))
        line.type(2.0)
        self.wait_at(ELBOW, 0.2)
        self.wait_at(KNEE, 0.8)
        self.states.clear()
        page.press("Play")
        # Of all states: the page may be looked at too seldom to meet it there.
        self.states.wait(
            lambda state: abs(position_of(state, ELBOW) - 0.3) < 0.05,
            "the motion on its way",
        )
        page.wait_for(lambda: line.value() == SECONDS, "the end")
        self.wait_at(ELBOW, 0.4)
        page.raw.get_by_role("button", name="Play", exact=True).wait_for()
        self.keep(page, "motion")

    def test_a_finding_is_shown_and_clicked(self):
        page = self.page
        self.open_motion()
        page.slider("Time").type(1.0)
        self.wait_at(ELBOW, 0.1)
        found = page.raw.get_by_role(
            "button", name=re.compile(r"^3\.00 s\s+position left_knee")
        )
        found.click()
        self.wait_at(ELBOW, 0.3)
        page.wait_for(lambda: page.slider("Time").value() == 3.0, "the time line")

    def test_a_file_is_dropped_and_another_refused(self):
        page = self.page
        page.open_tab("Motion")
        broken = self.folder / "broken.csv"
        broken.write_text("time,left_knee_joint\n0,none\n")
        page.drop_file(broken)
        page.raw.locator(".g1-failed").first.wait_for()
        self.assertIn("'none'", page.raw.locator(".g1-failed").first.inner_text())
        file = write_motion(self.folder / "dropped.csv")
        if MOTION.exists():
            file = MOTION
        page.drop_file(file)
        page.wait_for(lambda: f"Findings: {file.name}" in page.text(), "the motion")

    # --- what is taken along ---

    def test_the_configuration_is_copied(self):
        page = self.page
        slider = self.slider(LEG, "left_knee")
        slider.type(0.2)
        self.wait_at(KNEE, 0.2)
        self.command(**{KNEE: 0.6})
        page.wait_for(lambda: slider.value() == 0.6, "the slider")
        page.open_tab("View")
        page.press("Copy as YAML")
        page.wait_for(lambda: page.clipboard().startswith("copied:"), "the YAML")
        pose = yaml.safe_load(page.clipboard())["copied"]
        self.assertEqual((pose[KNEE], len(pose)), (0.6, 29))
        page.press("Copy rostopic pub")
        page.wait_for(lambda: "rostopic pub" in page.clipboard(), "the command")
        words = shlex.split(page.clipboard())
        self.assertEqual(words[3:5], ["/joint_commands", "sensor_msgs/JointState"])
        self.assertEqual(dict(zip(*yaml.safe_load(words[5]).values())), pose)

    def test_a_picture_is_saved(self):
        page = self.page
        page.open_tab("View")
        path = page.download(lambda: page.press("Save a picture"), self.folder)
        self.assertEqual(path.name, "robot.png")
        self.assertTrue(path.read_bytes().startswith(b"\x89PNG"))
        pixels = read_picture(path)
        self.assertEqual(pixels.shape[:2], page.scene().shape[:2])
        self.assertGreater((pixels.max(axis=2) < 90).mean(), 0.005, "dark parts")

    def test_plots_show_a_joint(self):
        page = self.page
        page.open_tab("Plots")
        page.choose("Joint", "left_knee")
        page.press("Add")
        page.raw.locator(".uplot canvas").wait_for()
        self.assertIn("commanded", page.text())
        self.keep(page, "plot")
        page.press("Clear")
        page.raw.locator(".uplot").wait_for(state="detached")

    # --- others ---

    def test_whoever_misbehaves_or_vanishes_disturbs_nobody(self):
        garbage, vanishing = (PageClient(self.server.address) for _ in range(2))
        garbage.send("GuiUpdateMessage", uuid="none", updates={"value": "x" * 1000})
        garbage.send_bytes(b"\xc1 this is no message")
        vanishing.vanish()
        garbage.wait_for(lambda: garbage.has_ended, "its end")
        slider = self.slider(LEG, "left_knee")
        for position in (0.9, 0.1):
            slider.type(position)
            self.wait_at(KNEE, position)
        garbage.close()

    def test_a_phone_shows_the_robot_and_moves_it(self):
        phone = self.chromium.open(
            self.server.address, phone=True, script=browser.JAGGED
        )
        self.addCleanup(phone.close)
        phone.wait_for(lambda: "Robot" in phone.text(), "the panel")
        phone.dismiss()
        phone.wait_for(lambda: shows_robot(phone), "the robot")
        self.keep(phone, "phone")
        slider = self.slider(LEG, "left_knee", phone)
        slider.tap()
        middle = sum(slider.limits()) / 2
        phone.wait_for(lambda: self.is_at(KNEE, middle, 0.1), "the touched slider")
        title = phone.raw.get_by_text("g1_29dof", exact=True)
        title.tap()
        phone.wait_for(
            lambda: not phone.raw.get_by_role("tab", name="View").is_visible(),
            "a folded panel",
        )
        self.keep(phone, "phone_folded")
        title.tap()
        phone.raw.get_by_role("tab", name="View").wait_for()
        self.assertEqual(phone.problems, [])

    def test_others_need_the_token(self):
        # A small robot: two pages of the G1 are much for two cores.
        robot = str(REPOSITORY / "test" / "data" / "revolute.urdf")
        arguments = "--model", robot, "--host", "0.0.0.0", "--port", "0"
        with Command(*arguments) as command:
            address, _, token = command.address.partition("?token=")
            self.assertTrue(token)
            window = self.chromium.open(address, (400, 300))
            self.addCleanup(window.close)
            self.assertIn("wants the token", window.text())
            self.assertNotIn(token, window.raw.content())
            window.raw.goto(command.address)
            window.wait_for(lambda: "Poses" in window.text(), "the page")
            window.raw.goto(address)
            window.wait_for(lambda: "Poses" in window.text(), "who was let in once")

    def test_zz_nothing_was_wrong_with_the_page(self):
        self.assertEqual(self.page.problems, [])


def is_red(picture):
    """Mark the pixels of links that collide."""
    red, green, blue = np.moveaxis(picture.astype(int), 2, 0)
    return (red > 110) & (green < 0.4 * red) & (blue < 0.4 * red)
