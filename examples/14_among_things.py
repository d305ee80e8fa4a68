"""Pick a box from a shelf and put it on a table, away from a wall, by a scene."""

import numpy as np

from g1_description import Robot, Scene, box_targets, line


def box_at(x, y, z, yaw=0.0):
    """Return the pose of the centre of the box, whose width is along its y axis."""
    return np.array([x, y, z, 0.0, 0.0, np.sin(0.5 * yaw), np.cos(0.5 * yaw)])


robot = Robot()
standing, base = robot.named_configuration("stand"), [0.0, 0.0, 0.7634, 0, 0, 0, 1]
on_shelf, over_shelf = box_at(0.32, 0.22, 0.38, 0.5), box_at(0.32, 0.22, 0.58, 0.5)
on_table, over_table = box_at(0.35, -0.22, 0.85, -0.5), box_at(0.35, -0.22, 1.05, -0.5)
ahead = box_at(0.37, 0.0, 0.9)
stops = [over_shelf, on_shelf, over_shelf, ahead, over_table, on_table, over_table]
ends, times, boxes = [0.0], np.zeros(1), np.array(stops[:1])
for start, end in zip(stops, stops[1:]):
    more, way = line(start, end, speed=0.2)
    times, boxes = np.append(times, times[-1] + more[1:]), np.append(boxes, way[1:], 0)
    ends.append(times[-1])

scene = Scene()
scene.box("shelf", [0.3, 0.2, 0.02], [0.36, 0.24, 0.31], rpy=[0, 0, 0.5])
scene.box("table", [0.3, 0.26, 0.03], [0.42, -0.29, 0.775])
scene.box("wall", [0.02, 0.5, 0.6], [0.12, 0.55, 0.9], color=[0.5, 0.6, 0.7])
scene.box("box", [0.12, 0.24, 0.12], on_shelf, mass=0.5, may_touch=["right_hand"])
scene.attach("box", "left_hand", ends[1], ends[5])

palms = box_targets(boxes, width=0.24)
options = {"balance": True, "avoid_collisions": True, "floor": 0.0}
path = robot.ik_trajectory(times, palms, standing, base, scene=scene, **options)
print(path.message or f"all is reached, in {times[-1]:.1f} s")
robot.write_motion("among_things.csv", path)
scene.save("among_things.scene.yaml")
verdict = robot.check(path, scene=scene)
print("passed" if verdict.passed else verdict.findings)
