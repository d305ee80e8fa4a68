"""Carry a box from a low shelf to a table with both palms, and try it in physics."""

import numpy as np

from g1_description import Robot, box_targets, line


def box_at(x, y, z, yaw=0.0):
    """Return the pose of the centre of the box, whose width is along its y axis."""
    return np.array([x, y, z, 0.0, 0.0, np.sin(0.5 * yaw), np.cos(0.5 * yaw)])


robot = Robot()
standing, base = robot.named_configuration("stand"), [0.0, 0.0, 0.7634, 0, 0, 0, 1]
shelf, over_shelf = box_at(0.32, 0.22, 0.35, 0.5), box_at(0.32, 0.22, 0.55, 0.5)
table, over_table = box_at(0.35, -0.22, 0.85, -0.5), box_at(0.35, -0.22, 1.05, -0.5)
ahead = box_at(0.37, 0.0, 0.9)
stops = [ahead, over_shelf, shelf, over_shelf, ahead, over_table, table, over_table]
times, boxes = np.zeros(1), np.array(stops[:1])
for start, end in zip(stops, stops[1:]):
    more, way = line(start, end, speed=0.2)
    times = np.append(times, times[-1] + more[1:])
    boxes = np.append(boxes, way[1:], axis=0)

palms = box_targets(boxes, width=0.24)
options = {"balance": True, "avoid_collisions": True, "floor": 0.0}
path = robot.ik_trajectory(times, palms, standing, base, **options)
print(path.message or f"all is reached, in {times[-1]:.1f} s")
margin = min(result.margin for result in path.results)
print(f"centre of mass at least {1e3 * margin:.0f} mm inside the feet's edges")

robot.write_motion("pick_and_place.csv", path.motion)
verdict = robot.checker(physics=True).check(path.motion)
print("passed, also in physics" if verdict.passed else verdict.findings)
