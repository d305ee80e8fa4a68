"""Gizmos on hands, feet and other links of a robot, which the whole body follows.

With the gizmos on, every link can be dragged with the mouse, too.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from g1_description.bounds import MAX_VALUE
from g1_description.ik.posing import roles_of
from g1_description.ik.results import IkResult
from g1_description.robot.assembly import WORLD
from g1_description.robot.poses import fitting_poses
from g1_description.robot.rotation import conjugate, from_z, rotate
from g1_description.robot.transform import IDENTITY, compose
from g1_description.web.controls import valid_pose
from g1_description.web.panel import Key, RobotPanel
from g1_description.web.scene.robot import SEE_THROUGH, rgb
from g1_description.web.scene.stage import MAP
from g1_description.web.scene.tree import pose_of, wxyz
from g1_description.web.shown import Shown
from g1_description.web.ui_loop import Lane

if TYPE_CHECKING:
    from collections.abc import Iterator

    from viser import MeshHandle, TransformControlsHandle

SCALE = 0.2
"""Length of a gizmo's arrows, in [m]."""

POINT_AXES = 0.05
"""Length of the axes of a named point, in [m]."""

TARGET = (0.95, 0.6, 0.1, SEE_THROUGH)
"""Colour of a link at a target that is not reached."""

LINK, MAP_AXES = "the link", "the map"

UNDO, REDO, MIRROR, RESET = "Undo", "Redo", "Mirror", "Reset"


class ReachPanel(RobotPanel):
    """Inverse kinematics of one robot, with links in its profile."""

    title = "Reach"

    @classmethod
    def fits(cls, shown: Shown) -> bool:
        """Return whether the profile has links that can be dragged."""
        return bool(roles_of(shown.robot.description))

    def build(self) -> None:
        """Add controls and gizmos."""
        gui, ui, name = self.gui, self.ui, self.robot.name.replace("/", "_")
        self.posing = self.shown.posing
        self._lane = Lane(ui)
        self._held = ""
        """Role of the gizmo that is held with the mouse."""
        self._grabbed: tuple[str, np.ndarray] | None = None
        """A link that is dragged with the mouse, and where in its frame."""
        self._ghosts: dict[str, list[MeshHandle]] = {}
        self._on = gui.add_checkbox(
            "Gizmos",
            False,
            hint="on hands, feet and other links; all links can be dragged, too",
        )
        self._axes = gui.add_dropdown(
            "Arrows along", [LINK, MAP_AXES], hint="the axes of the link, or of the map"
        )
        self._stay = {
            foot: gui.add_checkbox(f"{foot.replace('_', ' ').capitalize()} stays", True)
            for foot in self.posing.feet
        }
        self._balance = gui.add_checkbox(
            "Balance", True, hint="centre of mass above the feet that stay"
        )
        self._avoid = gui.add_checkbox(
            "Avoid collisions", False, hint="links keep 2 mm from all, objects too"
        )
        self._changes = gui.add_button_group("Change", [UNDO, REDO, MIRROR])
        self._pose = gui.add_dropdown(
            "Pose",
            fitting_poses(self.robot.description),
            initial_value=self.posing.standing_pose,
            hint="of Reset, which stands the robot on the floor",
        )
        reset = gui.add_button(RESET, color="orange")
        ui.on(self._on, self._show_gizmos)
        ui.on(self._axes, self.update)
        ui.on(self._avoid, self._prepare)
        for box in (*self._stay.values(), self._balance, self._pose):
            ui.on(box, self._choose)
        ui.on(self._changes, lambda: self.change(self._changes.value))
        ui.on(reset, lambda: self.change(RESET))
        self._gizmos = {
            role: self.scene.add_transform_controls(
                f"{MAP}/reach/{name}/{role}", scale=SCALE, visible=False
            )
            for role in self.posing.roles
        }
        description, frames = self.robot.description, self.shown.body.tree.frames
        self._points = [
            self.scene.add_frame(
                f"{frames[at.link].name}/point_{number}",
                axes_length=POINT_AXES,
                axes_radius=0.05 * POINT_AXES,
                wxyz=wxyz(np.append(np.zeros(3), from_z(np.array(at.axis)))),
                position=at.point,
                visible=False,
            )
            for number, at in enumerate(description.profile.points.values())
            if at.link in frames
        ]
        """Named points of links; z is where they face."""
        self._turns = dict.fromkeys(self._gizmos, IDENTITY)
        """Pose of each link in the frame of its gizmo: a rotation."""
        for role, gizmo in self._gizmos.items():
            self._listen(gizmo, role)

    @property
    def has_gizmo(self) -> bool:
        """Whether the gizmos are shown."""
        return bool(self._on.value)

    def hotkeys(self) -> list[Key]:
        """List its keys."""
        undo, redo = partial(self.change, UNDO), partial(self.change, REDO)
        return [
            Key("G", "show gizmos, or hide them", self.toggle, "G"),
            Key("Ctrl+Z", "undo", undo, "Z", "cmd/ctrl"),
            Key("Ctrl+Shift+Z", "redo", redo, "Z", "cmd/ctrl+shift"),
        ]

    def toggle(self) -> None:
        """Show the gizmos, or hide them."""
        self._on.value = not self._on.value
        self._show_gizmos()

    def leave(self) -> None:
        """Hide the gizmos."""
        if self.has_gizmo:
            self.toggle()

    def refresh(self) -> None:
        """List the poses again."""
        self._pose.options = tuple(fitting_poses(self.robot.description))

    def _show_gizmos(self) -> None:
        """Show the gizmos on their links, or hide them."""
        self.update()
        for node in (*self._gizmos.values(), *self._points):
            node.visible = self.has_gizmo
        self.shown.body.on_drag(self._on_drag if self.has_gizmo else None)

    def _choose(self) -> None:
        """Take the switches over."""
        self.posing.fixed_links = {
            foot for foot, box in self._stay.items() if box.value
        }
        self.posing.balance = bool(self._balance.value)
        self._balance.disabled = not self.posing.stands
        self.posing.avoid_collisions = bool(self._avoid.value)

    def _prepare(self) -> None:
        """Prepare self-collisions on first use, which may take seconds."""
        self._choose()
        if self._avoid.value and not self.posing.is_prepared:
            make, robot = self.page.make_checker, self.robot.description
            self._lane.do(lambda: make(robot).collisions, self.posing.prepare)

    # --- dragging ---

    def _listen(self, gizmo: TransformControlsHandle, role: str) -> None:
        """Listen to the mouse that takes a gizmo, drags it and lets it go."""

        async def came(event: Any) -> None:  # in the order of the events
            act = partial(self._drag, role, event.phase)
            self.ui.post((id(gizmo), event.phase), act)

        gizmo.on_update(came)

    def _drag(self, role: str, phase: str) -> None:
        """Move the robot so that a link follows its gizmo, between begin and end."""
        if phase != "update":
            self.posing.end_drag()
            self._held = role if phase == "start" else ""
        gizmo = self._gizmos[role]
        pose = valid_pose(pose_of(gizmo.position, gizmo.wxyz))
        if phase == "update" and pose is not None:
            target = compose(pose, self._turns[role])
            self._move(role, target, self.posing.centers[role])

    def _move(self, link: str, target: np.ndarray, point: np.ndarray) -> None:
        """Search a configuration, through which the robot moves."""
        if self.posing.avoid_collisions:
            self.posing.scene = self.page.scene_now(self.robot)
        pieces = self.posing.search(link, target, point)
        self._lane.go_through(_marked(pieces), partial(self._found, link), "search")

    def _found(self, link: str, found: tuple[IkResult, bool]) -> None:
        """Move the robot; show at the end what is not reached."""
        result, is_last = found
        self.posing.follow(result)
        if is_last:
            self.report(result.message)
            self._show_ghost(link, not result.reached)

    def _on_drag(self, link: str, event: Any) -> None:
        """Note that the mouse drags a link, in the thread of the server."""
        phase, at = event.phase, event.end_position
        if phase == "start":
            at = event.start_position
        self.ui.post(("grab", id(self), phase), partial(self._grab, link, phase, at))

    def _grab(self, link: str, phase: str, at: tuple[float, ...]) -> None:
        """Move the robot so that a point of a link follows the mouse."""
        place = np.array(at, dtype=float)
        if place.shape != (3,) or not (np.abs(place) <= MAX_VALUE).all():
            return
        place -= self.page.stage.shift
        if phase == "start":
            self.posing.end_drag()
            state = self.robot.state()
            if state is None or state.base_pose is None or link == WORLD:
                return
            pose = self.posing.link_poses(state)[link]
            point = rotate(conjugate(pose[3:]), place - pose[:3])
            self._grabbed = link, point
        elif self._grabbed is not None and self._grabbed[0] == link:
            if phase == "end":
                self._grabbed = None
                self.posing.end_drag()
            else:
                self._move(link, place, self._grabbed[1])

    def _show_ghost(self, role: str, is_on: bool) -> None:
        """Show the link of a gizmo at its target, or hide it."""
        if is_on and role in self._gizmos and role not in self._ghosts:
            link = self.posing.roles[role]
            center = self.posing.centers[role].astype(np.float32)
            self._ghosts[role] = [
                self.scene.add_mesh_simple(
                    f"{self._gizmos[role].name}/target_{number}",
                    patch.vertices - center,
                    patch.faces,
                    color=rgb(TARGET),
                    opacity=TARGET[3],
                    flat_shading=True,
                )
                for number, patch in enumerate(self.shown.body.patches.get(link, ()))
            ]
        for mesh in self._ghosts.get(role, ()):
            mesh.wxyz = wxyz(self._turns[role])
            mesh.visible = is_on

    # --- whole changes ---

    def change(self, kind: str) -> None:
        """Undo, redo, mirror or reset.

        Raises:
            G1DescriptionError: If that is not possible.
        """
        self._lane.cancel("search")
        posing = self.posing
        if kind == RESET:
            posing.reset(str(self._pose.value))
        else:
            {UNDO: posing.undo, REDO: posing.redo, MIRROR: posing.mirror}[kind]()
        self._held = ""
        self.report("")

    def update(self) -> None:
        """Put gizmos that are not dragged on their links."""
        state = self.shown.newest
        if not self.has_gizmo or state is None or state.base_pose is None:
            return
        is_along_link = self._axes.value == LINK
        for role, pose in self.posing.handle_poses(state).items():
            gizmo, turn = self._gizmos[role], np.append(np.zeros(3), pose[3:])
            if role == self._held or self.ui.edits.is_held(gizmo):
                continue
            self._turns[role] = IDENTITY if is_along_link else turn
            gizmo.position = pose[:3]
            gizmo.wxyz = np.array(wxyz(pose if is_along_link else IDENTITY))
            self._show_ghost(role, False)


def _marked(pieces: Iterator[IkResult]) -> Iterator[tuple[IkResult, bool]]:
    """Mark the last result of a search."""
    for found in pieces:
        yield found, False
    yield found, True
