"""A world file, started by a launch file for Gazebo, becomes the stand-in's world."""

import signal
import subprocess
import tempfile
import unittest
from pathlib import Path

import rospy
from gazebo_msgs.srv import GetPhysicsProperties
from support.golden.simulator import Simulator
from support.ros_testing import DEADLINE, process_of, program, wait_for

SHELF = Path(__file__).resolve().parents[1] / "data" / "shelf.world"
SECOND = "/second/gazebo"


class Server:
    """A second simulator of this master, paused, with a command line of gzserver."""

    def __init__(self, *words):
        """Start it, and wait until it answers."""
        self._output = tempfile.TemporaryFile()  # noqa: SIM115  (kept until the end)
        command = [program("gzserver", "gazebo_ros"), "-u", *map(str, words)]
        self._process = subprocess.Popen(
            [*command, "__ns:=/second", "__name:=gazebo"],
            stdout=self._output,
            stderr=subprocess.STDOUT,
        )
        wait_for(lambda: process_of(SECOND) == self._process.pid, "the simulator")
        # dynamic_reconfigure's server is made last: it has written its numbers.
        rospy.wait_for_service(f"{SECOND}/set_parameters", DEADLINE)

    def physics(self):
        """Give gravity along z, the time step, and the solver's iterations."""
        name = f"{SECOND}/get_physics_properties"
        now = rospy.ServiceProxy(name, GetPhysicsProperties)()
        return now.gravity.z, now.time_step, now.ode_config.sor_pgs_iters

    def output(self):
        """Give all it has written."""
        self._output.seek(0)
        return self._output.read().decode()

    def end(self, by=signal.SIGINT):
        """Send a signal and wait for the end."""
        self._process.send_signal(by)
        self._process.wait(DEADLINE)


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
            ("/nowhere/w.world", "World file /nowhere/w.world does not exist."),
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

    def test_what_a_former_simulator_wrote_is_no_wish(self):
        empty = Server()
        self.addCleanup(empty.end)
        self.assertEqual(empty.physics(), (-9.8, 0.001, 50))
        self.assertEqual(rospy.get_param(f"{SECOND}/gravity_z"), -9.8)
        empty.end()
        shelf = Server(SHELF)
        self.addCleanup(shelf.end)
        self.assertEqual(shelf.physics(), (-2.0, 0.002, 77))
        self.assertEqual(rospy.get_param(f"{SECOND}/gravity_z"), -2.0)
        self.assertNotIn("overrides", shelf.output())

    def test_a_wish_wins_over_the_file_and_is_logged(self):
        rospy.set_param(f"{SECOND}/initial/gravity_z", -1)
        self.addCleanup(rospy.delete_param, f"{SECOND}/initial")
        for end in (signal.SIGKILL, signal.SIGINT):
            server = Server(SHELF, "_initial/sor_pgs_iters:=77")
            self.addCleanup(server.end)
            self.assertEqual(server.physics(), (-1.0, 0.002, 77))
            words = "shelf.world: gravity_z is -1 (~initial/gravity_z overrides the"
            self.assertIn(f"{words} file's -2)", server.output())
            self.assertEqual(server.output().count("overrides"), 1)
            server.end(end)

    def test_a_bare_number_is_ignored_with_a_line(self):
        empty = Server("_gravity_z:=-1", "_initial/time_step:=0.01")
        self.addCleanup(rospy.delete_param, f"{SECOND}/initial")
        self.addCleanup(empty.end)
        self.assertEqual(empty.physics(), (-9.8, 0.01, 50))
        words = "~gravity_z = -1 is ignored; set ~initial/gravity_z"
        self.assertEqual(empty.output().count(words), 1)
        self.assertNotIn("overrides", empty.output())  # there is no file

    def test_a_wish_that_cannot_be_ends_the_node_with_its_name(self):
        command = ["rosrun", "g1_description", "gazebo_stand_in.py", "__ns:=/third"]
        done = subprocess.run(
            [*command, "_initial/gravity_z:=down"],
            stderr=subprocess.PIPE,
            check=False,
            text=True,
            timeout=DEADLINE,
        )
        self.assertEqual(done.returncode, 1)
        words = "~initial/gravity_z must be a float like -9.8 (got 'down')."
        self.assertIn(words, done.stderr)
