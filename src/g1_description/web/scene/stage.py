"""The surroundings of the robots: floor, axes of the map, camera."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from viser import ViserServer


LOOK_AT = (-0.1, 0.16, 0.68)
CAMERA = (2.1, 1.35, 1.2)
FIELD_OF_VIEW = 0.75
SKY, LAMP = 2.6, 1.8
"""Where the camera begins, in [m], and how much it sees from bottom to top, in [rad]:
it is before a robot of the height of a person, on its left, and looks a little beside
it, where the panel is. How bright the
sky is, and a lamp at the camera's first place."""


MAP = "/map"
"""The node above robots, and above all that belongs to them."""

SECTION = 1.0
"""Distance of the floor's strong lines, in [m]."""


class Stage:
    """The floor and the map of a scene."""

    def __init__(self, server: ViserServer) -> None:
        self._map = server.scene.add_frame(MAP, show_axes=False)
        self._axes = server.scene.add_frame(
            f"{MAP}/axes", axes_length=0.3, axes_radius=0.008, visible=False
        )
        self.shift = np.zeros(3)
        """Position of the map in the scene, in [m]."""
        self._grid = server.scene.add_grid(
            "/floor",
            infinite_grid=True,
            cell_size=0.1,
            section_size=SECTION,
            cell_color=(225, 228, 232),
            section_color=(175, 180, 188),
            fade_distance=14.0,
            plane_color=(244, 245, 247),
            plane_opacity=1.0,
            shadow_opacity=0.25,
        )
        server.initial_camera.position = CAMERA
        server.initial_camera.look_at = LOOK_AT
        server.initial_camera.fov = FIELD_OF_VIEW
        # A map of the surroundings costs a browser without a GPU half of its time.
        server.scene.configure_environment_map(None)
        server.scene.add_light_hemisphere(
            "/lights/sky",
            sky_color=(255, 255, 255),
            ground_color=(150, 150, 155),
            intensity=SKY,
        )
        server.scene.add_light_directional(
            "/lights/lamp",
            intensity=LAMP,
            position=CAMERA,
            cast_shadow=False,
        )

    def follow(self, place: np.ndarray) -> None:
        """Move the map so that one place of it is where the camera began to look.

        The camera itself stays in the hands of each person. The floor has no end: it
        is moved by less than the distance of its lines.

        Args:
            place: x and y in the map, in [m].
        """
        shift = np.array([-place[0], -place[1], 0.0])
        if (shift != self.shift).any():
            self.shift = shift
            self._map.position = shift
            self._grid.position = np.fmod(shift, SECTION)

    def show_floor(self, shown: bool) -> None:
        """Show the floor, or hide it."""
        self._grid.visible = shown

    def show_axes(self, shown: bool) -> None:
        """Show the axes of the map, or hide them."""
        self._axes.visible = shown
