"""Finds pairs of links that may touch by design, as MoveIt's setup assistant does."""

from __future__ import annotations

import hashlib
import re
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Callable

import numpy as np

from g1_description.collisions.allowed_pairs import (
    ADJACENT,
    ALWAYS,
    DEFAULT,
    NEVER,
    AllowedPair,
    AllowedPairs,
    read_allowed_pairs,
    write_allowed_pairs,
)
from g1_description.collisions.self_collisions import SelfCollisions
from g1_description.errors import AllowedPairsError, InvalidValueError
from g1_description.files.model_files import PACKAGE, find_folder, ros_home
from g1_description.files.uris import local_path
from g1_description.robot.assembly import bodies_of
from g1_description.robot.description import Description, limits_of
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.transform import IDENTITY
from g1_description.robot.tree import below

SAMPLES = 100_000
"""Default number of random configurations. A contact in more than 3 / SAMPLES of all
configurations is missed with a probability of 5 % at most."""

QUICK_SAMPLES = 1000
"""Random configurations for a robot that has no file of allowed pairs."""

ABOUT_KEPT = """\
Pairs of links that are not checked for collisions, found at the first check. A copy of
this file called collisions.yaml in the robot's profile may be edited.
"""

NEAR = 0.02
"""A pair that comes nearer than this is checked, though it may never touch, in [m]."""

REACH = 1.0
"""Range of a joint that slides without limits, to both sides, in [m]."""

BATCH = 2000
"""Configurations between two reports of progress."""

Progress = Callable[[int, int], None]
"""Called with the number of finished samples, and of all."""


def find_allowed_pairs(
    description: Description,
    samples: int = SAMPLES,
    seed: int = 0,
    progress: Progress | None = None,
) -> AllowedPairs:
    """Find the pairs of links that need not be checked.

    Once a pair was near in one sample and apart in another, it is neither ``never`` nor
    ``always`` and is not examined further.

    Args:
        description: The robot; names of its meshes can be found from anywhere.
        samples: Number of random configurations inside the limits.
        seed: Seed of the random numbers.
        progress: Called after each batch.

    Returns:
        The pairs with their reasons, the same for the same arguments.
    """
    adjacent = adjacent_pairs(description)
    collisions = SelfCollisions(description, adjacent)
    links, n_pairs = collisions.links, len(collisions.pairs)
    was_near, was_apart = np.zeros(n_pairs, bool), np.zeros(n_pairs, bool)
    random = np.random.RandomState(seed)
    for first in range(0, samples, BATCH):
        poses = random_poses(description, random, min(BATCH, samples - first))
        unknown = np.flatnonzero(~(was_near & was_apart))
        near = collisions.contacts(poses, NEAR, unknown)
        was_near[near.pair] = True
        overlaps = np.bincount(near.pair[near.distance < 0.0], minlength=n_pairs)
        was_apart[unknown] |= overlaps[unknown] < len(poses)
        if progress is not None:
            progress(first + len(poses), samples)
    reasons = np.where(was_near | (samples == 0), "", NEVER).astype(object)
    lower, upper = _ranges(description)
    zero = np.clip(np.zeros((1, len(lower))), lower, upper)
    reasons[collisions.contacts(_poses(description, zero)).pair] = DEFAULT
    reasons[was_near & ~was_apart] = ALWAYS
    found = zip(collisions.pairs, reasons.tolist())
    pairs = [pair for pair in adjacent if pair.links <= {*links}]
    pairs += [AllowedPair(*pair, reason) for pair, reason in found if reason]
    return AllowedPairs(description.name, links, tuple(pairs), samples, seed)


def quick_allowed_pairs(description: Description) -> AllowedPairs:
    """Find allowed pairs of a robot without a file, in about a second.

    Few samples do not prove that a pair never touches, so such pairs are checked.
    """
    found = find_allowed_pairs(description, QUICK_SAMPLES)
    pairs = tuple(pair for pair in found.pairs if pair.reason != NEVER)
    return replace(found, pairs=pairs)


def collisions_of(
    description: Description, file: Path | None = None, visual_hulls: bool = True
) -> SelfCollisions:
    """Prepare a robot's self-collisions.

    Args:
        description: The robot.
        file: Its allowed pairs; None: those of its profile, or, if that has none or
            lacks links of the robot, pairs that are found once and kept.
        visual_hulls: Whether links without collision shapes use the convex hulls of
            their visuals.

    Raises:
        AllowedPairsError: If a file cannot be read, or is for another robot.
    """
    if file is not None:
        return SelfCollisions(description, read_allowed_pairs(file), visual_hulls)
    known, why = description.profile.collisions, ""
    if known is not None:
        pairs = read_allowed_pairs(known)
        try:
            return SelfCollisions(description, pairs, visual_hulls)
        except AllowedPairsError as error:
            why = f"{error} "
    found, place = kept_allowed_pairs(description)
    other = SelfCollisions(description, found, visual_hulls)
    note = (
        f"{why}The allowed collisions of {description.name} were found in "
        f"{QUICK_SAMPLES} random configurations{place}."
    )
    other.notes = (note, *other.notes)
    return other


def kept_allowed_pairs(description: Description) -> tuple[AllowedPairs, str]:
    """Read the allowed pairs that were found of a robot; find and keep them at first.

    They are kept below ``~/.ros/g1_description/collisions``, by the content of the
    robot and its meshes.

    Returns:
        The pairs, and where they are as the end of a sentence; empty if they cannot be
        written.
    """
    name = re.sub(r"[^\w.-]+", "_", description.name)
    folder = ros_home() / PACKAGE / "collisions"
    file = folder / f"{name}_{_fingerprint(description)[:12]}.yaml"
    with suppress(AllowedPairsError):
        return read_allowed_pairs(file), f" and are kept in {file}"
    found = quick_allowed_pairs(description)
    try:
        write_allowed_pairs(file, found, ABOUT_KEPT)
    except InvalidValueError:
        return found, ""
    return found, f" and are kept in {file}"


def _fingerprint(description: Description) -> str:
    """Hash a robot and the files of its meshes."""
    found = hashlib.sha256(f"{QUICK_SAMPLES} {description!r}".encode())
    shapes = [
        s for link in description.links for s in (*link.collisions, *link.visuals)
    ]
    for name in dict.fromkeys(s.filename for s in shapes if s.kind == "mesh"):
        path = local_path(name, find_folder)
        with suppress(OSError):
            found.update(Path(path).read_bytes() if path else b"")
    return found.hexdigest()


def adjacent_pairs(description: Description) -> tuple[AllowedPair, ...]:
    """List pairs of links that a joint connects.

    Links connected by fixed joints count as one body: all links of adjacent bodies are
    adjacent. A body without shapes is skipped: its children are adjacent to its parent.
    """
    body_of = bodies_of(description)
    groups: dict[str, list[str]] = {}
    for link, body in body_of.items():
        groups.setdefault(body, []).append(link)
    shaped = {
        link.name for link in description.links if link.collisions or link.visuals
    }
    carrier: dict[str, str] = {}
    pairs = []
    for joint in below(description.roots, description.joints):
        child, parent = body_of[joint.child], body_of[joint.parent]
        if child == parent or child != joint.child:
            continue
        if shaped.isdisjoint(groups[parent]):
            parent = carrier.get(parent, parent)
        carrier[child] = parent
        pairs += [
            AllowedPair(a, b, ADJACENT) for a in groups[parent] for b in groups[child]
        ]
    return tuple(pairs)


def random_poses(
    description: Description, random: np.random.RandomState, count: int
) -> np.ndarray:
    """Place the links in random configurations inside the limits.

    Args:
        description: The robot.
        random: Random number generator.
        count: Number of configurations.

    Returns:
        Poses of the links, the root at the origin, shape (count, n_links, 7).
    """
    lower, upper = _ranges(description)
    shares = random.random_sample((count, len(lower)))
    return _poses(description, lower + shares * (upper - lower))


def _poses(description: Description, positions: np.ndarray) -> np.ndarray:
    """Place the links of all trees, whose roots are at the origin."""
    roots = np.tile(IDENTITY, (len(positions), len(description.roots), 1))
    return Kinematics(description).link_poses(roots, positions)


def _ranges(description: Description) -> tuple[np.ndarray, np.ndarray]:
    """Return limits of joints in [rad] or [m], with a usual range for missing ones."""
    joints = description.movable_joints
    usual = [REACH if joint.kind == "prismatic" else np.pi for joint in joints]
    lower, upper = limits_of(joints)
    return (
        np.where(np.isfinite(lower), lower, np.minimum(upper, 0.0) - usual),
        np.where(np.isfinite(upper), upper, np.maximum(lower, 0.0) + usual),
    )
