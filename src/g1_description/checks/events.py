"""Events before a failure of a robot: what its states and its commands show."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from g1_description.checks.ground_samples import drifts
from g1_description.checks.intervals import runs
from g1_description.checks.measured import Measured
from g1_description.checks.rule import units
from g1_description.checks.rules.forces import CONTACT_FORCES, side, unknown_forces
from g1_description.checks.rules.ground import CENTER_OF_MASS
from g1_description.checks.run import Run
from g1_description.motion.history import CommandStream
from g1_description.robot.dynamics import GRAVITY

LATE, PERIODS = 0.1, 5.0
"""A stream is late after this time in [s], and as many of its usual periods."""

STEP_TIME, STEP = 0.04, 0.15
"""A command jumps if it changes by more than ``STEP``, in [rad] or [m], within this
time in [s], and by less than half of it in the same direction before and after."""

HIGH = 0.02
"""Height above the floor from which a robot drops, in [m]."""

PUSH, PUSH_TIME = 0.12, 0.04
"""Least push along the floor as a fraction of the weight, and its time in [s]."""

LOAD = 15.0
"""Least weight in a hand that its file does not have, in [N]."""

PLATEAU, PLATEAU_TIME = 1e-3, 0.05
"""Largest change of a saturated effort as a fraction of it, and least time in [s]."""

WEAK = 0.9
"""A motor that gives less than this fraction of its joint's limit is weak."""

LAG, MOVED = 0.1, 0.02
"""Tracking errors in [rad] or [m]: of a joint that lags, and one that changes."""

LITTLE = 0.5
"""Fraction of the limit below which a motor could give much more."""

SLIP = 0.02
"""Least way of a foot along the floor in a contact, in [m]."""

RAISED = 0.015
"""Height above the other feet at which a foot is meant to be in the air, in [m]."""

HIGHER = 0.005
"""A foot this much higher than it is meant to be is not just raised, in [m]."""

LOST_TIME = 0.05
"""Shortest time without a contact, in [s]."""


@dataclass(frozen=True)
class Event:
    """Something that happened before a failure."""

    name: str
    """Its name in ``first_cause.CAUSES``; of the failure, ``FAILURE``."""

    time: float
    """When it began, in [s]."""

    subject: tuple[str, ...]
    """Joint, link or sender; empty for the whole robot."""

    text: str
    """What happened, with its size."""

    def __str__(self) -> str:
        """Write it with its time."""
        return f"{self.time:.3f} s: {self.text}"


# --- commands ---


def late_commands(run: Run) -> Iterator[Event]:
    """Find streams that pause, and go on somewhere else."""
    joints = {joint.name: joint for joint in run.joints}
    for stream in run.commands:
        names, (sender, topic) = stream.command.names, stream.command[:2]
        known = [column for column, name in enumerate(names) if name in joints]
        if stream.stamps is None or stream.positions is None or not known:
            continue
        if stream.count < 10:
            continue
        times = 1e-9 * stream.stamps
        gaps = np.diff(times)
        usual = float(np.median(gaps))
        steps = np.abs(np.diff(stream.positions[:, known], axis=0))
        is_late = (gaps > max(LATE, PERIODS * usual)) & (steps.max(axis=1) > MOVED)
        is_late &= (times[1:] > run.times[0]) & (times[:-1] < run.end)
        for row in np.flatnonzero(is_late):
            column = int(steps[row].argmax())
            joint = joints[names[known[column]]]
            text = (
                f"{sender} sends nothing on {topic} for {gaps[row]:.2f} s, usually "
                f"every {usual:.3f} s, and then a position of {joint.name} that "
                f"differs by {steps[row, column]:.2f} {units(joint)[0]}"
            )
            yield Event("late_commands", float(times[row]), (sender,), text)


def command_jumps(run: Run) -> Iterator[Event]:
    """Find jumps of the commands."""
    times, desired = run.times, run.held
    period = np.ptp(times) / max(len(times) - 1, 1)
    reach = max(int(np.ceil(STEP_TIME / max(period, 1e-9))), 1)
    if len(times) <= 2 * reach:
        return
    changes = np.nan_to_num(desired[reach:] - desired[:-reach])
    around = np.pad(changes, ((reach, reach), (0, 0)), "constant")
    steps, ways = np.abs(changes), np.sign(changes)
    smooth = np.maximum(around[: -2 * reach] * ways, around[2 * reach :] * ways)
    is_jump = steps - 2.0 * np.maximum(smooth, 0.0) > STEP
    for first, last in runs(is_jump.any(axis=1)):
        column = int(steps[first : last + 1].max(axis=0).argmax())
        row = first + int(steps[first : last + 1, column].argmax())
        parts = np.abs(np.diff(desired[row : row + reach + 1, column]))
        begin = row + int((parts > 0.5 * parts.max()).argmax()) + 1
        time, joint = float(times[begin]), run.joints[column]
        text = (
            f"the command of {joint.name} jumps by {steps[row, column]:.2f} "
            f"{units(joint)[0]}{_sender(run, joint.name, time)}"
        )
        yield Event("command_jump", time, (joint.name,), text)


def _sender(run: Run, joint: str, time: float) -> str:
    """Name who sent the last command to a joint before a time in [s]."""
    known = [
        (float(stamps[stamps <= time + STEP_TIME].max()), stream.command)
        for stream in run.commands
        if not stream.command.names or joint in stream.command.names
        for stamps in [1e-9 * _stamps(stream)]
        if (stamps <= time + STEP_TIME).any()
    ]
    if not known:
        return ""
    command = max(known, key=lambda pair: pair[0])[1]
    return f", as {command.sender} sent it on {command.topic}"


def _stamps(stream: CommandStream) -> np.ndarray:
    """Return the known stamps of commands in [ns]."""
    ends = np.array([stream.first, stream.last])
    return ends if stream.stamps is None else stream.stamps


def infeasible_commands(run: Run) -> Iterator[Event]:
    """Find where the commanded motion itself cannot be done."""
    commanded = run.commanded
    if commanded is None:
        return
    rules = [CENTER_OF_MASS]
    if not unknown_forces(run.robot, commanded.motion):
        rules.append(CONTACT_FORCES)
    found = [f for rule in rules for f in rule.find(rule, commanded) if f is not None]
    if found:
        first = min(found, key=lambda finding: finding.first_time)
        text = f"the commanded motion cannot be done: {first.text}"
        time = _since(commanded, first.first_time)
        yield Event("infeasible_commands", time, (), text)


def _since(commanded: Measured, time: float) -> float:
    """Find since when the commanded centre of mass is outside the support, in [s]."""
    assert commanded.balance is not None
    is_inside = ~(commanded.balance.center_margin < 0.0) & (commanded.times <= time)
    begin = int(np.append(np.flatnonzero(is_inside), -1).max()) + 1
    return min(time, float(commanded.times[min(begin, len(commanded.times) - 1)]))


# --- what acts on the robot ---


def starts_high(run: Run) -> Iterator[Event]:
    """Find a robot that drops."""
    ground = run.measured.ground if run.stands else None
    if ground is None or ground.in_contact[0].any():
        return
    height = float(ground.heights[0].min())
    if height > HIGH:
        text = f"the robot begins {height:.2f} m above the floor"
        yield Event("starts_high", float(run.times[0]), (), text)


def pushed(run: Run) -> Iterator[Event]:
    """Find pushes along the floor that feet and motors do not explain.

    What has lost its balance turns about the edges of its feet, which fits worse.
    """
    pushes = run.external
    if pushes is None:
        return
    measured = run.measured
    weight = float(run.robot.masses.total) * GRAVITY
    root = list(pushes)[-1]
    falls = min((event.time for event in unbalanced(run)), default=run.end)
    along = pushes[root][:, :2]
    sizes = np.hypot(*along.T) / weight
    window = run.robot.thresholds.window
    sizes[measured.times < measured.times[0] + window] = 0.0
    sizes[measured.times > measured.times[-1] - window] = 0.0
    for first, last in _longer(measured.times, sizes > PUSH, PUSH_TIME):
        worst = first + int(sizes[first : last + 1].argmax())
        half = np.flatnonzero(sizes[:worst] < 0.5 * sizes[worst])
        begin = int(half[-1]) + 1 if len(half) else first
        where = side(measured.base_poses()[worst, 3:], along[worst], WAYS)
        text = f"{root} is pushed with {weight * sizes[worst]:.0f} N{where}"
        time = float(measured.times[begin])
        if time <= falls:
            yield Event("push", time, (root,), text)


WAYS = (" forwards", " to the left", " backwards", " to the right")


def loads(run: Run) -> Iterator[Event]:
    """Find weights at the ends of limbs that are not in the robot's file."""
    pushes = run.external
    if pushes is None:
        return
    for link, force in list(pushes.items())[:-1]:
        weight = -float(np.median(force[:, 2]))
        if link not in run.measured.ground_links and weight > LOAD:
            text = f"{link} carries {weight:.0f} N that the robot's file does not have"
            yield Event("load", float(run.times[0]), (link,), text)


# --- motors ---


def _saturated(run: Run) -> Iterator[tuple[int, float, float]]:
    """Find motors that give a constant effort while the error changes.

    Yields:
        Column of the joint, first time in [s], and the effort in [N m] or [N].
    """
    efforts, times = run.efforts, run.times
    if efforts is None:
        return
    errors = run.errors
    for column in range(len(run.joints)):
        size = np.abs(efforts[:, column])
        is_same = np.abs(np.diff(efforts[:, column])) <= PLATEAU * size[1:]
        is_same = np.append(is_same & (size[1:] > 0.0), False)
        for first, last in _longer(times, is_same, PLATEAU_TIME):
            own = errors[first : last + 1, column]
            if not np.isnan(own).any() and np.ptp(own) > MOVED:
                yield column, float(times[first]), float(size[first])


def weak_motors(run: Run) -> Iterator[Event]:
    """Find motors with less effort than the robot's file says."""
    for column, time, effort in _saturated(run):
        joint, limit = run.joints[column], run.joints[column].effort
        if effort < WEAK * limit < np.inf:
            unit = units(joint)[1]
            text = (
                f"the motor of {joint.name} gives no more than {effort:.3g} of "
                f"{limit:.3g} {unit}"
            )
            yield Event("weak_motor", time, (joint.name,), text)


def saturations(run: Run) -> Iterator[Event]:
    """Find motors at their limits."""
    for column, time, effort in _saturated(run):
        joint = run.joints[column]
        if effort >= WEAK * joint.effort or np.isinf(joint.effort):
            text = (
                f"the motor of {joint.name} is at its limit of {effort:.3g} "
                f"{units(joint)[1]}"
            )
            yield Event("saturation", time, (joint.name,), text)


def lags(run: Run) -> Iterator[Event]:
    """Find joints that lag."""
    for column, first, last in _lagging(run):
        joint, errors = run.joints[column], run.errors[first : last + 1, column]
        text = (
            f"{joint.name} is up to {np.nanmax(np.abs(errors)):.2f} "
            f"{units(joint)[0]} off its command"
        )
        yield Event("lag", float(run.times[first]), (joint.name,), text)


def low_gains(run: Run) -> Iterator[Event]:
    """Find joints that lag alone although their motors could give more."""
    efforts = run.efforts
    if efforts is None:
        return
    errors = np.nan_to_num(np.abs(run.errors))
    saturated = {column for column, *_ in _saturated(run)}
    for column, first, last in _lagging(run):
        joint, size = run.joints[column], np.abs(efforts[first : last + 1, column])
        given = float(np.median(size))
        lag = first + int((errors[first:, column] > LAG).argmax())
        is_alone = (np.delete(errors[lag], column) < LAG / 2.0).all()
        is_little = given < LITTLE * joint.effort < np.inf
        if column not in saturated and is_alone and is_little:
            unit, effort = units(joint)
            error = errors[first : last + 1, column].max()
            text = (
                f"{joint.name} is up to {error:.2f} {unit} off its command while its "
                f"motor gives {given:.3g} of {joint.effort:.3g} {effort}: its gains "
                "are too low"
            )
            yield Event("low_gain", float(run.times[first]), (joint.name,), text)


def _lagging(run: Run) -> Iterator[tuple[int, int, int]]:
    """List joints that lag, each time with the first and last row."""
    errors = np.nan_to_num(np.abs(run.errors))
    for column in range(len(run.joints)):
        for first, last in _longer(run.times, errors[:, column] > LAG, PUSH_TIME):
            near = np.flatnonzero(errors[:first, column] < MOVED)
            yield column, int(near[-1]) + 1 if len(near) else 0, last


# --- feet ---


def slips(run: Run) -> Iterator[Event]:
    """Find feet that slide along the floor."""
    ground = run.measured.ground if run.stands else None
    if ground is None:
        return
    touches = ground.in_contact
    touches = touches & (ground.heights <= run.robot.thresholds.contact_height)
    ways = np.nan_to_num(drifts(ground.steps, touches))
    for column in np.flatnonzero(ways.max(axis=0) > SLIP):
        worst = int((ways[:, column] > SLIP).argmax())
        still = np.flatnonzero(ways[:worst, column] < SLIP / 4.0)
        begin = int(still[-1]) if len(still) else 0
        link = run.measured.ground_links[column]
        text = f"{link} slips, by up to {ways[:, column].max():.2f} m"
        yield Event("slip", float(run.measured.times[begin]), (link,), text)


def lost_contacts(run: Run) -> Iterator[Event]:
    """Find feet that are in the air, and are meant to stand or to be lower."""
    ground = run.measured.ground if run.stands else None
    if ground is None or not ground.in_contact[0].any():
        return
    meant = np.ones_like(ground.in_contact)
    if run.commanded is not None and run.commanded.ground is not None:
        names, commanded = (
            list(run.commanded.ground_links),
            run.commanded.ground.heights,
        )
        low = commanded.min(axis=1)
        for column, link in enumerate(run.measured.ground_links):
            if link in names:
                own = commanded[:, names.index(link)] - low
                is_higher = ground.heights[:, column] > own + HIGHER
                meant[:, column] = (own < RAISED) & is_higher
            else:
                meant[:, column] = False
    for column in np.flatnonzero(ground.in_contact[0]):
        is_lost = ~ground.in_contact[:, column] & meant[:, column]
        for first, _ in _longer(run.measured.times, is_lost, LOST_TIME):
            link = run.measured.ground_links[column]
            text = f"{link} leaves the floor"
            time = float(run.measured.times[first])
            yield Event("lost_contact", time, (link,), text)


def unbalanced(run: Run) -> Iterator[Event]:
    """Find when the centre of mass leaves the support for good."""
    balance = run.measured.balance if run.stands else None
    if balance is None:
        return
    margin = np.nan_to_num(balance.center_margin, nan=1.0)
    inside = np.flatnonzero(margin >= 0.0)
    first = int(inside[-1]) + 1 if len(inside) else 0
    if first < len(margin):
        text = "the centre of mass leaves the support polygon"
        yield Event("unbalanced", float(run.measured.times[first]), (), text)


def _longer(times: np.ndarray, mask: np.ndarray, least: float) -> list[tuple[int, int]]:
    """List the intervals of samples that last for a time in [s] at least."""
    return [(a, b) for a, b in runs(mask) if times[b] - times[a] >= least]
