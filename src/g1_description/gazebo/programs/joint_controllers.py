"""Controllers of single joints with rl_sar's topics, as ros_control would run them.

They are described by parameters in the node's namespace, as rl_sar's robot_control.yaml
sets them: NAME/joint for each controller, and joint_state_controller.

Publishes: NAME/state (robot_msgs/MotorState) for each controller, joint_states
    (sensor_msgs/JointState) for joint_state_controller; motor_commands
    (g1_description/MotorCommands) below /gazebo
Subscribes: NAME/command (robot_msgs/MotorCommand); motor_states
    (g1_description/MotorStates) below /gazebo
Parameters: ~model_name (default: the namespace)
"""

from __future__ import annotations

import argparse
import sys
import threading
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
import rospy
from robot_msgs.msg import MotorCommand, MotorState
from sensor_msgs.msg import JointState

from g1_description.bounds import MAX_VALUE
from g1_description.choices import GAZEBO
from g1_description.command_line import OneSentenceParser, own_arguments
from g1_description.errors import G1DescriptionError, UnknownNameError
from g1_description.msg import MotorCommands, MotorStates
from g1_description.ros.conversions import COMMAND_FIELDS
from g1_description.ros.lifecycle import start_node
from g1_description.ros.log import SHORT_PERIOD, ThrottledLog
from g1_description.text import listed, similar_first

ALL_JOINTS = "joint_state_controller"
"""The controller that publishes the states of all joints."""

PERIOD = 0.001
"""Shortest time between two messages to the simulator, in [s]: a program that commands
all joints sends a message for each."""


class JointControllers:
    """Passes commands on to the simulator, and states back."""

    def __init__(self, model: str, joints: Mapping[str, str], has_all: bool) -> None:
        """Advertise and subscribe.

        Args:
            model: Name of the model.
            joints: Its joints by controller.
            has_all: Whether to publish the states of all joints.
        """
        self._model, self._joints = model, [*joints.values()]
        self._commands = np.zeros((len(COMMAND_FIELDS), len(joints)))
        self._is_commanded = np.zeros(len(joints), dtype=bool)
        self._log = ThrottledLog()
        self._is_checked = False
        self._lock, self._changed = threading.Lock(), threading.Event()
        self._motors = rospy.Publisher(
            f"{GAZEBO}/motor_commands", MotorCommands, queue_size=1
        )
        self._states = [
            rospy.Publisher(f"{name}/state", MotorState, queue_size=1)
            for name in joints
        ]
        self._all = None
        if has_all:
            self._all = rospy.Publisher("joint_states", JointState, queue_size=1)
        for number, name in enumerate(joints):
            rospy.Subscriber(
                f"{name}/command",
                MotorCommand,
                partial(self._on_command, number),
                queue_size=1,
                tcp_nodelay=True,
            )
        rospy.Subscriber(
            f"{GAZEBO}/motor_states", MotorStates, self._on_states, tcp_nodelay=True
        )

    def _on_command(self, number: int, command: MotorCommand) -> None:
        """Keep the newest command of a joint; ignore an invalid one.

        The simulator refuses a message whole.
        """
        values = [getattr(command, name) for name in COMMAND_FIELDS]
        is_finite = all(abs(value) <= MAX_VALUE for value in values)
        if not is_finite or command.kp < 0.0 or command.kd < 0.0:
            joint = self._joints[number]
            got = ", ".join(f"{name}: {v}" for name, v in zip(COMMAND_FIELDS, values))
            self._log.warn(
                joint,
                f"{joint}: ignored a command, as all numbers must be within "
                f"+-{MAX_VALUE:g}, kp and kd at least 0 (got {got})",
                SHORT_PERIOD,
            )
            return
        with self._lock:
            self._commands[:, number] = values
            self._is_commanded[number] = True
        self._changed.set()

    def _on_states(self, states: MotorStates) -> None:
        """Publish the states of the model's joints."""
        if states.model_name != self._model:
            return
        if self._all is not None:
            self._all.publish(
                header=states.header,
                name=states.joint_names,
                position=states.q,
                velocity=states.dq,
                effort=states.tau,
            )
        if not self._is_checked:
            self._is_checked = True
            for joint in self._joints:
                if joint not in states.joint_names:
                    rospy.logerr(
                        "%s has no joint %s, whose controller does nothing. Known "
                        "joints: %s",
                        self._model,
                        joint,
                        listed(similar_first(joint, states.joint_names)),
                    )
        row = {name: number for number, name in enumerate(states.joint_names)}
        efforts = states.tau or [0.0] * len(states.q)
        for joint, publisher in zip(self._joints, self._states):
            if joint in row and publisher.get_num_connections():
                n = row[joint]
                state = MotorState(q=states.q[n], dq=states.dq[n], tau_est=efforts[n])
                publisher.publish(state)

    def run(self) -> None:
        """Pass commands on until the node is shut down."""
        while not rospy.is_shutdown():
            if not self._changed.wait(0.1):
                continue
            self._changed.clear()
            with self._lock:
                rows = np.flatnonzero(self._is_commanded)
                values = self._commands[:, rows].tolist()
            names = [self._joints[row] for row in rows.tolist()]
            self._motors.publish(
                model_name=self._model,
                joint_names=names,
                **dict(zip(COMMAND_FIELDS, values)),
            )
            rospy.rostime.wallsleep(PERIOD)


def find_joints(names: Sequence[str]) -> dict[str, str]:
    """Read the joints of controllers from the parameter server.

    Args:
        names: Names of the controllers, below the node's namespace.

    Raises:
        UnknownNameError: If a controller has no joint there.
    """
    joints = {name: rospy.get_param(f"{name}/joint", "") for name in names}
    unknown = [name for name, joint in joints.items() if not joint]
    if unknown:
        place = rospy.resolve_name(f"{unknown[0]}/joint")
        raise UnknownNameError(
            f"No joint of {listed(unknown)}: there is no parameter {place}. Load the "
            "file of the controllers first."
        )
    return joints


def parser() -> OneSentenceParser:
    """Make a parser of the arguments of controller_manager's spawner."""
    made = OneSentenceParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    made.add_argument(
        "controllers", nargs="+", metavar="NAME", help="names of controllers"
    )
    for name in ("--wait-for", "--shutdown-timeout", "--timeout"):
        made.add_argument(name, metavar="VALUE", help="ignored")
    return made


def main() -> None:
    """Run the node."""
    names = parser().parse_args(own_arguments()).controllers
    start_node("joint_controllers")
    try:
        joints = find_joints([name for name in names if name != ALL_JOINTS])
    except G1DescriptionError as error:
        rospy.logfatal("%s", error)
        sys.exit(1)
    model = rospy.get_param("~model_name", rospy.get_namespace().strip("/"))
    controllers = JointControllers(str(model), joints, ALL_JOINTS in names)
    rospy.loginfo("%s: controllers of %d joints", model, len(joints))
    controllers.run()
