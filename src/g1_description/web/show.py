"""A world of robots on a page, until somebody ends it."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable
from pathlib import Path

from g1_description.errors import InvalidValueError
from g1_description.robot.poses import Pose, with_pose
from g1_description.web.check_thread import MakeChecker
from g1_description.web.controls import known
from g1_description.web.library import Library
from g1_description.web.page import Page
from g1_description.web.robot import ShownRobot, ShownWorld
from g1_description.web.server.address import ServerOptions
from g1_description.web.server.page_server import PageServer

COPIED = "copied"
"""Name of the pose in what is copied."""


class Show:
    """A page and its server."""

    def __init__(
        self,
        world: ShownWorld,
        options: ServerOptions,
        make_checker: MakeChecker,
        library: Library | None = None,
        motion_first: bool = False,
    ) -> None:
        """Open the page.

        Args:
            world: The robots.
            options: Who may come in, and where.
            make_checker: Prepares the checks of a robot.
            library: Motions to look through; None: none.
            motion_first: Whether the page opens with the tab of the motion.

        Raises:
            PageServerError: If the page cannot be opened.
        """
        first = world.robots[0]
        self._server = PageServer(
            options,
            None if options.read_only else self._on_file,
            {
                "configuration.yaml": lambda: configuration_yaml(first),
                "configuration.sh": lambda: configuration_command(first),
            },
        )
        self.page = Page(
            self._server.viser,
            world,
            make_checker,
            options.read_only,
            library,
            motion_first,
        )
        self.page.watched = lambda: self._server.browsers

    @property
    def address(self) -> str:
        """URL of the page."""
        return self._server.address

    def _on_file(self, name: str, path: Path) -> str:
        """Open a file that a person has dropped."""
        return self.page.motion.read(name, path)

    def run(self) -> None:
        """Draw until ``stop`` is called."""
        try:
            self.page.run()
        finally:
            self._server.close()

    def stop(self) -> None:
        """End ``run``; from any thread, and from a signal."""
        self.page.stop()


def positions_of(robot: ShownRobot) -> dict[str, float]:
    """Return where a robot's joints are, in [rad] or [m], in the order of its file.

    Raises:
        InvalidValueError: If nothing is known.
    """
    state = robot.state()
    if state is None:
        raise InvalidValueError("No state of the robot has been received yet.")
    return known(state.positions_by_name, robot)


def configuration_yaml(robot: ShownRobot) -> str:
    """Write where a robot is as an entry of a file of poses."""
    return with_pose("", Pose(COPIED, positions_of(robot)), "the clipboard")


def configuration_command(robot: ShownRobot) -> str:
    """Write the command that moves a robot to where it is now."""
    positions = positions_of(robot)
    names = ", ".join(map(_yaml_name, positions))
    # Not as 1e-05, which YAML takes for text.
    values = ", ".join(f"{value:.9f}".rstrip("0") + "0" for value in positions.values())
    message = shlex.quote(f"{{name: [{names}], position: [{values}]}}")
    return f"rostopic pub -1 {robot.joint_topic} sensor_msgs/JointState {message}\n"


def _yaml_name(name: str) -> str:
    """Write a name in YAML, in quotation marks where it needs them."""
    return name if re.fullmatch(r"[A-Za-z_][\w.-]*", name) else json.dumps(name)


def tell_address(
    show: Show, options: ServerOptions, tell: Callable[[str], object]
) -> None:
    """Tell the address, and what it means to have one with a token."""
    tell(f"open {show.address}")
    if "token=" in show.address:
        may = "sees" if options.read_only else "moves"
        tell(f"Anyone with this address {may} the robot.")
