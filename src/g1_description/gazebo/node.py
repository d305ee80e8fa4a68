"""The simulator's node: one loop that steps, publishes and answers.

Publishes: /clock (rosgraph_msgs/Clock), ~link_states (gazebo_msgs/LinkStates),
    ~model_states (gazebo_msgs/ModelStates), ~world_state (gazebo_msgs/WorldState):
    at each step, while there are subscribers; ~tracking (g1_description/TrackingReport)
Subscribes: ~set_model_state (gazebo_msgs/ModelState), ~set_link_state
    (gazebo_msgs/LinkState), ~set_model_trajectory (g1_description/ModelTrajectory)
Services: those in the folder services, and dynamic_reconfigure's
Parameters: those of parameters.GazeboParameters
"""

from __future__ import annotations

import contextlib
import queue
import sys
import threading
import time
from concurrent.futures import CancelledError, Future
from functools import partial

import rospy
from gazebo_msgs.msg import LinkState, ModelState

from g1_description.errors import G1DescriptionError
from g1_description.gazebo.parameters import GazeboParameters
from g1_description.gazebo.reconfigure import offer_physics
from g1_description.gazebo.services import joints, links, models, spawn
from g1_description.gazebo.services import time as times
from g1_description.gazebo.services import world as worlds
from g1_description.gazebo.services.base import RefusalError, Simulation, make_callback
from g1_description.gazebo.start import find_listeners, make_world, spawn_robot
from g1_description.gazebo.topics import StateTopics, tracking_message
from g1_description.msg import ModelTrajectory, TrackingReport
from g1_description.ros.gazebo_log import answer_as_roscpp, publish_log
from g1_description.ros.lifecycle import quiet_when_closing, start_node
from g1_description.ros.log import SHORT_PERIOD
from g1_description.ros.master import stay_registered
from g1_description.ros.parameters import read_parameters
from g1_description.ros.tcpros import serve_as_roscpp
from g1_description.sim.world import World

TRACKING_QUEUE_SIZE = 100
"""Reports kept for a slow subscriber: as many robots may end a motion together."""

MAX_PENDING = 100
"""Pending calls above which a subscriber's thread waits for its message's turn."""


class Calls:
    """Callbacks of rospy, which run in its threads, and the calls that they queue.

    Only the loop changes the world. Others read it while they hold its lock: they do
    not wait for the step under way, but for a command that is being executed.
    """

    def __init__(self, lock: threading.Lock) -> None:
        self._lock = lock  # held while the world changes
        # Not a SimpleQueue: a signal during its get() can make it wait for ever.
        self._queue: queue.Queue = queue.Queue()
        self._is_over = False

    def serve(self, name: str, answer, *prepare):
        """Make the callback of a service: one that reads does not need the loop.

        Args:
            name: The service's; those that read begin with ``get_``.
            answer: The function that answers.
            prepare: A function that prepares the request, while time runs on.
        """
        make = self._beside_the_loop if name.startswith("get_") else self.in_the_loop
        return make(answer, *prepare)

    def _beside_the_loop(self, answer):
        """Make a callback that answers at once, from the state after the last step.

        A robot that lies keeps the loop busy all the time.
        """

        def handler(request):
            with self._lock:
                return answer(request)

        return handler

    def in_the_loop(self, answer, prepare=None):
        """Make a callback that lets the loop answer, and waits for the answer.

        The loop may answer with a future: the caller waits for that, too.
        """

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
        """Make a callback that lets the loop act, and waits behind a long queue only.

        To wait each time would let messages pile up on a busy machine, where it takes
        the loop long to get its turn.
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
        """Wait for a call, at most so many [s]; answer it, and return if one came."""
        try:
            call, answer, request = self._queue.get(wait > 0.0, wait)
        except queue.Empty:
            return False
        try:
            with self._lock:
                result = answer(request)
        except BaseException as error:  # the caller's thread raises it again
            call.set_exception(error)
        else:
            call.set_result(result)
        return True

    def cancel(self) -> None:
        """Cancel all calls, also those to come."""
        self._is_over = True
        with contextlib.suppress(queue.Empty):
            while True:
                self._queue.get_nowait()[0].cancel()


def _log_failure(call: Future) -> None:
    if not call.cancelled() and call.exception() is not None:
        rospy.logerr("A message could not be obeyed: %r", call.exception())


MAX_WAIT = 0.1
"""Longest wait before looking whether to shut down, in [s]. Time lost to a busy
machine beyond this is not caught up."""

SWITCH_INTERVAL = 5e-5
"""Longest in [s] that the loop's Python keeps a caller's thread from running."""

HUSH_POLL = 0.01
"""Wait before checking again whether states may be published, in [s]."""


class GazeboNode:
    """The loop, which alone changes the world."""

    def __init__(self, world: World, parameters: GazeboParameters) -> None:
        self._world = world
        self._simulation = Simulation(
            world, parameters.paused, parameters.strict_messages
        )
        self._stepper = self._simulation.stepper
        self._calls = Calls(world.lock)
        network = parameters.enable_ros_network
        listeners = find_listeners() if network else ()
        self._topics = StateTopics(world, parameters, listeners)
        self._tracking = None
        if not network:
            return
        self._tracking = rospy.Publisher(
            "~tracking", TrackingReport, queue_size=TRACKING_QUEUE_SIZE, latch=True
        )
        for topic, kind, act in (
            ("~set_model_state", ModelState, models.put_model),
            ("~set_link_state", LinkState, links.put_link),
            ("~set_model_trajectory", ModelTrajectory, joints.play),
        ):
            # Each message counts: they may be of different models.
            rospy.Subscriber(
                topic,
                kind,
                self._calls.later_in_the_loop(partial(self._obey, topic, act)),
                queue_size=None,
                tcp_nodelay=True,
            )
        for module in (models, links, joints, worlds, spawn, times):
            for name, kind, answer, *parse in module.SERVICES:
                answer = make_callback(self._simulation, kind, answer)
                prepare = (partial(one, world.is_dynamic) for one in parse)
                handler = self._calls.serve(name, answer, *prepare)
                rospy.Service(f"~{name}", kind, handler)
        offer_physics(world.properties, self._calls.in_the_loop(self._reconfigure))

    def _obey(self, topic: str, act, message) -> None:
        """Act on a message, and log why it is refused, unless that was done."""
        try:
            act(self._simulation, message)
        except RefusalError:
            pass
        except G1DescriptionError as error:
            warning = f"{topic[1:]}: refused, {error}"
            self._simulation.log.warn(topic, warning, SHORT_PERIOD)

    def _reconfigure(self, numbers: dict) -> dict:
        """Change the physics' numbers; return them as they are if that is refused."""
        try:
            worlds.change_physics(self._simulation, numbers)
        except G1DescriptionError as error:
            rospy.logerr("set_parameters: refused, %s", error)
            properties, kept = self._world.properties, {*worlds.UNSETTABLE}
            return {n: getattr(properties, n) for n in numbers if n not in kept}
        rospy.loginfo("physics dynamics reconfigure update complete")
        rospy.loginfo("physics dynamics reconfigure complete")
        return {}

    def run(self) -> None:
        """Step, publish and answer until the node is shut down."""
        due = time.monotonic()
        while not rospy.is_shutdown():
            now = time.monotonic()
            if self._is_hushed or not self._is_running:
                self._answer_one(self._stand_still())
                due = time.monotonic()
                continue
            # The period may have become shorter since the last step.
            due = min(due, now + self._world.properties.period)
            if now < due and not self._stepper.is_stepping:
                self._answer_one(min(due - now, MAX_WAIT))
            else:
                for _ in range(len(self._calls)):
                    self._answer_one(0.0)
                self._step()
                due = max(due + self._world.properties.period, now - MAX_WAIT)
        self._stepper.cancel()
        self._calls.cancel()

    def _stand_still(self) -> float:
        """Publish changes while time stands still.

        Returns:
            How long to wait for a call until the next look, in [s].
        """
        wait = HUSH_POLL
        if not self._is_hushed:
            with quiet_when_closing():
                wait = min(self._topics.settle(), MAX_WAIT)
        return wait

    @property
    def _is_hushed(self) -> bool:
        """Whether nothing may be published yet, because time has gone back."""
        hushed = True
        with quiet_when_closing():
            hushed = self._topics.is_hushed(self._stepper.paused)
        return hushed

    @property
    def _is_running(self) -> bool:
        """Whether steps are to be done."""
        stepper = self._stepper
        return (
            not stepper.paused or stepper.is_stepping
        ) and self._world.properties.step_ns > 0

    def _answer_one(self, wait: float) -> None:
        """Wait for a call, at most so many [s], and answer it if one comes."""
        if self._calls.answer(wait):
            self._topics.change()

    def _step(self) -> None:
        """Let a time step pass and publish the states after it."""
        if self._is_hushed or not self._is_running:
            return
        if self._stepper.is_stepping:
            self._topics.wait_for_room()
        self._world.step()
        with quiet_when_closing():
            self._topics.publish(self._stepper.is_last_step)
            self._publish_tracking()
        self._stepper.count()

    def _publish_tracking(self) -> None:
        """Publish and log the reports of motions that ended in this step."""
        for tracker in self._world.motions.take_tracked() if self._tracking else ():
            rospy.loginfo("%s: %s", tracker.model.name, tracker.report)
            self._tracking.publish(tracking_message(tracker))


def main(given=None, on_start=lambda: None) -> None:
    """Run the node ``gazebo``.

    Args:
        given: Parameters by name that win over the defaults, not over those on the
            parameter server.
        on_start: Called when the node can log.
    """
    sys.setswitchinterval(SWITCH_INTERVAL)
    serve_as_roscpp()
    answer_as_roscpp()
    start_node("gazebo", disable_rosout=True)
    publish_log()
    on_start()
    try:
        parameters = read_parameters(GazeboParameters, given)
        world, parameters = make_world(parameters)
        spawn_robot(world, parameters)
    except G1DescriptionError as error:
        rospy.logfatal("%s", error)
        sys.exit(1)
    node = GazeboNode(world, parameters)
    stay_registered()
    node.run()
