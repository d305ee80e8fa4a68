"""What PyBullet's C code would print is not seen, all else is."""

import os
import subprocess
import sys

from conftest import REPOSITORY

ROBOT = '<robot name="r"><link name="a"/></robot>'
USE_ALL = f"""
import numpy as np
from g1_description.robot.urdf import parse_urdf
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.sim.bullet.engine import BulletEngine
from g1_description.sim.engine import PhysicsProperties
from g1_description.render.scene import Picture
from g1_description.sim.standing import standing_height
robot = parse_urdf('{ROBOT}')
BulletEngine("hold", PhysicsProperties()).close()
standing_height(lump_fixed_joints(robot), np.array([0.0, 0.0, 0.0, 1.0]))
scene = Picture()
scene.add(robot)
"""
SPEAK = "import os; print('one', flush=True); os.system('echo two'); os.write(2, b'3')"
BOTH = """
import threading
from g1_description.sim.bullet.client import connect
def connect_often():
    for _ in range(50):
        connect().disconnect()
thread = threading.Thread(target=connect_often)
thread.start()
count = 0
while thread.is_alive():
    print(count, flush=True)
    count += 1
print("all", count)
"""
CLOSED = "import os; os.close(1); os.close(2)\n"


def run(code):
    return subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": str(REPOSITORY / "src")},
        capture_output=True,
        text=True,
    )


def test_nothing_is_printed_of_itself_and_all_that_others_print():
    """Before and afterwards, by C and by Python."""
    before = "import ctypes; ctypes.CDLL(None).puts(b'zero')"
    done = run(f"{before}\n{USE_ALL}\n{SPEAK}\nos._exit(0)")
    assert (done.returncode, done.stderr) == (0, "3")
    assert done.stdout == "zero\none\ntwo\n"


def test_what_another_thread_prints_meanwhile_is_seen():
    *lines, (_, count) = map(str.split, run(BOTH).stdout.splitlines())
    assert lines == [[str(number)] for number in range(int(count))]


def test_a_pybullet_that_is_broken_is_told():
    done = run(
        "import sys; sys.modules['pybullet'] = None\n"
        "import g1_description.sim.bullet.client"
    )
    assert "import of pybullet halted" in done.stderr
    assert done.returncode == 1


def test_output_may_be_closed():
    assert run(CLOSED + USE_ALL).returncode == 0
