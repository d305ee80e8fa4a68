"""Contact forces of an open motion on the page."""

import numpy as np
import pytest

pytest.importorskip("viser", reason="viser is not installed")

from web_clients import running

from g1_description.checks.arrows import BLUE, RED
from g1_description.checks.checker import Checker
from g1_description.motion.motion import Motion
from g1_description.robot.load import read_description
from g1_description.sim.standing import standing_base
from g1_description.web.file_world import FileWorld, StillRobot
from g1_description.web.page import Page
from g1_description.web.scene.robot import SEE_THROUGH, rgb
from g1_description.web.server.address import ServerOptions

from page_client import PageClient

pytestmark = pytest.mark.slow
ROBOT = read_description("g1_29dof")
JOINTS = tuple(joint.name for joint in ROBOT.movable_joints)


def read(path, robot, rate):
    """Stand, and hang in the air from 1 s on."""
    times = np.arange(0.0, 2.0, 0.02)
    base = np.tile(standing_base(ROBOT, {}), (len(times), 1))
    base[times > 1.0, 2] += 0.2
    return Motion(times, JOINTS, np.zeros((len(times), len(JOINTS))), None, base)


def test_arrows_are_those_of_the_shown_time_and_seen_through_the_robot():
    world = FileWorld([StillRobot("g1", ROBOT)], read)
    with running(Page(world, ServerOptions(port=0), Checker)) as page:
        client = PageClient(page.address)
        client.wait_until_whole()

        def arrows():
            nodes = [*client.nodes.items()]
            found = (n for name, n in nodes if "/forces/g1/contact forces/t" in name)
            return sorted(tuple(n["color"]) for n in found if "color" in n)

        def opacities():
            nodes = [*client.nodes.items()]
            return {n.get("opacity") for name, n in nodes if "/visual_" in name}

        def wait_for(*colors):
            wanted = sorted(map(rgb, colors))
            client.wait_for(lambda: arrows() == wanted, f"arrows of colours {wanted}")

        client.upload("Open a motion", "stand.csv", b"any")
        client.wait_for(lambda: client.says("Not checked"), "the findings")
        client.set("Time", 0.5)
        assert arrows() == [] and opacities() == {None}
        client.set("Contact forces", True)
        wait_for(BLUE, BLUE)
        client.wait_for(lambda: opacities() == {SEE_THROUGH}, "a translucent robot")
        client.set("Time", 1.5)
        wait_for(RED)
        client.set("left_knee", 1.0)
        wait_for()
        client.set("Time", 0.5)
        wait_for(BLUE, BLUE)
        client.set("Contact forces", False)
        wait_for()
        client.wait_for(lambda: opacities() == {None}, "an opaque robot")
        client.close()
