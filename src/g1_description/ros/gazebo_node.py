"""The stand-in's node: one loop that steps, publishes and answers.

Publishes: /clock (rosgraph_msgs/Clock), ~link_states (gazebo_msgs/LinkStates),
    ~model_states (gazebo_msgs/ModelStates): at each step, while someone listens
Subscribes: ~set_model_state (gazebo_msgs/ModelState)
Services: those of gazebo_services
Parameters: those of parameters.GazeboParameters
"""

from __future__ import annotations

import queue
import sys
import time
from concurrent.futures import CancelledError, Future

import numpy as np
import rospkg
import rospy
from gazebo_msgs.msg import LinkStates, ModelState, ModelStates
from rosgraph_msgs.msg import Clock

from ..core.errors import DescriptionError, G1DescriptionError
from ..core.rotation import from_rpy
from ..sim.world import World
from .gazebo_services import GazeboServices
from .link_states import LinkStatesEncoder
from .messages import PreparedLinkStates, PreparedModelStates, stamp_from_ns
from .parameters import GazeboParameters, read_parameters
from .shutdown import quiet_when_closing

QUEUE = 100
"""Messages kept for a slow subscriber; a tenth of a second of steps."""

PATIENCE = 0.1
"""Longest wait before looking whether to shut down, in [s]. Time lost to a busy
machine beyond this is not caught up."""


class GazeboNode:
    """The loop. Callbacks of rospy put calls; the loop alone touches the world."""

    def __init__(self, parameters: GazeboParameters) -> None:
        """Make the world and the robot, then the topics and services.

        Args:
            parameters: The node's parameters.

        Raises:
            G1DescriptionError: If the robot cannot be spawned.
        """
        p = parameters
        self._rate = p.max_update_rate
        self._world = World(
            p.physics,
            p.time_step,
            (p.gravity_x, p.gravity_y, p.gravity_z),
            _package_folder,
        )
        every = 1.0 / (p.time_step * p.link_states_rate) if p.link_states_rate else 1.0
        self._publish_every = max(1, int(every + 1e-9))
        self._steps = 0
        if p.robot_description:
            self._spawn(p)
        self._services = GazeboServices(self._world, p.strict_messages)
        self._services.paused = p.paused
        # Not a SimpleQueue: a signal during its get() can make it wait for ever.
        self._calls: queue.Queue = queue.Queue()
        self._link_states, self._model_states = LinkStatesEncoder(), LinkStatesEncoder()
        self._clock_topic = rospy.Publisher("/clock", Clock, queue_size=QUEUE)
        self._link_states_topic = rospy.Publisher(
            "~link_states", LinkStates, queue_size=QUEUE
        )
        self._model_states_topic = rospy.Publisher(
            "~model_states", ModelStates, queue_size=QUEUE
        )
        rospy.Subscriber(
            "~set_model_state",
            ModelState,
            self._in_the_loop(self._services.apply_model_state),
        )
        for name, kind, answer in self._services.table():
            rospy.Service(f"~{name}", kind, self._in_the_loop(answer))

    def _spawn(self, parameters: GazeboParameters) -> None:
        """Spawn the robot of the parameters."""
        p = parameters
        urdf = rospy.get_param(p.robot_description, None)
        if not isinstance(urdf, str):
            raise DescriptionError(
                f"There is no robot on the parameter {p.robot_description}."
            )
        rotation = from_rpy(np.array([p.roll, p.pitch, p.yaw]))
        pose = np.concatenate([[p.x, p.y, p.z], rotation])
        left_out = self._world.spawn(p.model_name, urdf, pose, p.fixed_base)
        for clause in left_out:
            rospy.logwarn("%s: %s", p.model_name, clause)
        robot = self._world.models[p.model_name].lumped.description
        rospy.loginfo(
            "%s: %d joints, %d links, %.3f kg, %s",
            p.model_name,
            len(robot.joints),
            len(robot.links),
            robot.mass,
            p.physics,
        )

    def _in_the_loop(self, answer):
        """Make a callback that lets the loop answer, and waits for it."""

        def handler(request):
            call: Future = Future()
            self._calls.put((call, answer, request))
            try:
                return call.result()
            except CancelledError:
                raise rospy.ServiceException("the simulator is shutting down") from None

        return handler

    def run(self) -> None:
        """Step, publish and answer until the node is shut down."""
        period = 1.0 / self._rate if self._rate else 0.0
        due = time.monotonic()
        while not rospy.is_shutdown():
            now = time.monotonic()
            if self._services.paused:
                self._answer_one(PATIENCE)
                due = time.monotonic()
            elif now < due:
                self._answer_one(min(due - now, PATIENCE))
            else:
                for _ in range(self._calls.qsize()):
                    self._answer_one(0.0)
                self._step()
                due = max(due + period, now - PATIENCE)
        self._refuse()

    def _answer_one(self, wait: float) -> None:
        """Wait for a call and answer it, if one comes.

        Args:
            wait: Longest wait in [s].
        """
        try:
            call, answer, request = self._calls.get(wait > 0.0, wait)
        except queue.Empty:
            return
        try:
            call.set_result(answer(request))
        except BaseException as error:  # the caller's thread raises it again
            call.set_exception(error)

    def _step(self) -> None:
        """Let a time step pass and tell the world of it."""
        if not self._services.paused:
            self._world.step()
            with quiet_when_closing():
                self._publish()

    def _refuse(self) -> None:
        """Tell callers that nobody will answer any more."""
        while not self._calls.empty():
            self._calls.get()[0].cancel()

    def _publish(self) -> None:
        """Publish the time, then the states of that time."""
        self._clock_topic.publish(Clock(stamp_from_ns(self._world.time_ns)))
        self._steps += 1
        if self._steps % self._publish_every:
            return
        if self._link_states_topic.get_num_connections():
            poses, twists = self._world.link_states()
            message = PreparedLinkStates()
            names = self._world.link_names()
            message.data = self._link_states.encode(names, poses, twists)
            self._link_states_topic.publish(message)
        if self._model_states_topic.get_num_connections():
            models = self._world.models.values()
            message = PreparedModelStates()
            message.data = self._model_states.encode(
                list(self._world.models),
                np.array([model.pose for model in models]),
                np.array([model.twist for model in models]),
            )
            self._model_states_topic.publish(message)


def _package_folder(name: str) -> str | None:
    """Find a ROS package's folder."""
    try:
        return rospkg.RosPack().get_path(name)
    except rospkg.ResourceNotFound:
        return None


def main() -> None:
    """Run the node ``gazebo``."""
    rospy.init_node("gazebo")
    try:
        node = GazeboNode(read_parameters(GazeboParameters))
    except G1DescriptionError as error:
        rospy.logfatal("%s", error)
        sys.exit(1)
    node.run()
