"""Goals of follow_joint_trajectory, sent by actionlib's ordinary client."""

import math
import unittest

import numpy as np
import rospy
from control_msgs.msg import FollowJointTrajectoryResult as Result
from geometry_msgs.msg import Point, Pose, Quaternion
from sensor_msgs.msg import JointState
from support.goals import Client, Joints, Snapshot, goal_of, tolerance
from support.joint_limits import limits
from support.programs import Program, run
from support.ros_testing import NodeLog, wait_for
from support.stand_in import Node
from trajectory_msgs.msg import JointTrajectory

ELBOW, KNEE, SHOULDER = (
    "left_elbow_joint",
    "left_knee_joint",
    "left_shoulder_pitch_joint",
)
RIGHT = "right_elbow_joint"
HOME = dict.fromkeys((ELBOW, KNEE, SHOULDER, RIGHT), 0.25)
WORLD = (
    *("_model_name:=one", "_on_floor:=true", "_link_states_rate:=100"),
    "_pub_clock_frequency:=100",
)
ROBOTS = [
    {"name": "one", "namespace": ""},
    {
        "name": "two",
        "controllers": [
            {
                "name": "left_arm",
                "joints": [SHOULDER, ELBOW],
                "constraints": {
                    "goal_time": 0.2,
                    ELBOW: {"trajectory": 0.1, "goal": 0.05},
                },
            },
            {"name": "right/arm", "joints": [RIGHT]},
        ],
    },
]
"""The first has one controller for all joints, the second has two."""
ROUNDED = 1e-3
"""[rad] So far a motion may go beyond a limit."""


def elbow(**places):
    """Give the points of a motion of the elbow: t500=1.0 is 1 rad after 500 ms."""
    return {int(t[1:]) / 1000: {ELBOW: place} for t, place in places.items()}


class TestFollowJointTrajectory(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.begin_world()
        cls.addClassCleanup(lambda: cls.world.close())
        rospy.set_param("/bridge/robots", ROBOTS)
        bridge = Program("link_states_bridge.py", "__name:=bridge")
        cls.addClassCleanup(bridge.wait)
        cls.addClassCleanup(bridge.terminate)
        cls.log = NodeLog("/bridge")
        cls.addClassCleanup(cls.log.close)
        cls.client = Client("/follow_joint_trajectory")
        cls.second = Client("/follow_joint_trajectory")
        cls.joints = Joints()
        cls.addClassCleanup(cls.joints.close)
        cls.lower, cls.upper = limits()[1]
        cls.names = limits()[0]

    @classmethod
    def begin_world(cls):
        cls.world = Node(*WORLD)
        cls.spawn_other()

    @classmethod
    def spawn_other(cls):
        urdf = rospy.get_param("/robot_description")
        place = Pose(Point(2.0, 0.0, 0.793), Quaternion(0.0, 0.0, 0.0, 1.0))
        answer = cls.call("spawn_urdf_model", "two", urdf, "", place, "")
        assert answer.success, answer.status_message

    @classmethod
    def call(cls, name, *args):
        return cls.world.services.call(name, *args)

    def setUp(self):
        if not self.world.is_alive():
            self.begin_world()
        self.log.clear()
        self.joints.clear()
        for name in ("one", "two"):
            self.call("set_model_configuration", name, "", [*HOME], [*HOME.values()])
        self.joints.wait("the robot at home", **HOME)
        self.joints.clear()

    def check(self, found, state, code, *words):
        """Check the end of a goal."""
        self.assertEqual((found[0], found[1].error_code), (state, code), found[1])
        text = found[1].error_string
        for word in words:
            self.assertIn(word, text)
        if code:
            self.assertTrue(text.endswith("."), text)
            self.assertEqual(text.count("\n"), 0)

    def check_done(self, found):
        self.check(found, "SUCCEEDED", Result.SUCCESSFUL)

    def check_still(self, **positions):
        """Check that joints are somewhere, and stay there without velocity."""
        now = self.call("get_world_properties").sim_time
        before, after = self.joints.at(now), self.joints.at(now + 0.1)
        self.assertEqual(before.position, after.position)
        self.assertEqual(set(after.velocity.values()), {0.0})
        for name, position in positions.items():
            self.assertAlmostEqual(after.position[name], position, 9)
        return after.position

    def check_that_nothing_jumps(self):
        """By the time between states: a busy machine may skip some."""
        seen = [Snapshot(message) for message in self.joints.messages]
        angles = np.diff([one.position[ELBOW] for one in seen])
        self.assertLess(max(np.abs(angles) / np.diff([s.stamp for s in seen])), 10.0)

    def reset(self):
        """Reset the world when all that was published is of a later time."""
        self.reset_time = self.call("get_world_properties").sim_time
        self.joints.at(self.reset_time)
        self.joints.clear()
        self.call("reset_simulation")

    def wait_for_elbow(self, least):
        """Wait until the elbow has come somewhere."""
        wait_for(lambda: self.joints.next().position[ELBOW] > least, "a bent elbow")

    def test_joints_follow_the_points(self):
        points = {0.2: {ELBOW: 0.5, KNEE: 0.25}, 0.6: {ELBOW: 0.1, KNEE: 0.75}}
        self.check_done(self.client.run(goal_of(points)))
        self.joints.wait("the end", **points[0.6])
        first = self.client.feedback[0]
        start = (first.header.stamp - first.desired.time_from_start).to_sec()
        knots = [0.0, 0.2, 0.6]
        for message in self.joints.messages:
            seen = Snapshot(message)
            elapsed = seen.stamp - start
            for joint in (ELBOW, KNEE):
                places = [0.25, points[0.2][joint], points[0.6][joint]]
                wanted = np.interp(elapsed, knots, places)
                self.assertAlmostEqual(seen.position[joint], wanted, 6)
        self.check_still(**{**HOME, **points[0.6]})

    def test_with_velocities_they_follow_polynomials(self):
        goal = goal_of(elbow(t0=0.25, t400=0.75), [[0.0], [0.0]])
        self.check_done(self.client.run(goal))
        self.joints.wait("the end", **{ELBOW: 0.75})
        first = self.client.feedback[0]
        start = (first.header.stamp - first.desired.time_from_start).to_sec()
        for message in self.joints.messages:
            seen = Snapshot(message)
            share = np.clip((seen.stamp - start) / 0.4, 0.0, 1.0)
            wanted = 0.25 + 0.5 * share**2 * (3.0 - 2.0 * share)
            self.assertAlmostEqual(seen.position[ELBOW], wanted, 6)
            wanted = 0.5 / 0.4 * 6.0 * share * (1.0 - share)
            self.assertAlmostEqual(seen.velocity[ELBOW], wanted, 4)

    def test_feedback_tells_where_the_joints_should_be_and_are(self):
        self.check_done(self.client.run(goal_of(elbow(t500=1.25))))
        feedback = self.client.feedback
        stamps = [message.header.stamp.to_sec() for message in feedback]
        self.assertGreaterEqual(len(stamps), 2)
        self.assertGreaterEqual(min(np.diff(stamps)), 0.05 - 1e-9)
        for message in feedback:
            self.assertEqual(message.joint_names, [ELBOW])
            desired, actual = message.desired, message.actual
            elapsed = desired.time_from_start.to_sec()
            self.assertAlmostEqual(desired.positions[0], 0.25 + 2.0 * elapsed, 2)
            self.assertAlmostEqual(desired.velocities[0], 2.0, 2)
            error = desired.positions[0] - actual.positions[0]
            self.assertEqual(message.error.positions[0], error)
            self.assertAlmostEqual(error, 0.0, 9)

    def test_other_joints_stay(self):
        self.check_done(self.client.run(goal_of({0.1: {KNEE: 0.5}})))
        self.check_still(**{**HOME, KNEE: 0.5})

    def test_a_single_point_without_time_is_shown_at_once(self):
        self.check_done(self.client.run(goal_of(elbow(t0=0.5))))
        self.check_still(**{ELBOW: 0.5})

    def test_a_goal_of_the_future_waits(self):
        start = rospy.get_time() + 3.0
        self.client.send(goal_of(elbow(t0=0.25, t200=0.75), stamp=start))
        self.client.wait_until_active()
        self.check_done(self.client.end())
        self.joints.wait("the end", **{ELBOW: 0.75})
        for message in self.joints.messages:
            seen = Snapshot(message)
            wanted = np.interp(seen.stamp - start, [0.0, 0.2], [0.25, 0.75])
            self.assertAlmostEqual(seen.position[ELBOW], wanted, 6)

    def test_a_goal_of_the_past_is_rejected_and_the_present_one_goes_on(self):
        wait_for(lambda: rospy.get_time() > 3.0, "simulated time")
        self.client.send(goal_of(elbow(t600=0.75)))
        self.client.wait_until_active()
        late = goal_of(elbow(t0=0.0, t100=-0.5), stamp=rospy.get_time() - 2.0)
        found = self.second.run(late)
        self.check(found, "REJECTED", Result.OLD_HEADER_TIMESTAMP, "in the past")
        self.check_done(self.client.end())
        self.check_still(**{ELBOW: 0.75})

    def test_of_a_goal_partly_of_the_past_the_rest_is_done(self):
        wait_for(lambda: rospy.get_time() > 1.0, "simulated time")
        start = rospy.get_time() - 0.5
        points = elbow(t0=-0.5, t400=-0.5, t4000=0.75)
        self.check_done(self.client.run(goal_of(points, stamp=start)))
        self.joints.wait("the end", **{ELBOW: 0.75})
        angles = [Snapshot(m).position[ELBOW] for m in self.joints.messages]
        self.assertGreaterEqual(min(angles), 0.25 - 1e-9)
        self.check_that_nothing_jumps()

    def test_a_cancelled_goal_stops_where_it_is(self):
        self.client.send(goal_of(elbow(t10000=2.0)))
        self.wait_for_elbow(0.4)
        self.client.cancel()
        self.assertEqual(self.client.end()[0], "PREEMPTED")
        angle = self.check_still()[ELBOW]
        self.assertGreater(angle, 0.4)
        self.assertLess(angle, 1.9)

    def test_a_goal_takes_the_place_of_another(self):
        self.client.send(goal_of(elbow(t10000=2.0)))
        self.wait_for_elbow(0.4)
        self.check_done(self.second.run(goal_of(elbow(t300=0.0))))
        self.assertEqual(self.client.state, "PREEMPTED")
        self.check_that_nothing_jumps()
        self.check_still(**{ELBOW: 0.0})

    def test_another_command_for_a_joint_takes_the_place_of_a_goal(self):
        commands = rospy.Publisher("/joint_commands", JointState, queue_size=1)
        motions = rospy.Publisher("/joint_trajectory", JointTrajectory, queue_size=1)
        motion = goal_of(elbow(t100=-0.5)).trajectory
        other = goal_of({0.1: {KNEE: 0.5}}).trajectory
        command = JointState(name=[ELBOW], position=[-0.3])
        for publisher, message, place in (
            (commands, command, -0.3),
            (motions, motion, -0.5),
        ):
            wait_for(publisher.get_num_connections, publisher.name)
            self.client.send(goal_of(elbow(t20000=2.0)))
            self.client.wait_until_active()
            if publisher is motions:
                motions.publish(other)
                self.joints.wait("the knee", **{KNEE: 0.5})
                self.assertEqual(self.client.state, "ACTIVE")
            publisher.publish(message)
            self.assertEqual(self.client.end()[0], "PREEMPTED")
            self.joints.wait("the command", **{ELBOW: place})
            self.check_still(**{ELBOW: place})

    def test_an_empty_goal_stops_the_joints(self):
        self.client.send(goal_of(elbow(t10000=2.0)))
        self.wait_for_elbow(0.4)
        self.check_done(self.second.run(goal_of({})))
        self.assertEqual(self.client.state, "PREEMPTED")
        self.assertLess(self.check_still()[ELBOW], 1.9)

    def test_wrong_joints_are_told_and_the_present_goal_goes_on(self):
        self.client.send(goal_of(elbow(t600=0.75)))
        self.client.wait_until_active()
        wrong = goal_of({0.1: {"left_elbo_joint": 0.0}})
        found = self.second.run(wrong)
        self.check(found, "REJECTED", Result.INVALID_JOINTS, "left_elbo_joint", ELBOW)
        nameless = goal_of({0.1: {}})
        found = self.second.run(nameless)
        self.check(found, "REJECTED", Result.INVALID_JOINTS, "has no joint names")
        self.check_done(self.client.end())

    def test_numbers_that_make_no_motion_are_told(self):
        ragged = goal_of(elbow(t100=0.5))
        ragged.trajectory.points[0].positions = [0.0, 0.0]
        falling = goal_of(elbow(t200=0.5, t100=0.75))
        some = goal_of(elbow(t100=0.5, t200=0.75), [[0.0], []])
        strict = goal_of(elbow(t100=0.5), path_tolerance=tolerance(ELBOW, math.nan))
        for goal, words in (
            (goal_of(elbow(t100=math.nan)), "nan"),
            (goal_of(elbow(t100=math.inf)), "inf"),
            (ragged, "got 2"),
            (falling, "must increase"),
            (some, "no velocities"),
            (strict, "NaN"),
        ):
            with self.subTest(words):
                found = self.client.run(goal)
                self.check(found, "REJECTED", Result.INVALID_GOAL, words)
        self.check_still(**HOME)

    def beyond(self):
        """Give a point of the elbow beyond its limit."""
        limit = self.upper[self.names.index(ELBOW)]
        return limit, elbow(t400=limit + 0.3, t500=limit + 0.3)

    def test_a_limit_on_the_way_breaks_the_path_tolerance(self):
        limit, points = self.beyond()
        goal = goal_of(points, path_tolerance=tolerance(ELBOW, 0.1))
        found = self.client.run(goal)
        code = Result.PATH_TOLERANCE_VIOLATED
        self.check(found, "ABORTED", code, ELBOW, "position", "(tolerance 0.1)")
        self.joints.wait("the limit", **{ELBOW: limit + ROUNDED})
        self.log.wait(lambda m: "limit" in m.msg, "a line about the limit")

    def test_a_limit_at_the_end_breaks_the_goal_tolerance(self):
        _, points = self.beyond()
        goal = goal_of(points, goal_tolerance=tolerance(ELBOW, 0.1))
        found = self.client.run(goal)
        self.check(found, "ABORTED", Result.GOAL_TOLERANCE_VIOLATED, ELBOW, "0.299")

    def test_the_goal_may_come_later(self):
        _, points = self.beyond()
        goal = goal_of(points, goal_tolerance=tolerance(ELBOW, 0.1))
        goal.goal_time_tolerance = rospy.Duration(30.0)
        self.client.send(goal)
        begin = rospy.get_time()
        wait_for(lambda: rospy.get_time() > begin + 1.0, "simulated time")
        self.assertEqual(self.client.state, "ACTIVE")
        self.client.cancel()
        self.assertEqual(self.client.end()[0], "PREEMPTED")

    def test_without_tolerances_a_limit_is_no_fault(self):
        _, points = self.beyond()
        for position in (0.0, -1.0, 0.5):
            goal = goal_of(points, path_tolerance=tolerance(ELBOW, position))
            self.check_done(self.client.run(goal))

    def test_paused_time_lets_a_goal_wait(self):
        self.client.send(goal_of(elbow(t4000=0.75)))
        self.wait_for_elbow(0.3)
        self.call("pause_physics")
        world = self.call("get_world_properties").sim_time
        self.second.send(goal_of({0.2: {KNEE: 0.5}}))
        self.second.wait_until_active()
        self.assertEqual(self.call("get_world_properties").sim_time, world)
        self.assertEqual(self.client.state, "PREEMPTED")
        self.call("unpause_physics")
        self.check_done(self.second.end())
        # As in the controller, joints that the new goal does not have go on.
        self.joints.wait("the end of both", **{KNEE: 0.5, ELBOW: 0.75})
        self.check_still(**{KNEE: 0.5, ELBOW: 0.75})

    def test_a_reset_ends_a_goal_and_the_next_one_is_done(self):
        wait_for(lambda: rospy.get_time() > 2.0, "simulated time")
        self.client.send(goal_of(elbow(t20000=2.0)))
        self.wait_for_elbow(0.3)
        self.reset()
        found = self.client.end()
        self.check(found, "ABORTED", Result.INVALID_GOAL, "time went back")
        self.joints.forget(self.reset_time)
        self.check_done(self.client.run(goal_of(elbow(t200=0.75))))
        self.check_still(**{ELBOW: 0.75})

    def test_a_goal_in_the_silence_after_a_reset_is_done(self):
        wait_for(lambda: rospy.get_time() > 2.0, "simulated time")
        self.reset()
        self.check_done(self.client.run(goal_of(elbow(t500=0.75))))
        self.joints.forget(self.reset_time)
        self.check_still(**{ELBOW: 0.75})

    def test_a_robot_that_is_deleted_ends_its_goal(self):
        client = Client("/two/left_arm/follow_joint_trajectory")
        client.send(goal_of(elbow(t20000=2.0)))
        client.wait_until_active()
        self.call("delete_model", "two")
        found = client.end()
        self.check(found, "ABORTED", Result.INVALID_GOAL, "no longer publishes", ELBOW)
        self.spawn_other()

    def test_a_simulator_that_goes_ends_its_goal_and_the_next_one_serves(self):
        self.client.send(goal_of(elbow(t20000=2.0)))
        self.client.wait_until_active()
        self.world.kill()
        found = self.client.end()
        self.check(found, "ABORTED", Result.INVALID_GOAL, "The simulator is gone")
        found = self.client.run(goal_of(elbow(t200=0.75)))
        self.check(found, "REJECTED", Result.INVALID_GOAL, "simulator")
        self.setUp()
        self.check_done(self.client.run(goal_of(elbow(t200=0.75))))

    def test_controllers_have_their_joints_and_constraints(self):
        left = Client("/two/left_arm/follow_joint_trajectory")
        right = Client("/two/right/arm/follow_joint_trajectory")
        left.send(goal_of({0.5: {SHOULDER: 0.5, ELBOW: 0.75}}))
        right.send(goal_of({0.3: {RIGHT: 0.6}}))
        self.check_done(right.end())
        self.check_done(left.end())
        found = right.run(goal_of(elbow(t100=0.0)))
        self.check(found, "REJECTED", Result.INVALID_JOINTS, ELBOW, RIGHT)
        _, points = self.beyond()
        found = left.run(goal_of(points))
        self.check(found, "ABORTED", Result.PATH_TOLERANCE_VIOLATED, "(tolerance 0.1)")
        goal = goal_of(points, path_tolerance=tolerance(ELBOW, -1.0))
        found = left.run(goal)
        self.check(found, "ABORTED", Result.GOAL_TOLERANCE_VIOLATED, "(tolerance 0.05)")
        self.check_still(**HOME)  # the other robot

    def test_controllers_that_make_no_sense_end_the_bridge(self):
        for value, words in (
            ("3", "must be a list"),
            ("[{name: arm, joints: [nose]}]", "'nose'"),
        ):
            with self.subTest(value):
                arguments = f"_controllers:={value}", "_model_name:=one"
                found = run("link_states_bridge.py", "__name:=odd", *arguments)
                text = found.stdout + found.stderr
                self.assertEqual(found.returncode, 1, text)
                self.assertIn(words, text)
                self.assertNotIn("Traceback", text)
