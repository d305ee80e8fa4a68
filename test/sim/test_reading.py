"""What another thread reads while the world steps."""

import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from test_world import ARM
from waiting import wait_for

from g1_description.motion.motion import Motion

STEPS = 100
SWING = Motion(np.array([0.0, 2.0]), ("hinge",), np.array([[-0.5], [0.5]]))


@pytest.fixture
def busy_threads():
    """Threads that take turns at every chance."""
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(interval)


def seen(world):
    """What there is to read: the time, and the state of two models."""
    return world.time_ns, b"".join(part.tobytes() for part in world.link_states())


def read_on(world, found, is_over):
    """Read until it is over, each time while nothing changes; give what was seen."""
    while not is_over.is_set():
        with world.lock:
            found.add(seen(world))
    return found


@pytest.mark.parametrize("physics", ["kinematic", "limp"])
def test_it_is_of_one_step(make_world, busy_threads, physics):
    world = make_world(physics)
    for number in range(2):
        world.spawn_urdf(f"arm{number}", ARM, np.array([number, 0, 0.4, 0, 0, 0, 1.0]))
        if not world.is_dynamic:
            world.motions.play(world.model(f"arm{number}"), SWING, 0)
    found, is_over = set(), threading.Event()
    states = {seen(world)}
    with ThreadPoolExecutor(1) as pool:
        reader = pool.submit(read_on, world, found, is_over)
        wait_for(lambda: found, "a first look")
        for _ in range(STEPS):
            world.step()
            states.add(seen(world))
        is_over.set()
        found = reader.result()
    assert len(found) > 1
    assert len(states) == STEPS + 1
    assert found <= states
