"""Gizmos on hands, feet and other links of a robot, which the whole body follows.

With the gizmos on, every link can be dragged with the mouse, too.
"""

from __future__ import annotations

import math
import time
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from g1_description.bounds import MAX_VALUE
from g1_description.ik.inverse_kinematics import IkResult
from g1_description.ik.posing import Posing
from g1_description.robot.assembly import WORLD
from g1_description.robot.poses import fitting_poses
from g1_description.robot.rotation import conjugate, rotate
from g1_description.robot.state import RobotState
from g1_description.web.controls import HELD, LEAST_NORM, PERIOD, JointPanel
from g1_description.web.findings_panel import plain
from g1_description.web.robot import ShownRobot
from g1_description.web.scene.robot import SEE_THROUGH, SceneRobot, rgb
from g1_description.web.scene.stage import MAP, Stage
from g1_description.web.scene.tree import pose_of, wxyz
from g1_description.web.ui_loop import Lane, UiLoop

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from viser import MeshHandle, TransformControlsHandle, ViserServer

    from g1_description.collisions.self_collisions import SelfCollisions

SCALE = 0.2
"""Length of a gizmo's arrows, in [m]."""

TARGET = (0.95, 0.6, 0.1, SEE_THROUGH)
"""Colour of a link at a target that is not reached."""

LONGEST = 60.0
"""Time without a move after which a gizmo is no longer held, in [s]: browsers that
vanish do not let it go."""

UNDO, REDO, MIRROR, RESET = "Undo", "Redo", "Mirror", "Reset"


class ReachPanel:
    """Inverse kinematics of one robot."""

    def __init__(
        self,
        server: ViserServer,
        ui: UiLoop,
        robot: ShownRobot,
        joints: JointPanel,
        body: SceneRobot,
        stage: Stage,
        collisions: Callable[[], SelfCollisions],
    ) -> None:
        """Add the panel.

        Args:
            server: The server.
            ui: Runs the actions.
            robot: The robot, with links in its profile.
            joints: Its sliders.
            body: Its shapes.
            stage: Where it is.
            collisions: Prepares its self-collisions, which may take seconds.
        """
        self._ui, self._robot, self._joints = ui, robot, joints
        self._body, self._stage = body, stage
        self.posing = Posing(robot.description, robot.state, self._command)
        self._make_collisions = collisions
        roles = self.posing.roles
        self._dragged_at = dict.fromkeys(roles, -math.inf)
        self._held = ""
        """Role of the gizmo that is held with the mouse."""
        self._grabbed: tuple[str, np.ndarray] | None = None
        """A link that is dragged with the mouse, and where in its frame."""
        self._lane = Lane(ui)
        self._ghosts: dict[str, list[MeshHandle]] = {}
        self._looked = 0.0
        self._add(server)

    def _add(self, server: ViserServer) -> None:
        """Add controls and gizmos."""
        gui, ui, name = server.gui, self._ui, self._robot.name.replace("/", "_")
        with gui.add_folder("Reach", expand_by_default=False):
            self._on = gui.add_checkbox(
                "Gizmos",
                False,
                hint="on hands, feet and other links; all links can be dragged, too",
            )
            self._holds = {
                foot: gui.add_checkbox(f"{_label(foot)} stays", True)
                for foot in self.posing.feet
            }
            self._balance = gui.add_checkbox(
                "Balance", True, hint="centre of mass above the feet that stay"
            )
            self._avoid = gui.add_checkbox(
                "Avoid collisions", False, hint="links keep 2 mm from each other"
            )
            self._changes = gui.add_button_group("Change", [UNDO, REDO, MIRROR])
            self._pose = gui.add_dropdown(
                "Pose",
                fitting_poses(self._robot.description),
                initial_value=self.posing.standing_pose,
                hint="of Reset, which stands the robot on the floor",
            )
            self._reset = gui.add_button(RESET, color="orange")
            self._told = gui.add_markdown("", visible=False)
        ui.on(self._on, self._show_gizmos)
        ui.on(self._avoid, self._prepare)
        for box in (*self._holds.values(), self._balance, self._pose):
            ui.on(box, self._choose)
        ui.on(self._changes, lambda: self.change(self._changes.value))
        ui.on(self._reset, lambda: self.change(RESET))
        self._gizmos = {
            role: server.scene.add_transform_controls(
                f"{MAP}/reach/{name}/{role}", scale=SCALE, visible=False
            )
            for role in self.posing.roles
        }
        self._turns = {role: gizmo.wxyz for role, gizmo in self._gizmos.items()}
        for role, gizmo in self._gizmos.items():
            ui.on(gizmo, partial(self._dragged, role))
            gizmo.on_update(partial(self._begin_or_end, role))
        self._scene = server.scene

    @property
    def has_gizmos(self) -> bool:
        """Whether the gizmos are shown."""
        return bool(self._on.value)

    def toggle(self) -> None:
        """Show the gizmos, or hide them."""
        self._on.value = not self._on.value
        self._show_gizmos()

    def _show_gizmos(self) -> None:
        """Show the gizmos, or hide them."""
        self._pose.options = tuple(fitting_poses(self._robot.description))
        self._looked = 0.0
        for gizmo in self._gizmos.values():
            gizmo.visible = self.has_gizmos
        self._body.on_drag(self._on_drag if self.has_gizmos else None)

    def _choose(self) -> None:
        """Take the switches over."""
        self.posing.held = {foot for foot, box in self._holds.items() if box.value}
        self.posing.balance = bool(self._balance.value)
        self._balance.disabled = not self.posing.stands
        self.posing.avoid_collisions = bool(self._avoid.value)

    def _prepare(self) -> None:
        """Prepare self-collisions on first use."""
        self._choose()
        if self._avoid.value and not self.posing.is_prepared:
            self._lane.do(self._make_collisions, self.posing.prepare)

    def _command(self, positions: dict[str, float], base: np.ndarray) -> None:
        """Command a configuration."""
        self._joints.let_go()
        self._robot.command_all(positions, base)

    # --- dragging ---

    def _dragged(self, role: str) -> None:
        """Move the robot so that a link follows its gizmo."""
        gizmo = self._gizmos[role]
        self._turns[role] = gizmo.wxyz
        pose = pose_of(gizmo.position, gizmo.wxyz)
        # Browsers send no other values; viser does not validate them.
        if pose.shape != (7,) or not (np.abs(pose) <= MAX_VALUE).all():
            return
        length = np.linalg.norm(pose[3:])
        if not length > LEAST_NORM:
            return
        pose[3:] /= length
        if not self._is_dragged(role):
            self.posing.end_drag()
        self._dragged_at[role] = time.monotonic()
        self._move(role, pose, self.posing.centers[role])

    def _move(self, link: str, target: np.ndarray, point: np.ndarray) -> None:
        """Search a configuration, through which the robot moves."""
        pieces = self.posing.search(link, target, point)
        self._lane.go_through(_marked(pieces), partial(self._found, link), "search")

    def _found(self, link: str, found: tuple[IkResult, bool]) -> None:
        """Move the robot; show at the end what is not reached."""
        result, is_last = found
        self.posing.follow(result)
        if is_last:
            self._tell(result.message)
            self._show_ghost(link, not result.reached)

    def _begin_or_end(self, role: str, event: Any) -> None:
        """Hear of the mouse that takes a gizmo or lets it go, in a thread of viser."""
        if event.phase != "update":
            act = partial(self._hold, role, event.phase == "start")
            self._ui.post(("hold", id(self), role), act)

    def _hold(self, role: str, is_held: bool) -> None:
        """Begin a drag of a gizmo, or end it."""
        self.posing.end_drag()
        self._held = role if is_held else ""
        self._dragged_at[role] = time.monotonic()

    def _is_dragged(self, role: str) -> bool:
        """Return whether a gizmo is held, or was dragged recently."""
        longest = LONGEST if role == self._held else HELD
        return time.monotonic() < self._dragged_at[role] + longest

    def _on_drag(self, link: str, event: Any) -> None:
        """Hear of the mouse that drags a link, in the thread of the server."""
        phase, at = event.phase, event.end_position
        if phase == "start":
            at = event.start_position
        self._ui.post(("grab", id(self), phase), partial(self._grab, link, phase, at))

    def _grab(self, link: str, phase: str, at: tuple[float, ...]) -> None:
        """Move the robot so that a point of a link follows the mouse."""
        place = np.array(at, dtype=float)
        if place.shape != (3,) or not (np.abs(place) <= MAX_VALUE).all():
            return
        place -= self._stage.shift
        if phase == "start":
            self.posing.end_drag()
            state = self._robot.state()
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
                self._scene.add_mesh_simple(
                    f"{self._gizmos[role].name}/target_{number}",
                    patch.vertices - center,
                    patch.faces,
                    color=rgb(TARGET),
                    opacity=TARGET[3],
                    flat_shading=True,
                )
                for number, patch in enumerate(self._body.patches.get(link, ()))
            ]
        for mesh in self._ghosts.get(role, ()):
            if mesh.visible != is_on:
                mesh.visible = is_on

    # --- whole changes ---

    def change(self, what: str) -> None:
        """Undo, redo, mirror or reset.

        Raises:
            G1DescriptionError: If that is not possible.
        """
        self._lane.cancel("search")
        if what == RESET:
            self.posing.reset(str(self._pose.value))
        else:
            {
                UNDO: self.posing.undo,
                REDO: self.posing.redo,
                MIRROR: self.posing.mirror,
            }[what]()
        self._dragged_at = dict.fromkeys(self._gizmos, -math.inf)
        self._tell("")

    def _tell(self, text: str) -> None:
        """Show a sentence, or none."""
        self._told.content = plain(text)
        self._told.visible = bool(text)

    def follow(self, state: RobotState) -> None:
        """Put gizmos that are not dragged on their links."""
        now = time.monotonic()
        if not self.has_gizmos or now < self._looked + PERIOD:
            return
        if state.base_pose is None:
            return
        self._looked = now
        for role, pose in self.posing.handle_poses(state).items():
            if not self._is_dragged(role):
                self._put(role, self._gizmos[role], pose)

    def _put(self, role: str, gizmo: TransformControlsHandle, pose: np.ndarray) -> None:
        """Put a gizmo at the centre of its link."""
        # A person's value is another array, and may not have been heard yet.
        if gizmo.wxyz is self._turns[role]:
            self._show_ghost(role, False)
            gizmo.position = pose[:3]
            gizmo.wxyz = np.array(wxyz(pose))


def _marked(pieces: Iterator[IkResult]) -> Iterator[tuple[IkResult, bool]]:
    """Mark the last result of a search."""
    for found in pieces:
        yield found, False
    yield found, True


def _label(role: str) -> str:
    """Write a role as text."""
    return role.replace("_", " ").capitalize()
