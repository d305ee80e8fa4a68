"""Pick a box from a shelf, put it on a table, level all the way, and leave."""

import numpy as np

from g1_description import Robot, Scene, box_targets
from g1_description.motion.edit import joined, minimum_jerk_fraction

robot = Robot()
standing, base = robot.named_configuration("stand"), [0.0, 0.0, 0.7634, 0, 0, 0, 1]
shelf, table = np.array([0.32, 0.22, 0.42, 0.5]), np.array([0.38, -0.2, 0.85, -0.5])
up, ahead = [0.0, 0.0, 0.2, 0.0], [0.37, 0.0, 0.9, 0.0]
carry = [shelf, shelf + up, ahead, table + up, table]  # x, y, z and yaw of the box
stops = [shelf + up, shelf, *carry, table, table + up, ahead, shelf + up]
stops = np.column_stack([stops, [0.34] * 2 + [0.24] * 5 + [0.34] * 4])  # and width
share = minimum_jerk_fraction(np.linspace(0.0, 1.0, 100))[:, np.newaxis]
way = np.concatenate([a + share * (b - a) for a, b in zip(stops, stops[1:])])
times, (x, y, z, yaw, width) = 2.0 + np.arange(len(way)) / 50, way.T
boxes = np.stack([x, y, z, 0 * x, 0 * x, np.sin(yaw / 2), np.cos(yaw / 2)], axis=1)

scene, hands = Scene(), ["left_hand", "right_hand"]
scene.box("shelf", [0.3, 0.2, 0.02], [0.36, 0.24, 0.33], rpy=[0, 0, 0.5])
scene.box("table", [0.3, 0.26, 0.03], [0.5, -0.27, 0.755])
scene.box("wall", [0.02, 0.5, 0.6], [0.1, 0.7, 0.9], color=[0.5, 0.6, 0.7])
scene.box("box", [0.12, 0.24, 0.16], boxes[200], mass=0.5, may_touch=hands)
scene.attach("box", "left_hand", begin=times[200], end=times[600])

palms = box_targets(boxes, width)
options = {"balance": True, "avoid_collisions": True, "floor": 0.0}
path = robot.ik_trajectory(times, palms, standing, base, scene=scene, **options)
print(path.message or f"all is reached, in {times[-1]:.1f} s")
approach = robot.keyframes([(standing, base), path.results[0]], [0, 2])
leave = robot.keyframes([path.results[-1], (standing, base)], [0, 2])
motion = joined([approach, path, leave])
robot.write_motion("among_things.csv", motion)
scene.save("among_things.scene.yaml")
verdict = robot.check(motion, scene=scene)
print("passed" if verdict.passed else verdict.findings)
