"""The page in three dimensions in a real browser, opened from disk."""

import sys
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "rostest"))
from scipy.spatial.transform import Rotation
from support import browser

from g1_description import Robot
from g1_description.checks.arrows import force_arrows
from g1_description.checks.report import FileResult
from g1_description.checks.verdict import Verdict
from g1_description.motion.motion import Motion, sample
from g1_description.render.page import motion_page, write_page
from g1_description.render.page_data import motion_data
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.load import read_description
from g1_description.scenes.carried import holds_of, motion_links, object_poses
from g1_description.scenes.scene import Scene

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(bool(browser.missing()), reason=browser.missing()),
]
ROOT = Path(__file__).resolve().parents[2]
WINDOW = (900, 700)
STRANGE = "a' \"b\" <i>&amp; \u00e9\u4e2d </script><script>throw Error('ran')</script>"


@pytest.fixture(scope="module")
def chromium():
    with browser.Browser() as one:
        yield one


@pytest.fixture(scope="module")
def robot():
    return Robot()


@pytest.fixture(scope="module")
def faulty(robot):
    """Give a motion with findings, and its verdict."""
    motion = robot.read_motion(ROOT / "motions" / "faulty.csv")
    return motion, robot.check(motion)


@contextmanager
def opening(chromium, folder):
    """Give what opens a page; in the end it had no errors and made no request."""
    pages, requests = [], []

    def open_page(text, phone=False, name="page.html"):
        file = folder / name
        file.write_bytes(text.encode("utf-8", "backslashreplace"))
        page = chromium.open("about:blank", WINDOW, phone=phone)
        pages.append(page)
        page.raw.route("**/*", lambda route: route.continue_())
        page.raw.on("request", lambda request: requests.append(request.url))
        page.raw.goto(file.as_uri())
        page.wait_for(lambda: page.raw.evaluate(DRAWN), "the robot")
        return page

    yield open_page
    for page in pages:
        assert page.problems == []
        page.close()
    assert len(requests) == len(pages)
    assert all(url.startswith("file://") for url in requests)


@pytest.fixture
def opened(chromium, tmp_path):
    with opening(chromium, tmp_path) as open_page:
        yield open_page


@pytest.fixture(scope="module")
def page(chromium, robot, faulty, tmp_path_factory):
    """Open the page of the motion with findings."""
    with opening(chromium, tmp_path_factory.mktemp("page")) as open_page:
        yield open_page(motion_page(robot.description, *faulty, "faulty.csv"))


DRAWN = "Boolean(viewer.motion && viewer.scene.placed)"
NOW = "viewer.draw(1)"


def shown_time(page):
    return page.raw.evaluate("viewer.time")


def matrices(page, links, time, number=0):
    """Read the matrices with which links of a robot are drawn, shape (n, 4, 4)."""
    read = page.raw.evaluate(
        "([links, time, number]) => { viewer.show(time); viewer.draw(1);"
        " return links.map((link) => viewer.matrix(link, number)); }",
        [links, time, number],
    )
    return np.array(read).reshape(-1, 4, 4).swapaxes(1, 2)


def as_matrices(poses):
    found = np.tile(np.eye(4), (len(poses), 1, 1))
    turns = Rotation.from_quat(poses[:, 3:])
    for column, axis in enumerate(np.eye(3)):
        found[:, :3, column] = turns.apply(axis)
    found[:, :3, 3] = poses[:, :3]
    return found


def compare_poses(page, description, motion, time, number=0):
    """Compare what is drawn with our forward kinematics."""
    now = sample(motion, np.array([time]))
    joints = [joint.name for joint in description.movable_joints]
    rows = now.positions[0][[motion.joint_names.index(name) for name in joints]]
    poses = Kinematics(description).link_poses(now.base_poses[0], rows)
    drawn = matrices(page, [*description.link_names], time, number)
    assert np.abs(drawn - as_matrices(poses)).max() < 1e-4


def test_links_are_drawn_where_they_are(page, robot, faulty):
    motion, _ = faulty
    for time in (0.0, 0.81, 1.7, 2.8, 5.0833, 8.0):
        compare_poses(page, robot.description, motion, time)


def test_objects_are_drawn_where_they_are_and_carried(opened, robot, faulty):
    scene = Scene()
    scene.box("shelf", [0.4, 0.6, 0.03], [0.6, 0.0, 0.7], color=[0.1, 0.2, 0.9])
    scene.sphere("ball", 0.1, [0.3, 0.2, 0.8])
    scene.plane("wall", [-1.0, 0.0, 0.0], [1.0, 0.0, 0.0])
    scene.attach("ball", "left_hand", 1.0, 5.0)
    motion, verdict = faulty
    page = opened(motion_page(robot.description, motion, verdict, "a", scene))
    links = motion_links(robot.description, motion)
    holds = holds_of(scene.values(), robot.description, links)
    for time in (0.0, 0.81, 1.7, 2.8, 5.0833, 8.0):
        matrices(page, [], time)
        read = page.raw.evaluate("viewer.scene.placed[0].slice(-3)")
        drawn = np.array(read).reshape(-1, 4, 4).swapaxes(1, 2)
        poses = object_poses(holds, np.array([time]), links)[0]
        assert np.abs(drawn - as_matrices(poses)).max() < 1e-4


def test_joints_of_all_kinds_move_and_turn_between_samples(opened):
    """With velocities, and axes that are not at the origins of links, as in SDF."""
    random = np.random.default_rng(0)
    tree = read_description(str(ROOT / "test" / "data" / "tree.urdf"))
    moved = [replace(j, joint_origin=random.normal(size=3)) for j in tree.joints]
    tree = replace(tree, joints=tuple(moved))
    names = tuple(joint.name for joint in tree.movable_joints)
    assert {joint.kind for joint in tree.movable_joints} >= {"revolute", "prismatic"}
    bases = random.normal(size=(4, 7))
    bases[:, 3:] /= np.linalg.norm(bases[:, 3:], axis=1, keepdims=True)
    numbers = random.normal(size=(2, 4, len(names)))
    motion = Motion(np.array([0.0, 0.3, 1.0, 1.5]), names, *numbers, bases)
    page = opened(motion_page(tree, motion))
    for time in random.uniform(0.0, 1.5, 5):
        compare_poses(page, tree, motion, float(time))


def test_findings_jump_to_their_worst_time_and_are_marked(page, faulty):
    _, verdict = faulty
    buttons = page.raw.locator(".findings button")
    assert buttons.count() == len(verdict.causes)
    reds = 0
    for number, cause in enumerate(verdict.causes):
        buttons.nth(number).click()
        times = [finding.worst_time for finding in cause]
        assert min(abs(shown_time(page) - time) for time in times) < 1e-9
        page.raw.evaluate(NOW)
        assert "now" in buttons.nth(number).get_attribute("class")
        assert page.raw.locator(".mark").count() >= 1
        if cause[0].check == "self_collision":
            reds += 1
            (label,) = page.raw.locator(".mark").all_inner_texts()
            assert label.endswith(" 29 mm")
            assert red_pixels(page) > 1500
        if cause[0].check == "velocity":
            assert page.raw.locator("#what").input_value().startswith("velocity:")
    assert reds == 1
    page.raw.evaluate("viewer.show(0); viewer.draw(1)")
    assert page.raw.locator(".mark").count() == red_pixels(page) == 0


def red_pixels(page):
    """Count the red pixels of the scene, without labels."""
    page.raw.evaluate(NOW)
    page.raw.add_style_tag(content=".mark { visibility: hidden }")
    pixels = page.picture()[:450, :500].astype(int)
    return int((pixels[..., 0] - pixels[..., 1:].max(axis=-1) > 90).sum())


def test_contact_forces_are_drawn_where_they_act_and_hidden_by_a_button(page, faulty):
    motion, verdict = faulty
    time = float(motion.times[60])
    given = force_arrows(verdict).at(time)
    drawn = page.raw.evaluate("(time) => viewer.motion.arrows(time)", time + 0.004)
    for arrow, one in zip(given, drawn):
        assert one["start"] == pytest.approx(arrow.start.tolist(), abs=1e-6)
        assert one["vector"] == pytest.approx(arrow.vector.tolist(), abs=1e-6)
    assert [one["isMissing"] for one in drawn] == [False, False, True]

    def blue_pixels():
        page.raw.evaluate("(time) => { viewer.show(time); viewer.draw(1); }", time)
        pixels = page.picture()[:450, :500].astype(int)
        return int((pixels[..., 2] - pixels[..., :2].max(axis=-1) > 90).sum())

    assert blue_pixels() > 150
    page.raw.locator("#forces").click()
    assert blue_pixels() == 0
    page.raw.locator("#forces").click()


def test_what_a_motion_was_before_is_drawn_beside_it_until_it_is_hidden(opened, robot):
    before, time = robot.read_motion("squat.csv"), 1.5
    motion = replace(before, positions=0.5 * before.positions)
    page = opened(motion_page(robot.description, motion, before=before, about="a < b"))
    assert page.raw.text_content("pre") == "a < b"
    beside = before.base_poses + np.eye(7)[1]
    compare_poses(page, robot.description, motion, time)
    before = replace(before, base_poses=beside)
    compare_poses(page, robot.description, before, time, 1)
    page.raw.click("#before")
    page.wait_for(lambda: page.raw.evaluate("viewer.scene.placed.length") == 1, "one")


def test_the_page_says_how_much_is_missing(opened, robot):
    times = np.arange(0.0, 1.0, 0.02)
    rows = np.zeros((len(times), len(robot.joint_names)))
    high = np.tile([0.0, 0.0, 1.2, 0.0, 0.0, 0.0, 1.0], (len(times), 1))
    motion = Motion(times, tuple(robot.joint_names), rows, None, high)
    page = opened(motion_page(robot.description, motion, robot.check(motion)))
    page.raw.evaluate("viewer.show(0.5); viewer.draw(1)")
    assert "344 N and 0.0 N m are missing" in page.text()
    assert red_pixels(page) > 100
    page.raw.evaluate("viewer.show(0); viewer.draw(1)")  # accelerations are not known
    assert "are missing" not in page.raw.locator("#scene").inner_text()


def test_a_drag_in_the_plot_moves_the_time_and_it_plays(page):
    box = page.raw.locator("#chart canvas").bounding_box()
    left, right = box["x"] + 58, box["x"] + box["width"] - 12
    y, middle = box["y"] + 0.8 * box["height"], (left + right) / 2
    page.drag((left, y), (middle, y))
    assert shown_time(page) == pytest.approx(4.0, abs=0.05)
    page.drag((middle, y), (right + 300, y))
    assert shown_time(page) == 8.0
    page.raw.locator("#speed").select_option("2")
    page.press("▶")  # from the beginning, as it was at the end
    page.wait_for(lambda: 0.5 < shown_time(page) < 8.0, "the motion")
    page.raw.evaluate("document.activeElement.blur()")
    page.raw.keyboard.press(" ")
    page.wait_for(lambda: not page.raw.evaluate("viewer.playing"), "the pause")
    page.raw.evaluate("viewer.show(1)")
    page.raw.keyboard.press("ArrowRight")
    assert shown_time(page) == pytest.approx(1.02)


def test_the_plot_is_that_of_the_chosen_joint(page, faulty):
    motion, _ = faulty
    column = motion.joint_names.index("left_elbow_joint")
    page.raw.locator("#what").select_option(f"position:{column}")
    drawn = np.array(page.raw.evaluate("[...viewer.chart.values]"))
    assert drawn == pytest.approx(motion.positions[:, column], abs=1e-6)
    page.raw.locator("#what").select_option(f"velocity:{column}")
    drawn = np.array(page.raw.evaluate("[...viewer.chart.values]"))
    rates = np.diff(motion.positions[:, column]) / np.diff(motion.times)
    assert drawn[:-1] == pytest.approx(rates, abs=1e-4)


def test_the_base_and_speeds_of_links_are_plotted(opened, robot):
    times = np.linspace(0.0, 2.0, 81)
    turns = np.stack([np.sin(times), 0.5 * np.cos(times), 5.0 * times])
    bases = np.hstack(
        [
            np.stack([times**2, -times, 0.8 + 0.1 * times], axis=1),
            Rotation.from_euler("xyz", turns.T).as_quat(),
        ]
    )
    elbow = np.sin(3.0 * times)[:, None]
    motion = Motion(times, ("left_elbow_joint",), elbow, base_poses=bases)
    page = opened(motion_page(robot.description, motion))

    def plotted(key):
        page.raw.evaluate(f"viewer.plot('{key}')")
        return np.array(page.raw.evaluate("[...viewer.chart.values]"))

    wanted = np.vstack([bases[:, :3].T, turns])
    for name, line in zip(("x", "y", "z", "roll", "pitch", "yaw"), wanted):
        np.testing.assert_allclose(plotted(f"base:{name}"), line, atol=1e-5)
    poses = robot.link_poses({"left_elbow_joint": elbow[:, 0]}, bases)
    links = page.raw.evaluate("viewer.robot.links.map((link) => link.name)")
    for link in ("pelvis", "left_rubber_hand", "right_ankle_roll_link"):
        velocity = np.gradient(poses[link][:, :3], times, axis=0)
        speed = np.linalg.norm(velocity, axis=1)
        found = plotted(f"speed:{links.index(link)}")
        np.testing.assert_allclose(found, speed, atol=1e-3)
    options = page.raw.evaluate(
        "[...viewer.what.options].map((one) => one.textContent)"
    )
    assert {"yaw of the base", "speed of left_rubber_hand"} < {*options}


def test_strange_names_are_text(opened, robot, faulty):
    motion, verdict = faulty
    verdict = Verdict(STRANGE, verdict.findings, verdict.checked, notes=(STRANGE,))
    name = "x # ?%20 'q' \u00e9.html"
    page = opened(motion_page(robot.description, motion, verdict, STRANGE), name=name)
    assert page.raw.title() == STRANGE
    text = page.text()
    assert text.count("<script>throw Error('ran')</script>") == 3


def test_on_a_phone_findings_are_folded_and_the_robot_has_room(opened, robot, faulty):
    page = opened(motion_page(robot.description, *faulty), phone=True)
    width, height = browser.PHONE
    box = page.raw.locator("#scene canvas").bounding_box()
    assert box["width"] == width and box["height"] > height / 2
    button = page.raw.locator(".findings button").first
    assert not button.is_visible()
    page.raw.locator("h2").tap()
    button.tap()
    assert shown_time(page) > 0.0
    assert page.raw.locator("#scene canvas").bounding_box()["height"] > height / 4
    assert page.raw.evaluate("document.documentElement.scrollWidth") == width


def test_several_files_have_a_table_that_is_sorted(chromium, robot, faulty, tmp_path):
    motion, verdict = faulty
    data = tmp_path / "motion"
    data.write_text(motion_data(robot.description, motion, verdict))
    lengths = {"b": 9.0, "a": 10.0, "d": None, "c": 2.5}
    outcomes = [
        FileResult(name, Verdict("r", figures={} if n is None else {"duration": n}))
        for name, n in lengths.items()
    ]
    outcomes[1] = FileResult("a", verdict)
    motions = [data if outcome.file == "a" else tmp_path / "no" for outcome in outcomes]
    path = tmp_path / "page.html"
    write_page(path, robot.description, outcomes, motions, 0)
    page = chromium.open(path.as_uri(), WINDOW)

    def sorted_by(head):
        page.raw.locator(".files th", has_text=head).click()
        names = page.raw.locator(".files td:first-child").all_inner_texts()
        return "".join(names)

    assert not page.raw.locator("#viewer").is_visible()
    orders = [sorted_by("length"), sorted_by("length"), sorted_by("file")]
    assert orders == ["cabd", "bacd", "abcd"]
    page.raw.locator("a[href='#file1']").click()
    page.wait_for(lambda: page.raw.evaluate(DRAWN), "the robot")
    assert page.raw.locator(".findings button:visible").count() == len(verdict.causes)
    page.raw.locator(".back:visible").click()
    overview = page.raw.locator("#overview")
    page.wait_for(overview.is_visible, "the table")
    page.raw.locator("a[href='#file3']").click()
    assert page.raw.locator("section:visible h2").inner_text() == "c passed"
    assert not page.raw.locator("#viewer").is_visible()
    page.raw.locator(".back:visible").click()
    assert page.raw.locator("#overview").is_visible()
    assert page.problems == []
    page.close()


def test_without_webgl_the_texts_and_plots_are_there(chromium, robot, faulty, tmp_path):
    file = tmp_path / "page.html"
    file.write_text(motion_page(robot.description, *faulty))
    script = "const make = HTMLCanvasElement.prototype.getContext;"
    script += "HTMLCanvasElement.prototype.getContext = function (kind) {"
    script += " return kind === 'webgl2' ? null : make.call(this, kind); };"
    page = chromium.open(file.as_uri(), WINDOW, script=script)
    page.wait_for(lambda: "no WebGL 2" in page.text(), "the sentence")
    page.raw.locator(".findings button").nth(1).click()
    assert shown_time(page) > 0.0
    assert page.problems == []
    page.close()


def test_the_robot_is_drawn_again_after_the_browser_lost_it(opened, robot, faulty):
    page = opened(motion_page(robot.description, *faulty))
    page.raw.evaluate(
        "window.ending = viewer.scene.gl.getExtension('WEBGL_lose_context');"
        "window.before = viewer.scene; ending.loseContext()"
    )
    page.wait_for(lambda: page.raw.evaluate("before.gl.isContextLost()"), "the loss")
    page.raw.evaluate("ending.restoreContext()")
    page.wait_for(lambda: page.raw.evaluate("viewer.scene !== before"), "a new scene")
    page.raw.locator(".findings button").nth(1).click()
    assert red_pixels(page) > 1500
