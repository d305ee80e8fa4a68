"""The first cause of a failure is the fault that was put into the simulation."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from g1_description import Robot
from g1_description.checks import first_cause
from g1_description.checks.checker import Checker
from g1_description.checks.first_cause import failure_text
from g1_description.checks.run import states_of
from g1_description.motion.history_chunks import Stretch
from g1_description.sim.rollout import Conditions, rollout

pytest.importorskip("mujoco")
from bench import causes as faults

ROBOT = Robot()
CHECKER = ROBOT.checker()


def simulated(kind, seed):
    """Simulate a fault; return its states, the commands and the fault."""
    fault, motion, _, stream = faults.drawn(ROBOT, kind, np.random.default_rng(seed))
    return faults.simulated(ROBOT, motion, fault), [stream], fault


def explained(kind, seed, **changes):
    """Simulate a fault; explain its states, some of which may be unknown."""
    states, commands, fault = simulated(kind, seed)
    return CHECKER.explain(replace(states, **changes), commands), fault


def after_waiting(states, base=None):
    """Let a robot wait for three seconds before its states, at a pose of the base."""
    rows = np.append(np.zeros(600, dtype=int), np.arange(len(states.stamps)))
    found = states.rows(rows)
    if base is not None:
        found.base_poses[:600] = base
    return replace(found, stamps=5_000_000 * np.arange(1, len(rows) + 1))


def stretch_of(motion):
    """Return the states of a robot that does what it is commanded."""
    names, stamps = motion.joint_names, np.round(1e9 * motion.times).astype(np.int64)
    states = Stretch(1, stamps, names, names, motion.positions, None, motion.base_poses)
    return replace(states, commanded=motion.positions.copy())


@pytest.fixture(scope="module")
def push():
    """A push of a robot that is never commanded, and the first cause."""
    states, _, _ = simulated("push", [4, 0, 0])
    return states, CHECKER.explain(states).chain[0]


@pytest.mark.parametrize(
    ("kind", "seed"),
    [
        ("weak motor", [0, 0, 0]),
        ("wrong gain", [1, 0, 0]),
        ("jump", [2, 0, 0]),
        ("push", [4, 0, 0]),
        ("base too high", [5, 0, 0]),
        ("heavy hand", [6, 1, 0]),
        ("late stream", [7, 0, 0]),
    ],
)
def test_the_first_cause_of_a_failure_is_the_fault(kind, seed):
    found, fault = explained(kind, seed)
    assert faults.is_right(found, fault), str(found)
    times = [event.time for event in found.chain[1:]]
    assert times == sorted(times) and max(times, default=0.0) <= found.failure.time
    assert not found.unknown
    if kind in ("jump", "late stream"):
        assert faults.SENDER in found.first and "joint_commands" in found.first
    if kind == "push":
        at, _, x, y = fault.push
        assert abs(found.chain[0].time - at) < 0.1
        assert " forwards" in found.first and x > abs(y)


def test_a_command_beyond_the_limit_of_a_joint_is_one_to_its_limit():
    states, commands, fault = simulated("push", [4, 0, 0])
    name = "left_elbow_joint"
    limit = ROBOT.upper[ROBOT.joint_names.index(name)]
    states.commanded[:, states.commanded_names.index(name)] = limit + 0.5
    for position in (limit, limit + 0.5):  # a real one may get there
        states.positions[:, states.names.index(name)] = position
        assert faults.is_right(CHECKER.explain(states, commands), fault)


def test_a_slip_is_the_first_cause_where_the_base_leaves_its_command():
    random = np.random.default_rng([3, 1, 0])
    states, commands, fault = faults.run(ROBOT, "slippery floor", random)
    found = CHECKER.explain(states, commands)
    assert faults.is_right(found, fault), str(found)
    assert found.failure.text.startswith("the base is 0.15 m or 0.3 rad off")


def test_a_sound_run_has_no_first_cause():
    assert explained("sound", [8, 0, 0])[0] is None


def test_what_is_not_known_is_not_blamed_and_said():
    found, _ = explained("push", [4, 0, 0], efforts=None, commanded=None)
    assert found.failure.text == "the robot falls"
    assert found.chain[0].name in ("lost_contact", "unbalanced", "slip")
    assert found.unknown == "Not known: efforts of the motors, commands."
    found, _ = explained("jump", [2, 0, 0], base_poses=None)
    assert found.chain[0].name == "command_jump"
    assert found.unknown == "Not known: how it stands."


def test_the_first_command_to_a_joint_jumps_from_where_it_is():
    fault, motion, _, stream = faults.drawn(
        ROBOT, "jump", np.random.default_rng([2, 0, 0])
    )
    states = faults.simulated(ROBOT, motion, fault)
    commanded = states.commanded.copy()
    commanded[1e-9 * states.stamps < fault.span[0] + faults.PERIOD] = np.nan
    found = CHECKER.explain(replace(states, commanded=commanded), [stream])
    assert faults.is_right(found, fault), str(found)
    assert abs(found.chain[0].time - fault.span[0]) < 0.05


def test_who_leans_too_far_is_not_pushed_as_well():
    times = np.arange(0.0, 3.0, 0.02)
    lean = -0.15 + 0.15 * np.cos(np.pi * np.clip((times - 0.5) / 1.5, 0.0, 1.0))
    ankles = {f"{side}_ankle_pitch_joint": lean for side in faults.SIDES}
    conditions = Conditions(engine="mujoco")
    played = rollout(ROBOT.description, ROBOT.trajectory(times, ankles), conditions)
    states = states_of(played)
    states.commanded[:, [name not in ankles for name in states.commanded_names]] = (
        np.nan
    )
    found = CHECKER.explain(replace(states, commanded_bases=None))
    assert found.chain[0].name == "infeasible_commands"
    assert "push" not in [event.name for event in found.chain], str(found)


def test_names_of_joints_are_written_as_they_are():
    fault, motion, _, _ = faults.drawn(ROBOT, "sound", np.random.default_rng([8, 0, 0]))
    states = faults.simulated(ROBOT, motion, fault)
    states.commanded[-50:, states.commanded_names.index("left_elbow_joint")] += 0.5
    assert CHECKER.explain(states).first.startswith("left_elbow_joint is 0.2 rad off")


def test_nothing_is_said_to_be_right_that_is_not_known():
    motion = ROBOT.read_motion("squat.csv")
    played = rollout(ROBOT.description, motion, Conditions(engine="mujoco"))
    states = states_of(played)
    assert failure_text(None, states).splitlines() == [
        "Nothing failed: the robot does not fall, no joint is 0.2 rad off its command, "
        "and the base is not 0.15 m or 0.3 rad off its command."
    ]
    some = replace(states, base_poses=None)
    assert failure_text(None, some).splitlines() == [
        "Nothing failed: no joint is 0.2 rad off its command.",
        "  Not known: the base.",
    ]
    none = replace(some, commanded=None)
    assert failure_text(None, none).startswith("Nothing is known to have failed.")
    lying = states.base_poses.copy()
    lying[:, 3:] = [0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)]
    lying[0] = np.nan
    told = failure_text(None, replace(states, base_poses=lying))
    assert "The base leans by 90 degrees already in the first state" in told


def test_a_kind_of_events_is_a_line():
    events = [("lag", "a"), ("lag", "b"), ("slip", "c"), ("lag", "d"), ("slip", "e")]
    found = first_cause.Explanation(
        first_cause.Event(first_cause.FAILURE, 9.0, (), "the robot falls"),
        tuple(
            first_cause.Event(name, float(at), (subject,), f"{subject} is bad")
            for at, (name, subject) in enumerate(events)
        ),
    )
    later = "1.000 s: b is bad, and 1 more joint", "2.000 s: c is bad, and 1 more link"
    assert str(found).splitlines()[1:] == [f"  {line}" for line in later]
    assert found.note.endswith(f"a is bad. Other events: {'; '.join(later)}.")


def test_a_fast_smooth_command_does_not_jump():
    motion = ROBOT.read_motion("squat.csv").resampled(100.0)
    states = stretch_of(motion)
    states.commanded[:, states.names.index("left_knee_joint")] += 0.58 * (
        1.0 - np.cos(6.0 * np.pi * np.clip(motion.times - 1.0, 0.0, None))
    )
    found = CHECKER.explain(states)
    assert found.failure.text.startswith("left_knee_joint")
    assert "command_jump" not in [event.name for event in found.chain], str(found)


@pytest.mark.parametrize(("rows", "rate"), [(2, 100.0), (4, 200.0), (1, 50.0)])
def test_a_jump_has_its_size_although_the_failure_is_within_it(rows, rate):
    motion = ROBOT.read_motion("squat.csv").resampled(rate)
    states = stretch_of(motion)
    jump = np.interp(np.arange(len(motion.times)), [100, 100 + rows], [0.0, 0.8])
    states.commanded[:, states.names.index("left_elbow_joint")] += jump
    found = CHECKER.explain(states)
    assert "the command of left_elbow_joint jumps by 0.8" in found.first


def test_a_command_that_is_wrong_once_jumps():
    states = stretch_of(ROBOT.read_motion("squat.csv").resampled(100.0))
    states.commanded[100:102, states.names.index("left_elbow_joint")] += 0.5
    assert CHECKER.explain(states).chain[0].name == "command_jump"


@pytest.mark.parametrize("rate", [20.0, 200.0])
def test_a_base_that_is_placed_does_not_fall(rate):
    states = stretch_of(ROBOT.read_motion("squat.csv").resampled(rate))
    states.base_poses[len(states.stamps) // 2 :, 3:] = LYING[3:]
    assert CHECKER.explain(states) is None


def test_a_moment_long_before_a_fall_is_not_its_cause():
    """A jump of a wrist at 0.8 s; the centre of mass leaves the support at 6.7 s."""
    conditions = Conditions(engine="mujoco")
    checker = ROBOT.checker(physics=conditions)
    motion = ROBOT.read_motion("faulty.csv")
    played = rollout(ROBOT.description, motion, conditions)
    found = checker.explain(states_of(played), (), played)
    assert found.chain[0].name == "infeasible_commands"
    assert "centre of mass" in found.first
    assert not any(event.name == "command_jump" for event in found.chain)


def test_states_may_be_rare_or_missing(push):
    states, cause = push
    is_kept = np.ones(len(states.stamps), dtype=bool)
    is_kept[50:70] = False
    for rows in (slice(None, None, 10), is_kept):
        found = CHECKER.explain(states.rows(rows)).chain[0]
        assert (found.name, found.subject) == ("push", ("pelvis",))
        assert abs(found.time - cause.time) < 0.05
    bases = states.base_poses.copy()
    bases[:50] = np.nan
    found = CHECKER.explain(replace(states, base_poses=bases))
    assert found.chain[0] == cause
    few = states.rows(slice(0, 20))
    few = replace(few, commanded=few.positions + 0.3 * np.eye(20)[-1:].T)
    assert CHECKER.explain(few).failure.time == 1e-9 * few.stamps[-1]


def test_a_robot_on_an_unknown_box_does_not_begin_high(push):
    states, cause = push
    bases = states.base_poses + 0.3 * np.eye(7)[2]
    found = CHECKER.explain(
        replace(states, base_poses=bases, commanded_bases=np.repeat(bases[:1], 556, 0))
    )
    assert found.chain == (cause,)
    assert found.unknown == "Not known: how it stands."


LYING = np.array([0.0, 0.0, 0.1, 0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)])


def test_a_robot_that_is_placed_does_not_fall(push):
    sound, _, _ = simulated("sound", [8, 0, 0])
    assert CHECKER.explain(after_waiting(sound, LYING)) is None
    found = CHECKER.explain(after_waiting(push[0], LYING))
    assert found.chain[0] == replace(push[1], time=found.chain[0].time)
    assert abs(found.chain[0].time - push[1].time - 3.0) < 1e-6


def test_a_base_may_be_commanded_only_later():
    states, commands, _ = simulated("sound", [8, 0, 0])
    bases = states.base_poses.copy()
    bases[:300] = np.nan
    states = replace(states, commanded_bases=bases)
    assert CHECKER.explain(states, commands) is None
    moved = states.base_poses + 0.2 * np.eye(7)[0]
    found = CHECKER.explain(replace(states, base_poses=moved), commands)
    assert found.failure.text.startswith("the base is 0.15 m")
    assert found.failure.time == 1e-9 * states.stamps[300]


def test_an_earlier_jump_does_not_hide_the_last_one():
    states, _, fault = simulated("jump", [2, 0, 0])
    states = replace(after_waiting(states), efforts=None)
    states.commanded[100:200, states.names.index("left_wrist_roll_joint")] += 0.18
    found = CHECKER.explain(states)
    assert found.chain[0].name == "command_jump"
    assert found.chain[0].subject == (fault.joint,)
    assert found.chain[0].time > 3.0


def test_a_limit_that_no_file_tells_is_no_weak_motor():
    joints = [replace(joint, effort=np.inf) for joint in ROBOT.description.joints]
    robot = replace(ROBOT.description, joints=tuple(joints))
    states, commands, _ = simulated("weak motor", [0, 0, 0])
    assert Checker(robot).explain(states, commands).chain[0].name == "saturation"


def test_feet_that_are_raised_as_commanded_do_not_lose_contact():
    states = stretch_of(ROBOT.read_motion("step_in_place.csv").resampled(100.0))
    wrist = states.names.index("left_wrist_roll_joint")
    states.commanded[-1, wrist] += 0.5
    assert {event.name for event in CHECKER.explain(states).chain} == {"command_jump"}


@pytest.mark.parametrize(
    "names", [("unbalanced", "lost_contact"), ("saturation", "lost_contact")]
)
def test_of_events_that_explain_each_other_the_earlier_one_is_first(names, monkeypatch):
    events = [
        first_cause.Event(name, at, (), "") for name, at in zip(names, (1.0, 1.05))
    ]
    causes = [
        replace(
            first_cause.CAUSE[event.name], find=lambda _, event=event: iter([event])
        )
        for event in reversed(events)
    ]
    monkeypatch.setattr(first_cause, "CAUSES", causes)
    run = SimpleNamespace(end=2.0, failure="the robot falls", unknown="")
    assert first_cause.explain(run).chain == (*events,)
