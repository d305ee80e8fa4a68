"""Which states the command record takes, what ends it, and what it refuses."""

from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rospy", reason="rospy is not installed")
pytest.importorskip("g1_description.msg", reason="the workspace is not sourced")

from g1_description.bridge.recorded_file import Room, room_of
from g1_description.cli import record
from g1_description.cli.recorder import (
    Recorder,
    SeveralModelsError,
    find_model,
)
from g1_description.errors import MotionError, UnknownNameError
from g1_description.robot.state import RobotState

MILLISECOND = 1_000_000
BASE = np.array([0.0, 0.0, 0.8, 0.0, 0.0, 0.0, 1.0])


def state(milliseconds, base=BASE, **joints):
    joints = joints or {"a": 1e-3 * milliseconds}
    stamp = round(milliseconds * MILLISECOND)
    return RobotState(stamp, tuple(joints), np.array([*joints.values()]), None, base)


def recorded(rate, seconds, times, room=(100, False)):
    """Record states at some times in [ms]; give the recorder, and what it took."""
    recorder = Recorder(rate, seconds, lambda names, has_base: Room(*room))
    for time in times:
        recorder.take(state(time))
    return recorder, [1e-6 * state.stamp for state in recorder.states]


@pytest.mark.parametrize(
    ("rate", "times", "taken"),
    [
        (0, [7, 8, 11, 11, 12], [7, 8, 11, 12]),
        (
            50,
            [7, 30, 40, 47, 60, 67],
            [7, 30, 47, 67],
        ),
        (1000, np.array([0, 1.0, 1.9995, 3.0]), [0, 1.0, 1.9995, 3.0]),
    ],
)
def test_the_first_state_that_is_not_before_a_period_is_taken(rate, times, taken):
    recorder, found = recorded(rate, None, times)
    np.testing.assert_allclose(found, taken, atol=1e-9)
    assert not recorder.is_over
    motion, begin = recorder.motion()
    np.testing.assert_allclose(motion.times, 1e-3 * (np.array(taken) - taken[0]))
    np.testing.assert_allclose(motion.positions[:, 0], 1e-3 * np.array(found))
    assert begin == round(taken[0] * MILLISECOND) and motion.velocities is None


def test_it_ends_after_its_seconds():
    recorder, found = recorded(50, 0.04, range(7, 100, 5))
    assert found == pytest.approx([7, 27, 47])
    assert recorder.is_over and recorder.notes == []


@pytest.mark.parametrize(
    ("rate", "times", "room", "taken", "why"),
    [
        (0, [5, 6, 7, 2, 9], (9, False), [5, 6, 7], "0.002 s: time went back."),
        (0, range(9), (4, False), [0, 1, 2, 3], "0.003 s: the file is full."),
        (50, [0, 20, 80, 81], (4, True), [0, 20], "0.020 s: the file is full."),
    ],
)
def test_it_ends_early_with_a_note(rate, times, room, taken, why):
    recorder, found = recorded(rate, None, times, room)
    assert found == pytest.approx(taken) and recorder.is_over
    assert recorder.notes == [f"the recording ends after {why}"]


def test_states_that_lack_joints_or_the_base_are_ignored_and_counted():
    recorder, _ = recorded(0, None, [0])
    for other in (state(1, b=0.0), state(2, base=None), state(3)):
        recorder.take(other)
    motion, _ = recorder.motion()
    assert motion.times.tolist() == [0.0, 0.003]
    assert recorder.notes == ["ignored 2 incomplete states."]


def test_a_robot_without_a_base_is_not_recorded_to_an_npz(tmp_path):
    recorder = Recorder(50, None, lambda *known: room_of(tmp_path / "a.npz", *known))
    recorder.take(state(0, base=None))
    assert recorder.is_over and not recorder.states
    with pytest.raises(MotionError, match="An npz needs base poses"):
        wait_for_first(recorder)


# --- the wait for the first state ---------------------------------------------------


def wait_for_first(recorder, problem=None):
    states = SimpleNamespace(keep_up=int, problem=problem, topic="/nowhere/states")
    record._wait_for_first(recorder, states)


@pytest.mark.parametrize("limit", ["TIMEOUT", "SPAWN_TIMEOUT"])
def test_without_a_state_it_says_why(monkeypatch, limit):
    monkeypatch.setattr(record, limit, -1.0)
    missing = limit == "SPAWN_TIMEOUT" and UnknownNameError("no model 'nobody'")
    recorder, _ = recorded(0, None, [])
    told = "no model 'nobody'" if missing else "on /nowhere/states within -1 s; is a"
    with pytest.raises((UnknownNameError, record.NoAnswerError), match=told):
        wait_for_first(recorder, missing or None)


LINKS = ["ground::link", "one::pelvis", "one::foot", "two::pelvis", "two::foot"]
ROBOT = SimpleNamespace(name="g1", link_names=["pelvis", "foot", "hand"])


def test_the_model_is_the_one_with_the_links_or_that_of_the_namespace():
    assert find_model(LINKS[:4], ROBOT) == "one"
    assert find_model(LINKS, ROBOT, "two") == "two"
    with pytest.raises(SeveralModelsError, match="several match, one, two: choose one"):
        find_model(LINKS, ROBOT, "three")
    with pytest.raises(UnknownNameError, match="'g1' in the simulator; its models: gr"):
        find_model(LINKS[:1], ROBOT)
    with pytest.raises(UnknownNameError, match="its models: none"):
        find_model([], ROBOT)


# --- the command line ---------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["there.csv"], "already exists; use --force to replace it"),
        (["folder.csv", "--force"], "The folder "),
        (["a.txt"], "must end in .csv or .npz or .bag"),
        (["a.csv", "--seconds", "0"], "--seconds: must be"),
    ],
)
def test_a_fault_is_reported_and_writes_nothing(
    tmp_path, monkeypatch, capsys, words, told
):
    (tmp_path / "there.csv").write_text("old")
    (tmp_path / "folder.csv").mkdir()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["record", *words])
    with pytest.raises(SystemExit) as end:
        record.main()
    assert end.value.code == 2
    assert told in capsys.readouterr().err
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "folder.csv",
        "there.csv",
    ]
    assert (tmp_path / "there.csv").read_text() == "old"
