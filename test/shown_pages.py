"""Pages that run, for tests that use them as browsers do."""

import sys
import threading
from functools import lru_cache
from pathlib import Path

import numpy as np
from waiting import DEADLINE

from g1_description import Robot
from g1_description.checks.checker import Checker
from g1_description.checks.thresholds import Thresholds
from g1_description.errors import InvalidValueError
from g1_description.motion.motion import Motion
from g1_description.robot.urdf import parse_urdf
from g1_description.sim.standing import standing_base
from g1_description.web.file_world import FileWorld, StillRobot
from g1_description.web.page import Page
from g1_description.web.server.address import ServerOptions

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tools"))
from page_client import PageClient

SHAPE = '<origin xyz="0 0 -0.2"/><geometry><box size="0.1 0.1 0.3"/></geometry>'
SHAPES = (
    f'<visual>{SHAPE}</visual><collision>{SHAPE}</collision><inertial><mass value="1"/>'
    '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
)
ELBOW = (
    '<joint name="{0}_elbow_joint" type="revolute"><parent link="trunk"/>'
    '<child link="{0}_arm"/><origin xyz="0 {1} 0"/><axis xyz="1 0 0"/>'
    '<limit lower="-2" upper="1.614429558" effort="9" velocity="9"/></joint>'
)
ARMS = (
    '<robot name="arms">'
    + "".join(
        f'<link name="{name}">{SHAPES}</link>'
        for name in ("trunk", "left_arm", "right_arm")
    )
    + ELBOW.format("left", 0.3)
    + ELBOW.format("right", -0.3)
    + "</robot>"
)
"""Two arms beside a trunk, which hit each other where both are turned inwards."""


class Stepped:
    """A simulator that stands still, whose steps last while ``gate`` is clear."""

    is_paused = is_stand_in = is_kinematic = True

    def __init__(self):
        self.calls, self.gate = [], threading.Event()
        self.gate.set()
        self.problem = None

    def status(self):
        return "stands still"

    def step(self, steps):
        self._call(steps)
        assert self.gate.wait(DEADLINE)

    def pause(self):
        self._call("pause")

    def go_on(self):
        self._call("go on")

    def reset(self):
        self._call("reset")

    def hang(self, robot, is_on, length):
        if length > 2.5:
            raise InvalidValueError("There is no such rope.")
        self._call((robot, is_on, length))

    def _call(self, call):
        self.calls.append(call)
        if self.problem:
            raise InvalidValueError(self.problem)


def ramp(seconds):
    """Give a motion of the left elbow, from 0 to -0.3 rad/s."""
    times = np.linspace(0.0, seconds, 31)
    return Motion(times, ("left_elbow_joint",), -0.3 * times[:, np.newaxis])


class Open:
    """A page of the two arms that runs, and clients of it."""

    def __init__(self, make_checker=None, **options):
        self.robot = StillRobot("arms", parse_urdf(ARMS))
        self.world = FileWorld([self.robot], lambda path, robot, rate: ramp(3.0))
        self.simulator = self.world.simulator = Stepped()
        self.show = Page(
            self.world,
            ServerOptions(port=0, **options),
            make_checker or (lambda robot: Checker(robot, Thresholds())),
        )
        self._clients = []
        self._thread = threading.Thread(target=self.show.run)
        self._thread.start()

    def client(self):
        """Give a client that knows all of the page, whose controls show the robot."""
        one = PageClient(self.show.address)
        one.wait_until_whole()
        self._clients.append(one)
        if one.find("x y z"):
            place = np.round(self.robot.state().base_pose[:3], 4).tolist()
            one.wait_for(lambda: one.value("x y z") == place, "the base at rest")
            for name in ("left_elbow", "right_elbow"):
                angle = self.position(f"{name}_joint")
                one.wait_for(lambda n=name, a=angle: one.value(n) == a, "a slider")
        return one

    def position(self, joint="left_elbow_joint"):
        return self.robot.state().positions_by_name[joint]

    def rest(self):
        """Put the robot back; all clients go."""
        while self._clients:
            self._clients.pop().close()
        self.robot.reset()
        self.simulator.calls.clear()

    def close(self):
        self.rest()
        self.show.stop()
        self._thread.join(DEADLINE)


class StandingG1:
    """A page of the G1, for all tests of a run."""

    def __init__(self):
        self.model = Robot()
        self.robot = StillRobot("g1", self.model.description)
        self.checker = checker = self.model.checker()
        self.read = None
        """Reads the files that are opened."""
        world = FileWorld([self.robot], lambda *given: self.read(*given))
        self.simulator = world.simulator = Stepped()
        self.show = Page(world, ServerOptions(port=0), lambda _: checker)
        threading.Thread(target=self.show.run, daemon=True).start()

    def stand(self):
        """Let the robot stand."""
        model = self.model
        stand = dict(zip(model.joint_names, model.pose("stand").tolist()))
        self.robot.command_all(stand, standing_base(model.description, stand))

    def places(self):
        """Give the poses of its links."""
        state = self.robot.state()
        return self.model.link_poses(state.positions_by_name, state.base_pose)


def delete_keyframes(client):
    """Delete the keyframes that another test has left."""
    while client.value("Selected") != "none":
        left = client.element("Selected")["options"]
        client.set("Keyframe", "Delete")
        client.wait_for(
            lambda old=left: client.element("Selected")["options"] != old, "one less"
        )


standing_g1 = lru_cache(None)(StandingG1)
"""The page of the G1: it takes seconds to make."""
