"""How a motion that was executed differs from its reference."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from g1_description.checks.checker import Checker
from g1_description.checks.report import table
from g1_description.checks.rules.ground import slides
from g1_description.checks.verdict import Finding, Verdict
from g1_description.errors import MotionError
from g1_description.motion.files.conventions import of_robot
from g1_description.motion.motion import SNAP, Motion, sample
from g1_description.robot.assembly import WORLD, root_in_base
from g1_description.robot.description import Description
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.rotation import angle_between
from g1_description.robot.transform import IDENTITY, compose

PERIOD = 0.02
"""Period of the samples among which the time shift is sought first, in [s]."""

LEAST_OVERLAP = 0.5
"""Least share of the shorter motion that is compared."""

MAX_TIMES = 100_000
"""Most samples of the search for a time shift: half an hour."""

BATCH = 1000
"""Samples whose links are placed at once."""

MAX_LISTED = 5
"""Joints in a text, those with the largest errors."""


@dataclass(frozen=True)
class Error:
    """The size of an error over time."""

    rms: float
    largest: float
    when: float
    """Time of the largest one in the reference, in [s]."""


@dataclass(frozen=True)
class Comparison:
    """Differences of an executed motion from its reference, over their common time.

    Bodies are the robot's links. Errors of bodies are means over the links.
    """

    shift: float
    """Time of the executed motion minus that of the reference, in [s]."""

    duration: float
    """Compared time, in [s]."""

    joints: Mapping[str, Error]
    """Errors of each joint in both motions, in [rad] or [m]."""

    bodies: Error | None
    """Distance of links in the map, in [m]; None without a base in both motions."""

    bodies_from_root: Error
    """Distance of links in the frame of the base, in [m]."""

    base_position: Error | None
    """Distance of the base, in [m]."""

    base_angle: Error | None
    """Angle between both attitudes of the base, in [rad]."""

    slip: Mapping[str, tuple[float, float]]
    """Path that each link slides on the floor, in the reference and when executed, in
    [m]."""

    findings: tuple[tuple[Finding, float, float], ...]
    """Findings in the executed motion, with the largest error of a joint in [rad] or
    [m], and of bodies from the root in [m], while they last."""

    def as_dict(self) -> dict[str, Any]:
        """Return a dictionary for JSON."""
        content = asdict(self)
        content["findings"] = [
            {
                "check": finding.check,
                "subject": list(finding.subject),
                "first_time": finding.first_time,
                "joint_error": joint,
                "body_error": body,
            }
            for finding, joint, body in self.findings
        ]
        return content

    def __str__(self) -> str:
        """Summarize it, with the joints of the largest errors."""
        joints = sorted(self.joints.items(), key=lambda item: -item[1].rms)
        total = float(np.sqrt(np.mean([e.rms**2 for _, e in joints])))
        rows: list[tuple[str, ...]] = [("", "rms", "largest", "at")]
        named = {
            "bodies in the map": self.bodies,
            "bodies from the root": self.bodies_from_root,
            "position of the base": self.base_position,
        }
        rows += [_row(name, e, "m") for name, e in named.items() if e is not None]
        if self.base_angle is not None:
            rows.append(_row("angle of the base", self.base_angle, "rad"))
        rows += [_row(name, error, "") for name, error in joints[:MAX_LISTED]]
        lines = [
            f"{len(joints)} joints compared for {self.duration:.2f} s, shifted by "
            f"{self.shift:+.3f} s: rms error {total:.4f}",
            *table(rows, 1),
        ]
        for link, (before, after) in self.slip.items():
            lines.append(f"  {link} slides {after:.3f} m (reference {before:.3f} m)")
        for finding, joint, body in self.findings:
            lines.append(
                f"  {finding.check} {finding.name or 'the robot'} from "
                f"{finding.first_time:.3f} s: joints off by up to {joint:.4f}, bodies "
                f"by {body:.4f} m"
            )
        return "\n".join(lines)


def _row(name: str, error: Error, unit: str) -> tuple[str, ...]:
    """Describe an error."""
    sizes = (f"{size:.4f} {unit}".strip() for size in (error.rms, error.largest))
    return name, *sizes, f"{error.when:.2f} s"


def compare(
    checker: Checker,
    reference: Motion,
    executed: Motion,
    shift: float | None = None,
) -> Comparison:
    """Compare an executed motion with its reference, at the samples of the former.

    Args:
        checker: Checker of the robot that both motions fit, as by ``fitted``.
        reference: The motion that was to be executed.
        executed: The measured motion.
        shift: Time of the executed motion minus that of the reference, in [s]; None:
            the one with the smallest rms error of the joints.

    Raises:
        MotionError: If they have no common joints or times.
    """
    robot = checker.description
    names = _common_joints(reference, executed)
    if shift is None:
        shift = find_shift(reference, executed)
    first, last = _overlap(reference, executed, shift)
    times = executed.times - shift
    times = times[(times >= first - SNAP) & (times <= last + SNAP)]
    if not times.size:
        raise MotionError("The motions have no common times.")
    desired, found = (
        replace(motion.sampled(at), times=times, velocities=None)
        for motion, at in ((reference, times), (executed, times + shift))
    )
    errors = np.abs(found.arranged(names).positions - desired.arranged(names).positions)
    no_bases = (replace(motion, base_poses=None) for motion in (desired, found))
    from_root = _distances(robot, *no_bases)
    in_map = base_position = base_angle = None
    if desired.base_poses is not None and found.base_poses is not None:
        in_map = _error(_distances(robot, desired, found), times)
        offsets = found.base_poses[:, :3] - desired.base_poses[:, :3]
        base_position = _error(np.linalg.norm(offsets, axis=1), times)
        angles = angle_between(desired.base_poses[:, 3:], found.base_poses[:, 3:])
        base_angle = _error(angles, times)
    # Both at the same times, as what counts as sliding depends on the rate.
    slips = [_slip(checker.check(motion, ["skating"])) for motion in (desired, found)]
    findings = []
    for finding in checker.check(executed).findings:
        rows = _rows(finding, times + shift)
        if rows.size:
            most = float(errors[rows].max()), float(from_root[rows].max())
            findings.append((finding, *most))
    return Comparison(
        shift,
        float(times[-1] - times[0]),
        {name: _error(errors[:, column], times) for column, name in enumerate(names)},
        in_map,
        _error(from_root, times),
        base_position,
        base_angle,
        {
            link: (slips[0].get(link, 0.0), slips[1].get(link, 0.0))
            for link in dict.fromkeys([*slips[0], *slips[1]])
        },
        tuple(findings),
    )


def find_shift(reference: Motion, executed: Motion) -> float:
    """Find the time shift with the smallest rms error of the common joints, in [s].

    All shifts at which at least half of the shorter motion overlaps are tried in steps
    of ``PERIOD``, as cross-correlations by FFT; the best one is refined.

    Raises:
        MotionError: If the motions are too long, or have no common joints.
    """
    # Both take a second to import, and are needed here only.
    from scipy.optimize import minimize_scalar
    from scipy.signal import correlate

    names = _common_joints(reference, executed)
    reference, executed = reference.arranged(names), executed.arranged(names)
    rows = [_evenly(reference), _evenly(executed)]
    if len(rows[0]) == 1 or len(rows[1]) == 1:
        return float(executed.times[0] - reference.times[0])
    a, b = (row - np.concatenate(rows).mean(axis=0) for row in rows)
    ones = np.ones(len(a)), np.ones(len(b))
    counts = correlate(ones[1], ones[0], method="fft")
    squares = correlate(ones[1], (a**2).sum(axis=1), method="fft")
    squares += correlate((b**2).sum(axis=1), ones[0], method="fft")
    for column in range(len(names)):
        squares -= 2.0 * correlate(b[:, column], a[:, column], method="fft")
    fits = counts >= max(1.0, LEAST_OVERLAP * min(len(a), len(b))) - 0.5
    best = int(np.argmin(np.where(fits, squares / np.maximum(counts, 1.0), np.inf)))
    lag = (best - (len(a) - 1)) * PERIOD
    start = lag + float(executed.times[0] - reference.times[0])
    result = minimize_scalar(
        lambda shift: _mean_square(reference, executed, shift),
        bounds=(start - PERIOD, start + PERIOD),
        method="bounded",
        options={"xatol": 1e-5},
    )
    return float(result.x)


def _common_joints(reference: Motion, executed: Motion) -> tuple[str, ...]:
    """List the joints that both motions have."""
    names = tuple(n for n in reference.joint_names if n in executed.joint_names)
    if not names:
        raise MotionError("The motions have no common joints.")
    return names


def _evenly(motion: Motion) -> np.ndarray:
    """Sample joints with ``PERIOD``, shape (n, n_joints)."""
    count = int((motion.times[-1] - motion.times[0]) / PERIOD) + 1
    if count > MAX_TIMES:
        raise MotionError(
            f"A motion of {count * PERIOD:.0f} s is too long to find its time shift; "
            f"the limit is {MAX_TIMES * PERIOD:.0f} s. Cut it, or give the shift."
        )
    return sample(motion, motion.times[0] + PERIOD * np.arange(count)).positions


def _overlap(reference: Motion, executed: Motion, shift: float) -> tuple[float, float]:
    """Find the common time of both, in that of the reference, in [s]."""
    first = max(float(reference.times[0]), float(executed.times[0]) - shift)
    return first, min(float(reference.times[-1]), float(executed.times[-1]) - shift)


def _mean_square(reference: Motion, executed: Motion, shift: float) -> float:
    """Compute the mean square of the errors of the same joints.

    At the samples of the executed motion: between them, noise is smaller.
    """
    first, last = _overlap(reference, executed, shift)
    is_common = (executed.times >= first + shift) & (executed.times <= last + shift)
    if not is_common.any():
        return np.inf
    desired = sample(reference, executed.times[is_common] - shift).positions
    return float(np.mean((executed.positions[is_common] - desired) ** 2))


def _distances(robot: Description, desired: Motion, found: Motion) -> np.ndarray:
    """Compute the mean distance of links in two motions, in [m], shape (n,).

    Both have the same times; without a base, it is at the origin.
    """
    links = [row for row, name in enumerate(robot.link_names) if name != WORLD]
    kinematics, T_base_root = Kinematics(robot), root_in_base(robot)
    distances = np.empty(len(desired.times))
    for begin in range(0, len(distances), BATCH):
        part, places = slice(begin, begin + BATCH), []
        for motion in (desired, found):
            positions = of_robot(motion.joint_names, motion.positions[part], robot)
            base = np.tile(IDENTITY, (len(positions), 1))
            if motion.base_poses is not None:
                base = motion.base_poses[part]
            poses = kinematics.link_poses(compose(base, T_base_root), positions)
            places.append(poses[:, links, :3])
        offsets = np.linalg.norm(places[1] - places[0], axis=-1)
        distances[part] = offsets.mean(axis=1)
    return distances


def _error(sizes: np.ndarray, times: np.ndarray) -> Error:
    """Summarize the sizes of an error at times, shape (n,)."""
    row = int(np.argmax(sizes))
    rms = float(np.sqrt(np.mean(sizes**2)))
    return Error(rms, float(sizes[row]), float(times[row]))


def _rows(finding: Finding, times: np.ndarray) -> np.ndarray:
    """Find the samples nearest to the beginning of a finding's intervals, and within.

    Intervals outside of the compared times, in [s], are left out.
    """
    rows = []
    for begin, end in finding.intervals:
        if end < times[0] - SNAP or begin > times[-1] + SNAP:
            continue
        rows.append(np.array([np.argmin(np.abs(times - begin))]))
        rows.append(np.flatnonzero((times >= begin) & (times <= end)))
    return np.concatenate(rows) if rows else np.zeros(0, dtype=int)


def _slip(verdict: Verdict) -> dict[str, float]:
    """Integrate the speed of links that slide on the floor, in [m]."""
    measured = verdict.measured
    if measured is None or measured.ground is None or len(measured.times) < 2:
        return {}
    speeds = np.nan_to_num(measured.once(slides))
    steps = np.diff(measured.times)[:, np.newaxis]
    paths = (0.5 * (speeds[1:] + speeds[:-1]) * steps).sum(axis=0)
    return dict(zip(measured.ground_links, paths.tolist()))
