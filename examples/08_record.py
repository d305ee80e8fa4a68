"""Record base and joints of the robot that runs, and write them as a motion."""

import rospy
from g1_description.msg import RobotState

from g1_description import Robot, Stream

robot = Robot()
states = []

reach = robot.read_motion("reach.csv")
with Stream() as stream:
    stream.send(reach.positions[0], reach.base[0])
    rospy.sleep(0.5)
    rospy.Subscriber("robot_state", RobotState, states.append)
    for positions, base in zip(reach.positions, reach.base):
        stream.send(positions, base)

begin = states[0].header.stamp
bases = [(s.base_pose.position, s.base_pose.orientation) for s in states]
motion = robot.trajectory(
    [(s.header.stamp - begin).to_sec() for s in states],
    [s.position for s in states],
    base=[[p.x, p.y, p.z, q.x, q.y, q.z, q.w] for p, q in bases],
)
robot.write_motion("/tmp/my_reach.csv", motion)
# The same by the command: rosrun g1_description record my_reach.csv --seconds 5

again = robot.read_motion("/tmp/my_reach.csv")
print(f"{len(again.joint_names)} joints, base: {again.base is not None}")
