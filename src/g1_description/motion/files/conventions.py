"""Conventions that a file does not state, detected from its numbers.

Names of joints, order of quaternions, and units of angles differ between publishers of
files with the same shape.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from g1_description.errors import MotionError
from g1_description.motion.files.source import MotionSource
from g1_description.motion.motion import Motion
from g1_description.robot.assembly import WORLD
from g1_description.robot.description import Description, Joint
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.rotation import rotate
from g1_description.robot.transform import IDENTITY, compose
from g1_description.robot.tree import below

LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
WAIST = ("waist_yaw", "waist_roll", "waist_pitch")
ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow")
WRIST = ("wrist_roll", "wrist_pitch", "wrist_yaw")


def _g1_joints(waist: Sequence[str], arm: Sequence[str]) -> tuple[str, ...]:
    """Name the joints of a G1 in the order of the vendor's files."""
    legs = [f"{side}_{joint}" for side in ("left", "right") for joint in LEG]
    arms = [f"{side}_{joint}" for side in ("left", "right") for joint in arm]
    return tuple(f"{name}_joint" for name in (*legs, *waist, *arms))


G1_JOINTS = {
    29: _g1_joints(WAIST, (*ARM, *WRIST)),
    27: _g1_joints(WAIST[:1], (*ARM, *WRIST)),
    23: _g1_joints(WAIST[:1], (*ARM, WRIST[0])),
}
"""Joints of the G1's versions by their number, in the order of the vendor's files."""

ASAP_JOINTS = _g1_joints(WAIST, ARM)
"""The other layout of 23 joints: ASAP, PBHC and GMT lock the wrists."""

_ISAAC_ORDER = (
    *(0, 6, 12, 1, 7, 13, 2, 8, 14, 3, 9, 15, 22, 4, 10, 16, 23, 5, 11, 17, 24),
    *(18, 25, 19, 26, 20, 27, 21, 28),
)
ISAAC_JOINTS = tuple(G1_JOINTS[29][number] for number in _ISAAC_ORDER)
"""The 29 joints breadth first, as Isaac Lab lists them."""

ISAAC_LAB = "isaaclab"
JOINT_ORDERS = ("mujoco", ISAAC_LAB)
"""Orders of joints without names: that of the robot's file, and breadth first."""

_LIMITS = {
    "waist_roll_joint": 0.52,
    "waist_pitch_joint": 0.52,
    "left_wrist_roll_joint": 1.972,
    "right_wrist_roll_joint": 1.972,
}
"""Limits in [rad] of the joints in which the two versions of 23 joints differ."""

BEYOND = 0.05
"""Tolerance of the limits of a layout, in [rad]."""

SOLES = ("left_foot", "right_foot")
"""Roles of the links of a profile whose z axes are normal to the soles."""

MAX_TILT = 25.0
"""Largest tilt of the lower sole of a standing robot, in [deg]."""

LOWEST_FOOT = -0.3
"""Least height of the lower foot of a standing robot, in [m]."""

SAME_TILT = 3.0
"""Smaller differences in tilt do not decide the quaternion order, in [deg]."""

N_SAMPLES = 100
"""Samples that are examined for the order of quaternions."""

MAX_ANGLE = 10.0
"""Larger angles of revolute joints must be degrees, even unwrapped, in [rad]."""

W_FIRST_COLUMNS = [0, 1, 2, 4, 5, 6, 3]
"""How poses with quaternions w x y z are read as if they had x y z w."""

OTHER_ORDER = {"wxyz": "xyzw", "xyzw": "wxyz"}
"""The two orders of quaternions, each by the other one."""

W_FIRST = "Base quaternions are read as w x y z: only then are the feet flat."

EITHER = (
    "Base quaternions are read as x y z w, though the feet are flat in w x y z, too; "
    "set --order to be certain."
)

UNKNOWN_QUATERNION = (
    "Cannot tell the quaternion order of the base: the feet are flat in neither. Give "
    "it, --order xyzw or --order wxyz; or the joints are in another order, "
    "--input-joint-order isaaclab."
)


def names_of_columns(
    source: MotionSource, positions: np.ndarray, robot: Description
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Name the joints of a file without names.

    23 joints of a G1 have two layouts. For another robot than one of 23 joints they are
    ASAP's if they are within ASAP's limits, else Unitree's: right for 125 of 126 files,
    of which 67 were in ASAP's layout and 59 cut to Unitree's.

    Args:
        source: The file, for the order of joints if the user gives it.
        positions: Positions of the joints, shape (n_samples, n_joints).
        robot: The robot; if the numbers of joints are equal, its names in their order.

    Returns:
        The names, those of a G1 if the robot has another number of joints, and a
        message on the assumption.

    Raises:
        MotionError: If no known robot has that number.
    """
    found = layouts(positions.shape[1], robot)
    is_isaac = source.options.joint_order == ISAAC_LAB
    ordered = [breadth_first(robot, n) if is_isaac else n for n in found]
    if len(found) == 1:
        return ordered[0], ()
    excess = [_excess(positions, names, robot) for names in ordered]
    fitting = [number for number, beyond in enumerate(excess) if beyond <= BEYOND]
    best = fitting[0] if fitting else int(np.argmin(excess))
    is_asap = found[best] == ASAP_JOINTS
    layout = "Unitree's layout (waist_yaw and wrist_roll)"
    if is_asap:
        layout = "ASAP's layout (3 waist joints, no wrists)"
    why = "the other's limits are exceeded"
    if len(fitting) != 1:
        why = f"both layouts are {'within' if fitting else 'beyond'} limits"
    note = (
        f"23 unnamed joints are ambiguous; assuming {layout}: {why}. Name the joints "
        "in a CSV header."
    )
    return ordered[best], (note,)


def layouts(n_joints: int, robot: Description) -> list[tuple[str, ...]]:
    """List possible names of the joints of a file, the likeliest first.

    Raises:
        MotionError: If no known robot has that number.
    """
    own = tuple(joint.name for joint in robot.movable_joints)
    found = [own] if n_joints == len(own) else []
    if found and set(own) not in (set(G1_JOINTS[23]), set(ASAP_JOINTS)):
        return found
    if set(G1_JOINTS[29]) & set(own):
        known = (ASAP_JOINTS, *G1_JOINTS.values())
        others = [names for names in known if len(names) == n_joints]
        found += [names for names in others if set(names) != set(own)]
    if not found:
        raise MotionError(
            f"The file has {n_joints} unnamed joints, but {robot.name} has "
            f"{len(own)}. Name the columns, or choose another robot."
        )
    return found


def breadth_first(robot: Description, names: Collection[str]) -> tuple[str, ...]:
    """List named joints breadth first, as Isaac Lab does, as if all others were fixed.

    Args:
        robot: The robot.
        names: Names of the joints; those that the robot does not have are left out.
    """
    depth = {robot.root: 0}
    found: list[Joint] = []
    for joint in below([robot.root], robot.joints):
        is_named = joint.name in names
        depth[joint.child] = depth[joint.parent] + is_named
        found += [joint] if is_named else []
    found.sort(key=lambda joint: depth[joint.child])
    return tuple(joint.name for joint in found)


def _excess(positions: np.ndarray, names: tuple[str, ...], robot: Description) -> float:
    """Return the largest excess of positions over the limits, in [rad]."""
    limits = {name: (-limit, limit) for name, limit in _LIMITS.items()}
    limits.update({j.name: (j.lower, j.upper) for j in robot.movable_joints})
    lower, upper = np.array([limits.get(n, (-np.inf, np.inf)) for n in names]).T
    excess = np.maximum(lower - positions, positions - upper)
    return float(excess.max(initial=-np.inf))


def isaac_joints(source: MotionSource) -> tuple[str, ...]:
    """Name the 29 joints of a format that has Isaac Lab's order."""
    is_other = source.options.joint_order not in (None, ISAAC_LAB)
    return G1_JOINTS[29] if is_other else ISAAC_JOINTS


def base_of(
    places: np.ndarray, turns: np.ndarray, order: str | None = None
) -> np.ndarray:
    """Join places and quaternions of a format to poses, shape (n, 7).

    Args:
        places: In [m], shape (n, 3).
        turns: Quaternions, shape (n, 4).
        order: Theirs, xyzw or wxyz; None: wxyz.
    """
    if order != "xyzw":
        turns = turns[:, [1, 2, 3, 0]]
    return np.concatenate([places, turns], axis=1)


def known_velocities(motion: Motion) -> np.ndarray | None:
    """Return the velocities of joints; None if all are zero though positions change.

    Some writers fill in zeros, and streamed configurations have no velocities.
    """
    velocities, positions = motion.velocities, motion.positions
    if velocities is None or velocities.any() or len(positions) < 2:
        return velocities
    return None if np.ptp(positions, axis=0).any() else velocities


def w_last(
    motion: Motion,
    robot: Description,
    order: str | None = None,
    is_w_last: bool = False,
) -> Motion:
    """Convert base quaternions from w x y z to x y z w, if necessary.

    The sole of the lower foot decides: of 67 files, 62 x y z w and 5 w x y z, its tilt
    (the median of up to 100 samples) was smaller in the right order in all, at most 17
    degrees, and 13 to 180 in the wrong one. It does not decide for a robot that lies; a
    robot whose profile has no ``SOLES`` is not checked. If the robot stands upright in
    both orders, x y z w is assumed, with a message.

    Args:
        motion: With a base, whose quaternions are as in the file.
        robot: The robot.
        order: The order, xyzw or wxyz, if the user gives it.
        is_w_last: Whether the format has x y z w, unless flat feet show otherwise.

    Returns:
        The motion, with a message if its quaternions are not certainly x y z w.

    Raises:
        MotionError: If the order is unknown, or joints are in degrees.
    """
    check_radians(motion, robot)
    base = motion.base_poses
    if base is None or order == "xyzw":
        return motion
    other = replace(motion, base_poses=base[:, W_FIRST_COLUMNS])
    if order == "wxyz":
        return other
    if not has_soles(robot):
        return motion
    as_read, turned = map(tilt_on_floor, lower_feet(motion, robot, W_FIRST_COLUMNS))
    if min(as_read, turned) > MAX_TILT and not is_w_last:
        raise MotionError(UNKNOWN_QUATERNION)
    if as_read <= turned + SAME_TILT or turned > MAX_TILT:
        is_open = abs(as_read - turned) <= SAME_TILT and not is_w_last
        return replace(motion, notes=(*motion.notes, *([EITHER] if is_open else ())))
    return replace(other, notes=(*motion.notes, W_FIRST))


def has_soles(robot: Description) -> bool:
    """Return whether a robot is one whose feet show how it stands."""
    is_whole = robot.root != WORLD and len(robot.roots) == 1
    return is_whole and {*SOLES} <= {*robot.profile.links}


def tilt_on_floor(lower: np.ndarray) -> float:
    """Find the tilt of the lower feet in [deg]; infinite if below the floor."""
    return np.inf if np.median(lower[:, 2]) < LOWEST_FOOT else tilt(lower)


def tilt(lower: np.ndarray) -> float:
    """Find the tilt of the soles of the lower feet in [deg], the median."""
    upward = rotate(lower[:, 3:], np.array([0.0, 0.0, 1.0]))[:, 2]
    return float(np.degrees(np.arccos(np.clip(np.median(upward), -1.0, 1.0))))


def lower_feet(
    motion: Motion, robot: Description, columns: Sequence[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Place the lower one of ``SOLES`` in up to ``N_SAMPLES`` samples.

    Args:
        motion: With a base.
        robot: The robot.
        columns: Another order of the elements of the base's poses.

    Returns:
        Poses of the foot for the base as it is, and for that of the columns, each of
        shape (n, 7).
    """
    samples = np.unique(np.linspace(0, len(motion.times) - 1, N_SAMPLES).astype(int))
    positions = of_robot(motion.joint_names, motion.positions[samples], robot)
    rows = [robot.link_names.index(robot.profile.links[role]) for role in SOLES]
    still = np.tile(IDENTITY, (len(samples), 1))
    T_base_feet = Kinematics(robot).link_poses(still, positions)[:, rows]
    assert motion.base_poses is not None
    base = motion.base_poses[samples, np.newaxis]

    def lower(T_map_base: np.ndarray) -> np.ndarray:
        feet = compose(T_map_base, T_base_feet)
        lowest = np.argmin(feet[..., 2], axis=1)
        return np.asarray(feet[np.arange(len(samples)), lowest])

    return lower(base), lower(base[..., list(columns)])


def of_robot(
    names: Sequence[str], positions: np.ndarray, robot: Description
) -> np.ndarray:
    """Arrange positions in the order of the robot's joints; missing ones are at zero.

    Args:
        names: Names of the file's joints; unknown ones are ignored.
        positions: Their positions, shape (n_samples, n_joints).
        robot: The robot.

    Returns:
        Positions of the movable joints, shape (n_samples, n_movable_joints).
    """
    column = {name: number for number, name in enumerate(names)}
    found = np.zeros((len(positions), len(robot.movable_joints)))
    for number, joint in enumerate(robot.movable_joints):
        if joint.name in column:
            found[:, number] = positions[:, column[joint.name]]
    return found


def with_endings(motion: Motion, robot: Description) -> Motion:
    """Add ``_joint`` to the names of joints if that makes all of them the robot's."""
    own = {joint.name for joint in robot.movable_joints}
    names = {name: f"{name}_joint" for name in motion.joint_names}
    if not names or {*names} & own or not {*names.values()} <= own:
        return motion
    note = "Joint names lack the ending _joint, which is added."
    return replace(motion.renamed(names), notes=(*motion.notes, note))


def check_radians(motion: Motion, robot: Description) -> None:
    """Check that angles are in radians.

    Args:
        motion: Motion of joints of the robot.
        robot: The robot. Continuous joints may turn any number of times.

    Raises:
        MotionError: If an angle is too large for radians.
    """
    revolute = {j.name: j for j in robot.movable_joints if j.kind == "revolute"}
    positions = np.abs(motion.positions)
    for number, name in enumerate(motion.joint_names):
        if name not in revolute or positions[:, number].max() <= MAX_ANGLE:
            continue
        row = int(np.argmax(positions[:, number]))
        joint = revolute[name]
        raise MotionError(
            f"{name} is at {motion.positions[row, number]:.6g} in sample "
            f"{row + 1}, with limits of {joint.lower:.3g} and {joint.upper:.3g} rad: "
            "this looks like degrees. Positions must be in radians."
        )
