r"""Random poses at rest, and whether a level floor can carry them: by geometry alone.

hpp-centroidal-dynamics needs newer libraries than pin of requirements-dev.txt, so it is
in none of these files. In a workspace that is sourced:

    pip install --target FOLDER hpp-centroidal-dynamics
    LIB=FOLDER/cmeel.prefix/lib
    LD_LIBRARY_PATH=$LD_LIBRARY_PATH:$LIB \
    PYTHONPATH=tools:$PYTHONPATH:$LIB/python3.11/site-packages \
    .venv/bin/python -m bench --only forces
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice

import numpy as np
from scipy.spatial import ConvexHull

from g1_description.motion.motion import Motion
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.rotation import conjugate, from_rotation_vector, rotate
from g1_description.sim.standing import outlines

from .ik import random_stands

KINDS = "two feet", "one foot", "hands and knees"
TOUCHES, HOVERS = (0.004, 0.006), 0.016
"""Links touch the floor below the first height and do not above the second one, or the
third one for links at the ends of limbs, in [m]; poses with others are not used."""

FLAT = 0.01
"""Points that support are at most this far above the lowest one of their link, [m]."""

NEAR = 0.15
"""Largest distance of the centre of mass from the ankle, of poses on one foot, [m]."""

FEET = "left_foot", "right_foot"
FRICTION, CERTAIN, SOME = 0.6, 0.002, 1e-3
"""Of the floor; distance from the edge of the support polygon in [m] from which on
verdicts are compared; and the part of the weight that is missing where forces are not
enough."""

SAMPLE = 70
"""Number of poses of each kind for hpp-centroidal-dynamics."""

KNEELING = {"hip_pitch": -1.5, "knee": 1.6, "shoulder_pitch": -1.2, "elbow": 0.3}
DOWN = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True, eq=False)
class StaticPose:
    """A pose at rest, and what carries it."""

    motion: Motion
    """Of one sample."""

    links: tuple[str, ...]
    """The links that touch the floor."""

    points: np.ndarray
    """Where they do, in the map, in [m], shape (k, 3)."""

    center: np.ndarray
    """Centre of mass in the map, in [m], shape (3,)."""

    @property
    def margin(self):
        """Distance of the centre of mass inside the support polygon in [m].

        Outside, it is negative and at most as large as the distance.
        """
        lines = ConvexHull(self.points[:, :2]).equations
        return -(lines @ np.append(self.center[:2], 1.0)).max()


def compare_poses(bench):
    """Compare verdicts on random poses with geometry and with another library."""
    for kind, count in zip(KINDS, (700, 650, 650)):
        with bench.attempt(f"{kind}, at rest"):
            drawn = static_poses(bench.robot, kind, bench.length(count, 20))
            _compare(bench, kind, [p for p in drawn if abs(p.margin) > CERTAIN])


def _compare(bench, name, poses):
    """Compare verdicts on poses of one kind."""
    found = [bench.robot.contact_forces(pose.motion) for pose in poses]
    missing = np.array([each.missing_share[0] for each in found])
    tips = np.array([pose.margin for pose in poses]) < 0.0
    name, of = f"{name}, at rest", f"of {len(poses)}"
    bench.add(f"{name}: beyond the support polygon", tips.sum(), of)
    wrong = np.count_nonzero((missing > SOME) != tips)
    bench.add(f"{name}: other verdicts than the polygon's", wrong, of, "<= 0")
    share = "% of weight"
    bench.add(f"{name}: missing inside, largest", 100 * missing[~tips].max(), share)
    bench.add(f"{name}: missing beyond, least", 100 * missing[tips].min(), share)
    try:
        import hpp_centroidal_dynamics as hpp
    except ImportError as error:
        bench.leave_out(f"hpp-centroidal-dynamics: {error}")
        return
    balanced = [_is_balanced(hpp, bench.robot.mass, pose) for pose in poses[:SAMPLE]]
    wrong = np.count_nonzero((missing[:SAMPLE] > SOME) == np.array(balanced))
    name = f"{name}: other verdicts than hpp-centroidal-dynamics'"
    bench.add(name, wrong, f"of {len(balanced)}", "<= 0")


def _is_balanced(hpp, mass, pose):
    """Ask hpp-centroidal-dynamics for forces in pyramids of friction."""
    solver, up = hpp.Equilibrium("", mass, 4), np.tile(-DOWN, (len(pose.points), 1))
    # Its primal programs give up where there are many points.
    dual = hpp.EquilibriumAlgorithm.EQUILIBRIUM_ALGORITHM_DLP
    solver.setNewContacts(pose.points, up, FRICTION, dual)
    status, robustness = solver.computeEquilibriumRobustness(pose.center)
    return status == hpp.LP_status.LP_STATUS_OPTIMAL and robustness >= 0.0


def static_poses(robot, kind, count):
    """Draw poses in which it is clear which links touch the floor.

    Args:
        robot: The robot.
        kind: One of ``KINDS``.
        count: How many.
    """
    number, outline = KINDS.index(kind), _Outline(robot)
    draw = (_on_two_feet, _on_one_foot, _on_hands_and_knees)[number]
    drawn = draw(robot, outline, np.random.default_rng(number))
    found = (_placed(robot, outline, *each) for each in drawn)
    return islice((pose for pose in found if pose is not None), count)


class _Outline:
    """The shapes of a robot, as points."""

    def __init__(self, robot):
        links = [e for e in robot.description.links if e.collisions or e.visuals]
        self._robot, self._shapes = robot, {e.name: outlines(e) for e in links}
        is_end = Kinematics(robot.description).end_links()
        self.ends = {link for link in self._shapes if is_end[robot.link_row(link)]}
        """Those at the ends of limbs."""

    def placed(self, positions, base):
        """Place the lowest points of each link in the map, in [m], shapes (k, 3)."""
        poses = self._robot.link_poses(positions, base)
        found = {}
        for link, (points, radii) in self._shapes.items():
            turned = rotate(poses[link][3:], points)
            found[link] = poses[link][:3] + turned + radii[:, np.newaxis] * DOWN
        return found


def _placed(robot, outline, positions, base, wanted):
    """Put a pose on the floor; None unless the wanted links, clearly, touch it."""
    points = outline.placed(positions, base)
    lowest = {link: each[:, 2].min() for link, each in points.items()}
    floor = min(lowest.values())
    near = {link for link in points if lowest[link] < floor + TOUCHES[0]}
    unclear = {
        link
        for link in points
        if lowest[link] < floor + (HOVERS if link in outline.ends else TOUCHES[1])
    }
    if near != unclear or not near.issuperset(wanted):
        return None
    base = np.append(base[:3] + floor * DOWN, base[3:])
    places = [points[link] for link in sorted(near)]
    low = [each[each[:, 2] <= each[:, 2].min() + FLAT] for each in places]
    names = tuple(robot.joint_names)
    return StaticPose(
        Motion(np.zeros(1), names, positions[None], None, base[None]),
        tuple(sorted(near)),
        np.concatenate(low) + floor * DOWN,
        robot.center_of_mass(positions, base),
    )


def _on_two_feet(robot, outline, random):
    """Draw poses of pelvis and arms with both soles on the floor."""
    feet = [robot.profile.links[role] for role in FEET]
    stand, base = robot.named_configuration("stand"), np.eye(7)[6]
    base[2] = 0.7634
    for found in random_stands(robot, stand, base, random):
        yield found.positions, found.base, feet


def _on_one_foot(robot, outline, random):
    """Draw poses with a level sole, not too far from the centre of mass."""
    while True:
        side = random.choice(["left", "right"])
        near = 0.3 * (robot.random_configuration(random) - robot.neutral)
        positions = robot.named_configuration("stand") + near
        for axis in ("pitch", "roll"):
            row = robot.joint_row(f"{side}_ankle_{axis}_joint")
            positions[row] = random.uniform(robot.lower[row], robot.upper[row])
        positions = np.clip(positions, robot.lower, robot.upper)
        foot = robot.profile.links[f"{side}_foot"]
        base = np.zeros(7)
        base[3:] = conjugate(robot.link_poses(positions)[foot][3:])
        away = robot.center_of_mass(positions, base)
        away = away - robot.link_poses(positions, base)[foot][:3]
        if np.hypot(*away[:2]) < NEAR:
            yield positions, base, [foot]


def _on_hands_and_knees(robot, outline, random):
    """Draw poses that lie on a facet of their convex hull.

    Its corners belong to three links, a forearm or hand and a knee among them.
    """
    kneeling = robot.neutral.copy()
    for joint, value in KNEELING.items():
        for side in ("left", "right"):
            kneeling[robot.joint_row(f"{side}_{joint}_joint")] = value
    while True:
        positions = kneeling + random.uniform(-0.4, 0.4, len(kneeling))
        positions = np.clip(positions, robot.lower, robot.upper)
        points = outline.placed(positions, np.eye(7)[6])
        names = np.repeat([*points], [len(each) for each in points.values()])
        hull = ConvexHull(np.concatenate([*points.values()]))
        links = [{*names[corners]} for corners in hull.simplices]
        fits = [
            len(three) == 3
            and any("knee" in link for link in three)
            and any("wrist" in link or "elbow" in link for link in three)
            for three in links
        ]
        for facet in random.permutation(np.flatnonzero(fits))[:1]:
            normal = hull.equations[facet, :3]
            axis = np.cross(normal, DOWN)
            angle = np.arctan2(np.linalg.norm(axis), normal @ DOWN)
            base = np.zeros(7)
            base[3:] = from_rotation_vector(angle * axis / np.linalg.norm(axis))
            yield positions, base, links[facet]
