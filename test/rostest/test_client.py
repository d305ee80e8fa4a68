"""g1_description.Client: what it sets and reads, to the last bit."""

import os
import tempfile
import time
import unittest
from pathlib import Path

import numpy as np
import rospy
from gazebo_msgs.msg import LinkStates
from gazebo_msgs.srv import GetPhysicsProperties, SetPhysicsProperties
from std_srvs.srv import Empty
from support.ros_testing import DEADLINE, Connected
from support.stand_in import Node

from g1_description import Client, Robot
from g1_description.errors import G1DescriptionError
from g1_description.robot.rotation import normalized

ELBOW, KNEE = "left_elbow_joint", "right_knee_joint"
ROBOT = Robot()
WORLDS = []
HERE = [0.2, -0.1, 0.9, 0.0, 0.0, 0.6, 0.8]


def setUpModule():
    """Start three simulators, as programs step them; two are alike."""
    hold = "_physics:=hold", "_initial_pose:=stand"
    for name, arguments in (
        ("gazebo", hold),
        ("twin", hold),
        ("kinematic", ["_initial/max_update_rate:=100"]),
    ):
        WORLDS.append(Node("_on_floor:=true", "_paused:=true", *arguments, name=name))


def tearDownModule():
    for world in WORLDS:
        world.close()


def bits(state):
    """Give all numbers of a state, to the last bit."""
    arrays = state.positions, state.velocities, state.base, state.base_twist
    return state.time_ns, *(array.tobytes() for array in arrays)


def sockets():
    """List the open sockets of this process."""
    files = Path("/proc/self/fd").iterdir()
    open_files = [os.readlink(file) for file in files if file.is_symlink()]
    return {name for name in open_files if name.startswith("socket:")}


def experiment(client):
    """Do what robots hardly stand: sets, commands, steps and a motion, all random."""
    rng = np.random.default_rng(5)
    states = [client.reset()]
    for _ in range(3):
        states.append(client.step(int(rng.integers(1, 30))))
        client.command(ROBOT.random_configuration(rng))
        states.append(client.step(10))
        base = np.concatenate([[0.0, 0.0, 1.0], normalized(rng.normal(size=4))])
        states.append(client.step(5, {ELBOW: rng.uniform(0.0, 1.0)}, base))
    times = np.linspace(0.0, 0.1, 6)
    positions = ROBOT.random_configuration(rng, 6)
    done = client.play(ROBOT.trajectory(times, positions), every=20)
    return [
        *map(bits, states),
        done.times.tobytes(),
        done.positions.tobytes(),
        done.velocities.tobytes(),
        done.base_poses.tobytes(),
    ]


class TestPhysics(unittest.TestCase):
    def setUp(self):
        self.client = Client()
        self.addCleanup(self.client.close)

    def test_a_run_repeats_after_a_reset_and_in_another_process(self):
        first, again = experiment(self.client), experiment(self.client)
        self.assertEqual(first, again)
        with Client(gazebo="/twin") as twin:
            self.assertEqual(experiment(twin), first)
        self.assertEqual(len({state for state in first[:10]}), 10)

    def test_a_state_is_what_link_states_shows(self):
        shown = Connected("/gazebo/link_states", LinkStates, queue_size=None)
        self.addCleanup(shown.close)
        self.client.set(ROBOT.named_configuration("wave"), HERE)
        for number in range(3):
            shown.clear()
            state = self.client.step(10 + number, {KNEE: 0.3 * number})
            message = shown.wait(self.shows(state), "the state")
            poses = ROBOT.link_poses(state.positions, state.base)
            for name, pose, twist in zip(message.name, message.pose, message.twist):
                model, _, link = name.partition("::")
                if model != "g1_robot":
                    continue
                p, q = pose.position, pose.orientation
                at = np.array([p.x, p.y, p.z, q.x, q.y, q.z, q.w])
                self.assertLess(np.abs(at - poses[link]).max(), 1e-9, link)
                if link == "pelvis":
                    v, w = twist.linear, twist.angular
                    moves = np.array([v.x, v.y, v.z, w.x, w.y, w.z])
                    self.assertEqual(at.tobytes(), state.base.tobytes())
                    self.assertEqual(moves.tobytes(), state.base_twist.tobytes())

    @staticmethod
    def shows(state):
        """Give what tells link states that are those after all steps of a request."""

        def is_it(message):
            pelvis = message.pose[message.name.index("g1_robot::pelvis")].position
            return [pelvis.x, pelvis.y, pelvis.z] == state.base[:3].tolist()

        return is_it

    def test_steps_take_simulated_time_alone(self):
        begin = self.client.reset().time_ns
        self.assertEqual(begin, 0)
        self.assertEqual(self.client.step(25).time_ns, 25_000_000)
        self.assertEqual(self.client.state().time, 0.025)

    def test_an_anchor_is_refused_where_physics_moves_the_base(self):
        with self.assertRaises(G1DescriptionError) as found:
            self.client.anchor("left_ankle_roll_link")
        told = "an anchor needs kinematic physics; in hold physics moves the base."
        self.assertEqual(str(found.exception), told)
        self.assertEqual(self.client.anchor(), "")

    def test_motors_go_to_what_is_commanded_and_hold_what_is_set(self):
        self.client.reset()
        row = self.client.joint_names.index(ELBOW)
        begin = self.client.state().positions[row]
        self.assertEqual(self.client.command({ELBOW: begin + 0.2}), "")
        soon = self.client.step(5).positions[row]
        self.assertLess(abs(soon - begin), 0.1)
        later = self.client.step(600).positions[row]
        self.assertLess(abs(later - begin - 0.2), 0.02)
        self.assertEqual(self.client.set({ELBOW: 0.1}).positions[row], 0.1)


class TestKinematic(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.client = Client(gazebo="/kinematic")
        cls.addClassCleanup(cls.client.close)

    def refusal(self, function, *args, **kwargs):
        """Return the sentence with which something is refused; nothing changed."""
        before = bits(self.client.state())
        with self.assertRaises(G1DescriptionError) as found:
            function(*args, **kwargs)
        self.assertEqual(bits(self.client.state()), before)
        self.assertNotIn("\n", str(found.exception))
        return str(found.exception)

    def test_joints_are_in_the_order_of_the_robot(self):
        self.assertEqual(self.client.joint_names, ROBOT.joint_names)

    def test_what_is_set_is_there_to_the_last_bit(self):
        positions = ROBOT.random_configuration(2)
        state = self.client.set(positions, HERE)
        self.assertEqual(state.positions.tobytes(), positions.tobytes())
        self.assertEqual(state.base.tolist(), HERE)
        self.assertEqual((state.velocities.any(), state.note), (False, ""))
        moved = self.client.set({ELBOW: 0.5})
        expected = positions.copy()
        expected[ROBOT.joint_row(ELBOW)] = 0.5
        self.assertEqual(moved.positions.tobytes(), expected.tobytes())
        self.assertEqual(moved.base.tolist(), HERE)

    def test_an_anchor_stays_while_joints_are_set_and_played(self):
        hand, before = "left_rubber_hand", self.client.set(ROBOT.neutral, HERE)
        wanted = ROBOT.link_poses(before.positions, before.base)[hand]
        self.addCleanup(self.client.anchor)
        self.assertEqual(self.client.anchor(hand), "")
        way = np.linspace(ROBOT.neutral, ROBOT.random_configuration(7), 6)
        self.client.set(way[-1])
        done = self.client.play(ROBOT.trajectory(0.01 * np.arange(6), way))
        placed = ROBOT.forward_kinematics(done.positions, done.base_poses)
        seen = placed[:, ROBOT.link_row(hand)]
        np.testing.assert_allclose(seen, np.tile(wanted, (len(seen), 1)), atol=1e-9)
        self.assertNotEqual(done.base_poses[-1].tolist(), HERE)
        self.assertIn("no link 'ear'", self.refusal(self.client.anchor, "ear"))
        self.assertEqual(self.client.anchor("lowest_foot"), hand)

    def test_a_base_that_is_set_with_joints_is_there_with_an_anchor_too(self):
        hand = "left_rubber_hand"
        self.client.set(ROBOT.neutral, [0, 0, 0.8, 0, 0, 0, 1])
        self.addCleanup(self.client.anchor)
        self.client.anchor(hand)
        state = self.client.set(ROBOT.random_configuration(3), HERE)
        self.assertEqual(state.base.tolist(), HERE)
        self.assertFalse(state.base_twist.any())
        wanted = ROBOT.link_poses(state.positions, state.base)[hand]
        after = self.client.step(1, ROBOT.random_configuration(4))
        placed = ROBOT.link_poses(after.positions, after.base)[hand]
        np.testing.assert_allclose(placed, wanted, atol=1e-9)

    def test_what_is_clamped_is_told(self):
        state = self.client.set({KNEE: 9.0})
        row = ROBOT.joint_row(KNEE)
        self.assertEqual(state.positions[row], ROBOT.upper[row])
        self.assertIn(KNEE, state.note)
        self.assertEqual(state.clamped, (KNEE,))

    def test_a_motion_is_played_as_it_is(self):
        times = np.linspace(0.0, 0.05, 51)
        way = ROBOT.trajectory(
            times,
            np.linspace(ROBOT.neutral, ROBOT.named_configuration("squat"), 51),
            base_poses=np.linspace(
                [0, 0, 0.9, 0, 0, 0, 1], [0.1, 0, 0.7, 0, 0, 0, 1], 51
            ),
        )
        done = self.client.play(way)
        self.assertEqual(done.joint_names, way.joint_names)
        self.assertLess(np.abs(done.times - times).max(), 1e-12)
        self.assertLess(np.abs(done.positions - way.positions).max(), 1e-12)
        self.assertLess(np.abs(done.base_poses - way.base_poses).max(), 1e-12)
        with tempfile.TemporaryDirectory() as folder:
            ROBOT.write_motion(f"{folder}/done.csv", done)
            read = ROBOT.read_motion(f"{folder}/done.csv")
        self.assertEqual(read.positions.tobytes(), done.positions.tobytes())

    def test_a_record_has_its_last_state_in_any_case(self):
        done = self.client.record(25, every=10)
        self.assertEqual(np.round(done.times, 9).tolist(), [0.0, 0.01, 0.02, 0.025])

    def test_what_cannot_be_done_is_refused(self):
        client = self.client
        text = self.refusal(client.set, {"left_elbow": 0.1})
        self.assertIn("Known joints: left_elbow_joint", text)
        self.assertIn("(28,)", self.refusal(client.set, np.zeros(28)))
        self.assertIn(
            "single configuration", self.refusal(client.set, np.zeros((2, 29)))
        )
        self.assertIn("single pose", self.refusal(client.set, None, [HERE, HERE]))
        self.assertIn("(got nan)", self.refusal(client.command, {ELBOW: np.nan}))
        self.assertIn("whole number", self.refusal(client.step, -1))
        self.assertIn("whole number", self.refusal(client.step, 1.5))
        self.assertIn("whole number", self.refusal(client.record, 10, every=0))
        wrong = ROBOT.trajectory([0.0], [ROBOT.neutral])
        names = tuple(f"other_{name}" for name in ROBOT.joint_names)
        wrong = type(wrong)(wrong.times, names, wrong.positions)
        self.assertIn("other_left", self.refusal(client.follow, wrong))

    def test_a_motion_is_refused_while_steps_have_no_length(self):
        ask = rospy.ServiceProxy(
            "/kinematic/get_physics_properties", GetPhysicsProperties
        )
        change = rospy.ServiceProxy(
            "/kinematic/set_physics_properties", SetPhysicsProperties
        )
        before = ask()
        rest = before.max_update_rate, before.gravity, before.ode_config
        self.addCleanup(change, before.time_step, *rest)
        change(0.0, *rest)
        still = ROBOT.trajectory([0.0, 1.0], [ROBOT.neutral, ROBOT.neutral])
        self.assertIn("time_step is 0", self.refusal(self.client.play, still))

    def test_steps_while_time_runs_are_refused(self):
        rospy.ServiceProxy("/kinematic/unpause_physics", Empty)()
        with self.assertRaisesRegex(G1DescriptionError, "time is running"):
            self.client.step()
        rospy.ServiceProxy("/kinematic/pause_physics", Empty)()
        self.client.step()

    def test_time_runs_again_afterwards_if_it_did_before(self):
        physics = rospy.ServiceProxy(
            "/kinematic/get_physics_properties", GetPhysicsProperties
        )
        rospy.ServiceProxy("/kinematic/unpause_physics", Empty)()
        with Client(gazebo="kinematic"):
            self.assertTrue(physics().pause)
        self.assertFalse(physics().pause)
        rospy.ServiceProxy("/kinematic/pause_physics", Empty)()
        with Client(gazebo="/kinematic/"):
            pass
        self.assertTrue(physics().pause)


class TestAbsent(unittest.TestCase):
    def refusal(self, **arguments):
        begin = time.monotonic()
        with self.assertRaises(G1DescriptionError) as found:
            Client(timeout=3.0, **arguments)
        self.assertLess(time.monotonic() - begin, DEADLINE)
        return str(found.exception)

    def test_what_is_not_there_is_told_in_time(self):
        self.assertIn("/nowhere is not running;", self.refusal(gazebo="/nowhere"))
        self.assertIn("No robot within", self.refusal(model="g2_robot"))
        service = rospy.Service("/other/pause_physics", Empty, lambda _: None)
        self.addCleanup(service.shutdown)
        self.assertIn("is not the simulator", self.refusal(gazebo="/other"))

    def test_no_connection_stays_if_there_is_no_robot(self):
        before = sockets()
        try:
            Client(model="g2_robot", timeout=1.0)
        except G1DescriptionError as error:
            kept = error  # and with it all that was made
        self.assertEqual(sockets() - before, set(), kept)
