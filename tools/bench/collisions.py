"""How many configurations are checked for self-collision, and by which engine.

Configurations are random inside the limits, where every one has some six collisions,
and those of motions of other people, where few have any. All pairs are checked but for
those of config/collisions_g1.yaml. Times are the processor's, the shortest of several
runs in turn, as other work of the machine makes them longer. The engines measure the
same pairs: those that spheres, boxes and separating planes leave over; hpp-fcl's
distances are exact on the same hulls, and the others are compared with them.
"""

import resource
import time
from pathlib import Path

import numpy as np

from g1_description.collisions.allowed_pairs import read_allowed_pairs
from g1_description.collisions.convex_shapes import robot_shapes
from g1_description.collisions.distances import SLACK, ShapeCollisions
from g1_description.collisions.find_pairs import random_poses
from g1_description.collisions.self_collisions import SelfCollisions
from g1_description.files.uris import with_absolute_uris
from g1_description.motion.files.read import read_motion
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.urdf import parse_urdf

from .collision_engines import ENGINES, REACH
from .start_up import measure_models

ROOT = Path(__file__).resolve().parents[2]
CLIPS = ("B_HandsUp.csv", "M_ShortMove13.csv", "J_ShortDance16_JazzWalk.csv")
MOTIONS = ROOT.parent / "shared" / "data" / "motions"
ALLOWED = ROOT / "config" / "collisions_g1.yaml"
RUNS = 7
SAMPLES = 4000
NEAR = 0.02  # [m]
TARGET = ">= 5000"


def run(bench):
    """Check the package's model, and the vendor's where it is here."""
    measure_models(bench, measure, TARGET)


def measure(bench, name, model, target=TARGET):
    """Measure one model: checks of everything, then engines on the same pairs."""
    text = with_absolute_uris(model.read_text(encoding="utf-8"), model.parent)
    robot = parse_urdf(text)
    before, start = memory(), time.process_time()
    collisions = SelfCollisions(robot, read_allowed_pairs(ALLOWED))
    bench.add(f"{name}: preparing", time.process_time() - start, "s")
    poses = random_poses(robot, np.random.RandomState(1), bench.count(SAMPLES, 500))
    sets = {"random": poses, **clips(bench, robot)}
    jobs = {
        f"{kind}{suffix}": (len(rows), collisions.contacts, (rows, margin))
        for kind, rows in sets.items()
        for suffix, margin in (("", 0.0), (", also what is nearer than 20 mm", NEAR))
    }
    bench.say(f"{name}: configurations")
    for kind, (count, seconds) in shortest(jobs, bench.count(RUNS, 2)).items():
        bound = target if kind == "random" else ""
        bench.add(f"{name}: {kind}", count / seconds, "1/s", bound)
    bench.add(f"{name}: memory for this", memory() - before, "MB")
    compare(bench, name, robot, collisions, poses)


def clips(bench, robot):
    """Place the links of the motions of other people."""
    files = [MOTIONS / name for name in CLIPS]
    if not all(file.exists() for file in files):
        bench.leave_out("motions of other people: they are not here")
        return {}
    found = []
    for file in files:
        motion = read_motion(file, robot, 60.0).trajectory
        order = [motion.joint_names.index(j.name) for j in robot.movable_joints]
        positions = motion.positions[:, order]
        found.append(Kinematics(robot).link_poses(motion.base_poses, positions))
    return {"motions": np.concatenate(found)}


def compare(bench, name, robot, collisions, poses):
    """Let all engines measure the pairs that are left over."""
    shapes = robot_shapes(robot)
    finder = ShapeCollisions(shapes.shapes)
    row = {link: number for number, link in enumerate(shapes.links)}
    pairs = [(row[a], row[b]) for a, b in collisions.pairs]
    poses = poses[:1000]
    *_, placed = finder.candidates(poses, finder.shape_pairs(pairs), SLACK)
    bench.add(f"{name}: pairs left over per configuration", len(placed.a) / len(poses))
    engines = {}
    for engine in ENGINES:
        try:
            engines[engine.name] = engine(shapes.shapes)
        except ImportError:
            bench.leave_out(f"{engine.name}: it is not installed")
    bench.say(f"{name}: engines")
    jobs = {
        engine: (len(placed.a), made.distances, (placed,))
        for engine, made in engines.items()
    }
    for engine, (count, seconds) in shortest(jobs, bench.count(RUNS, 2)).items():
        bench.add(f"{name}: a pair by {engine}", 1e6 * seconds / count, "us")
    differences(bench, name, engines, placed)


def differences(bench, name, engines, placed):
    """Tell how far engines are from the exact one, where shapes overlap."""
    found = {engine: made.distances(placed) for engine, made in engines.items()}
    exact = found.pop("hpp-fcl", None)
    if exact is None:
        return
    for engine, distances in found.items():
        error = 1e3 * np.abs(distances - exact)
        for kind, rows in (("deep", exact < 0.0), ("apart", exact > 0.0)):
            rows = rows & ~np.isnan(distances) & (exact < REACH)
            if rows.any():
                bench.add(
                    f"{name}: {engine}, largest error {kind}", error[rows].max(), "mm"
                )


def shortest(jobs, runs):
    """Run jobs in turn; give their counts and shortest processor times in [s]."""
    times = {name: [] for name in jobs}
    for _ in range(runs):
        for name, (_, function, arguments) in jobs.items():
            start = time.process_time()
            function(*arguments)
            times[name].append(time.process_time() - start)
    return {name: (jobs[name][0], min(taken)) for name, taken in times.items()}


def memory():
    """Give the memory that this process holds, in [MB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return 1e-6 * pages * resource.getpagesize()
