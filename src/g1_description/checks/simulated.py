"""The objects of a scene in the simulation of a motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from g1_description.checks.measured import Measured
from g1_description.motion.motion import Motion
from g1_description.robot.assembly import Assembly
from g1_description.robot.description import Description, Joint, Link
from g1_description.scenes.carried import Hold
from g1_description.sim.rollout import Conditions, Rollout, rollout
from g1_description.sim.standing import GAP
from g1_description.text import listed


def simulate(measured: Measured, conditions: Conditions) -> Rollout:
    """Simulate a motion among the objects of its scene.

    Objects without mass are static, others move by themselves, but for the times in
    which links carry them; one that a link carries throughout is a part of the link.
    The robot starts on what is below it.

    Args:
        measured: The motion, with its surroundings and ground.
        conditions: Conditions of the simulation.

    Raises:
        G1DescriptionError: If it cannot be simulated.
    """
    robot, motion = measured.robot.description, measured.motion
    around, ground = measured.surroundings, measured.ground
    if around is None or ground is None:
        played = rollout(robot, motion, conditions)
        if measured.robot.obstacles is None:
            return played
        why = "The simulation ignores the objects of the scene."
        return replace(played, left_out=(*played.left_out, why))
    held: list[tuple[float, str, str]] = []
    free, left_out = [], []
    for each, holds in zip(around.objects, around.holds):
        if _is_always_carried(holds, motion):
            robot = _carrying(robot, each.link, holds[1])
        elif len(holds) > 1 and each.mass is None:
            left_out.append(each.name)
        else:
            link = Description(each.name, each.name, (each.link,), ())
            assembly = Assembly(link, static=each.mass is None)
            free.append((each.name, assembly, each.pose))
            held += [(hold.begin, each.name, hold.link) for hold in holds[1:]]
    lift = GAP - float(ground.heights[0].min())
    bases = motion.base_poses
    assert bases is not None, "the ground is known"
    bases = bases + lift * np.eye(7)[2]
    held.sort()
    among = replace(conditions, objects=tuple(free), holds=tuple(held))
    placed = replace(among, on_floor=False)
    played = rollout(robot, replace(motion, base_poses=bases), placed)
    if not left_out:
        return played
    why = (
        "The simulation ignores objects without a mass that links carry for a part of "
        f"the motion: {listed(left_out)}."
    )
    return replace(played, left_out=(*played.left_out, why))


def _is_always_carried(holds: Sequence[Hold], motion: Motion) -> bool:
    """Return whether one link carries an object throughout."""
    begins = [hold.begin for hold in holds[1:]]
    is_from_start = bool(begins) and begins[0] <= motion.begin
    return is_from_start and not any(begin < motion.end for begin in begins[1:])


def _carrying(robot: Description, link: Link, hold: Hold) -> Description:
    """Fix an object to the link that carries it."""
    joint = Joint(f"{link.name} is carried", "fixed", hold.link, link.name, hold.pose)
    return replace(robot, links=(*robot.links, link), joints=(*robot.joints, joint))
