"""Objects that links take from afar, let go in the air, or never take."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from g1_description.checks.measured import Measured
from g1_description.checks.rule import Rule
from g1_description.checks.thresholds import Level
from g1_description.checks.verdict import FAILED, WARNING, Finding
from g1_description.collisions.contacts import Contacts
from g1_description.collisions.obstacles import FLAT, FLOOR
from g1_description.robot.assembly import bodies_of
from g1_description.robot.tree import below
from g1_description.scenes.carried import named_link, object_poses

FAR = 100.0
"""Distances are known up to this, in [m]."""

INSIDE = 1e-3
"""An object that is this deep in another one, in [m], does not fall."""


def _find(rule: Rule, measured: Measured) -> Iterator[Finding | None]:
    """Find objects that are taken or let go where they cannot be."""
    motion, around = measured.motion, measured.surroundings
    assert around is not None
    slack = measured.robot.thresholds.longest_interval
    for row, each in enumerate(around.objects):
        begins = [one.begin for one in each.attachments]
        for one in each.attachments:
            link = named_link(measured.robot.description, one.link, each.name)
            early = min(one.end, np.inf if np.isinf(one.begin) else one.begin + slack)
            if one.begin > motion.end or early <= motion.begin:
                yield _outside(rule, measured, (link, each.name), one.begin)
            else:
                begin = max(one.begin, motion.begin)
                yield _taken(rule, measured, link, row, begin)
            if motion.begin < one.end <= motion.end and one.end not in begins:
                yield _let_go(rule, measured, row, one.end)


def _outside(
    rule: Rule, measured: Measured, subject: tuple[str, str], time: float
) -> Finding:
    """Find an attachment that begins before or after the motion."""
    motion, (link, name) = measured.motion, subject
    level = rule.level_in(measured.robot.thresholds)
    is_late = time > motion.end
    event = "end of the motion" if is_late else "start of the motion"
    nearest = motion.end if is_late else motion.begin
    return Finding(
        check=rule.name,
        severity=WARNING if level.failure is None else FAILED,
        subject=subject,
        worst=abs(time - nearest) if np.isfinite(time) else 0.0,
        bound=0.0,
        unit="s",
        first_time=nearest,
        worst_time=nearest,
        share=0.0,
        intervals=((nearest, nearest),),
        text=f"{name} is attached to {link} at {time:g} s, "
        f"{'after' if is_late else 'before'} the {event} at {nearest:g} s",
    )


def _contacts(
    measured: Measured, time: float, pairs: list[tuple[int, int]]
) -> Contacts:
    """Find how far links and objects are from others, of pairs of their rows."""
    robot, around = measured.robot, measured.surroundings
    assert around is not None
    times = np.array([time])
    base, positions = measured.at(times)[:2]
    links = robot.kinematics.link_poses(base, positions)
    poses = object_poses(around.holds, times, measured.link_poses)
    some = around.obstacles.of_pairs(pairs)
    return some.contacts_among(links, poses, FAR, around.floor)


def _taken(
    rule: Rule, measured: Measured, link: str, row: int, time: float
) -> Finding | None:
    """Find a hand that is away from an object when it takes it."""
    robot, around = measured.robot, measured.surroundings
    assert around is not None
    bodies = bodies_of(robot.description)
    hand = {name for name, body in bodies.items() if body == bodies[link]}
    hand |= {joint.child for joint in below(hand, robot.description.joints)}
    rows = [number for number, name in enumerate(robot.links) if name in hand]
    near = _contacts(measured, time, [(n, len(robot.links) + row) for n in rows])
    name = around.objects[row].name
    text = f"{link} is {{worst:.4g}} m from {name} when it grasps it at {time:.3f} s"
    return _nearest(rule, measured, (link, name), time, near, text)


def _let_go(rule: Rule, measured: Measured, row: int, time: float) -> Finding | None:
    """Find an object that is let go in the air."""
    around = measured.surroundings
    assert around is not None
    names, n_links = around.obstacles.names, len(measured.robot.links)
    others = [n for n in range(n_links, len(names)) if n != n_links + row]
    near = _contacts(measured, time, [(n_links + row, other) for other in others])
    is_above = (near.normal[:, 2] < -FLAT) | (near.distance < -INSIDE)
    near, name = near[np.flatnonzero(is_above)], around.objects[row].name
    lower = (
        names[others[near.pair[near.distance.argmin()]]] if is_above.any() else FLOOR
    )
    text = f"{name} is released {{worst:.4g}} m above {lower} at {time:.3f} s"
    return _nearest(rule, measured, (name, lower), time, near, text)


def _nearest(
    rule: Rule,
    measured: Measured,
    subject: tuple[str, str],
    time: float,
    contacts: Contacts,
    text: str,
) -> Finding | None:
    """Compare the least distance at a time; that without a contact is not known."""
    sizes = np.full(len(measured.times), np.nan)
    points = np.full((len(sizes), 2, 3), np.nan)
    if len(contacts.distance):
        at = min(int(np.searchsorted(measured.times, time)), len(sizes) - 1)
        best = int(contacts.distance.argmin())
        sizes[at] = contacts.distance[best]
        points[at] = contacts.points_a[best], contacts.points_b[best]
    return rule.compared(measured, subject, sizes, text, points=points)


GRASP = Rule(
    name="grasp",
    about="[objects that are grasped from afar, released in the air, or attached "
    "outside of the motion](scenes.md#checked)",
    level=Level(0.02, 0.05),
    limit="m from an object when it is grasped, or above what is below when released; "
    "with --scene",
    unit="m",
    find=_find,
    needs=("objects", "neighbours"),
    requires="a scene, base",
    is_live=False,
    namespace="contacts",
)
