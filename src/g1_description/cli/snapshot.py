"""The command snapshot, which draws a running robot, or a motion.

With --model or --motion, ROS is not used.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Collection, Sequence

import numpy as np

from g1_description.checks.arrows import motion_arrows
from g1_description.choices import DEFAULT
from g1_description.cli import options
from g1_description.cli.film import (
    FILMS,
    Moment,
    check_length,
    check_place,
    count,
    drawn,
    film,
    forces_of,
    frame,
    motion_of,
    place,
    placed,
    write_film,
    write_picture,
    write_video,
)
from g1_description.cli.options import MODEL
from g1_description.cli.start import is_shut_down
from g1_description.command_line import (
    argument,
    exit_with_error,
    number,
    option,
    own_arguments,
    parse,
)
from g1_description.errors import (
    G1DescriptionError,
    InvalidValueError,
    UnknownNameError,
)
from g1_description.files.atomic import write_whole
from g1_description.motion.files.formats import read_motion
from g1_description.motion.files.source import ReadOptions
from g1_description.motion.motion import Motion, configuration, sample
from g1_description.render.camera import VIEWS
from g1_description.render.page import motion_page
from g1_description.render.scene import Picture, draw
from g1_description.robot.description import Description
from g1_description.robot.load import read_description
from g1_description.robot.poses import check_limits
from g1_description.scenes.carried import holds_of, motion_links, object_poses
from g1_description.scenes.objects import SceneObject
from g1_description.scenes.scene import Scene
from g1_description.sim.standing import standing_base
from g1_description.text import listed, similar_first

SIDES = (16, 4096)
"""Smallest and largest width and height of a picture, in pixels."""

PAGE = ".html"


def size(text: str) -> tuple[int, int]:
    """Read a width and a height in pixels."""
    sides = text.lower().split("x")
    if len(sides) == 2 and all(side.isdigit() for side in sides):
        width, height = (int(side) for side in sides)
        if min(width, height) >= SIDES[0] and max(width, height) <= SIDES[1]:
            return width, height
    raise argparse.ArgumentTypeError(
        f"must be a size like 1280x960, from {SIDES[0]} to {SIDES[1]} pixels "
        f"(got '{text}')"
    )


def joints(text: str) -> dict[str, float]:
    """Read positions of joints."""
    pairs = [pair.partition("=") for pair in text.split(",")]
    for name, equals, position in pairs:
        if not (name.strip() and equals and position.strip()):
            raise argparse.ArgumentTypeError(
                f"must be like a=1.2,b=-0.3 (got '{text}')"
            )
    return {name.strip(): number(position) for name, _, position in pairs}


PICTURE, ANIMATION, RUNNING = "a picture", "an animation", "running robots"

EXCLUDED = {
    "size": {"a page"},
    "seconds": {PICTURE, "a page"},
    "fps": {PICTURE, "a page"},
    "time": {ANIMATION, "a page", RUNNING, "--model"},
    "namespace": {"--model", "--motion"},
    "joints": {RUNNING},
    "scene": {RUNNING},
    "forces": {"a page", RUNNING, "--model"},
    **dict.fromkeys(
        ("motion_fps", "motion_topic", "motion_order", "motion_format"),
        frozenset({RUNNING, "--model"}),
    ),
}
"""Options, and the outputs and robots to which they do not apply."""


@dataclass
class SnapshotOptions:
    """Write a picture, an animation or a page of the robot, or of a motion."""

    out: Path = argument(
        "output file: a picture .png, an animation .gif or .mp4, or a page in three "
        "dimensions .html",
        Path,
        metavar="OUT",
    )
    view: str = option(
        "direction to look from: front, side (the robot's right), back or iso",
        "iso",
        choices=tuple(VIEWS),
    )
    size: tuple[int, int] = option(
        "width and height in pixels",
        None,
        size,
        shown="1280x960, for animations 640x480",
    )
    joints: dict[str, float] = option(
        "positions of joints in rad or m, with --model or --motion, such as "
        "a=1.2,b=-0.3",
        None,
        joints,
    )
    namespace: list[str] | None = option(
        "namespace of the robot's topics; repeat it for several robots",
        None,
        str,
        shown="the current namespace",
        action="append",
    )
    model: str | None = option(
        f"draw {MODEL}, without a master: at its zero pose, or with --motion",
        None,
        str,
    )
    motion: Path | None = option(
        "draw the motion in this file, without a master",
        None,
        options.motion_file,
        metavar="FILE",
    )
    motion_fps: float | None = options.fps()
    motion_topic: str | None = options.topic()
    motion_order: str | None = options.order()
    motion_format: str | None = options.file_format()
    scene: Path | None = options.scene()
    time: float | None = option(
        "time of the motion that a picture shows [s]", None, number, shown="its begin"
    )
    forces: bool = option(
        "draw the contact forces of the motion, and in red what is missing", False
    )
    gif: bool = option("write an animation; implied by .gif and .mp4", False)
    seconds: float | None = option(
        "duration of the animation [s], at most 60",
        None,
        number,
        shown="5, or the whole motion",
    )
    fps: float = option(
        "pictures per second of the animation, at most 30", None, number, shown="15"
    )

    def __post_init__(self) -> None:
        """Check combinations of options, and set defaults that depend on others.

        Raises:
            InvalidValueError: If options contradict each other, the file cannot be
                written, or an animation would be too long.
        """
        ending = self.out.suffix.lower()
        self.is_film = self.gif or ending in FILMS
        self.is_page = ending == PAGE
        self._check()
        if ending == ".mp4" and any(side % 2 for side in self.size or ()):
            raise InvalidValueError("for .mp4, both numbers of --size must be even")
        if self.seconds is None and not self.motion:
            self.seconds = 5.0
        self.joints = self.joints or {}
        self.fps = 15.0 if self.fps is None else self.fps
        self.size = self.size or ((640, 480) if self.is_film else (1280, 960))
        check_place(self.out, FILMS if self.is_film else (".png", PAGE))
        if self.is_film:
            seconds = 1.0 if self.seconds is None else self.seconds
            check_length(seconds, self.fps, self.size)

    def _check(self) -> None:
        """Check that options apply to the output and its content."""
        output = ANIMATION if self.is_film else "a page" if self.is_page else PICTURE
        shown = "--motion" if self.motion else "--model" if self.model else RUNNING
        for name, uses in EXCLUDED.items():
            value = getattr(self, name)
            for one in (output, shown):
                if value is not None and value is not False and one in uses:
                    flag = f"--{name.replace('_', '-')}"
                    raise InvalidValueError(f"{flag} does not apply to {one}")
        if self.is_film and shown == "--model":
            raise InvalidValueError("an animation of --model needs --motion")
        if self.is_page and len(self.namespace or []) > 1:
            raise InvalidValueError(
                "a page shows one robot: --namespace cannot be repeated"
            )


def notify(sentence: str) -> None:
    """Print a message on stderr."""
    print(f"snapshot: {sentence}", file=sys.stderr, flush=True)


def check_joints(requested: dict[str, float], description: Description) -> None:
    """Check that a robot has joints, and that positions are within their limits.

    Raises:
        UnknownNameError: If a joint is unknown.
        InvalidValueError: If a position is outside the limits.
    """
    joints = {joint.name: joint for joint in description.movable_joints}
    unknown = [name for name in requested if name not in joints]
    if unknown:
        raise UnknownNameError(
            f"Robot '{description.name}' has no joint {listed(unknown)}. Its joints: "
            f"{listed(similar_first(unknown[0], joints)) or 'none'}."
        )
    for name, position in requested.items():
        check_limits("--joints", joints[name], position)


def draw_all(
    robots: Sequence[Description],
    moments: Sequence[Moment],
    args: SnapshotOptions,
    objects: Collection[SceneObject] = (),
) -> None:
    """Draw robots and objects, and write a picture or an animation.

    Args:
        robots: The robots.
        moments: All of them in each picture.
        args: The options.
        objects: The objects.

    Raises:
        KeyboardInterrupt: If the node was shut down meanwhile; nothing is written.
    """
    scene = Picture()
    for robot in robots:
        _, left_out = scene.add(robot)
        if left_out:
            notify(f"ignored in '{robot.name}': {'; '.join(left_out)}.")
    _, left_out = scene.add_objects(objects)
    if left_out:
        notify(f"ignored in {args.scene}: {'; '.join(left_out)}.")
    camera, floor = frame(scene, moments, args.view, args.size)

    def picture(n: int) -> np.ndarray:
        place(scene, moments[n])
        return draw(scene, camera, *args.size, floor, forces_of(moments[n]))

    if args.out.suffix.lower() == ".mp4":
        write_video(args.out, drawn(len(moments), picture), args.size, args.fps)
    elif args.is_film:
        write_film(args.out, film(len(moments), picture), args.fps)
    else:
        pixels = picture(0)
        if is_shut_down():
            raise KeyboardInterrupt
        write_picture(args.out, pixels)
    print(f"{args.out}: {'x'.join(map(str, args.size))}, {args.view}")


def draw_file(args: SnapshotOptions) -> None:
    """Draw a motion, or a robot at its zero pose, from files.

    Raises:
        G1DescriptionError: If a file cannot be read, or an option does not fit it.
    """
    robot, motion, scene = read_files(args)
    times = _times(args, motion)
    found = sample(motion, times)
    bases = found.base_poses
    poses = np.zeros((len(times), 0, 7))
    if scene:
        links = motion_links(robot, motion)
        poses = object_poses(holds_of(scene.values(), robot, links), times, links)
    forces = motion_arrows(robot, motion, scene) if args.forces else None
    moments = [
        Moment(
            [placed(robot, None if bases is None else bases[number], row)],
            dict(zip(scene, poses[number])),
            forces.at(times[number]) if forces else (),
        )
        for number, row in enumerate(
            dict(zip(motion.joint_names, row)) for row in found.positions.tolist()
        )
    ]
    draw_all([robot], moments, args, [*scene.values()])
    missing = forces.text(times[0]) if forces and not args.is_film else ""
    if missing:
        notify(f"{missing} at {times[0]:g} s.")


def write_page(args: SnapshotOptions) -> None:
    """Write a page in three dimensions, of files or of a running robot.

    Raises:
        G1DescriptionError: As for ``draw_file`` and ``watch_now``.
    """
    if args.model or args.motion:
        robot, motion, scene = read_files(args)
    else:
        robots, (moment,), objects = watch_now(args)
        robot, motion = robots[0], motion_of(robots[0], moment.robots[0])
        known = moment.objects
        scene = Scene([replace(o, pose=known.get(o.name, o.pose)) for o in objects])
    name = args.motion.name if args.motion else robot.name
    text = motion_page(robot, motion, name=name, scene=scene)
    # File names may contain bytes that are not text.
    write_whole(args.out, text.encode("utf-8", "backslashreplace"))
    n = len(motion.times)
    print(f"{args.out}: {n} samples" if n > 1 else f"{args.out}: one configuration")


def read_files(args: SnapshotOptions) -> tuple[Description, Motion, Scene]:
    """Read a robot, its motion and its scene.

    Without a motion, the robot's zero pose is the only sample. In a scene, a robot
    without poses of its base stands on the floor as in the first sample.

    Raises:
        G1DescriptionError: If a file cannot be read, or an option does not fit it.
    """
    robot = read_description(args.model or DEFAULT)
    check_joints(args.joints, robot)
    zero = dict.fromkeys([joint.name for joint in robot.movable_joints], 0.0)
    motions = [args.motion] if args.motion else []
    scene = options.scene_of(args.scene, motions) or Scene()
    if not args.motion:
        motion = configuration({**zero, **args.joints}, None)
        return robot, _standing(robot, motion) if scene else motion, scene
    given = ReadOptions(
        args.motion_fps, args.motion_topic, args.motion_order, args.motion_format
    )
    motion = read_motion(args.motion, robot, given)
    for note in motion.notes:
        notify(note)
    motion = with_joints(motion, args.joints)
    return robot, _standing(robot, motion) if scene else motion, scene


def _standing(robot: Description, motion: Motion) -> Motion:
    """Let a robot of a motion without poses of the base stand on the floor."""
    if motion.base_poses is not None:
        return motion
    bent = dict(zip(motion.joint_names, motion.positions[0].tolist()))
    bases = np.tile(standing_base(robot, bent), (len(motion.times), 1))
    return replace(motion, base_poses=bases)


def _times(args: SnapshotOptions, motion: Motion) -> np.ndarray:
    """Choose the times to draw, in [s]."""
    begin, end = motion.begin, motion.end
    if args.is_film:
        whole = max(motion.duration, 1.0 / args.fps)
        seconds = whole if args.seconds is None else min(args.seconds, whole)
        check_length(seconds, args.fps, args.size)
        return begin + np.arange(count(seconds, args.fps)) / args.fps
    time = begin if args.time is None else args.time
    if not begin <= time <= end:
        raise InvalidValueError(
            f"--time {time:g} is outside the motion ({begin:g}-{end:g} s)."
        )
    return np.array([time])


def with_joints(motion: Motion, positions: dict[str, float]) -> Motion:
    """Hold joints of a motion at given positions."""
    new = [name for name in positions if name not in motion.joint_names]
    motion = motion.arranged([*motion.joint_names, *new])
    columns = [motion.joint_names.index(name) for name in positions]
    held, velocities = motion.positions.copy(), motion.velocities
    held[:, columns] = [*positions.values()]
    if velocities is not None:
        velocities = velocities.copy()
        velocities[:, columns] = 0.0
    return replace(motion, positions=held, velocities=velocities)


def watch_now(
    args: SnapshotOptions,
) -> tuple[list[Description], list[Moment], list[SceneObject]]:
    """Sample the running robots, for the requested duration.

    Returns:
        The robots, all that is in each picture, and the objects in the simulator.

    Raises:
        NoAnswerError: If there is no master, it is lost, or no states of a robot.
        InvalidValueError: Without ROS.
    """
    try:
        from g1_description.cli.running_robots import watch
    except ModuleNotFoundError as error:
        raise InvalidValueError(
            f"Running robots need ROS (there is no {error.name}); --motion FILE or "
            "--model FILE draws without it."
        ) from error
    return watch(
        args.namespace, (args.seconds, args.fps) if args.is_film else None, notify
    )


def main() -> None:
    """Run the command, or exit with a message."""
    try:
        args = parse(SnapshotOptions, "snapshot", own_arguments())
        if args.is_page:
            write_page(args)
        elif args.model or args.motion:
            draw_file(args)
        else:
            robots, moments, objects = watch_now(args)
            draw_all(robots, moments, args, objects)
    except (G1DescriptionError, OSError) as error:
        exit_with_error("snapshot", error)
