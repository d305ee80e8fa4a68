"""Spawn robots in a grid: spawning_node.py COUNT."""

import sys

import rospy
from gazebo_msgs.srv import SpawnModel
from geometry_msgs.msg import Pose

ROW = 10


def main():
    """Spawn them, one after the other."""
    rospy.init_node("spawning")
    spawn = rospy.ServiceProxy("/gazebo/spawn_urdf_model", SpawnModel, persistent=True)
    spawn.wait_for_service()
    urdf = rospy.get_param("/robot_description")
    for number in range(int(sys.argv[1])):
        pose = Pose()
        pose.position.x, pose.position.y = number % ROW, number // ROW
        pose.position.z, pose.orientation.w = 1.0, 1.0
        answer = spawn(f"robot_{number}", urdf, "", pose, "world")
        if not answer.success:
            sys.exit(answer.status_message)


if __name__ == "__main__":
    main()
