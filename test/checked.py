"""A small robot and motions of it, which tests of checks share."""

import os
import signal
from pathlib import Path

import numpy as np

from g1_description.motion.files import table
from g1_description.motion.files.formats import read_motion
from g1_description.motion.motion import Motion

ARM = "arm_joint"

POST = """<robot name="post">
  <link name="base"><inertial><mass value="10"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><box size="0.4 0.4 0.1"/></geometry></collision></link>
  <link name="arm"><inertial><origin xyz="0 0 0.15"/><mass value="0.5"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 0 0.25"/><geometry><box size="0.04 0.04 0.3"/></geometry>
    </collision></link>
  <joint name="arm_joint" type="revolute"><parent link="base"/><child link="arm"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="0.62" velocity="3"/></joint>
</robot>"""
"""An arm on a flat box, and a weak motor."""


def post_motion(reach=0.5, seconds=1.0, rate=50.0):
    """Swing the arm to one side and back, while the box lies on the floor."""
    times = np.arange(int(seconds * rate) + 1) / rate
    arm = reach * np.sin(np.pi * times / seconds) ** 2
    base = np.tile([0.0, 0.0, 0.05, 0.0, 0.0, 0.0, 1.0], (len(times), 1))
    return Motion(times, (ARM,), arm[:, np.newaxis], base_poses=base)


def write_motions(folder, *reaches):
    """Write a CSV for each reach of the arm; return the files."""
    files = []
    for number, reach in enumerate(reaches):
        file = folder / f"motion{number}.csv"
        file.write_bytes(table.write(post_motion(reach), None, None)[0])
        files.append(file)
    return files


def read(path, robot, options):
    """Read a motion, where there are no bags."""
    return read_motion(path, robot, options)


def read_or_die(path, robot, options):
    """Read a motion; files with some names end the process that reads them."""
    marker = path.with_suffix(".begun")
    if path.name.startswith("once") and not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if path.name.startswith("deadly"):
        os.kill(os.getpid(), signal.SIGKILL)
    return read_motion(path, robot, options)


def stay(path, robot, options):
    """Tell who reads, and never end."""
    path.with_name("pid").write_text(str(os.getpid()))
    while True:
        signal.pause()


def assert_as_kept(text, name, folder):
    """Compare a text with the one that is kept as test/data/NAME.

    Where it is as it shall be, keep it: its copy is in the folder.
    """
    kept = Path(__file__).parent / "data" / name
    (folder / name).write_text(text, encoding="utf-8")
    said = f"if this is as it shall be: cp {folder / name} {kept}"
    assert text == kept.read_text(encoding="utf-8"), said
