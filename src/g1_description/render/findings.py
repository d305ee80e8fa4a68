"""Pictures of a motion at the worst times of its findings."""

from __future__ import annotations

import io
import math
from functools import cached_property

import numpy as np
from PIL import Image, ImageDraw

from g1_description.checks.causes import worst_of
from g1_description.checks.verdict import Finding, Verdict
from g1_description.motion.motion import Motion, sample
from g1_description.render.camera import VIEWS, framing
from g1_description.render.picture import draw
from g1_description.render.scene import Scene
from g1_description.robot.assembly import root_in_base
from g1_description.robot.description import Description
from g1_description.robot.transform import IDENTITY, compose

SIZE = 300, 330
"""Width and height in pixels."""

COLORS, RED, RING = 96, (214, 69, 65), 18
"""Colours of a picture, and the colour and radius in pixels of the ring around the
points of a finding."""

MOST = 8
"""Causes of a motion that are drawn; the failed ones are first."""


class FindingPictures:
    """Draws a robot at the worst time of each cause of findings."""

    def __init__(self, description: Description) -> None:
        """Take the robot; its meshes are read for the first picture."""
        self._description = description

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle the robot only: each process has a scene of its own."""
        return FindingPictures, (self._description,)

    @cached_property
    def _scene(self) -> Scene:
        scene = Scene()
        scene.add(self._description)
        return scene

    def draw(self, motion: Motion, verdict: Verdict) -> tuple[bytes, ...]:
        """Draw the first ``MOST`` causes of a verdict, as PNG each.

        Nothing is drawn of a robot without visual shapes.
        """
        if not self._scene.corners().size:
            return ()
        return tuple(
            self._picture(motion, worst_of(findings))
            for findings in verdict.causes[:MOST]
        )

    def _picture(self, motion: Motion, finding: Finding) -> bytes:
        """Draw the worst time of a finding, from the side on which it is."""
        now = sample(motion, np.array([finding.worst_time]))
        base = IDENTITY if now.base_poses is None else now.base_poses[0]
        root = compose(base, root_in_base(self._description))
        positions = dict(zip(motion.joint_names, now.positions[0].tolist()))
        self._scene.place(0, root, positions)
        corners = self._scene.corners()
        yaw, pitch = VIEWS["iso"]
        if finding.points:
            x, y, _ = np.mean(finding.points, axis=0) - (base[:3])
            yaw = math.atan2(y, x)
        camera = framing(corners, yaw, pitch, SIZE[0] / SIZE[1])
        floor = 0.0 if now.base_poses is not None else float(corners[:, 2].min())
        picture = Image.fromarray(draw(self._scene, camera, *SIZE, floor))
        if finding.points:
            marks = camera.seen(np.array(finding.points)) * SIZE[0] * [1, -1]
            center = marks.mean(axis=0) + np.array(SIZE) / 2
            ring = [*(center - RING), *(center + RING)]
            ImageDraw.Draw(picture).ellipse(ring, outline=RED, width=3)
        content = io.BytesIO()
        picture.quantize(COLORS).save(content, "PNG", optimize=True)
        return content.getvalue()
