"""The history of a robot: what comes back is what went in, within its bounds."""

import functools
import time
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from g1_description.motion.history import History, gaps_text
from g1_description.motion.history_chunks import MAX_COMMANDS, SIZE, Command, joined
from g1_description.robot.state import RobotState

PERIOD = 5_000_000
"""At 200 Hz, in [ns]."""

NAMES = ("hip", "knee", "ankle")
SINGLE = ("velocities", "base_twist", "efforts")
"""What is kept as float32."""


def state_at(stamp, rng, names=NAMES, **fields):
    """Make up a state with numbers of all sizes."""
    return RobotState(
        stamp,
        names,
        rng.normal(size=len(names)) * 10.0 ** rng.integers(-300, 9),
        rng.normal(size=len(names)).astype(np.float32).astype(float),
        rng.normal(size=7),
        rng.normal(size=6).astype(np.float32).astype(float),
        **fields,
    )


def filled(states, seconds=600.0, **limits):
    """Return a history that has packed these states."""
    history = History(seconds, **limits)
    for state in states:
        history.add(state)
        history.pack()
    return history


@functools.lru_cache(maxsize=None)
def of_600_ns():
    """Return a history with a state in each of 600 ns."""
    rng = np.random.default_rng(0)
    return filled(state_at(1 + n, rng) for n in range(600))


def same(one, other):
    """Tell whether two states are equal, bit by bit."""
    for field in fields(RobotState):
        a, b = getattr(one, field.name), getattr(other, field.name)
        if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
            if a.tobytes() != b.tobytes():
                return False
        elif a is not b and not (field.type != "np.ndarray | None" and a == b):
            return False
    return True


def all_of(history, run=0):
    """Return all states of a run."""
    return history.stretch(0, 1 << 62, run=run).states()


@settings(max_examples=40)
@given(st.integers(0, 3 * SIZE + 5), st.integers(0, 1 << 30), st.data())
def test_each_state_comes_back_bit_by_bit(count, seed, data):
    rng = np.random.default_rng(seed)
    known = data.draw(
        st.lists(st.sampled_from(("velocities", "base_pose", "base_twist")))
    )
    states = []
    for number in range(count + 1):
        state = state_at(1 + number * PERIOD, rng)
        if number % 3:
            state = replace(state, **dict.fromkeys(known))
        if number % 4 == 1:
            state = replace(
                state,
                commanded=dict(zip(NAMES[: 1 + number % 3], rng.normal(size=3))),
                commanded_base=rng.normal(size=7),
            )
        states.append(state)
    back = all_of(filled(states))
    assert len(back) == len(states)
    assert all(map(same, back, states))


def test_numbers_that_float32_lacks_are_rounded_only_there():
    rng = np.random.default_rng(1)
    states = [
        replace(
            state_at(1 + n, rng),
            velocities=rng.normal(size=3),
            base_twist=rng.normal(size=6),
            efforts=rng.normal(size=3),
        )
        for n in range(3 * SIZE)
    ]
    for back, state in zip(all_of(filled(states)), states):
        for name in SINGLE:
            rounded = getattr(state, name).astype(np.float32)
            assert (getattr(back, name) == rounded).all()
        assert same(
            replace(back, **dict.fromkeys(SINGLE)),
            replace(state, **dict.fromkeys(SINGLE)),
        )


def test_a_robot_without_joints_and_without_base_comes_back():
    states = [RobotState(1 + n, (), np.zeros(0)) for n in range(3 * SIZE)]
    back = all_of(filled(states))
    assert [state.stamp for state in back] == [state.stamp for state in states]
    assert back[0].base_pose is None and back[0].velocities is None


@given(st.lists(st.integers(0, 20), min_size=1, max_size=60), st.integers(0, 25))
def test_one_time_gives_the_last_state_that_is_not_later(steps, time):
    rng = np.random.default_rng(0)
    stamps = sorted({*steps})
    history = filled(state_at(stamp, rng) for stamp in stamps)
    found = history.stretch(time, time)
    before = [stamp for stamp in stamps if stamp <= time]
    assert (found and found.stamps.tolist()) == (before[-1:] or None)


@given(st.integers(0, 700), st.integers(0, 700), st.integers(0, 40), st.integers(0, 9))
def test_a_stretch_is_thinned_evenly_and_limited(begin, length, most, limit):
    end = begin + length + 1
    found = of_600_ns().stretch(begin, end, most, limit)
    inside = [n for n in range(1, 601) if begin <= n <= end]
    if not inside:
        assert found is None
        return
    stamps = found.stamps.tolist()
    count = min(len(inside), most) if most else len(inside)
    assert len(stamps) == (min(count, limit) if limit else count)
    assert stamps[0] == inside[0]
    if not limit:
        assert most == 1 or stamps[-1] == inside[-1]
        gaps = np.diff(stamps)
        assert not len(gaps) or np.ptp(gaps) <= 1


def test_older_chunks_go_when_the_time_is_over():
    rng = np.random.default_rng(0)
    history = filled((state_at(1 + n * PERIOD, rng) for n in range(9000)), 10.0)
    first, last = history.runs()[1]
    assert last == 1 + 8999 * PERIOD
    kept = (last - first) / 1e9
    assert 10.0 <= kept <= 10.0 + 4 * SIZE * PERIOD / 1e9


def test_older_chunks_go_when_the_memory_is_used():
    rng = np.random.default_rng(0)
    history = filled(
        (state_at(1 + n * PERIOD, rng) for n in range(9000)), max_bytes=200_000
    )
    assert 150_000 < history.n_bytes <= 200_000
    assert 500 < len(all_of(history)) < 3000
    assert history.runs()[1][1] == 1 + 8999 * PERIOD


def test_states_at_rest_need_a_hundredth():
    rng = np.random.default_rng(0)
    state = state_at(1, rng, names=tuple(f"joint_{n}" for n in range(29)))
    rest = filled(replace(state, stamp=1 + n * PERIOD) for n in range(20 * SIZE))
    assert rest.n_bytes / (19 * SIZE) < 25  # of 560 bytes


def test_earlier_runs_stay_when_time_goes_back():
    rng = np.random.default_rng(0)
    before = [state_at(1_000_000 + n, rng) for n in range(700)]
    after = [state_at(1 + n, rng) for n in range(30)]
    history = filled([*before, *after])
    assert history.run == 2
    assert history.runs() == {1: (1_000_000, 1_000_699), 2: (1, 30)}
    assert all(map(same, all_of(history, 1), before))
    assert all(map(same, all_of(history), after))
    assert history.stretch(0, 9, run=3) is None


@pytest.mark.parametrize(
    ("steps", "found"),
    [
        ([5] * 40, []),  # in [ms]
        ([1] * 300 + [12] + [1] * 300, [(300, 312)]),
        ([5] * 300 + [350] + [5] * 9, [(1500, 1850)]),
        ([5, 5, 9, 20, 5, 40, 5], []),
        ([5, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 5, 5], []),  # paused
        ([5, 5, 5, 5, -20, 5, 5, 5, 5], []),  # a reset
        ([300, 300, 300], []),
        ([], []),
    ],
)
def test_gaps_are_long_against_the_usual_step(steps, found):
    stamps = 1 + np.cumsum([1000, *steps]) * 1e6
    history = filled(
        RobotState(stamp, (), np.zeros(0)) for stamp in np.round(stamps).astype(int)
    )
    gaps = history.gaps(0, 1 << 62)
    assert [tuple(round(at / 1e6) - 1000 for at in gap) for gap in gaps] == found
    assert gaps_text(gaps).startswith("No states from") == bool(found)
    for gap in gaps:  # a range may begin in it
        assert history.gaps(gap[0] + 1, gap[1]) == [gap]
        assert gap not in history.gaps(gap[1], 1 << 62)


def test_the_longest_gaps_are_named():
    gaps = [(n * 10**9, n * 10**9 + 10**7 * (n % 6 + 1)) for n in range(1, 7)]
    assert gaps_text(gaps[:1]) == "No states from 1.000 s to 1.020 s."
    assert gaps_text(gaps) == (
        "No states from 3.000 s to 3.040 s, 4.000 s to 4.050 s, 5.000 s to 5.060 s and "
        "in 3 shorter gaps."
    )


def test_many_resets_do_not_use_more_memory():
    rng = np.random.default_rng(0)
    state = state_at(2, rng)
    history = filled(
        (replace(state, stamp=1_000_000 - n) for n in range(500)), max_bytes=500_000
    )
    assert history.n_bytes <= 500_000
    assert 100 < len(history.runs()) < 300


def test_a_state_of_the_same_time_is_no_other_state():
    rng = np.random.default_rng(0)
    state = state_at(1, rng)
    assert len(all_of(filled([state, state]))) == 1


def test_states_with_other_joints_than_the_last_are_counted():
    rng = np.random.default_rng(0)
    short = [state_at(1 + n, rng, NAMES[:2]) for n in range(5)]
    long = [state_at(10 + n, rng) for n in range(4)]
    stretch = filled([*short, *long]).stretch(0, 100)
    assert stretch.names == NAMES
    assert stretch.others == 5
    assert all(map(same, stretch.states(), long))


def test_parts_of_a_stretch_join_to_the_whole():
    rng = np.random.default_rng(0)
    states = [state_at(1 + n, rng) for n in range(900)]
    states[700:] = [replace(s, commanded={"knee": 0.5}) for s in states[700:]]
    history = filled(states)
    parts = [history.stretch(n, n + 99) for n in range(1, 900, 100)]
    assert all(map(same, joined(parts).states(), states))


def test_a_motion_has_what_all_states_have():
    rng = np.random.default_rng(0)
    unit = np.array([0.0, 0.0, 0.7, 0.0, 0.0, 0.0, 1.0])
    states = [
        replace(
            state_at(7 + n * PERIOD, rng), positions=rng.normal(size=3), base_pose=unit
        )
        for n in range(400)
    ]
    motion = filled(states).stretch(0, 1 << 40).motion()
    assert motion.times[0] == 0.0 and motion.duration == pytest.approx(399 * 0.005)
    assert (motion.positions == np.array([s.positions for s in states])).all()
    assert (motion.base_poses == unit).all() and motion.velocities is not None
    states[5] = replace(states[5], base_pose=None)
    assert filled(states).stretch(0, 1 << 40).motion().base_poses is None


@given(
    st.lists(st.tuples(st.sampled_from("ab"), st.integers(1, 2000)), max_size=40),
    st.integers(1, 3),
    st.lists(st.integers(0, 45_000), min_size=2, max_size=2).map(sorted),
)
def test_equal_commands_within_a_second_are_one_stream(sent, packed, span):
    history, stamp = History(600.0), 0
    times = {"a": [], "b": []}
    for sender, gap in sent:
        stamp += gap * 1_000_000
        history.add(RobotState(stamp, ("knee",) * packed, np.zeros(packed)))
        history.add_command(Command(sender, "joint_commands", "knee"))
        times[sender].append(stamp)
        packed = 4 - packed  # other joints: another chunk
        history.pack()
    begin, end = (1_000_000 * at for at in span)
    times = {key: [t for t in own if begin <= t <= end] for key, own in times.items()}
    expected = [
        (group[0], group[-1], len(group), sender)
        for sender, own in times.items()
        for group in np.split(own, np.flatnonzero(np.diff(own) > 1e9) + 1)
        if len(group)
    ]
    found = history.commands(begin, end)
    assert [stream.first for stream in found] == sorted(s.first for s in found)
    assert sorted(expected) == sorted(
        (one.first, one.last, one.count, one.command.sender) for one in found
    )


def test_positions_of_commands_come_back_as_float32():
    history, rng, sent = History(600.0), np.random.default_rng(0), []
    command = Command("a", "joint_commands", "2 joints", ("hip", "knee"))
    for stamp in range(1, 4 * SIZE):
        history.add(RobotState(stamp, (), np.zeros(0)))
        sent.append(rng.normal(size=2))
        history.add_command(command, sent[-1])
        history.add_command(Command("b", "base_command", "base"))
        history.pack()
    first, second = history.commands(3, 1 << 40, with_positions=True)
    assert first.command == command and second.positions.shape == (first.count, 0)
    assert first.stamps.tolist() == [*range(3, 4 * SIZE)]
    assert first.positions.dtype == np.float32
    assert (first.positions == np.array(sent[2:], np.float32)).all()
    assert history.commands(3, 1 << 40)[0].positions is None


def test_the_newest_state_of_a_time_ago_is_known():
    history, times = History(600.0), [time.time_ns()]
    for stamp in (5, 7, 7, 2):
        history.add(RobotState(stamp, (), np.zeros(0)))
        history.pack()
        times.append(time.time_ns())
    assert [*map(history.newest, times)] == [None, (1, 5), (1, 7), (1, 7), (2, 2)]


def test_commands_while_time_is_paused_are_bounded():
    history = History(600.0)
    command = Command("planner", "joint_commands", "knee")
    history.add_command(command)  # there is no state yet
    for stamp in range(1, 4 * SIZE):
        history.add(RobotState(stamp, ("knee",), np.zeros(1)))
        for _ in range(2 * MAX_COMMANDS if stamp == 1 else stamp % 3):
            history.add_command(command)
        history.pack()
    (stream,) = history.commands(0, 100_000)
    assert (stream.first, stream.last) == (1, 4 * SIZE - 2)
    assert history.commands(1, 1)[0].count == MAX_COMMANDS
