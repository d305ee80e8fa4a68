"""The command moveit_config, which writes a MoveIt configuration of a robot.

It needs neither a master nor MoveIt.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from xml.sax.saxutils import quoteattr

from lxml import etree

from g1_description.api import Robot
from g1_description.cli import options
from g1_description.collisions.allowed_pairs import ADJACENT
from g1_description.command_line import argument, exit_with_error, option, parse, say
from g1_description.errors import G1DescriptionError, InvalidValueError
from g1_description.files.atomic import write_whole
from g1_description.robot.assembly import limbs_of
from g1_description.robot.description import Description, Joint
from g1_description.robot.profile import is_profile
from g1_description.scenes.moveit import scene_text
from g1_description.scenes.scene import Scene

LIMBS = {
    "left_hand": "left_arm",
    "right_hand": "right_arm",
    "left_foot": "left_leg",
    "right_foot": "right_leg",
    "torso": "waist",
    "head": "neck",
}
"""Planning groups by the role of the link that a limb carries."""

HANDS = ("left_hand", "right_hand")

WHOLE = "whole_body"

SRDF, CONTROLLERS, BRIDGE = "robot.srdf", "controllers.yaml", "bridge.yaml"
JOINT_LIMITS, KINEMATICS = "joint_limits.yaml", "kinematics.yaml"
PLANNING, SCENE, LAUNCH = "ompl_planning.yaml", "objects.scene", "moveit.launch"

FOR_MOVEIT = (
    "action_ns: follow_joint_trajectory",
    "type: FollowJointTrajectory",
    "default: true",
)
"""Settings of a controller that MoveItSimpleControllerManager needs."""

ADAPTERS = (
    "AddTimeOptimalParameterization",
    "ResolveConstraintFrames",
    "FixWorkspaceBounds",
    "FixStartStateBounds",
    "FixStartStateCollision",
    "FixStartStatePathConstraints",
)
"""MoveIt's usual planning request adapters, in their order."""


@dataclass(frozen=True)
class MoveItOptions:
    """Write a MoveIt configuration of a robot.

    An SRDF with planning groups, named states and disabled collisions, settings of
    controllers, joint limits, kinematics and OMPL, and a launch file for them and
    display.launch.
    """

    out: Path = argument("the folder to write", Path, metavar="OUT")
    model: str = options.model()
    scene: Path | None = option(
        "a scene, whose objects MoveIt gets",
        None,
        Path,
        metavar="FILE",
        shown="none",
        see="[scenes](scenes.md)",
    )
    force: bool = option("replace existing files", False)


@dataclass(frozen=True)
class Group:
    """A planning group: the joints of a limb."""

    name: str
    base: str
    """The link that carries the limb."""

    tip: str
    """The last link of the chain."""

    joints: tuple[str, ...]
    hand: str = ""
    """The link of the end effector; empty if there is none."""

    @property
    def end(self) -> str:
        """Name of the end effector."""
        return self.name.replace("arm", "hand")


def groups_of(robot: Robot) -> tuple[Group, ...]:
    """Make a planning group of each limb with joints.

    A limb with a link that has a role in the robot's profile is named by that role,
    such as ``left_arm``; others by their last link. Joints off the path to that link,
    such as fingers, are in no group of a limb.
    """
    description = robot.description
    roles = {link: role for role, link in description.profile.links.items()}
    limbs, carriers = limbs_of(description), {j.child: j for j in description.joints}
    by_limb: dict[str, list[str]] = {}
    for link, limb in limbs.items():
        by_limb.setdefault(limb, []).append(link)
    found = []
    for links in by_limb.values():
        end = next((n for n in links if roles.get(n) in LIMBS), links[-1])
        way = _way(end, limbs, carriers)
        moving = [joint for joint in way if joint.kind != "fixed"]
        if not moving:
            continue  # the root, or what is fixed to it
        role = roles.get(end, "")
        # MoveIt's end effectors share no link with the group of their arm.
        is_hand = role in HANDS and way[-1].kind == "fixed"
        found.append(
            Group(
                LIMBS.get(role, f"to_{end}"),
                moving[0].parent,
                way[-1].parent if is_hand else end,
                tuple(joint.name for joint in moving),
                end if is_hand else "",
            )
        )
    return tuple(found)


def _way(
    end: str, limbs: Mapping[str, str], carriers: Mapping[str, Joint]
) -> list[Joint]:
    """Return the joints of a limb up to one of its links, the first one first."""
    way: list[Joint] = []
    link = end
    while link in carriers and limbs[link] == limbs[end]:
        way.insert(0, carriers[link])
        link = carriers[link].parent
    return way


def srdf(robot: Robot, groups: Sequence[Group]) -> bytes:
    """Write the SRDF."""
    root = etree.Element("robot", name=robot.name)

    def add(kind: str, parts: Iterable[tuple[str, dict[str, str]]] = (), **own: str):
        element = etree.SubElement(root, kind, own)
        for name, attributes in parts:
            etree.SubElement(element, name, attributes)

    for group in groups:
        chain = {"base_link": group.base, "tip_link": group.tip}
        add("group", [("chain", chain)], name=group.name)
    add("group", [("joint", {"name": n}) for n in robot.joint_names], name=WHOLE)
    for group in (g for g in groups if g.hand):
        add("group", [("link", {"name": group.hand})], name=group.end)
        ends = {"parent_link": group.tip, "parent_group": group.name}
        add("end_effector", name=group.end, group=group.end, **ends)
    parts = {WHOLE: robot.joint_names, **{g.name: g.joints for g in groups}}
    for pose in robot.pose_names:
        positions = dict(
            zip(robot.joint_names, robot.named_configuration(pose).tolist())
        )
        for name, joints in parts.items():
            values = [{"name": n, "value": f"{positions[n]:.10g}"} for n in joints]
            add("group_state", [("joint", v) for v in values], name=pose, group=name)
    place = {"parent_frame": "map", "child_link": robot.description.root}
    add("virtual_joint", name="map_joint", type="floating", **place)
    collisions = robot.checker().collisions
    checked = {frozenset(pair) for pair in collisions.pairs}
    reasons = {pair.links: pair.reason for pair in collisions.allowed}
    for link_a, link_b in combinations(collisions.links, 2):
        pair = frozenset((link_a, link_b))
        if pair not in checked:
            why = reasons.get(pair, ADJACENT).capitalize()
            add("disable_collisions", link1=link_a, link2=link_b, reason=why)
    return etree.tostring(
        root, pretty_print=True, xml_declaration=True, encoding="utf-8"
    )


def controllers(key: str, groups: Sequence[Group], *settings: str) -> str:
    """Write a list of controllers, one for each group.

    Args:
        key: Name of the list.
        groups: The groups.
        settings: Further lines of each controller.
    """
    lines = [f"{key}:"]
    for group in groups:
        lines += [
            f"- name: {json.dumps(f'{group.name}_controller')}",
            *(f"  {setting}" for setting in settings),
            f"  joints: {json.dumps(group.joints)}",
        ]
    return "\n".join([*lines, ""])


def joint_limits(description: Description) -> str:
    """Write the velocity limits; those of the URDF hold for positions."""
    lines = [
        "# URDF has no limits of acceleration. Where has_acceleration_limits is false,",
        "# MoveIt plans with 1 rad/s^2: put in what your motors can do.",
        "default_velocity_scaling_factor: 0.5",
        "default_acceleration_scaling_factor: 0.5",
        "joint_limits:",
    ]
    for joint in description.movable_joints:
        is_limited = math.isfinite(joint.velocity)
        lines += [
            f"  {json.dumps(joint.name)}:",
            f"    has_velocity_limits: {json.dumps(is_limited)}",
            *([f"    max_velocity: {joint.velocity:.10g}"] if is_limited else []),
            "    has_acceleration_limits: false",
        ]
    return "\n".join([*lines, ""])


def kinematics(groups: Sequence[Group]) -> str:
    """Write the solver of each chain."""
    lines = []
    for group in groups:
        lines += [
            f"{json.dumps(group.name)}:",
            "  kinematics_solver: kdl_kinematics_plugin/KDLKinematicsPlugin",
            "  kinematics_solver_search_resolution: 0.005",
            "  kinematics_solver_timeout: 0.05",
        ]
    return "\n".join([*lines, ""])


def planning(groups: Sequence[Group]) -> str:
    """Write the settings of OMPL."""
    adapters = " ".join(f"default_planner_request_adapters/{n}" for n in ADAPTERS)
    lines = [
        "planning_plugin: ompl_interface/OMPLPlanner",
        f"request_adapters: {adapters}",
        "start_state_max_bounds_error: 0.1",
        "planner_configs:",
        "  RRTConnect: {type: geometric::RRTConnect, range: 0.0}",
        "  RRTstar: {type: geometric::RRTstar, range: 0.0}",
    ]
    for name in (*(group.name for group in groups), WHOLE):
        lines += [
            f"{json.dumps(name)}:",
            "  default_planner_config: RRTConnect",
            "  planner_configs: [RRTConnect, RRTstar]",
            "  longest_valid_segment_fraction: 0.005",
        ]
    return "\n".join([*lines, ""])


def launch(model: str, has_scene: bool) -> str:
    """Write the launch file of display.launch and move_group."""
    objects = f"""
  <node name="publish_objects" pkg="moveit_ros_planning"
    type="moveit_publish_scene_from_text" args="$(dirname)/{SCENE}"
    if="$(arg move_group)"/>"""
    argument = "robot" if is_profile(model) else "model"
    if Path(model).exists():  # roslaunch may start elsewhere
        model = str(Path(model).resolve())
    return f"""\
<?xml version="1.0"?>
<!-- display.launch with a controller for each planning group, and move_group. -->
<launch>
  <arg name="display" default="true" doc="start display.launch, too"/>
  <arg name="physics" default="kinematic" doc="as in display.launch"/>
  <arg name="rviz" default="$(eval optenv('DISPLAY', '') != '')"
    doc="as in display.launch"/>
  <arg name="web" default="false" doc="as in display.launch"/>
  <arg name="move_group" default="true" doc="start MoveIt's move_group"/>

  <rosparam ns="link_states_bridge" file="$(dirname)/{BRIDGE}"/>
  <include file="$(find g1_description)/launch/display.launch" if="$(arg display)">
    <arg name="{argument}" value={quoteattr(model)}/>
    <arg name="physics" value="$(arg physics)"/>
    <arg name="rviz" value="$(arg rviz)"/>
    <arg name="web" value="$(arg web)"/>
  </include>

  <node name="planning_scene" pkg="g1_description" type="planning_scene.py"
      if="$(eval arg('display') and arg('move_group'))">
    <remap from="planning_scene" to="move_group/monitored_planning_scene"/>
  </node>

  <param name="robot_description_semantic" textfile="$(dirname)/{SRDF}"/>
  <rosparam ns="robot_description_planning" file="$(dirname)/{JOINT_LIMITS}"/>
  <rosparam ns="robot_description_kinematics" file="$(dirname)/{KINEMATICS}"/>
  <node name="move_group" pkg="moveit_ros_move_group" type="move_group"
      output="screen" if="$(arg move_group)">
    <rosparam file="$(dirname)/{CONTROLLERS}"/>
    <param name="moveit_controller_manager"
      value="moveit_simple_controller_manager/MoveItSimpleControllerManager"/>
    <param name="allow_trajectory_execution" value="true"/>
    <param name="default_planning_pipeline" value="ompl"/>
    <rosparam ns="planning_pipelines/ompl" file="$(dirname)/{PLANNING}"/>
    <param name="publish_planning_scene" value="true"/>
    <param name="publish_geometry_updates" value="true"/>
    <param name="publish_state_updates" value="true"/>
    <param name="publish_transforms_updates" value="true"/>
  </node>{objects if has_scene else ""}
</launch>
"""


def run(args: MoveItOptions) -> None:
    """Write the folder.

    Raises:
        G1DescriptionError: If the robot cannot be read or a file exists already;
            nothing is written then.
    """
    robot = Robot(args.model)
    groups = groups_of(robot)
    if not groups:
        raise InvalidValueError(f"{robot.name} has no movable joints to plan for.")
    files = {
        SRDF: srdf(robot, groups),
        CONTROLLERS: controllers("controller_list", groups, *FOR_MOVEIT),
        BRIDGE: controllers("controllers", groups),
        JOINT_LIMITS: joint_limits(robot.description),
        KINEMATICS: kinematics(groups),
        PLANNING: planning(groups),
        LAUNCH: launch(args.model, args.scene is not None),
    }
    if args.scene is not None:
        files[SCENE] = scene_text([*Scene.read(args.scene).values()])
    there = [name for name in files if (args.out / name).exists()]
    if there and not args.force:
        raise InvalidValueError(
            f"{args.out / there[0]} already exists; use --force to replace it."
        )
    for name, text in files.items():
        data = text if isinstance(text, bytes) else text.encode("utf-8")
        write_whole(args.out / name, data)
    named = ", ".join([*(group.name for group in groups), WHOLE])
    say(f"{args.out}: groups {named}; roslaunch {args.out / LAUNCH}")


def main() -> None:
    """Run the command line."""
    try:
        run(parse(MoveItOptions, "moveit_config"))
    except (G1DescriptionError, OSError) as error:
        exit_with_error("moveit_config", error)
