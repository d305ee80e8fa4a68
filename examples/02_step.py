"""Take over simulated time: set joints, step, read the state, play a motion."""

import numpy as np

from g1_description import Client, Robot

robot = Robot()
elbow = robot.joint_row("left_elbow_joint")
with Client() as client:
    client.reset()
    state = client.set({"left_elbow_joint": 0.5})
    print(f"{state.time:.3f} s: elbow at {state.positions[elbow]:.3f} rad")
    state = client.step(100)
    print(f"{state.time:.3f} s: 100 steps of {client.time_step} s later")

    squat = robot.read_motion("squat.csv")
    done = client.play(squat, every=20)

desired = [np.interp(done.times, squat.times, column) for column in squat.positions.T]
error = np.abs(done.positions.T - desired).max()
print(f"{done.duration:.2f} s played, largest error {error:.6f} rad")
