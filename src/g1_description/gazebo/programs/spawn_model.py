"""gazebo_ros' spawn_model: spawns a model from a file, parameter, database or input.

Calls: spawn_urdf_model or spawn_sdf_model (gazebo_msgs/SpawnModel),
    set_model_configuration (gazebo_msgs/SetModelConfiguration),
    unpause_physics (std_srvs/Empty), get_world_properties
    (gazebo_msgs/GetWorldProperties), delete_model (gazebo_msgs/DeleteModel),
    below /gazebo. Waits use wall time, as simulated time may stand still.
"""

from __future__ import annotations

import argparse
import re
import sys
import threading
from pathlib import Path

import numpy as np
import rospy
from gazebo_msgs.srv import (
    DeleteModel,
    GetWorldProperties,
    SetModelConfiguration,
    SpawnModel,
)
from std_srvs.srv import Empty

from g1_description.command_line import OneSentenceParser, number, own_arguments
from g1_description.errors import DescriptionError
from g1_description.files.model_files import model_folders, searched_folders
from g1_description.files.xml import decoded, parse_xml
from g1_description.robot.rotation import from_rpy
from g1_description.ros.conversions import pose_from_array
from g1_description.ros.lifecycle import start_node
from g1_description.ros.waiting import MASTER_PERIOD, wait_until

WARN_AFTER = 1.0
"""Wait for a service after which a message is logged, in [s]."""

LOAD_TIME = 0.5
"""Time in [s] that Gazebo loads a model after it said that it is spawned; meanwhile it
often loses positions of joints."""


def parser() -> OneSentenceParser:
    """Make a parser of spawn_model's arguments."""
    made = OneSentenceParser(prog="spawn_model", description="Spawn a model in Gazebo.")
    kind = made.add_mutually_exclusive_group(required=True)
    kind.add_argument("-urdf", action="store_true", help="the model is a URDF")
    kind.add_argument("-sdf", action="store_true", help="the model is SDF")
    source = made.add_mutually_exclusive_group(required=True)
    source.add_argument("-file", metavar="PATH", help="read the model from a file")
    source.add_argument("-param", metavar="NAME", help="or from the parameter server")
    source.add_argument("-database", metavar="NAME", help="or from the model path")
    source.add_argument("-stdin", action="store_true", help="or from standard input")
    made.add_argument("-model", required=True, help="name of the model in the world")
    for name in "xyz":
        made.add_argument(f"-{name}", type=number, default=0.0, help="position [m]")
    for name in "RPY":
        made.add_argument(f"-{name}", type=number, default=0.0, help="rotation [rad]")
    made.add_argument(
        "-reference_frame", default="", help="frame of the pose; default: world"
    )
    made.add_argument(
        "-J",
        dest="joints",
        nargs=2,
        action="append",
        default=[],
        metavar=("JOINT", "POSITION"),
        help="set a joint; may be repeated",
    )
    made.add_argument("-wait", metavar="MODEL", help="wait for this model first")
    made.add_argument(
        "-unpause", action="store_true", help="unpause physics at the end"
    )
    made.add_argument("-b", action="store_true", help="delete the model on shutdown")
    made.add_argument(
        "-package_to_model",
        action="store_true",
        help="turn package:// of meshes into model://",
    )
    made.add_argument("-robot_namespace", help="ROS namespace of the model's plugins")
    made.add_argument(
        "-gazebo_namespace", default="/gazebo", help="namespace of the services"
    )
    return made


def parse(arguments: list[str]) -> argparse.Namespace:
    """Read a command line; exit on an error."""
    reader = parser()
    # A space before a negative number: argparse takes -1e-3 for an option.
    words = [re.sub(r"^(?=-\.?\d)", " ", word) for word in arguments]
    args = reader.parse_args(words)
    try:
        args.joints = {name: number(position) for name, position in args.joints}
    except argparse.ArgumentTypeError as error:
        reader.error(f"argument -J: {error}")
    return args


def read_text(args: argparse.Namespace) -> str:
    """Read the model's text from the file, parameter, database or input.

    Raises:
        DescriptionError: If there is none, or it is not XML.
    """
    if args.param:
        place, text = f"parameter {args.param}", rospy.get_param(args.param, "")
    elif args.stdin:
        place, text = "input", sys.stdin.read()
    else:
        path = find_in_database(args.database) if args.database else args.file
        place, text = f"file {path}", _read_file(path)
    if not text or not isinstance(text, str):
        raise DescriptionError(f"The {place} is empty or missing.")
    parse_xml(f"text of the {place}", text)
    return package_to_model(text) if args.package_to_model else text


def _read_file(path: str) -> str:
    """Read a file."""
    try:
        return decoded(Path(path).read_bytes())
    except OSError as error:
        raise DescriptionError(
            f"Cannot read the file {path}: {error.strerror}."
        ) from error
    except UnicodeDecodeError as error:
        raise DescriptionError(f"The file {path} is not text: {error}.") from error


def find_in_database(model: str) -> str:
    """Find a model's SDF file below the model paths."""
    for folder in model_folders():
        path = Path(folder, model, "model.sdf")
        if path.is_file():
            return str(path)
    raise DescriptionError(
        f"No {model}/model.sdf below {searched_folders()}; online databases are not "
        "searched."
    )


def package_to_model(text: str) -> str:
    """Turn package:// into model:// in the file names of meshes."""
    return re.sub(
        r"""(<mesh\b[^>]*?\bfilename\s*=\s*["'])package://""", r"\1model://", text
    )


class GazeboServices:
    """Gazebo's services below a namespace."""

    def __init__(self, namespace: str) -> None:
        self._namespace = namespace.rstrip("/")
        self._lock = threading.RLock()
        self._has_spawned = self._is_over = False

    def wait_for(self, *names: str) -> None:
        """Wait for services.

        Raises:
            ROSInterruptException: If the node was shut down meanwhile.
        """
        for name in names:
            service = f"{self._namespace}/{name}"
            try:
                rospy.wait_for_service(service, WARN_AFTER)
            except rospy.ROSException:
                rospy.loginfo("Waiting for the service %s.", service)
                rospy.wait_for_service(service)

    def wait_and_call(self, name: str, kind, *arguments):
        """Wait for a service and call it.

        Raises:
            ROSInterruptException: If the node was shut down meanwhile.
            ServiceException: If it refuses.
        """
        self.wait_for(name)
        return self.call(name, kind, *arguments)

    def call(self, name: str, kind, *arguments):
        """Call a service without waiting for it.

        Raises:
            ROSInterruptException: If the node was shut down meanwhile.
            ServiceException: If it does not exist, or refuses.
        """
        with self._lock:
            if self._is_over:
                raise rospy.ROSInterruptException("interrupted")
            service = rospy.ServiceProxy(f"{self._namespace}/{name}", kind)
            response = service(*arguments)
            if not getattr(response, "success", True):
                raise rospy.ServiceException(response.status_message)
            self._has_spawned = self._has_spawned or kind is SpawnModel
        return response

    def delete_spawned(self, name: str) -> None:
        """Delete a model if it was spawned, and refuse further calls.

        Called from the shutdown thread, perhaps while the model is being spawned.
        Gazebo may have ended already.
        """
        with self._lock:
            try:
                if self._has_spawned:
                    response = self.call("delete_model", DeleteModel, name)
                    rospy.loginfo("%s", response.status_message)
            except (rospy.ROSException, rospy.ServiceException) as error:
                rospy.logwarn("The model %s was not deleted: %s", name, error)
            self._is_over = True

    def wait_for_model(self, name: str) -> None:
        """Wait until a model is in the world."""
        rospy.loginfo("Waiting for the model %s.", name)
        world = "get_world_properties", GetWorldProperties
        wait_until(
            lambda: name in self.wait_and_call(*world).model_names,
            period=MASTER_PERIOD,
        )


def calls(args: argparse.Namespace, text: str):
    """List the calls in order: service, type, arguments."""
    rotation = from_rpy(np.array([args.R, args.P, args.Y]))
    namespace = args.robot_namespace
    yield (
        "spawn_sdf_model" if args.sdf else "spawn_urdf_model",
        SpawnModel,
        args.model,
        text,
        rospy.get_namespace() if namespace is None else namespace,
        pose_from_array(np.array([args.x, args.y, args.z, *rotation])),
        args.reference_frame,
    )
    if args.joints:
        rospy.rostime.wallsleep(LOAD_TIME)
        names, positions = list(args.joints), list(args.joints.values())
        service = "set_model_configuration"
        yield service, SetModelConfiguration, args.model, "", names, positions
    if args.unpause:
        yield "unpause_physics", Empty


def spawn(args: argparse.Namespace, services: GazeboServices) -> None:
    """Spawn a model.

    Raises:
        DescriptionError: If the model cannot be read.
        ROSInterruptException: If the node was shut down meanwhile.
        ServiceException: If Gazebo refuses.
    """
    text = read_text(args)
    if args.wait:
        services.wait_for_model(args.wait)
    for call in calls(args, text):
        response = services.wait_and_call(*call)
        rospy.loginfo("%s", getattr(response, "status_message", f"{call[0]}: done"))


def main() -> None:
    """Run ``spawn_model``."""
    args = parse(own_arguments())
    start_node("spawn_model", anonymous=True)
    services = GazeboServices(args.gazebo_namespace)
    if args.b:
        rospy.on_shutdown(lambda: services.delete_spawned(args.model))
    try:
        spawn(args, services)
    except rospy.ROSInterruptException:
        sys.exit(f"spawn_model: interrupted before {args.model} was spawned.")
    except (DescriptionError, rospy.ServiceException) as error:
        rospy.logerr("%s", error)
        sys.exit(1)
    if args.b:
        rospy.spin()
