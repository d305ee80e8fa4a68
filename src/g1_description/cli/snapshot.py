"""A picture or a film of the robot as it is now, or of a motion, without a screen.

Subscribes: joint_states (sensor_msgs/JointState), /tf, /tf_static
Reads: robot_description; with --model or --motion nothing of ROS at all.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import Sequence

import numpy as np
import rosgraph
import rospy

from g1_description.cli.film import (
    FILMS,
    PlacedRobot,
    check_length,
    check_place,
    drawn,
    film,
    now,
    read_motion,
    record,
    side_by_side,
    write_film,
    write_picture,
    write_video,
)
from g1_description.command_line import OneSentenceParser, number
from g1_description.errors import (
    G1DescriptionError,
    InvalidValueError,
    UnknownNameError,
)
from g1_description.render.camera import VIEWS, Camera, framing
from g1_description.render.picture import draw
from g1_description.render.scene import Scene
from g1_description.robot.description import Description
from g1_description.robot.load import absolute_urdf
from g1_description.robot.poses import check_limits
from g1_description.robot.transform import IDENTITY
from g1_description.robot.urdf import parse_urdf
from g1_description.ros.lifecycle import own_arguments, start_node
from g1_description.ros.robot_view import RobotView
from g1_description.ros.waiting import NoAnswerError, wait_until
from g1_description.text import listed, similar_first

SIDES = (16, 4096)
"""Smallest and largest width and height of a picture, in pixels."""

JOINTS_TIMEOUT = 10.0
"""Longest wait for the positions of all joints, in [s]."""

BASE_TIMEOUT = 2.0
"""Longest wait for the base once the joints are known, in [s]."""

MAX_TIMES = 60
"""Most pictures of a contact sheet."""


def parser() -> OneSentenceParser:
    """Make a parser of snapshot's arguments."""
    made = OneSentenceParser(
        prog="snapshot",
        description="Write a picture or a film of the robot as it is now, or of a "
        "motion from a file.",
    )
    made.add_argument(
        "out", type=Path, help="output file: a picture .png, or a film .gif or .mp4"
    )
    made.add_argument(
        "--view",
        choices=VIEWS,
        default="iso",
        help="direction to look from; side: from the robot's right; default: iso",
    )
    made.add_argument(
        "--size",
        type=size,
        help="width and height in pixels; default: 1280x960, for films 640x480",
    )
    made.add_argument(
        "--joints",
        type=joints,
        default={},
        help="override joint positions, such as a=1.2,b=-0.3",
    )
    made.add_argument(
        "--model",
        help="draw a model file, as for model:= of the launch files, without a master",
    )
    made.add_argument(
        "--namespace",
        action="append",
        help="namespace of the robot's topics; repeat it for several robots",
    )
    made.add_argument(
        "--motion",
        help="draw the motion in this file (CSV, npz, pickle, bag, YAML of a "
        "trajectory) without a master: a film, or a sheet of pictures",
    )
    made.add_argument(
        "--motion-fps",
        type=number,
        help="samples per second of a motion without times; default: 30",
    )
    made.add_argument(
        "--motion-topic",
        help="topic of a bag with the joints; default: joint_states, or what there is",
    )
    made.add_argument(
        "--times",
        type=times,
        help="moments of the motion to draw side by side, such as 0,1.5,3",
    )
    made.add_argument(
        "--gif", action="store_true", help="record a film; as the name of the file says"
    )
    made.add_argument(
        "--seconds",
        type=number,
        help="duration of the film; default: 5, or the whole motion",
    )
    made.add_argument(
        "--fps", type=number, help="pictures per second of the film; default: 15"
    )
    return made


def size(text: str) -> tuple[int, int]:
    """Read a width and a height in pixels."""
    sides = text.lower().split("x")
    if len(sides) == 2 and all(side.isdigit() for side in sides):
        width, height = (int(side) for side in sides)
        if min(width, height) >= SIDES[0] and max(width, height) <= SIDES[1]:
            return width, height
    raise argparse.ArgumentTypeError(
        f"'{text}' is no size such as 1280x960, of {SIDES[0]} to {SIDES[1]} pixels"
    )


def joints(text: str) -> dict[str, float]:
    """Read positions of joints."""
    pairs = [pair.partition("=") for pair in text.split(",")]
    for name, equals, position in pairs:
        if not (name.strip() and equals and position.strip()):
            raise argparse.ArgumentTypeError(f"'{text}' is not such as a=1.2,b=-0.3")
    return {name.strip(): number(position) for name, _, position in pairs}


def times(text: str) -> list[float]:
    """Read moments of a motion, in [s]."""
    found = [number(part) for part in text.split(",")]
    if len(found) > MAX_TIMES:
        raise argparse.ArgumentTypeError(f"a sheet has at most {MAX_TIMES} pictures")
    return found


def parse(arguments: list[str]) -> argparse.Namespace:
    """Read a command line; end the program when it is wrong.

    Raises:
        InvalidValueError: If the file cannot be written, or a film be made.
    """
    reader = parser()
    args = reader.parse_args(arguments)
    args.is_film = args.gif or args.out.suffix.lower() in FILMS
    _check_together(reader, args)
    if args.seconds is None and not args.motion:
        args.seconds = 5.0
    args.fps = 15.0 if args.fps is None else args.fps
    args.size = args.size or ((640, 480) if args.is_film else (1280, 960))
    check_place(args.out, FILMS if args.is_film else (".png",))
    if args.is_film:
        check_length(1.0 if args.seconds is None else args.seconds, args.fps, args.size)
    return args


def _check_together(reader: OneSentenceParser, args: argparse.Namespace) -> None:
    """End the program where arguments do not go together."""
    if args.model and args.is_film and not args.motion:
        reader.error("--model draws a file, a film of it needs --motion")
    if (args.model or args.motion) and args.namespace:
        reader.error("--model and --motion draw files, without --namespace")
    if args.joints and len(args.namespace or []) > 1:
        reader.error("--joints is for one robot, not for several --namespace")
    if not args.is_film and not (args.seconds is None and args.fps is None):
        reader.error("--seconds and --fps go with a film")
    of_motion = (args.motion_fps, args.motion_topic, args.times)
    if not args.motion and any(value is not None for value in of_motion):
        reader.error("--motion-fps, --motion-topic and --times go with --motion")
    if args.times is not None and args.is_film:
        reader.error("--times goes with a picture, not with a film")
    if args.motion_fps is not None and not 0.0 < args.motion_fps <= 1e6:
        reader.error(
            f"--motion-fps {args.motion_fps:g} is no number of samples per second"
        )
    if (
        args.out.suffix.lower() == ".mp4"
        and args.size
        and any(n % 2 for n in args.size)
    ):
        reader.error("--size of an mp4 has even numbers")


PORTRAIT = 0.75
"""About the width over the height of a picture on a contact sheet."""

G1 = "package://g1_description/urdf/g1_29dof.urdf"
"""The robot of a motion where none is given."""


def notify(sentence: str) -> None:
    """Print a message on stderr."""
    print(f"snapshot: {sentence}", file=sys.stderr, flush=True)


def check_joints(wanted: dict[str, float], description: Description) -> None:
    """Check that joints are there, and within their limits.

    Raises:
        UnknownNameError: If one is not there.
        InvalidValueError: If one cannot be so.
    """
    joints = {joint.name: joint for joint in description.movable_joints}
    unknown = [name for name in wanted if name not in joints]
    if unknown:
        raise UnknownNameError(
            f"Robot '{description.name}' has no joint {listed(unknown)}; "
            f"it has {listed(similar_first(unknown[0], joints)) or 'none'}."
        )
    for name, position in wanted.items():
        check_limits("--joints", joints[name], position)


def load(scene: Scene, description: Description) -> None:
    """Add a robot to a scene and report what is missing."""
    _, left_out = scene.add(description)
    if left_out:
        notify(f"left out of '{description.name}': {'; '.join(left_out)}.")


def frame(
    scene: Scene,
    moments: Sequence[Sequence[PlacedRobot]],
    view: str,
    size: tuple[int, int],
) -> tuple[Camera, float]:
    """Find where to look from, so that the robots are seen at all moments.

    Args:
        scene: The robots.
        moments: What all of them do.
        view: Name of the view.
        size: Width and height of the picture in pixels.

    Returns:
        The camera, and the height of the floor in [m]: that of the map, or below the
        robots whose pose is unknown.

    Raises:
        InvalidValueError: If there is nothing to see.
    """
    corners = []
    for moment in moments:
        place(scene, moment)
        corners.append(scene.corners())
    points = np.concatenate(corners)
    if not points.size:
        raise InvalidValueError(
            "Nothing can be drawn: the robot has no visual shapes, or none that can be "
            "read."
        )
    is_placed = any(root is not None for root, _ in moments[0])
    floor = 0.0 if is_placed else float(points[:, 2].min())
    return framing(points, *VIEWS[view], size[0] / size[1]), floor


def place(scene: Scene, moment: Sequence[PlacedRobot]) -> None:
    """Put all robots where they are, or else their root at the origin."""
    for robot, (root, positions) in enumerate(moment):
        scene.place(robot, IDENTITY if root is None else root, positions)


def write(
    scene: Scene, moments: Sequence[Sequence[PlacedRobot]], args: argparse.Namespace
) -> None:
    """Draw and write what was requested.

    Raises:
        KeyboardInterrupt: If the node was shut down meanwhile; nothing is written.
    """
    if args.motion and not args.is_film:
        write_picture(args.out, sheet(scene, moments, args))
        print(f"{args.out}: {len(moments)} moments, {args.view}")
        return
    camera, floor = frame(scene, moments, args.view, args.size)

    def picture(n: int) -> np.ndarray:
        place(scene, moments[n])
        return draw(scene, camera, *args.size, floor)

    if args.out.suffix.lower() == ".mp4":
        write_video(args.out, drawn(len(moments), picture), args.size, args.fps)
    elif args.is_film:
        write_film(args.out, film(len(moments), picture), args.fps)
    else:
        pixels = picture(0)
        if rospy.is_shutdown():
            raise KeyboardInterrupt
        write_picture(args.out, pixels)
    print(f"{args.out}: {'x'.join(map(str, args.size))}, {args.view}")


def sheet(
    scene: Scene, moments: Sequence[Sequence[PlacedRobot]], args: argparse.Namespace
) -> np.ndarray:
    """Draw moments side by side, each where the robot then is, all at one scale."""
    n, (width, height) = len(moments), args.size
    columns = columns_of(n, width / height)
    n_rows = -(-n // columns)
    size = max(SIDES[0], width // columns), max(SIDES[0], height // n_rows)
    views = [frame(scene, [moment], args.view, size) for moment in moments]
    widest = max((camera for camera, _ in views), key=lambda camera: camera.width)

    def picture(number: int) -> np.ndarray:
        place(scene, moments[number])
        camera, floor = views[number]
        camera = replace(camera, width=widest.width, distance=widest.distance)
        return draw(scene, camera, *size, floor)

    return side_by_side(list(drawn(len(moments), picture)), columns)


def columns_of(n: int, ratio: float) -> int:
    """Find in how many columns pictures fill a sheet best.

    Args:
        n: Number of pictures.
        ratio: Width of the sheet over its height.
    """
    ideal = (n * ratio / PORTRAIT) ** 0.5

    def loss(columns: int) -> float:
        n_empty = -n % columns
        return abs(math.log(columns / ideal)) + n_empty / n

    return min(range(1, n + 1), key=loss)


def draw_file(args: argparse.Namespace) -> None:
    """Draw a URDF file: a motion, or its zero pose with the joints requested."""
    description = parse_urdf(absolute_urdf(args.model or G1))
    check_joints(args.joints, description)
    moments: list[list[PlacedRobot]] = [[(None, {})]]
    if args.motion:
        moments, notes = read_motion(args, description)
        for note in notes:
            notify(note)
    draw_all([description], moments, args)


def draw_now(args: argparse.Namespace) -> None:
    """Draw the robots that run.

    Raises:
        NoAnswerError: If there is no master, it goes, or nothing comes from a robot.
    """
    try:
        descriptions, moments = watch_now(args)
    except rospy.ROSInterruptException:
        raise
    except (OSError, rospy.ROSException, rosgraph.MasterException) as error:
        raise NoAnswerError(f"the master is gone: {error}.") from error
    draw_all(descriptions, moments, args)


def draw_all(
    robots: Sequence[Description],
    moments: Sequence[Sequence[PlacedRobot]],
    args: argparse.Namespace,
) -> None:
    """Draw robots, with the joints requested."""
    moments = [
        [(root, {**positions, **args.joints}) for root, positions in moment]
        for moment in moments
    ]
    with Scene() as scene:
        for robot in robots:
            load(scene, robot)
        write(scene, moments, args)


def watch_now(
    args: argparse.Namespace,
) -> tuple[list[Description], list[list[PlacedRobot]]]:
    """Watch the robots that run, as long as was requested.

    Returns:
        The robots, and where all of them are in each picture.

    Raises:
        NoAnswerError: If there is no master, or nothing comes from a robot.
        OSError: If the master goes meanwhile; also the errors of ROS.
    """
    if not rosgraph.is_master_online():
        raise NoAnswerError(
            f"There is no master at {rosgraph.get_master_uri()}: launch a robot, or "
            "draw a file with --model FILE."
        )
    start_node("snapshot", anonymous=True)
    namespaces = args.namespace or [rospy.get_namespace()]
    views = [RobotView(name.strip("/"), notify) for name in namespaces]
    for view in views:
        check_joints(args.joints, view.description)
        wait_for(view)
        report_unknown(view, args.joints)
    moments = record(views, args.seconds, args.fps) if args.is_film else [now(views)]
    for view in views:  # drawing needs the processor
        view.close()
    return [view.description for view in views], moments


def wait_for(view: RobotView) -> None:
    """Wait for all joints, or at least some, and for the pose of the base.

    Raises:
        NoAnswerError: If no position of any joint comes.
        ROSInterruptException: If the node is shut down.
    """
    wait_until(lambda: not view.missing, JOINTS_TIMEOUT)
    if view.missing and not view.positions:
        raise NoAnswerError(
            f"No joint states of '{view.description.name}' came on {view.topic} "
            f"within {JOINTS_TIMEOUT:g} s: does the bridge run, and is time not paused?"
        )
    wait_until(lambda: has_base(view), BASE_TIMEOUT)


def has_base(view: RobotView) -> bool:
    """Tell whether the pose of a robot's base is known."""
    state = view.state
    return state is not None and state.base_pose is not None


def report_unknown(view: RobotView, wanted: dict[str, float]) -> None:
    """Report joints and poses that are unknown."""
    name = view.description.name
    missing = [joint for joint in view.missing if joint not in wanted]
    if missing:
        notify(f"unknown positions of '{name}', drawn at 0: {', '.join(missing)}.")
    if not has_base(view):
        notify(f"{view.no_base}: '{name}' is drawn with its root at the origin.")


def main() -> None:
    """Write a picture or a film, or exit with a message."""
    try:
        args = parse(own_arguments())
        (draw_file if args.model or args.motion else draw_now)(args)
    except G1DescriptionError as error:
        sys.exit(f"snapshot: {error}")
    except OSError as error:
        sys.exit(f"snapshot: {error}.")
