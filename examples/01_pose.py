"""Move the robot to a named pose, on the topic that takes joint positions."""

import rospy
from sensor_msgs.msg import JointState

from g1_description import Robot

robot = Robot()
rospy.init_node("pose")
commands = rospy.Publisher("joint_commands", JointState, queue_size=1)
while not commands.get_num_connections():
    rospy.sleep(0.1)

pose = robot.named_configuration("t_pose")
commands.publish(JointState(name=robot.joint_names, position=pose))

while True:
    state = rospy.wait_for_message("joint_states", JointState)
    if max(abs(pose - state.position)) < 1e-6:
        break
for name in ("left_shoulder_roll_joint", "left_elbow_joint"):
    print(f"{name}: {state.position[state.name.index(name)]:.4f} rad")
