"""Worlds of many small models, in limp, before anything touches.

The substitute of gzserver loads a world in which they fall from a great height, with a
real-time factor of 0: as fast as possible. Nobody subscribes to states. Processor time
is that of the whole simulator between two readings of the simulated time.
"""

from __future__ import annotations

import tempfile
import time
from contextlib import closing
from pathlib import Path

import rosservice

from .nodes import Graph, wait_for
from tcpros import Service

MODELS = 53
TIME_STEP = 0.001  # [s]
HIGH = 10000.0  # [m]
BODY = """<inertial><mass>1</mass></inertial>
<collision name="shape"><geometry><box><size>0.2 0.2 0.2</size></box></geometry>
</collision>"""
BOX = f'<link name="body">{BODY}</link>'
HINGED = f"""<link name="body">{BODY}</link>
<link name="lid"><pose>0 0 0.3 0 0 0</pose>{BODY}</link>
<joint name="hinge" type="revolute"><parent>body</parent><child>lid</child>
<axis><xyz>1 0 0</xyz></axis></joint>"""


def world(content):
    """Write a world of models side by side."""
    models = [
        f'<model name="thing_{number}"><pose>{number % 8} {number // 8} {HIGH} 0 0 0'
        f"</pose>{content}</model>"
        for number in range(MODELS)
    ]
    return f'<sdf version="1.6"><world name="w">{"".join(models)}</world></sdf>'


def run(bench):
    """Measure boxes, and boxes with a lid."""
    for name, content, target in (
        (f"{MODELS} boxes", BOX, "<= 1"),
        (f"{MODELS} boxes with a hinged lid", HINGED, ""),
    ):
        with bench.attempt(name), tempfile.TemporaryDirectory() as folder:
            file = Path(folder, "small.world")
            file.write_text(world(content), encoding="utf-8")
            bench.add(f"{name}: a step", cost(bench, file), "ms", target)


def cost(bench, file):
    """Give the processor time of a step in [ms]."""
    with Graph() as graph:
        graph.start(["rosrun", "gazebo_ros", "gzserver", file, "_physics:=limp"])
        simulator = graph.node("/gazebo")
        services = rosservice.get_service_list
        wait_for(lambda: "/gazebo/set_real_time_factor" in services(), "its services")
        with closing(Service("/gazebo/get_world_properties")) as properties:
            wait_for(lambda: len(properties().model_names) >= MODELS, "models")
            with closing(Service("/gazebo/set_real_time_factor")) as set_factor:
                set_factor(0.0)
            meter, begin = simulator.meter(), properties().sim_time
            time.sleep(bench.seconds(5.0))
            spent, _ = meter()
            return spent * 1e3 * TIME_STEP / (properties().sim_time - begin)
