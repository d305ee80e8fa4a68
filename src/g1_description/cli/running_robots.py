"""Running robots as the command snapshot draws them.

Subscribes: robot_state (g1_description/RobotState); without a bridge joint_states
    (sensor_msgs/JointState), /tf, /tf_static; /gazebo/scene and /gazebo/object_states,
    as ros.present_objects, where they are
Reads: robot_description
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Callable

import rosgraph
import rospy

from g1_description.choices import GAZEBO
from g1_description.cli.film import Moment, count, placed
from g1_description.robot.description import Description
from g1_description.ros.lifecycle import no_master, start_node
from g1_description.ros.present_objects import PresentObjects
from g1_description.ros.robot_view import RobotView
from g1_description.ros.waiting import NoAnswerError, wait_until
from g1_description.scenes.objects import SceneObject
from g1_description.scenes.scene import Scene

JOINTS_TIMEOUT = 10.0
"""Longest wait for the positions of all joints, in [s]."""

BASE_TIMEOUT = 2.0
"""Longest wait for the base once the joints are known, in [s]."""

CLOCK_TIMEOUT = 10.0
"""Longest wait for the clock to advance, in [s]."""


def watch(
    namespaces: Sequence[str] | None,
    film: tuple[float, float] | None,
    notify: Callable[[str], None],
) -> tuple[list[Description], list[Moment], list[SceneObject]]:
    """Sample running robots, and the objects in the simulator.

    Args:
        namespaces: Those of the robots' topics; None: the current one.
        film: Duration in [s] and pictures per second of ROS' clock; None: once.
        notify: Prints a message.

    Returns:
        The robots, all that is in each picture, and the objects.

    Raises:
        NoAnswerError: If there is no master, it is lost, or no states of a robot.
    """
    if not rosgraph.is_master_online():
        raise NoAnswerError(f"{no_master()} --model FILE draws a file without one.")
    try:
        start_node("snapshot", anonymous=True)
        names = namespaces or [rospy.get_namespace()]
        views = [RobotView(name.strip("/"), notify) for name in names]
        for view in views:
            wait_until(lambda view=view: not view.missing, JOINTS_TIMEOUT)
            if view.missing and not view.positions:
                raise NoAnswerError(
                    f"There were no joint states of '{view.description.name}' on "
                    f"{view.topic} within {JOINTS_TIMEOUT:g} s; is the bridge running "
                    "and time unpaused?"
                )
            wait_until(lambda view=view: _has_base(view), BASE_TIMEOUT)
            name, lost = view.description.name, ", ".join(view.missing)
            if lost:
                notify(f"unknown positions of '{name}', drawn at 0: {lost}.")
            if not _has_base(view):
                notify(
                    f"{view.no_base}: '{name}' is drawn with its root at the origin."
                )
        objects = PresentObjects(GAZEBO, notify)
        objects.wait()
        sample = partial(now, views, objects)
        moments = record(sample, *film) if film else [sample()]
        for view in views:  # drawing needs the processor
            view.close()
        objects.close()
    except rospy.ROSInterruptException:
        raise
    except (OSError, rospy.ROSException, rosgraph.MasterException) as error:
        raise NoAnswerError(f"lost the connection to the master: {error}.") from error
    robots = [view.description for view in views]
    scene = objects.placed(robots[0], names[0].strip("/")) or Scene()
    return robots, moments, [*scene.values()]


def _has_base(view: RobotView) -> bool:
    """Return whether the pose of a robot's base is known."""
    state = view.state
    return state is not None and state.base_pose is not None


def record(sample: Callable[[], Moment], seconds: float, fps: float) -> list[Moment]:
    """Sample what is seen; a reset does not set the elapsed time back."""
    last, passed, found = rospy.get_time(), 0.0, []

    def has_advanced() -> bool:
        return rospy.get_time() != last

    for n in range(count(seconds, fps)):
        while passed < n / fps:
            if not wait_until(has_advanced, CLOCK_TIMEOUT):
                raise NoAnswerError(
                    f"The clock did not advance for {CLOCK_TIMEOUT:g} s (it is at "
                    f"{last:g} s); is time paused?"
                )
            before, last = last, rospy.get_time()
            passed += max(0.0, last - before)
        found.append(sample())
    return found


def now(views: Sequence[RobotView], objects: PresentObjects) -> Moment:
    """Return the current states of robots and objects."""
    states = [(view, view.state) for view in views]
    robots = [
        placed(view.description, state and state.base_pose, view.positions)
        for view, state in states
    ]
    return Moment(robots, objects.newest()[1])
