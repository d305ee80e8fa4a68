"""Parameters of the node that shows robots in a browser: names, defaults, ranges."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from g1_description.bridge.parameters import BridgeParameters, RobotParameters
from g1_description.checks.thresholds import Thresholds
from g1_description.checks.thresholds_file import read_thresholds
from g1_description.ros.parameters import check_files
from g1_description.web.server.address import ServerOptions


@dataclass(frozen=True)
class WebParameters:
    """Parameters of the node ``web``."""

    host: str = "127.0.0.1"
    """Address to listen on; any but the machine's own needs a token, which is part
    of the address in the log."""

    port: int = 8080
    """0: any that is free."""

    token: str = ""
    """The token; empty: a new one at each start. Anyone who can reach the master can
    read it."""

    read_only: bool = False
    """Display only; ignore input from browsers."""

    controls: bool = True
    """Enable the controls, which need a bridge."""

    gazebo: str = "/gazebo"
    """Namespace of the simulator; empty: there is none."""

    robot_description: str = "robot_description"
    """Parameter that holds the robot's URDF; searched for upward from the
    namespace."""

    model_name: str = "g1_robot"
    """Name of the robot on the page."""

    frame_prefix: str = ""
    """Prefix of the robot's frame names."""

    robots: tuple[dict, ...] = ()
    """Several robots instead of one, [as for the bridge](#several-robots)."""

    map_frame: str = "map"
    """Frame that is shown; its floor is at height 0."""

    ghost: bool = False
    """Whether the bridge publishes the commanded configuration."""

    collisions: str = ""
    """File of [allowed collisions](self_collision.md#allowed-pairs); empty: that of the
    robot's [profile](robots.md), or what is found."""

    thresholds: str = ""
    """File of the checks' thresholds; empty: ``config/checks.yaml``."""

    def __post_init__(self) -> None:
        """Check files."""
        check_files(self, "thresholds", "collisions")

    @property
    def each_robot(self) -> tuple[RobotParameters, ...]:
        """The robots to show."""
        bridge = BridgeParameters(
            model_name=self.model_name,
            robot_description=self.robot_description,
            frame_prefix=self.frame_prefix,
            robots=self.robots,
        )
        return bridge.each_robot

    @property
    def server(self) -> ServerOptions:
        """Address, access and token of the page."""
        return ServerOptions(
            self.host, self.port, read_only=self.read_only, token=self.token
        )

    def read_thresholds(self) -> Thresholds:
        """Read the thresholds.

        Raises:
            ThresholdError: If a file cannot be read.
        """
        return read_thresholds(Path(self.thresholds) if self.thresholds else None)
