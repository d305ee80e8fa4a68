"""A robot and its motions as JSON, for the page in three dimensions.

Arrays are little-endian and in base64. The page computes poses of links itself: joint
positions are a fifth of the size.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from g1_description.checks.arrows import force_arrows
from g1_description.checks.marks import short_name, size_text, subject_text
from g1_description.checks.rules import RULES
from g1_description.checks.rules.forces import forces
from g1_description.checks.verdict import FAILED, Finding, Verdict, worst_of
from g1_description.motion.motion import Motion
from g1_description.render.patches import (
    Patch,
    link_patches,
    object_shapes,
    patches_of,
)
from g1_description.robot.assembly import root_in_base
from g1_description.robot.description import Description, Joint, limb_of
from g1_description.robot.transform import compose, inverse
from g1_description.robot.tree import below
from g1_description.scenes.carried import holds_of, motion_links
from g1_description.scenes.objects import SceneObject

MAX_TRIANGLES = 90_000
"""Triangles of a robot; more are decimated. They take 1 MB."""

MAX_SAMPLES = 20_000
"""Samples of a motion, and of a line; of more every second, third ... is taken."""

FEW = 100
"""Number of triangles of a patch up to which all are kept."""

STEPS = 65_535
"""Steps of quantized coordinates over the extent of a patch."""


def as_json(content: Any) -> str:
    """Write JSON that may stand inside of an HTML element."""
    text = json.dumps(content, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c")


def robot_data(
    description: Description, objects: Collection[SceneObject] = ()
) -> tuple[str, tuple[str, ...]]:
    """Write a robot: links, joints, and triangles in the frames of links.

    Objects count on from the links.

    Args:
        description: The robot. Without visual shapes its collision shapes are taken.
        objects: Those around it.

    Returns:
        JSON, and a message for each mesh that cannot be used.
    """
    patches, left_out = link_patches(description)
    if not patches:
        patches, left_out = link_patches(description, solid=True)
    above = [*below(description.roots, description.joints)]
    rows = _rows(description)
    numbers = {joint.name: k for k, joint in enumerate(description.movable_joints)}
    links: list[dict[str, Any]] = [{"name": name} for name in description.roots]
    links += [
        {
            "name": joint.child,
            "parent": rows[joint.parent],
            "rest": joint.pose.tolist(),
            "joint": numbers.get(joint.name),
        }
        for joint in above
    ]
    around, missing = patches_of(object_shapes(objects))
    numbers_of = {each.name: len(rows) + k for k, each in enumerate(objects)}
    content = {
        "links": links,
        "joints": [_joint(joint, rows) for joint in description.movable_joints],
        "patches": [
            *_patches(patches, rows),
            *_patches(around, numbers_of),
        ],
    }
    return as_json(content), (*left_out, *missing)


def _patches(
    patches: Mapping[str, Sequence[Patch]], rows: Mapping[str, int]
) -> Iterator[dict[str, Any]]:
    """Write patches by name, with the rows of their links or objects."""
    n_triangles = sum(len(patch.faces) for some in patches.values() for patch in some)
    fraction = min(1.0, MAX_TRIANGLES / max(n_triangles, 1))
    for name, some in patches.items():
        for patch in some:
            yield {"link": rows[name], **_patch(patch, fraction)}


def _holds(
    description: Description, motion: Motion, objects: Collection[SceneObject]
) -> list[list[dict[str, Any]]]:
    """Describe what holds objects: since when, which link, and where in its frame."""
    rows = _rows(description)
    T_root_base = inverse(root_in_base(description))  # of a motion without a base
    links = motion_links(description, motion, T_root_base)
    holds = holds_of(objects, description, links)
    return [
        [
            {
                "begin": max(hold.begin, motion.begin),
                "link": rows.get(hold.link),
                "pose": hold.pose.tolist(),
            }
            for hold in some
        ]
        for some in holds
    ]


def _rows(description: Description) -> dict[str, int]:
    """Number the links: roots, then the others below them."""
    above = below(description.roots, description.joints)
    names = (*description.roots, *(joint.child for joint in above))
    return {name: row for row, name in enumerate(names)}


def _joint(joint: Joint, rows: dict[str, int]) -> dict[str, Any]:
    """Describe a joint with one degree of freedom; unknown limits are None."""
    bounds = (joint.lower, joint.upper, joint.velocity)
    lower, upper, velocity = (b if np.isfinite(b) else None for b in bounds)
    return {
        "name": short_name(joint.name),
        "group": limb_of(joint.name),
        "link": rows[joint.child],
        "axis": joint.axis.tolist(),
        "origin": joint.joint_origin.tolist(),
        "slides": joint.kind == "prismatic",
        "limits": [lower, upper],
        "velocity": velocity,
    }


def _patch(patch: Patch, fraction: float) -> dict[str, Any]:
    """Quantize a patch, with about a fraction of its triangles."""
    vertices, faces = patch.vertices, patch.faces
    if fraction < 1.0 and len(faces) > FEW:
        import fast_simplification  # few robots need it

        # Triangles without area, such as those at the poles of a ball, make spikes.
        is_triangle = (np.diff(np.sort(faces, axis=1), axis=1) > 0).all(axis=1)
        simpler = fast_simplification.simplify(
            vertices,
            faces[is_triangle].astype(np.int32),
            target_reduction=1.0 - fraction,
            agg=5,
        )
        vertices, faces = simpler if len(simpler[1]) else (vertices, faces)
    corner, extent = vertices.min(axis=0), np.ptp(vertices, axis=0)
    step = np.where(extent > 0.0, extent, 1.0) / STEPS
    return {
        "color": [round(part, 3) for part in patch.color],
        "corner": corner.tolist(),
        "step": step.tolist(),
        "vertices": _encoded(np.round((vertices - corner) / step), "<u2"),
        "faces": _encoded(faces, "<u4" if len(vertices) > STEPS else "<u2"),
        "wide": len(vertices) > STEPS,
    }


def motion_data(
    description: Description,
    motion: Motion,
    verdict: Verdict | None = None,
    objects: Collection[SceneObject] = (),
    before: Motion | None = None,
) -> str:
    """Write a motion and its findings.

    Args:
        description: The robot.
        motion: Motion of joints that it has.
        verdict: Verdict of the motion; with its measurements these are there, too.
        objects: Those around the robot, in the order of ``robot_data``.
        before: The motion before it was changed, if it is drawn, too.

    Returns:
        JSON.
    """
    return as_json(_content(description, motion, verdict, objects, before))


def _content(
    description: Description,
    motion: Motion,
    verdict: Verdict | None,
    objects: Collection[SceneObject],
    before: Motion | None,
) -> dict[str, Any]:
    """Collect what ``motion_data`` writes."""
    some = slice(None, None, -(-len(motion.times) // MAX_SAMPLES))
    numbers = {joint.name: k for k, joint in enumerate(description.movable_joints)}
    velocities, roots = motion.velocities, None
    if motion.base_poses is not None:
        T_map_root = compose(motion.base_poses[some], root_in_base(description))
        roots = _encoded(T_map_root, "<f4")
    lines = [*_lines(verdict)] if verdict is not None else []
    floor, checked = 0.0, None  # height in the map in [m], and times of lines
    if verdict is not None and verdict.measured is not None:
        floor = verdict.measured.robot.thresholds.floor_height
        checked = _encoded(_some(verdict.measured.times), "<f8")
    content: dict[str, Any] = {
        "times": _encoded(motion.times[some], "<f8"),
        "joints": [numbers[name] for name in motion.joint_names],
        "positions": _encoded(motion.positions[some], "<f4"),
        "velocities": None if velocities is None else _encoded(velocities[some], "<f4"),
        "roots": roots,
        "floor": floor if roots is not None else None,
        "holds": _holds(description, motion, objects) if objects else [],
        "causes": [],
        "contacts": [],
        "checked": checked,
        "forces": None if verdict is None else _forces(verdict),
        "lines": [{"name": n, "unit": unit, "values": v} for n, unit, v in lines],
    }
    if verdict is not None:
        names = [name for name, _, _ in lines]
        content["causes"] = [
            _cause(findings, description, motion, names) for findings in verdict.causes
        ]
        content["contacts"] = [
            {"name": short_name(link), "intervals": intervals}
            for link, intervals in verdict.floor_contacts.items()
        ]
    if before is not None:
        content["before"] = _content(description, before, None, (), None)
    return content


def _forces(verdict: Verdict) -> dict[str, str] | None:
    """Write contact forces as arrows; None if they are not known."""
    arrows = force_arrows(verdict)
    if arrows is None:
        return None
    pairs = np.stack([arrows.starts, arrows.vectors], axis=2)
    too_much = np.where(arrows.is_missing[:, np.newaxis], arrows.missing, np.nan)
    return {
        "arrows": _encoded(_some(pairs), "<f4"),
        "missing": _encoded(_some(too_much), "<f4"),
    }


def _some(rows: np.ndarray) -> np.ndarray:
    """Return every row, or every second, third ... if there are too many."""
    return rows[:: -(-len(rows) // MAX_SAMPLES)]


HEIGHT, CENTER, MISSING, FRICTION, FORCE, DEPTH = (
    "height of {} above the floor",
    "centre of mass inside the support polygon",
    "missing contact force",
    "friction needed",
    "vertical force on {}",
    "depth of the deepest self-collision",
)
"""Names of lines."""


def _lines(verdict: Verdict) -> Iterator[tuple[str, str, str]]:
    """List measurements: names, units, and values."""
    measured = verdict.measured
    if measured is None:
        return

    def line(values: np.ndarray) -> str:
        return _encoded(_some(np.where(np.isfinite(values), values, np.nan)), "<f4")

    if measured.balance is not None:
        yield CENTER, "m", line(measured.balance.center_margin)
    if "contact_forces" in verdict.checked:
        found = measured.once(forces)
        yield MISSING, "of the weight", line(found.missing_share)
        yield FRICTION, "", line(found.friction)
        for column, link in enumerate(found.links):
            if link in verdict.floor_contacts:
                up = found.forces[:, column, 2]
                yield FORCE.format(short_name(link)), "N", line(up)
    if "self_collision" in verdict.checked:
        yield DEPTH, "m", line(measured.depth)
    if measured.heights is not None:
        for link in verdict.floor_contacts:
            heights = measured.heights[:, measured.ground_links.index(link)]
            yield HEIGHT.format(short_name(link)), "m", line(heights)


def _cause(
    findings: Sequence[Finding],
    description: Description,
    motion: Motion,
    lines: Sequence[str],
) -> dict[str, Any]:
    """Describe the findings of one cause: their times, marks and plots."""
    worst = worst_of(findings)
    subject = worst.subject[0] if worst.subject else ""
    names = {"center_of_mass": CENTER, "contact_forces": MISSING}
    names["self_collision"] = DEPTH
    name = names.get(worst.check, HEIGHT.format(short_name(subject)))
    plot = f"line:{lines.index(name)}" if name in lines else ""
    if subject in motion.joint_names:
        kind = "velocity" if worst.check == "velocity" else "position"
        plot = f"{kind}:{motion.joint_names.index(subject)}"
    others = [finding for finding in findings if finding is not worst]
    return {
        "time": worst.worst_time,
        "plot": plot,
        "findings": [_finding(finding, description) for finding in (worst, *others)],
    }


def _finding(finding: Finding, description: Description) -> dict[str, Any]:
    """Describe when and where a finding is."""
    rule = next(rule for rule in RULES if rule.name == finding.check)
    links = [name for name in finding.subject if name in description.link_names]
    joints = [joint.name for joint in description.movable_joints]
    points = [point for point in finding.points if np.isfinite(point).all()]
    own = links if len(links) == len(points) else links[:1] * len(points)
    text = subject_text(finding)
    if rule.namespace:
        text = rule.label.format(subject=text)
    else:
        check = finding.check.replace("_", " ")
        text = f"{check} {text}" if finding.subject else check
    return {
        "failed": finding.severity == FAILED,
        "time": finding.worst_time,
        "intervals": finding.intervals,
        "label": f"{text} {size_text(finding)}".rstrip(),
        "red": links if rule.reddens else [],
        "joint": next((joints.index(n) for n in finding.subject if n in joints), None),
        "points": points,
        "links": own,
    }


def _encoded(array: np.ndarray, kind: str) -> str:
    """Encode an array as elements of a type."""
    return base64.b64encode(np.ascontiguousarray(array, dtype=kind).tobytes()).decode()
