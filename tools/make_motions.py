"""Write the motions of the package; see tools/make_motions."""

import sys
from inspect import cleandoc
from pathlib import Path

import numpy as np

from g1_description import Robot
from g1_description.motion.files.table import BASE, TIME
from g1_description.robot.rotation import conjugate, multiply, to_rotation_vector

RATE = 50.0  # [Hz]
DIGITS = 4  # behind the point, of [s], [m] and [rad]
DAMPING = 1e-3  # of the least squares
ITERATIONS = 100
LARGEST_STEP = 0.1  # of a joint in an iteration [rad]
CONVERGED = 1e-6  # [m] and [rad]

robot = Robot()
FEET = ("left_ankle_roll_link", "right_ankle_roll_link")
HAND = "right_rubber_hand"


def columns_of(side, *parts):
    """List the columns of joints."""
    return [robot.joint_row(f"{side}_{part}_joint") for part in parts]


LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow")
MOVED = {
    FEET[0]: (columns_of("left", *LEG), 6),
    FEET[1]: (columns_of("right", *LEG), 6),
    HAND: (columns_of("waist", "yaw", "pitch") + columns_of("right", *ARM), 3),
}
"""The joints that place a link, and how much of its pose counts: all, or its place."""

STAND = robot.named_configuration("stand")
REST = robot.on_floor(
    robot.trajectory([0.0], STAND[np.newaxis], base=[[0, 0, 0, 0, 0, 0, 1]])
)
HEIGHT = REST.base_poses[0, 2]  # of the pelvis above the floor, standing [m]
PLACES = robot.link_poses(STAND, REST.base_poses[0])
CENTER = np.mean([PLACES[foot][:2] for foot in FEET], axis=0) + np.array([0.03, 0.0])


def eased(times, *knots):
    """Move from value to value with minimum jerk; held before, between and after.

    Args:
        times: In [s], shape (n,).
        knots: A time in [s] and a value, of shape (...), each.

    Returns:
        The values, shape (n, ...).
    """
    at, values = zip(*knots)
    values = np.array(values, dtype=float)
    found = np.repeat(values[:1], len(times), axis=0)
    for begin, end, step in zip(at, at[1:], np.diff(values, axis=0)):
        s = np.clip((times - begin) / (end - begin), 0.0, 1.0)
        found += np.multiply.outer(s**3 * (10.0 - 15.0 * s + 6.0 * s**2), step)
    return found


def solved(times, joints=(), height=HEIGHT, lean=0.0, center=CENTER, poses=()):
    """Compute a motion from what its body parts do.

    Args:
        times: In [s], shape (n,).
        joints: Positions by joint, shapes (n,); others are those of the pose stand.
        height: Of the pelvis above the floor in [m], shape (n,).
        lean: Of the pelvis forwards in [rad], shape (n,).
        center: Where the centre of mass is, x and y in [m], shape (n, 2).
        poses: Of feet and the right hand by link, shapes (n, 7); other feet stay, and
            the hand turns as it likes.
    """
    n = len(times)
    positions = robot.positions({**dict(zip(robot.joint_names, STAND)), **dict(joints)})
    positions = np.array(np.broadcast_to(positions, (n, len(STAND))))
    base = np.zeros((n, 7))
    base[:, 2] = height
    base[:, 4], base[:, 6] = np.sin(0.5 * lean), np.cos(0.5 * lean)
    targets = {**{foot: PLACES[foot] for foot in FEET}, **dict(poses)}
    for _ in range(ITERATIONS):
        shift = center - robot.center_of_mass(positions, base)[:, :2]
        base[:, :2] += shift
        worst = np.abs(shift).max()
        for link, target in targets.items():
            columns, size = MOVED[link]
            pose = robot.link_poses(positions, base)[link]
            turn = multiply(target[..., 3:], conjugate(pose[:, 3:]))
            error = np.hstack([target[..., :3] - pose[:, :3], to_rotation_vector(turn)])
            error = error[:, :size, np.newaxis]
            J = robot.jacobian(link, positions, base)[:, :size, 6:][:, :, columns]
            J_t = np.swapaxes(J, 1, 2)
            damped = J @ J_t + DAMPING**2 * np.eye(size)
            step = (J_t @ np.linalg.solve(damped, error))[..., 0]
            positions[:, columns] += np.clip(step, -LARGEST_STEP, LARGEST_STEP)
            worst = max(worst, np.abs(error).max())
        if worst < CONVERGED:
            return robot.trajectory(times, positions, base=base)
    raise SystemExit(f"tools/make_motions: not reached, by {worst:.3g}")


FORWARD, UP = np.eye(7)[[0, 2]]  # of a pose


def clock(seconds):
    """Return the times of samples, shape (n,)."""
    return np.arange(round(seconds * RATE) + 1) / RATE


def squat():
    """Down, with both arms forward, and up again."""
    t = clock(6.0)
    down = eased(t, (0.4, 0.0), (2.4, 1.0), (3.2, 1.0), (5.4, 0.0))
    joints = {
        "left_shoulder_pitch_joint": 0.2 - 1.6 * down,
        "right_shoulder_pitch_joint": 0.2 - 1.6 * down,
        "left_shoulder_roll_joint": 0.15 + 0.1 * down,
        "right_shoulder_roll_joint": -0.15 - 0.1 * down,
        "left_elbow_joint": 0.9 + 0.5 * down,
        "right_elbow_joint": 0.9 + 0.5 * down,
        "waist_pitch_joint": 0.2 * down,
    }
    return solved(t, joints, height=HEIGHT - 0.26 * down, lean=0.25 * down)


def wave():
    """The right arm goes up, and its forearm waves three times."""
    t = clock(6.0)
    up = eased(t, (0.3, 0.0), (1.6, 1.0), (4.6, 1.0), (5.8, 0.0))
    swing = eased(t, (1.5, 0.0), (1.9, 1.0), (4.2, 1.0), (4.7, 0.0))
    beat = swing * np.sin(2.0 * np.pi * 1.2 * (t - 1.5))
    joints = {
        "right_shoulder_pitch_joint": 0.2 - 0.2 * up,
        "right_shoulder_roll_joint": -0.15 - 1.15 * up,
        "right_shoulder_yaw_joint": -1.5708 * up,
        "right_elbow_joint": 0.9 - 0.5 * up + 0.4 * beat,
        "right_wrist_roll_joint": 0.15 * beat,
        "waist_roll_joint": -0.05 * up,
        "waist_yaw_joint": -0.1 * up,
    }
    return solved(t, joints)


def step_in_place():
    """The weight goes from foot to foot, and the other foot is lifted."""
    t = clock(8.0)
    poses, way = {}, np.zeros(len(t))
    for foot, begin, side in ((FEET[1], 0.1, 1.0), (FEET[0], 4.0, -1.0)):
        lift, down = begin + 1.5, begin + 2.4
        up = eased(t, (lift, 0.0), (lift + 0.45, 0.07), (down, 0.0))
        poses[foot] = PLACES[foot] + np.multiply.outer(up, UP)
        knots = (begin, 0.0), (lift - 0.1, side), (down, side), (begin + 3.8, 0.0)
        way += eased(t, *knots)
    # A tenth inside the middle of the foot: the swinging leg pulls outwards.
    center = CENTER + np.multiply.outer(way, [0.0, 0.9 * PLACES[FEET[0]][1]])
    joints = {
        "left_shoulder_pitch_joint": 0.2 + 0.25 * way,
        "right_shoulder_pitch_joint": 0.2 - 0.25 * way,
    }
    return solved(t, joints, height=HEIGHT - 0.02, center=center, poses=poses)


def reach():
    """The right hand goes to a place in front and back, the knees bend."""
    t = clock(5.0)
    far = eased(t, (0.3, 0.0), (2.0, 1.0), (2.8, 1.0), (4.7, 0.0))
    hand = np.tile(PLACES[HAND], (len(t), 1))
    hand[:, :3] += np.multiply.outer(far, np.array([0.4, -0.12, 0.9]) - hand[0, :3])
    joints = {
        "left_shoulder_pitch_joint": 0.2 + 0.3 * far,
        "left_shoulder_roll_joint": 0.15 + 0.1 * far,
    }
    return solved(t, joints, height=HEIGHT - 0.08 * far, poses={HAND: hand})


def faulty():
    """Six faults, one after another.

    velocity        0.8 s  the left wrist turns faster than 22 rad/s
    self_collision  1.8 s  the right upper arm is in the torso
    position        2.9 s  the left elbow is 0.2 rad beyond its upper limit
    skating         4.0 s  both feet slide 12 cm forwards
    penetration     5.2 s  both feet are 2 cm below the floor
    center_of_mass  7.5 s  the robot leans forwards and would tip over
    """
    t = clock(8.0)
    out = eased(t, (0.0, 0.0), (0.4, 0.5), (1.2, 0.5), (1.7, 0.0))
    spin = eased(t, (0.2, 0.0), (0.7, -1.5), (0.92, 1.5), (1.4, 0.0))
    inwards = eased(t, (1.3, 0.0), (1.7, 1.0), (1.9, 1.0), (2.3, 0.0))
    stretch = eased(t, (2.3, 0.0), (2.8, 1.0), (3.0, 1.0), (3.5, 0.0))
    joints = {
        "left_shoulder_roll_joint": 0.15 + out,
        "left_wrist_yaw_joint": spin,
        "right_shoulder_roll_joint": -0.15 + 0.4 * inwards,
        "right_elbow_joint": 0.9 - 0.9 * inwards,
        "left_elbow_joint": 0.9 + 1.3944 * stretch,
    }
    slide = eased(t, (3.5, 0.0), (4.5, 0.12))
    sink = eased(t, (4.6, 0.0), (5.1, 0.02), (5.3, 0.02), (5.8, 0.0))
    lean = eased(t, (5.7, 0.0), (7.1, 0.11))
    moved = np.multiply.outer(slide, FORWARD) - np.multiply.outer(sink, UP)
    poses = {foot: PLACES[foot] + moved for foot in FEET}
    center = CENTER + np.multiply.outer(slide + lean, FORWARD[:2])
    height = HEIGHT - sink - 0.4 * lean
    return solved(t, joints, height=height, center=center, poses=poses)


def write(path, motion, about):
    """Write a motion as CSV with a header."""
    table = np.column_stack([motion.times, motion.base_poses, motion.positions])
    names = [TIME, *BASE, *motion.joint_names]
    lines = [f"# {line}".rstrip() for line in about] + [",".join(names)]
    for row in table:
        # Adding 0.0 makes 0.0 of -0.0.
        lines.append(",".join(f"{value:g}" for value in np.round(row, DIGITS) + 0.0))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def main():
    """Write all motions."""
    out = Path(sys.argv[1])
    out.mkdir(parents=True, exist_ok=True)
    for make in (squat, wave, step_in_place, reach, faulty):
        path = out / f"{make.__name__}.csv"
        write(path, make(), cleandoc(make.__doc__).splitlines())
        print(f"tools/make_motions: wrote {path}")


if __name__ == "__main__":
    main()
