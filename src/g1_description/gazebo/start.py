"""The start of the simulator: a world file and a robot."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import rospy

from g1_description.errors import DescriptionError, InvalidValueError
from g1_description.files.model_files import find_model
from g1_description.files.xml import decoded
from g1_description.gazebo.parameters import INITIAL, GazeboParameters, place_robot
from g1_description.gazebo.services.models import log_hulls
from g1_description.motion.motors import Motors, named_motors, read_motors
from g1_description.robot.assembly import Assembly
from g1_description.robot.profile import is_name
from g1_description.ros.parameters import private_parameters
from g1_description.sdf.world import EMPTY_WORLD, Sdf, read_sdf
from g1_description.sim.engine import GRAVITY_AXES
from g1_description.sim.world import World
from g1_description.text import listed


def make_world(parameters: GazeboParameters) -> tuple[World, GazeboParameters]:
    """Make the world of the file ``~world``.

    Returns:
        The world, and the parameters with the physics of the file; the parameter server
        overrides the file.

    Raises:
        G1DescriptionError: If the file cannot be read or a model cannot be loaded.
    """
    content = _content(parameters.world)
    physics, notes = _physics(content, parameters)
    properties = replace(parameters.properties, **physics)
    parameters = replace(parameters, properties=properties)
    motors: Motors | str | None = None
    if parameters.physics == "hold":
        given = parameters.motors
        motors = read_motors(Path(given)) if given and not is_name(given) else given
    world = World(parameters.physics, properties, content, motors, parameters.engine)
    for line in (*notes, *world.left_out):
        rospy.logwarn("%s: %s", parameters.world, line)
    own = private_parameters()
    for name, used in asdict(properties).items():
        if own.get(name, used) != used:
            rospy.loginfo(
                "~%s = %s is ignored; set ~%s%s", name, own[name], INITIAL, name
            )
    return world, parameters


def _content(path: str) -> Sdf:
    """Read a world file; without one, the empty world."""
    if not path:
        return read_sdf(EMPTY_WORLD)
    file = Path(path)
    if not file.is_file():
        raise DescriptionError(f"World file {path} does not exist.")
    try:
        return read_sdf(decoded(file.read_bytes(), "replace"), find_model)
    except DescriptionError as error:
        raise DescriptionError(f"World file {path}: {error}") from error


def _physics(
    content: Sdf, parameters: GazeboParameters
) -> tuple[dict[str, float], list[str]]:
    """Collect the physics of a world file that is not overridden by parameters."""
    given = {**content.physics, **dict(zip(GRAVITY_AXES, content.gravity or ()))}
    found, notes = {}, []
    for name, value in given.items():
        initial = getattr(parameters.properties, name)
        number = type(initial)(value)
        parameter = f"~{INITIAL}{name}"
        if rospy.has_param(parameter):
            if parameters.world and initial != number:
                notes.append(
                    f"{name} is {initial:g} ({parameter} overrides the file's "
                    f"{number:g})"
                )
            continue
        try:
            replace(parameters.properties, **{name: number})
        except InvalidValueError as error:
            notes.append(f"ignored: {error}")
        else:
            found[name] = number
    return found, notes


def spawn_robot(world: World, parameters: GazeboParameters) -> None:
    """Spawn the robot of the parameters, if they name one.

    Raises:
        G1DescriptionError: If it cannot be spawned.
    """
    name = parameters.spawn.model_name
    if not parameters.spawn.robot_description:
        return
    dynamic, fixed = world.is_dynamic, parameters.fixed_base
    assembly, pose = place_robot(parameters.spawn, fixed and dynamic, dynamic)
    if parameters.physics == "hold" and is_name(parameters.motors):
        named_motors(assembly.description.profile, parameters.motors)
    for line in world.spawn(name, assembly, pose, fixed):
        rospy.logwarn("%s: %s", name, line)
    try:
        world.anchors.set(world.models[name], parameters.spawn.anchor)
    except InvalidValueError as error:
        rospy.logwarn("The anchor of %s is ignored: %s.", name, error)
    log_hulls(world.models[name])
    other = {"mujoco": " with MuJoCo"}.get(parameters.engine, "")
    rospy.loginfo("%s: %s", name, figures(assembly, parameters.physics + other))


def figures(assembly: Assembly, physics: str) -> str:
    """Summarize a robot in a line, with its mass if that is known."""
    robot = assembly.description
    mass = "" if robot.mass is None else f" {robot.mass:.3f} kg,"
    joints, links = len(robot.movable_joints), len(assembly.link_names)
    profile = f"profile {robot.profile.name}" if robot.profile.name else "no profile"
    # Lumped links are not missing: those of the whole robot count.
    missing = (robot.given_profile or robot.profile).missing_links
    if missing:
        names = (f"{role}: {link}" for role, link in missing.items())
        profile += f", whose links {listed(names)} the robot does not have"
    return f"{joints} joints, {links} links,{mass} {physics}, {profile}"
