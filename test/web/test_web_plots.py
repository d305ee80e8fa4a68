"""Plots: what quantities are, and what a browser gets of them."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("viser", reason="viser is not installed")

from g1_description import Robot
from g1_description.errors import InvalidValueError
from g1_description.motion.history_chunks import Stretch
from g1_description.motion.motion import Motion
from g1_description.robot.urdf import parse_urdf
from g1_description.web import plots
from g1_description.web.file_world import FileWorld, StillRobot
from g1_description.web.quantities import (
    BASE,
    DISTANCE,
    EFFORT,
    ERROR,
    OF_BASE,
    POSITION,
    SPEED,
    VELOCITY,
    Quantities,
    Quantity,
    motion_stretch,
)
from g1_description.web.server.address import ServerOptions
from g1_description.web.show import Show

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools"))
from web_clients import running

from page_client import PageClient

BALL = '<collision><geometry><sphere radius="{}"/></geometry></collision>'
SLED = f"""
<robot name="sled">
  <link name="base">{BALL.format(0.1)}</link>
  <link name="slide">{BALL.format(0.2)}</link>
  <link name="arm"/>
  <joint name="to_slide" type="prismatic">
    <parent link="base"/><child link="slide"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="9" velocity="9" effort="9"/>
  </joint>
  <joint name="to_arm" type="continuous">
    <parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
    <origin xyz="0 0 1"/>
  </joint>
</robot>
"""


@pytest.fixture(scope="module")
def sled():
    return Quantities(parse_urdf(SLED))


def stretch(n, **arrays):
    """Give a slide and an arm that move, the second not commanded."""
    stamps = np.arange(n) * 10_000_000 + 10**9
    slide = np.linspace(0.5, 1.5, n)
    given = {
        "positions": np.stack([slide, 3.0 * slide], axis=1),
        "commanded": np.stack([slide + 0.25], axis=1),
        **arrays,
    }
    return Stretch(1, stamps, ("to_slide", "to_arm"), ("to_slide",), **given)


def test_joints_are_as_measured_and_commanded(sled):
    efforts = np.random.RandomState(1).normal(size=(11, 2))
    some = stretch(11, velocities=np.zeros((11, 2)), efforts=efforts)
    both = sled.lines(Quantity(POSITION, ("to_slide",)), some)
    np.testing.assert_array_equal(both[0], some.positions[:, 0])
    np.testing.assert_array_equal(both[1], some.positions[:, 0] + 0.25)
    found, commanded = sled.lines(Quantity(EFFORT, ("to_arm",)), some)
    np.testing.assert_array_equal(found, efforts[:, 1])
    assert np.isnan(commanded).all()
    # As it moved: 3 m in 0.1 s, whatever velocities were published.
    found, _ = sled.lines(Quantity(VELOCITY, ("to_arm",)), some)
    np.testing.assert_allclose(found, 30.0, rtol=1e-9)
    np.testing.assert_allclose(
        sled.lines(Quantity(ERROR, ("to_slide",)), some)[0], 0.25, atol=1e-15
    )
    # What nobody knows is left out.
    assert np.isnan(sled.lines(Quantity(ERROR, ("to_arm",)), some)[0]).all()
    for quantity in (
        Quantity(EFFORT, ("to_slide",)),
        Quantity(BASE, ("z",)),
        Quantity(BASE, ("speed",)),
        Quantity(SPEED, ("arm",)),
    ):
        assert np.isnan(sled.lines(quantity, stretch(11))).all()


def test_the_base_is_that_of_scipy_and_turns_on_without_jumps(sled):
    angles = np.stack(
        [np.linspace(-1, 1, 99), np.full(99, 0.3), np.linspace(0, 20, 99)]
    )
    turns = Rotation.from_euler("xyz", angles.T).as_quat()
    poses = np.hstack([np.random.RandomState(2).normal(size=(99, 3)), turns])
    poses[40] = np.nan  # unknown once
    some = stretch(99, base_poses=poses, commanded_bases=poses)
    for row, name in enumerate(OF_BASE[:3]):
        for line in sled.lines(Quantity(BASE, (name,)), some):
            np.testing.assert_array_equal(line, poses[:, row])
    for row, name in enumerate(OF_BASE[3:6]):
        wanted = angles[row].copy()
        wanted[40] = np.nan
        for line in sled.lines(Quantity(BASE, (name,)), some):
            np.testing.assert_allclose(line, wanted, atol=1e-12)


def test_links_have_speeds_and_distances(sled):
    # The slide moves by 1 m in 0.1 s along y, the base by 2 m along x.
    poses = np.zeros((11, 7))
    poses[:, 0], poses[:, 6] = np.linspace(0.0, 2.0, 11), 1.0
    some = stretch(11, base_poses=poses)
    speed, _ = sled.lines(Quantity(SPEED, ("slide",)), some)
    np.testing.assert_allclose(speed, 10.0 * np.sqrt(5.0), rtol=1e-9)
    distance, _ = sled.lines(Quantity(DISTANCE, ("slide", "base")), some)
    np.testing.assert_allclose(distance, some.positions[:, 0] - 0.3, atol=1e-4)
    with pytest.raises(InvalidValueError, match="no distance of slide and arm"):
        sled.lines(Quantity(DISTANCE, ("slide", "arm")), some)


def test_what_is_between_measured_distances_is_interpolated(sled):
    some = stretch(1000)  # 10 s
    distance, _ = sled.lines(Quantity(DISTANCE, ("slide", "base")), some)
    wanted = some.positions[:, 0] - 0.3
    np.testing.assert_allclose(distance[:-5], wanted[:-5], atol=1e-4)


def test_units_are_those_of_the_joint(sled):
    expected = {
        (POSITION, "to_arm"): "rad",
        (VELOCITY, "to_slide"): "m/s",
        (EFFORT, "to_arm"): "N m",
        (EFFORT, "to_slide"): "N",
        (ERROR, "to_slide"): "m",
        (BASE, "yaw"): "rad",
        (BASE, "x"): "m",
        (BASE, "speed"): "m/s",
        (SPEED, "arm"): "m/s",
        (DISTANCE, "arm"): "m",
    }
    for (kind, subject), unit in expected.items():
        assert sled.unit(Quantity(kind, (subject,))) == unit, kind


def test_a_motion_is_as_it_is_played():
    times = np.arange(4500) / 100.0
    motion = Motion(times, ("to_arm",), 2.0 * times[:, None])
    found = motion_stretch(motion)
    np.testing.assert_allclose(found.stamps, 1e9 * times)
    np.testing.assert_array_equal(found.positions, motion.positions)


def test_a_fast_motion_has_its_speed_and_its_turns(sled):
    """A base that sways and turns for ten minutes, at 200 Hz."""
    times = np.arange(120_000) / 200.0
    poses = np.zeros((len(times), 7))
    poses[:, 0] = 0.2 * np.sin(2.0 * np.pi * times)
    poses[:, 5], poses[:, 6] = np.sin(1.5 * times), np.cos(1.5 * times)
    some = Stretch(
        1,
        np.round(1e9 * times).astype(np.int64) + 1,
        ("to_slide", "to_arm"),
        (),
        np.zeros((len(times), 2)),
        base_poses=poses,
    )
    for quantity in (Quantity(SPEED, ("base",)), Quantity(BASE, ("speed",))):
        speed, _ = sled.lines(quantity, some)
        assert np.abs(speed.max() - 0.4 * np.pi) < 1e-3
    yaw, _ = sled.lines(Quantity(BASE, ("yaw",)), some)
    np.testing.assert_allclose(yaw, 3.0 * times, atol=1e-6)


# --- on the page ---


@pytest.fixture(scope="module")
def shown():
    model = Robot()
    still = StillRobot("g1", model.description)
    world = FileWorld([still], None)
    show = Show(world, ServerOptions(port=0), lambda _: model.checker())
    with running(show):
        yield still, show


@pytest.fixture
def browser(shown):
    _, show = shown
    with PageClient(show.address) as one:
        one.wait_until_whole()
        yield one
        one.press("Clear")
        one.wait_for(lambda: not drawn(one), "no plot")


def drawn(client):
    """Return the data of plots by the labels of their lines."""
    return {
        tuple(line["label"] for line in plot["series"]): plot["data"]
        for plot in [*client.elements.values()]
        if plot["type"] == "GuiUplotMessage"
    }


def add(client, kind, of, to=None):
    """Add a line, and wait until it is there."""
    choose(client, kind, of, to)
    label = f"{kind}, {of}" + (f" to {to}" if to else "")
    client.wait_for(lambda: any(label in labels for labels in drawn(client)), label)


def choose(client, kind, of, to=None):
    client.set("Quantity", kind)
    client.wait_for(lambda: of in client.element("Of")["options"], "its subjects")
    client.set("Of", of)
    if to:
        client.set("To", to)
    client.press("Add")


def test_lines_of_the_open_motion_by_unit_with_the_shown_time(shown, browser):
    still, show = shown
    times = np.linspace(0.0, 2.0, 201)
    motion = Motion(times, ("left_elbow_joint",), np.sin(times)[:, None])
    show.page.ui.post("test", lambda: show.page.motion.open("m", still, motion))
    add(browser, POSITION, "left_elbow")
    add(browser, VELOCITY, "left_elbow")
    add(browser, POSITION, "left_knee")
    knee = ("s", "position, left_elbow", "commanded", "position, left_knee")
    knee += "commanded", "shown time"
    speed = ("s", "velocity, left_elbow", "shown time")
    browser.wait_for(
        lambda: (
            {*drawn(browser)} == {knee, speed}
            and all(
                len(columns[0]) == len(times) for columns in drawn(browser).values()
            )
        ),
        "two plots",
    )
    own, elbow, planned, other, _, _ = drawn(browser)[knee]
    np.testing.assert_allclose(own, times, atol=1e-9)
    np.testing.assert_allclose(elbow, np.sin(times), atol=1e-12)
    assert np.isnan(planned).all()
    assert np.isnan(other).all()  # the motion does not have it
    inner = drawn(browser)[speed][1][1:-1]
    np.testing.assert_allclose(inner, np.cos(times[1:-1]), atol=1e-4)

    browser.set(plots.TIME, 1.5)
    player = show.page.motion.player
    browser.wait_for(lambda: player.time == 1.5, "its time")

    def marked():
        return times[np.isfinite(drawn(browser)[speed][-1])].tolist()

    browser.wait_for(lambda: marked() == [1.5, 1.51], "the mark")
    # uPlot is made anew when these change, and its axis of times is lost.
    scales = [
        plot["scales"] for plot in [*browser.elements.values()] if "scales" in plot
    ]
    assert scales == [{"x": {"time": False}}] * 2
    browser.set("Time", 0.25)
    browser.wait_for(lambda: browser.value(plots.TIME) == 0.25, "the other way round")


def test_distances_are_those_of_two_links(shown, browser):
    still, show = shown
    choose(browser, DISTANCE, "left_rubber_hand", "left_rubber_hand")
    browser.wait_for(
        lambda: any("two links" in str(e) for e in [*browser.elements.values()]),
        "a refusal",
    )
    assert not drawn(browser)
    model = Robot()
    rolls = np.linspace(0.0, 1.0, 5)
    motion = Motion(rolls, ("left_shoulder_roll_joint",), rolls[:, None])
    show.page.ui.post("test", lambda: show.page.motion.open("m", still, motion))
    add(browser, DISTANCE, "left_rubber_hand", "right_rubber_hand")
    browser.wait_for(
        lambda: any(
            len(d[0]) == 5 and np.isfinite(d[1]).all() for d in drawn(browser).values()
        ),
        "distances",
    )
    ((_, distances, _),) = drawn(browser).values()
    palms = [
        model.link_poses({"left_shoulder_roll_joint": roll}) for roll in rolls.tolist()
    ]
    apart = [
        np.linalg.norm(one["left_rubber_hand"][:3] - one["right_rubber_hand"][:3])
        for one in palms
    ]
    # Hands are not farther apart than their frames, and not much nearer.
    assert (np.diff(distances) > 0).all()
    assert (distances < apart).all()
    assert (distances > np.array(apart) - 0.3).all()


def test_a_seventh_line_takes_the_place_of_the_first(browser):
    joints = ["left_knee", "right_knee", "left_elbow", "right_elbow", "waist_yaw"]
    for joint in [*joints, "waist_roll", "waist_pitch"]:
        add(browser, POSITION, joint)
    (labels,) = drawn(browser)
    assert "position, left_knee" not in labels
    assert labels.count("commanded") == plots.MAX_CURVES


def test_peaks_stay_when_points_are_left_out():
    times = np.arange(10_000) / 200.0
    flat, wild = np.zeros(10_000), np.random.RandomState(4).normal(size=10_000)
    flat[[17, 9_999]] = 5.0, -3.0
    wild[200:900] = np.nan
    fewer, (one, other) = plots.thinned(times, [flat, wild], 700)
    assert 350 < len(fewer) <= 700
    assert len(one) == len(other) == len(fewer)
    assert (np.diff(fewer) >= 0).all()
    np.testing.assert_array_equal(fewer[[0, -1]], times[[0, -1]])
    assert (one.max(), one.min()) == (5.0, -3.0)
    assert abs(fewer[one.argmax()] - times[17]) < 0.15
    assert (np.nanmax(other), np.nanmin(other)) == (np.nanmax(wild), np.nanmin(wild))
    assert np.isnan(other).sum() in range(40, 55)
    few = plots.thinned(times[:700], [flat[:700]], 700)
    np.testing.assert_array_equal(few[1][0], flat[:700])
