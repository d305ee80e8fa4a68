"""The simulator's node: one loop that steps, publishes and answers.

Publishes: /clock (rosgraph_msgs/Clock), ~link_states (gazebo_msgs/LinkStates),
    ~model_states (gazebo_msgs/ModelStates), ~world_state (gazebo_msgs/WorldState),
    ~simulator_state (g1_description/SimulatorState), ~motor_states
    (g1_description/MotorStates):
    at each step, while there are subscribers; ~tracking
    (g1_description/TrackingReport); the topics of objects.ObjectTopics
Subscribes: ~set_model_state (gazebo_msgs/ModelState), ~set_link_state
    (gazebo_msgs/LinkState), ~set_model_trajectory (g1_description/ModelTrajectory),
    ~motor_commands (g1_description/MotorCommands)
Services: those in the folder services, and dynamic_reconfigure's
Parameters: those of parameters.GazeboParameters
"""

from __future__ import annotations

import contextlib
import logging
import queue
import sys
import threading
import time
from concurrent.futures import CancelledError, Future
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import rospy
from gazebo_msgs.msg import LinkState, ModelState

from g1_description.choices import ENGINE_LIBRARIES
from g1_description.errors import (
    DescriptionError,
    G1DescriptionError,
    InvalidValueError,
)
from g1_description.files.model_files import find_model
from g1_description.files.xml import decoded
from g1_description.gazebo.objects import ObjectTopics
from g1_description.gazebo.parameters import INITIAL, GazeboParameters, place_robot
from g1_description.gazebo.services import joints, links, models
from g1_description.gazebo.services import world as worlds
from g1_description.gazebo.services.base import RefusalError, Simulation, make_callback
from g1_description.gazebo.topics import StateTopics, tracking_message
from g1_description.motion.motors import Motors, named_motors, read_motors
from g1_description.msg import ModelTrajectory, TrackingReport
from g1_description.robot.assembly import Assembly
from g1_description.robot.profile import is_name
from g1_description.ros.lifecycle import quiet_when_closing, start_node
from g1_description.ros.log import SHORT_PERIOD, RosoutHandler
from g1_description.ros.parameters import private_parameters, read_parameters
from g1_description.ros.rospy_tcp import serve_as_roscpp
from g1_description.ros.wire import MotorCommandsArrays
from g1_description.sdf.world import EMPTY_WORLD, Sdf, read_sdf
from g1_description.sim.engine import GRAVITY_AXES
from g1_description.sim.world import World
from g1_description.text import listed

TRACKING_QUEUE_SIZE = 100
"""Reports kept for a slow subscriber: as many robots may end a motion together."""

MAX_PENDING = 100
"""Pending calls above which a subscriber's thread waits for its message's turn."""


class Calls:
    """Callbacks, which run in rospy's threads, and the queue of calls for the loop.

    Only the loop changes the world. Other threads read it under its lock: they wait for
    a command that is being executed, but not for the current step.
    """

    def __init__(self, lock: threading.Lock) -> None:
        self._lock = lock
        # Not a SimpleQueue: a signal during its get() can block it for ever.
        self._queue: queue.Queue = queue.Queue()
        self._is_over = False

    def serve(self, name: str, answer, *prepare):
        """Make the callback of a service.

        ``get_*`` is answered outside of the loop, at once, from the state after the
        last step: the loop may be busy all the time, such as with a robot lying on the
        floor.

        Args:
            name: Name of the service.
            answer: The function that answers.
            prepare: A function that parses the request in the caller's thread.
        """
        if not name.startswith("get_"):
            return self.in_the_loop(answer, *prepare)

        def handler(request):
            with self._lock:
                return answer(request)

        return handler

    def in_the_loop(self, answer, prepare=None):
        """Make a callback that waits for the loop's answer, which may be a future."""

        def handler(request):
            if prepare:
                request = prepare(request)
            call: Future = Future()
            self._queue.put((call, answer, request))
            if self._is_over:
                self.cancel()
            try:
                result = call.result()
                return result.result() if isinstance(result, Future) else result
            except CancelledError:
                raise rospy.ServiceException("the simulator is shutting down") from None

        return handler

    def later_in_the_loop(self, act):
        """Make a callback that queues a message, and blocks only if the queue is long.

        If it always blocked, messages would pile up in sockets on a busy machine.
        """

        def callback(message):
            call: Future = Future()
            call.add_done_callback(_log_failure)
            self._queue.put((call, act, message))
            if self._queue.qsize() > MAX_PENDING:
                with contextlib.suppress(CancelledError):
                    call.result()

        return callback

    def __len__(self) -> int:
        return self._queue.qsize()

    def answer(self, wait: float) -> bool:
        """Wait for a call up to ``wait`` [s], answer it; return whether one came."""
        try:
            call, answer, request = self._queue.get(wait > 0.0, wait)
        except queue.Empty:
            return False
        try:
            with self._lock:
                result = answer(request)
        except BaseException as error:  # raised in the caller's thread
            call.set_exception(error)
        else:
            call.set_result(result)
        return True

    def cancel(self) -> None:
        """Cancel all current and future calls."""
        self._is_over = True
        with contextlib.suppress(queue.Empty):
            while True:
                self._queue.get_nowait()[0].cancel()


def _log_failure(call: Future) -> None:
    if not call.cancelled() and call.exception() is not None:
        rospy.logerr("Internal error while handling a message: %r", call.exception())


MAX_WAIT = 0.1
"""Longest wait between two checks for a shutdown, and longest delay that the loop
catches up, in [s]."""

SWITCH_INTERVAL = 5e-5
"""Python's switch interval in [s], short so that callers' threads get their turn."""

SILENCE_POLL = 0.01
"""Time between two checks whether states may be published again, in [s]."""


class GazeboNode:
    """The loop: the only thread that changes the world."""

    def __init__(self, world: World, parameters: GazeboParameters) -> None:
        self._world = world
        self._simulation = Simulation(
            world, parameters.paused, parameters.strict_messages
        )
        self._stepper = self._simulation.stepper
        self._calls = Calls(world.lock)
        network = parameters.enable_ros_network
        self._topics = StateTopics(world, parameters)
        self._tracking = self._objects = None
        if not network:
            return
        self._objects = ObjectTopics(world, self._simulation.log)
        self._tracking = rospy.Publisher(
            "~tracking", TrackingReport, queue_size=TRACKING_QUEUE_SIZE, latch=True
        )
        for topic, kind, act in (
            ("~set_model_state", ModelState, models.put_model),
            ("~set_link_state", LinkState, links.put_link),
            ("~set_model_trajectory", ModelTrajectory, joints.play),
            ("~motor_commands", MotorCommandsArrays, joints.drive),
        ):
            # No message may be lost: they may be of different models.
            rospy.Subscriber(
                topic,
                kind,
                self._calls.later_in_the_loop(partial(self._on_message, topic, act)),
                queue_size=None,
                tcp_nodelay=True,
            )
        for module in (models, links, joints, worlds):
            for name, kind, answer, *parse in module.SERVICES:
                answer = make_callback(self._simulation, kind, answer)
                prepare = (partial(one, world.is_dynamic) for one in parse)
                handler = self._calls.serve(name, answer, *prepare)
                rospy.Service(f"~{name}", kind, handler)
        reconfigure = partial(worlds.reconfigure, self._simulation)
        worlds.offer_physics(world.properties, self._calls.in_the_loop(reconfigure))

    def _on_message(self, topic: str, act, message) -> None:
        """Apply a message, or log why it is refused."""
        try:
            act(self._simulation, message)
        except RefusalError:  # logged as Gazebo does
            pass
        except G1DescriptionError as error:
            warning = f"{topic[1:]}: refused, {error}"
            self._simulation.log.warn(topic, warning, SHORT_PERIOD)

    def run(self) -> None:
        """Step, publish and answer until the node is shut down."""
        due, steps = time.monotonic(), 1
        while not rospy.is_shutdown():
            now = time.monotonic()
            if self._is_silent or not self._is_running:
                wait = SILENCE_POLL
                if not self._is_silent:  # changes while time stands still
                    with quiet_when_closing():
                        wait = min(self._topics.settle(), MAX_WAIT)
                        self._publish_objects()
                self._answer_one(wait)
                due = time.monotonic()
                continue
            due = min(due, now + steps * self._world.properties.period)
            if now < due and not self._stepper.is_stepping:
                self._answer_one(min(due - now, MAX_WAIT))
            else:
                for _ in range(len(self._calls)):
                    self._answer_one(0.0)
                steps = self._step()
                due += steps * self._world.properties.period
                due = max(due, now - MAX_WAIT)
        self._stepper.cancel()
        self._calls.cancel()

    @property
    def _is_silent(self) -> bool:
        """Whether nothing may be published yet, because time went back."""
        is_silent = True
        with quiet_when_closing():
            is_silent = self._topics.is_silent(self._stepper.paused)
        return is_silent

    @property
    def _is_running(self) -> bool:
        """Whether time runs or steps are requested."""
        stepper = self._stepper
        return (
            not stepper.paused or stepper.is_stepping
        ) and self._world.properties.step_ns > 0

    def _publish_objects(self) -> None:
        """Publish the objects, if it is due."""
        if self._objects is not None:
            self._objects.publish()

    def _answer_one(self, wait: float) -> None:
        """Wait for a call up to ``wait`` [s], and answer it."""
        if self._calls.answer(wait):
            self._topics.change()

    def _step(self) -> int:
        """Compute time steps until a state is due, and publish it.

        Requested steps are computed one by one.

        Returns:
            Number of steps.
        """
        if self._is_silent or not self._is_running:
            return 1
        most = self._topics.steps_to_due()
        if self._stepper.is_stepping:
            self._topics.wait_for_room()
            most = 1
        count = self._world.advance(most)
        failure = self._world.engine.take_failure()
        if failure:
            self._simulation.log.warn("physics", failure, log=rospy.logerr)
        with quiet_when_closing():
            self._topics.publish(self._stepper.is_last_step)
            for tracker in self._world.motions.take_tracked() if self._tracking else ():
                rospy.loginfo("%s: %s", tracker.model.name, tracker.report)
                self._tracking.publish(tracking_message(tracker))
            self._publish_objects()
        self._stepper.count()
        return count


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
    models.log_hulls(world.models[name])
    physics = parameters.physics
    if physics != "kinematic":
        physics += f" with {ENGINE_LIBRARIES[parameters.engine]}"
    rospy.loginfo("%s: %s", name, figures(assembly, physics))


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


def main(given=None, on_start=lambda: None) -> None:
    """Run the node ``gazebo``.

    Args:
        given: Parameters by name that override the defaults, not those on the
            parameter server.
        on_start: Called once the node can log.
    """
    sys.setswitchinterval(SWITCH_INTERVAL)
    serve_as_roscpp()
    start_node("gazebo", disable_rosout=True)
    logging.getLogger("rosout").addHandler(RosoutHandler())
    on_start()
    try:
        parameters = read_parameters(GazeboParameters, given)
        world, parameters = make_world(parameters)
        spawn_robot(world, parameters)
    except G1DescriptionError as error:
        rospy.logfatal("%s", error)
        sys.exit(1)
    GazeboNode(world, parameters).run()
