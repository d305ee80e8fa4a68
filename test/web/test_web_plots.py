"""Plots: what quantities are, and what a browser gets of them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("viser", reason="viser is not installed")

from shown_pages import standing_g1

from g1_description.errors import InvalidValueError
from g1_description.motion.history_chunks import Stretch
from g1_description.motion.motion import Motion
from g1_description.robot.urdf import parse_urdf
from g1_description.web import plot_data
from g1_description.web.plot_data import Curve, PlotData
from g1_description.web.plots import TIME
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


# --- curves and their numbers ---


class Sled:
    """A sled with a history."""

    description = parse_urdf(SLED)

    def __init__(self, name, history=None, stamp=0):
        self.name, self.history = name, history
        self.newest = SimpleNamespace(stamp=stamp)

    def state(self):
        return self.newest


SLIDE, ARM = Quantity(POSITION, ("to_slide",)), Quantity(POSITION, ("to_arm",))


def test_curves_are_kept_once_by_unit_and_the_oldest_goes():
    robot, other = Sled("a"), Sled("b")
    data = PlotData([robot])
    for quantity in (SLIDE, ARM, SLIDE):
        data.add(Curve(robot, quantity))
    assert data.by_unit() == {"m": [Curve(robot, SLIDE)], "rad": [Curve(robot, ARM)]}
    assert data.label(Curve(robot, SLIDE)) == "position, to_slide"
    two = PlotData([robot, other])
    assert two.label(Curve(other, SLIDE)) == "b: position, to_slide"
    for name in OF_BASE:
        data.add(Curve(robot, Quantity(BASE, (name,))))
    assert len(data.curves) == plot_data.MAX_CURVES
    assert Curve(robot, SLIDE) not in data.curves


def test_columns_have_common_times_and_a_mark():
    one, other = Sled("one"), Sled("other")
    data = PlotData([one, other])
    curves = [Curve(one, SLIDE), Curve(other, ARM)]
    assert data.end is None
    assert data.columns(curves, None)[0].tolist() == [0.0, 1.0], "nothing is known"
    motions = {
        one: Motion(np.array([0.0, 1.0, 2.0]), ("to_slide",), np.array([[1, 3, 5.0]]).T)
    }
    data.numbers = data.compute(curves, data.of_motions(motions))
    assert data.end == 2.0
    for at, marked in ((1.0, [1, 2]), (1.5, [1, 2]), (9.0, [0, 1]), (None, [0, 1])):
        times, slide, commanded, arm, other_commanded, mark = data.columns(curves, at)
        assert times.tolist() == [0.0, 1.0, 2.0]
        assert slide.tolist() == [1.0, 3.0, 5.0]
        for unknown in (commanded, arm, other_commanded):
            assert np.isnan(unknown).all()
        if at != 1.5:
            assert np.flatnonzero(np.isfinite(mark)).tolist() == marked
    assert mark[0] < 1.0 and mark[1] > 5.0, "the axis has room"


def test_only_new_states_are_requested_of_a_robot_that_goes_on():
    all_states, requests = stretch(1001), []  # 1 s to 11 s

    class History:
        def whole(self, begin=0, end=0, run=0, last=0.0):
            end = end or robot.state().stamp
            begin = begin or end - round(1e9 * last)
            requests.append((begin, end))
            stamps = all_states.stamps
            kept = all_states.rows((stamps >= begin) & (stamps <= end))
            return SimpleNamespace(stretch=kept)

    robot = Sled("r", History(), 5 * 10**9)
    data, curve = PlotData([robot]), Curve(robot, SLIDE)

    def plotted(length):
        answer = data.compute([curve], data.of_history(None, length * 10**9))
        assert answer.problem == ""
        return answer.data[curve][0][[0, -1]].tolist()

    assert plotted(2) == [3.0, 5.0]
    robot.newest.stamp = 6 * 10**9
    assert plotted(2) == [4.0, 6.0]
    assert requests[-1] == (5 * 10**9 + 1, 6 * 10**9)
    assert plotted(3) == [3.0, 6.0], "a longer one is requested again"


def test_a_problem_of_one_robot_leaves_the_curves_of_another():
    def fail(**_):
        raise InvalidValueError("No bridge.")

    bad = Sled("bad", SimpleNamespace(whole=fail))
    good = Sled("good", SimpleNamespace())
    data = PlotData([bad, good])
    sources = {**data.of_history(None, 10**9), good: lambda: stretch(11)}
    curves = [Curve(bad, SLIDE), Curve(good, SLIDE)]
    answer = data.compute(curves, sources)
    assert (answer.problem, [*answer.data]) == ("No bridge.", curves[1:])


def test_peaks_stay_when_points_are_left_out():
    times = np.arange(10_000) / 200.0
    flat, wild = np.zeros(10_000), np.random.RandomState(4).normal(size=10_000)
    flat[[17, 9_999]] = 5.0, -3.0
    wild[200:900] = np.nan
    fewer, (one, other) = plot_data.thinned(times, [flat, wild], 700)
    assert 350 < len(fewer) <= 700
    assert len(one) == len(other) == len(fewer)
    assert (np.diff(fewer) >= 0).all()
    np.testing.assert_array_equal(fewer[[0, -1]], times[[0, -1]])
    assert (one.max(), one.min()) == (5.0, -3.0)
    assert abs(fewer[one.argmax()] - times[17]) < 0.15
    assert (np.nanmax(other), np.nanmin(other)) == (np.nanmax(wild), np.nanmin(wild))
    assert np.isnan(other).sum() in range(40, 55)
    few = plot_data.thinned(times[:700], [flat[:700]], 700)
    np.testing.assert_array_equal(few[1][0], flat[:700])


# --- on the page ---


@pytest.fixture
def browser():
    with PageClient(standing_g1().show.address) as one:
        one.wait_until_whole()
        yield one
        one.press("Clear")
        one.wait_for(lambda: not drawn(one), "no plot")


def open_motion(motion):
    """Open a motion of the robot, as a file would be."""
    page = standing_g1()
    panel = page.show.motion
    page.show.ui.post("test", lambda: panel.open("m", page.robot, motion))
    return panel


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


def test_lines_of_the_open_motion_by_unit_with_the_shown_time(browser):
    times = np.linspace(0.0, 2.0, 201)
    motion = Motion(times, ("left_elbow_joint",), np.sin(times)[:, None])
    panel = open_motion(motion)
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

    browser.set(TIME, 1.5)
    browser.wait_for(lambda: panel.player.time == 1.5, "its time")

    def marked():
        return times[np.isfinite(drawn(browser)[speed][-1])].tolist()

    browser.wait_for(lambda: marked() == [1.5, 1.51], "the mark")
    # uPlot is made anew when these change, and its axis of times is lost.
    scales = [
        plot["scales"] for plot in [*browser.elements.values()] if "scales" in plot
    ]
    assert scales == [{"x": {"time": False}}] * 2
    browser.set("Time", 0.25)
    browser.wait_for(lambda: browser.value(TIME) == 0.25, "the other way round")


def test_distances_are_those_of_two_links(browser):
    choose(browser, DISTANCE, "left_rubber_hand", "left_rubber_hand")
    browser.wait_for(
        lambda: any("two links" in str(e) for e in [*browser.elements.values()]),
        "a refusal",
    )
    assert not drawn(browser)
    model = standing_g1().model
    rolls = np.linspace(0.0, 1.0, 5)
    motion = Motion(rolls, ("left_shoulder_roll_joint",), rolls[:, None])
    open_motion(motion)
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
