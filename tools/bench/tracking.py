"""How well motors in hold follow motions, and what that costs.

The robot goes from standing straight to a squat and back in 3 s each, standing free;
then, hanging, its arms go through four poses in a second each; then, standing free, it
goes through motions of other people, which nothing keeps in balance: the legs do what
they are told, and the robot falls. Errors are position minus target at every step of
1 ms. A base has fallen when it leans by more than 45 degrees from the motion's, or has
sunk by 0.25 m more. Up to there, and over the whole motion, errors are told apart.
Processor time is that of the simulator's step, beside a step in which a joint is
commanded anew.
"""

from __future__ import annotations

import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np

from g1_description.files.uris import with_absolute_uris
from g1_description.motion.edit import minimum_jerk_trajectory
from g1_description.motion.files.read import read_motion
from g1_description.motion.motors import read_motors
from g1_description.motion.trajectory import sample
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.poses import parse_poses
from g1_description.robot.urdf import parse_urdf
from g1_description.sim.motions import WATCH_TIME
from g1_description.sim.standing import hanging_height, standing_height
from g1_description.sim.world import World

ROOT = Path(__file__).resolve().parents[2]
SHARED = ROOT.parent / "shared" / "data"
VENDOR = SHARED / "unitree_g1" / "g1_29dof_rev_1_0.urdf"
CLIPS = ("B_HandsUp.csv", "M_ShortMove13.csv", "J_ShortDance16_JazzWalk.csv")
RATE = 60.0  # [Hz] of the clips
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
STEP = 1e-3  # [s]
WATCH = round(1e-9 * WATCH_TIME / STEP) + 1
POSES = parse_poses((ROOT / "config" / "poses.yaml").read_text(), "poses.yaml")


class Stage:
    """A robot in a world of its own."""

    def __init__(self, model, positions, pose=None, fixed=False):
        """Put it on the floor, or hang it up.

        Args:
            model: Its file.
            positions: Where its joints begin, by name.
            pose: Of its base, whose height is replaced; None: upright at the origin.
            fixed: Whether its base is.
        """
        text = with_absolute_uris(model.read_text(encoding="utf-8"), model.parent)
        robot = replace(lump_fixed_joints(parse_urdf(text)), positions=positions)
        pose = np.array([0.0, 0.0, 0.0, *UPRIGHT]) if pose is None else pose.copy()
        pose[2] = (hanging_height if fixed else standing_height)(robot, pose[3:])
        motors = read_motors(ROOT / "config" / "motors.yaml")
        self.world = World("hold", motors=motors)
        self.world.spawn("robot", robot, pose, fixed)
        self.robot = self.world.model("robot")
        self.cost = []

    def close(self):
        """End the world."""
        self.world.close()

    def step(self):
        """Let a step pass, and note its processor time."""
        begin = time.process_time()
        self.world.step()
        self.cost.append(time.process_time() - begin)

    def go(self, pose, seconds):
        """Go to a pose; return the errors at each step, shape (n_steps, n_joints)."""
        names = self.robot.joint_names
        goal = np.array([POSES[pose].positions.get(name, 0.0) for name in names])
        start = np.array(self.robot.position)
        return self.follow(minimum_jerk_trajectory(names, start, goal, seconds))

    def follow(self, motion):
        """Follow a motion to its end; return the errors at each step."""
        start = self.world.time_ns + round(1e9 * STEP)
        self.world.motions.play(self.robot, motion, start)
        times = np.arange(0.0, motion.duration + STEP / 2.0, STEP)
        wanted = sample(motion, times).positions
        rows = self.robot.joint_rows(motion.joint_names)
        errors = np.zeros_like(wanted)
        for number in range(len(times)):
            self.step()
            errors[number] = self.robot.position[rows] - wanted[number]
        return errors

    def report(self):
        """Wait until the last motion is told; return its report."""
        for _ in range(WATCH):
            self.world.step()
        return self.world.motions.take_tracked()[-1].report


def rms(errors):
    """Give the root of the mean square of each joint, shape (n_joints,)."""
    return np.sqrt(np.mean(errors**2, axis=0))


def run(bench):
    """Measure poses on the package's model, motions on the vendor's."""
    squat(bench)
    arms(bench)
    if not VENDOR.exists():
        bench.leave_out("motions of other people: they are not here")
        return
    for clip in CLIPS:
        follow_clip(bench, SHARED / "motions" / clip)


def squat(bench):
    """Squat and stand again, standing free; then what a step costs otherwise."""
    bench.say("squat and stand again")
    with closing(Stage(bench.model, {})) as stage:
        begin = stage.robot.pose
        errors = np.concatenate([stage.go("squat", 3.0), stage.go("zero", 3.0)])
        following = 1e6 * np.median(stage.cost)
        fell = stage.report().fall_time is not None
        moved = np.linalg.norm(stage.robot.pose[:3] - begin[:3])
        bench.add("squat: distance from where it stood", 1e3 * moved, "mm", "< 30")
        bench.add("squat: rms error of the worst joint", rms(errors).max(), "rad")
        bench.add("squat: largest error", np.abs(errors).max(), "rad")
        bench.add("squat: falls", fell, "", "= 0")
        commanded = 1e6 * cost_of_commands(stage, bench.count(1000, 100))
        ratio = following / commanded
        bench.add("squat: processor time of a step, median", following, "us")
        bench.add("commanded joint: the same", commanded, "us")
        bench.add("processor time, squat / commanded joint", ratio, "", "< 1.5")


def cost_of_commands(stage, steps):
    """Give the processor time of a step in which a joint is commanded, in [s]."""
    stage.cost.clear()
    for number in range(steps):
        elbow = 0.1 * np.sin(0.01 * number)
        stage.world.set_joint_positions("robot", {"left_elbow_joint": elbow})
        stage.step()
    return np.median(stage.cost)


def arms(bench):
    """Move the arms of a robot that hangs."""
    bench.say("arms of a hanging robot")
    with closing(Stage(bench.model, {}, fixed=True)) as stage:
        ways = [stage.go(pose, 1.0) for pose in ("wave", "hands_up", "t_pose", "zero")]
        errors = np.concatenate(ways)
        worst = rms(errors).max()
        bench.add("arms: rms error of the worst joint", worst, "rad", "<= 0.02")
        bench.add("arms: largest error", np.abs(errors).max(), "rad")


def follow_clip(bench, file):
    """Go through a motion that nothing keeps in balance."""
    bench.say(file.stem)
    robot = parse_urdf(VENDOR.read_text(encoding="utf-8"))
    motion = read_motion(file, robot, RATE).trajectory
    positions = dict(zip(motion.joint_names, motion.positions[0].tolist()))
    with closing(Stage(VENDOR, positions, motion.base_poses[0])) as stage:
        errors = stage.follow(motion)
        report = stage.report()
        for name, rows in zip(motion.joint_names, errors.T):
            row = report.joint_names.index(name)
            share = 100.0 * report.limit_shares[row]
            bench.say(
                f"{name:27} rms {rms(rows):.4f}  largest {np.abs(rows).max():.4f} rad, "
                f"at effort limit {share:.1f} %"
            )
    tell(bench, file.stem, errors, report)


def tell(bench, name, errors, report):
    """Keep the figures of a motion."""
    fall = report.fall_time
    upright = errors if fall is None else errors[: round(fall / STEP)]
    if fall is not None:
        bench.add(f"{name}: falls after", fall, "s")
        bench.add(f"{name}: until then, worst rms error", rms(upright).max(), "rad")
        largest = np.abs(upright).max()
        bench.add(f"{name}: until then, largest error", largest, "rad")
    bench.add(f"{name}: rms error of all joints", np.sqrt(np.mean(errors**2)), "rad")
    bench.add(f"{name}: rms error of the worst joint", rms(errors).max(), "rad")
    bench.add(f"{name}: largest error", np.abs(errors).max(), "rad")
    share = 100.0 * report.limit_shares.max()
    bench.add(f"{name}: longest at effort limit, of a joint", share, "%")
