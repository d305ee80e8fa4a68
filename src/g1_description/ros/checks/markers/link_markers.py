"""Links that collide, as markers that stay with their frames."""

from __future__ import annotations

from collections.abc import Sequence

import genpy
import numpy as np
from visualization_msgs.msg import Marker

from g1_description.core.robot.description import Description
from g1_description.sim.marks.canvas import RED

from .maker import KINDS, MarkerMaker, Place

LINKS = "colliding links"
"""Namespace in RViz."""


class LinkMarkers:
    """Makes the markers of links of one robot."""

    def __init__(self, robot: Description) -> None:
        """Prepare.

        Args:
            robot: The robot.
        """
        self._shapes = {
            link.name: [s for s in link.visuals or link.collisions if s.kind in KINDS]
            for link in robot.links
        }
        counts = np.cumsum([0, *(len(shapes) for shapes in self._shapes.values())])
        self._numbers = dict(zip(self._shapes, counts.tolist()))

    def links(self, names: Sequence[str], prefix: str) -> list[Marker]:
        """Make the markers of links that collide; each stays with its link's frame.

        Args:
            names: Names of the links.
            prefix: What stands before the names of their frames.
        """
        markers = []
        for name in names:
            maker = MarkerMaker(Place(prefix + name, genpy.Time()))
            for shape in self._shapes[name]:
                maker.shape(LINKS, shape, RED, 0.6)
            for number, marker in enumerate(maker.markers):
                marker.frame_locked = True
                marker.id = self._numbers[name] + number
            markers += maker.markers
        return markers
