"""Find links that collide, or are near each other, in many configurations at once."""

import numpy as np

from g1_description import Robot

robot = Robot()
print(f"{len(robot.collision_pairs)} pairs of links are checked")

# The right arm goes from the side into the body.
roll = np.linspace(-0.3, 0.4, 8)
arm = robot.positions({"right_shoulder_roll_joint": roll})
contacts = robot.self_collisions(arm)
for sample, pair, distance in zip(contacts.sample, contacts.pair, contacts.distance):
    first, second = robot.collision_pairs[pair]
    print(
        f"roll {roll[sample]:+.1f}: {first} - {second} {-1000 * distance:.1f} mm deep"
    )

near = robot.self_collisions(robot.named_configuration("stand"), margin=0.02)
print(f"standing, {len(near.pair)} pairs are nearer than 2 cm")

drawn = robot.random_configuration(rng=1, size=200)
colliding = np.unique(robot.self_collisions(drawn).sample)
print(f"{len(colliding)} of {len(drawn)} random configurations collide")
