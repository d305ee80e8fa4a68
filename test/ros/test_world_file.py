#!/usr/bin/env python3
"""A world file, started by a launch file for Gazebo, becomes the stand-in's world."""

import subprocess
import sys
import unittest

import rospy
import rostest
from support.golden.simulator import Simulator
from support.ros_testing import DEADLINE, wait_for


class TestWorldFile(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.simulator = Simulator()

    def test_models_lights_and_physics_are_those_of_the_file(self):
        self.assertEqual(self.simulator.models(), ["ground_plane", "shelf", "cube"])
        physics = self.simulator.physics()
        self.assertEqual(physics["gravity"], [0.0, 0.0, -2.0])
        self.assertEqual(
            (physics["time_step"], physics["max_update_rate"]), (0.002, 500)
        )
        ode = physics["ode_config"]
        self.assertEqual((ode["sor_pgs_iters"], ode["sor_pgs_w"]), (77, 1.4))
        self.assertEqual((ode["erp"], ode["cfm"]), (0.3, 0.0))
        board = self.simulator.link("shelf::board")["pose"]
        self.assertEqual(board, [1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
        sun = self.simulator.call("get_light_properties", light_name="sun")
        self.assertTrue(sun["success"])

    def test_the_cube_comes_to_rest_on_the_board(self):
        self.simulator.call("unpause_physics")
        wait_for(lambda: self.simulator.time() > 2.0, "two seconds")
        height = self.simulator.state("cube")["pose"][2]
        self.assertAlmostEqual(height, 1.11, delta=0.002)

    def test_a_wrong_world_file_ends_the_node_with_a_sentence(self):
        command = ["rosrun", "g1_description", "gazebo_stand_in.py", "__ns:=/other"]
        for path, words in (
            ("/nowhere/w.world", "There is no world file /nowhere/w.world."),
            (__file__, f"World file {__file__}: The SDF is not XML"),
        ):
            done = subprocess.run(
                [*command, f"_world:={path}"],
                stderr=subprocess.PIPE,
                check=False,
                text=True,
                timeout=DEADLINE,
            )
            self.assertEqual(done.returncode, 1)
            self.assertIn(words, done.stderr)
            self.assertNotIn("Traceback", done.stderr)


if __name__ == "__main__":
    rospy.init_node("world_file_test")
    rostest.rosrun("g1_description", "world_file", TestWorldFile, sys.argv)
