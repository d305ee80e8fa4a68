"""Topics of single joints, as rl_sar's node uses them."""

import subprocess
import threading
import unittest
from contextlib import closing
from functools import partial

import rospy
from robot_msgs.msg import MotorCommand, MotorState
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import JointState
from support.ros_testing import DEADLINE, Connected, Repeated, program, wait_for

ELBOW, KNEE = "left_elbow", "right_knee"


class TestJointControllers(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.states, cls.commands = {}, {}
        for name in (ELBOW, KNEE):
            topic = f"/g1_gazebo/{name}_controller"
            cls.states[name] = Connected(f"{topic}/state", MotorState)
            cls.addClassCleanup(cls.states[name].close)
            publisher = rospy.Publisher(f"{topic}/command", MotorCommand, queue_size=10)
            wait_for(publisher.get_num_connections, "the controller to listen")
            cls.commands[name] = publisher

    def test_each_joint_follows_its_command_and_tells_its_effort(self):
        for name, goal in ((ELBOW, 1.0), (KNEE, 0.7)):
            self.commands[name].publish(MotorCommand(q=goal, kp=80.0, kd=4.0))

        def is_there(goal):
            def holds(m):
                effort = 80.0 * (goal - m.q) - 4.0 * m.dq
                return abs(m.q - goal) < 0.1 and abs(effort - m.tau_est) < 1.0

            return holds

        self.states[ELBOW].wait(is_there(1.0), "the elbow")
        self.states[KNEE].wait(is_there(0.7), "the knee")
        self.commands[ELBOW].publish(MotorCommand(tau=-6.0, kd=4.0))
        self.states[ELBOW].wait(lambda m: m.q < 0.0, "the elbow's effort")

    def test_an_invalid_command_to_a_joint_is_ignored_and_others_are_not(self):
        log = Connected("/rosout", Log)
        self.addCleanup(log.close)
        self.commands[KNEE].publish(MotorCommand(q=0.4, kp=80.0, kd=4.0))
        self.states[KNEE].wait(lambda m: abs(m.q - 0.4) < 0.1, "the knee")
        for bad, words in (
            (MotorCommand(q=float("nan")), "(got q: nan, dq: 0.0"),
            (MotorCommand(kd=-4.0), "kd: -4.0, tau: 0.0)"),
        ):
            # Again and again: the log may hear other nodes before this one.
            with closing(Repeated(partial(self.commands[KNEE].publish, bad), 0.2)):
                log.wait(partial(self.is_refused, words), words)
        self.states[ELBOW].clear()
        self.states[KNEE].clear()
        self.commands[ELBOW].publish(MotorCommand(q=0.5, kp=80.0, kd=4.0))
        self.states[ELBOW].wait(lambda m: abs(m.q - 0.5) < 0.1, "the elbow")
        self.assertAlmostEqual(self.states[KNEE].wait().q, 0.4, delta=0.1)

    @staticmethod
    def is_refused(words, message):
        start = f"{KNEE}_joint: ignored a command, as all numbers must be within"
        return message.msg.startswith(start) and words in message.msg

    def test_all_joints_are_published_with_their_efforts(self):
        states = Connected("/g1_gazebo/joint_states", JointState)
        self.addCleanup(states.close)
        message = states.wait()
        self.assertIn("left_hip_pitch_joint", message.name)
        sizes = {len(message.name), len(message.position), len(message.effort)}
        self.assertEqual(sizes, {29})
        self.commands[KNEE].publish(MotorCommand(tau=2.0, kd=4.0))
        states.wait(lambda m: max(map(abs, m.effort)) > 0.5, "the effort of the knee")

    def test_a_controller_without_a_joint_is_told(self):
        command = [program("joint_controllers.py"), "no_controller", "__ns:=/g1_gazebo"]
        ended = subprocess.run(
            command, capture_output=True, text=True, timeout=DEADLINE, check=False
        )
        self.assertEqual(ended.returncode, 1)
        self.assertIn(
            "No joint of no_controller: there is no parameter "
            "/g1_gazebo/no_controller/joint. Load the file of the controllers first.",
            ended.stderr + ended.stdout,
        )

    def test_a_controller_of_no_joint_of_the_model_is_told(self):
        command = [program("joint_controllers.py"), "bad_controller"]
        process = subprocess.Popen(
            [*command, "__ns:=/g1_gazebo", "__name:=bad"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.addCleanup(process.communicate)
        self.addCleanup(process.terminate)
        deadline = threading.Timer(DEADLINE, process.terminate)
        deadline.start()
        self.addCleanup(deadline.cancel)
        words = (
            "g1_gazebo has no joint left_elbw_joint, whose controller does nothing. "
            "Known joints: left_elbow_joint,"
        )
        self.assertTrue(any(words in line for line in process.stderr), words)
