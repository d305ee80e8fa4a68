"""The node that judges: its services, and what it tells of a robot that is there."""

import math
import threading
import unittest
from dataclasses import replace

import numpy as np
import rosgraph
import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from g1_description.msg import RobotState, RobotTrajectory
from g1_description.srv import CheckState, CheckTrajectory, SolveIK
from gazebo_msgs.msg import LinkStates
from geometry_msgs.msg import (
    Point,
    Pose,
    PoseStamped,
    Quaternion,
    Transform,
    Twist,
    Vector3,
)
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from support.ros_testing import DEADLINE, Connected, wait_for
from tf2_msgs.msg import TFMessage
from trajectory_msgs.msg import (
    JointTrajectory,
    JointTrajectoryPoint,
    MultiDOFJointTrajectory,
    MultiDOFJointTrajectoryPoint,
)
from visualization_msgs.msg import Marker, MarkerArray

from g1_description import Robot, Scene
from g1_description.checks.arrows import LENGTH
from g1_description.robot.urdf import parse_urdf
from g1_description.ros.conversions import transform
from g1_description.scenes.objects import Attachment
from g1_description.scenes.scene_file import yaml_of

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR

STANDING = 0.7918
"""[m] The pelvis above the floor."""
ARM_IN_TORSO = {"right_shoulder_roll_joint": 0.4, "right_shoulder_yaw_joint": 0.8}
KNEE = "left_knee_joint"


def pose(height=STANDING):
    return Pose(Point(0.0, 0.0, height), Quaternion(0.0, 0.0, 0.0, 1.0))


class TestChecks(unittest.TestCase):
    time = 100.0
    place = 0.0
    """[s], [m] Of the last state."""
    step = 0.1
    """[s] From one state to the next."""

    @classmethod
    def setUpClass(cls):
        cls.robot = parse_urdf(rospy.get_param("/robot_description"))
        cls.joints = {joint.name: joint for joint in cls.robot.movable_joints}
        cls.states = rospy.Publisher("/left/joint_states", JointState, queue_size=10)
        cls.tf = rospy.Publisher("/tf", TFMessage, queue_size=10)
        cls.static = rospy.Publisher("/tf_static", TFMessage, queue_size=1, latch=True)
        cls.check_state = rospy.ServiceProxy(
            "/left/checker/check_state", CheckState, persistent=True
        )
        cls.check_trajectory = rospy.ServiceProxy(
            "/left/checker/check_trajectory", CheckTrajectory
        )
        cls.check_state.wait_for_service(DEADLINE)
        for topic in (cls.states, cls.tf, cls.static):
            wait_for(topic.get_num_connections, f"a reader of {topic.name}")
        cls.diagnostics = Connected("/diagnostics", DiagnosticArray)
        cls.markers = Connected("/left/checker/markers", MarkerArray)

    # The services

    def request(self, height=STANDING, **positions):
        joints = JointState(name=[*positions], position=[*positions.values()])
        return self.check_state(joints, height is not None, pose(height or 0.0), [])

    def test_a_robot_that_stands_passes(self):
        answer = self.request()
        self.assertEqual((answer.success, answer.valid), (True, True))
        self.assertEqual((answer.severity, answer.findings), ("passed", []))
        for check in ("position", "self_collision", "penetration", "center_of_mass"):
            self.assertIn(check, answer.checked)

    def test_contacts_are_told_with_both_points(self):
        answer = self.request(**ARM_IN_TORSO)
        self.assertEqual((answer.success, answer.valid), (True, False))
        found = [f for f in answer.findings if "torso_link" in f.subject]
        self.assertTrue(found)
        for finding in found:
            a, b = (np.array([p.x, p.y, p.z]) for p in finding.points)
            self.assertAlmostEqual(np.linalg.norm(a - b), finding.worst, places=6)
            self.assertGreater(finding.worst, finding.bound)
            self.assertRegex(finding.text, r" penetrates \S+ by \S+ m$")

    def test_objects_of_the_simulator_are_known_where_they_are(self):
        scene = rospy.Publisher("/gazebo/scene", String, queue_size=1, latch=True)
        states = rospy.Publisher("/gazebo/object_states", LinkStates, queue_size=1)
        box = Scene().box("box", [0.2, 0.2, 0.2], [0.0, 0.0, 1.0])

        def collides():
            found = [f for f in self.request().findings if f.check == "collision"]
            return ["torso_link", "box"] in [f.subject for f in found]

        try:
            scene.publish(String(yaml_of([box])))
            wait_for(collides, "a collision with the box")
            for robot, is_free in (("left", True), ("other", False)):
                hold = Attachment(f"{robot}::torso_link")
                scene.publish(String(yaml_of([replace(box, attachments=(hold,))])))
                wait_for(
                    lambda free=is_free: collides() != free, f"{robot} to carry it"
                )
            wait_for(states.get_num_connections, "a reader of object_states")
            away = Pose(Point(3.0, 0.0, 1.0), Quaternion(w=1.0))
            states.publish(LinkStates(["box", "other"], [away] * 2, [Twist()] * 2))
            wait_for(lambda: not collides(), "the box away from the robot")
            at = [0.4, 0.25, 0.8]
            scene.publish(String(yaml_of([Scene().sphere("ball", 0.15, at)])))

            def is_avoided():
                answer = self.solve({"left_hand": at}, avoid_collisions=True)
                return not answer.reached and " at ball" in answer.status_message

            wait_for(is_avoided, "a search that avoids the ball")
        finally:
            scene.publish(String(yaml_of([])))
            scene.unregister()

    def test_a_limit_is_told_with_its_size(self):
        lower = self.joints[KNEE].lower
        answer = self.request(None, **{KNEE: lower - 0.25})
        (finding,) = answer.findings
        self.assertEqual((finding.check, finding.subject), ("position", [KNEE]))
        self.assertEqual((finding.severity, finding.unit), ("failed", "rad"))
        self.assertAlmostEqual(finding.worst, 0.25)
        self.assertNotIn("penetration", answer.checked)
        self.assertIn("penetration: the motion has no base", answer.skipped)

    def test_velocities_are_checked_where_they_are_given(self):
        limit = self.joints[KNEE].velocity
        joints = JointState(name=[KNEE], position=[0.1], velocity=[1.1 * limit])
        answer = self.check_state(joints, False, Pose(), ["velocity"])
        self.assertEqual([f.check for f in answer.findings], ["velocity"])
        self.assertEqual(answer.checked, ["velocity"])

    def test_bad_input_is_told_in_a_sentence(self):
        far, turned = pose(), pose()
        far.position.x, turned.orientation.x = math.inf, 3.0
        for names, positions, where, only, words in (
            (["left_nee_joint"], [0.0], None, [], "left_knee_joint"),
            ([KNEE], [math.nan], None, [], "nan"),
            ([KNEE], [], None, [], "got 0 for 1 names"),
            ([KNEE, KNEE], [0.0, 0.0], None, [], "must not repeat"),
            ([], [], far, [], "inf"),
            ([], [], turned, [], "quaternion"),
            ([], [], None, ["balance"], "Unknown check 'balance'"),
            ([KNEE], [0.0], None, ["velocity"], "All checks were skipped: velocity"),
        ):
            joints = JointState(name=names, position=positions)
            answer = self.check_state(joints, where is not None, where or pose(), only)
            self.assertEqual((answer.success, answer.valid), (False, False), words)
            self.assertIn(words, answer.status_message)
            self.assertEqual((answer.severity, answer.findings), ("", []))

    def trajectory(self, positions, joint=KNEE):
        """Make a motion of one joint of a robot that stands; 10 samples a second."""
        message = RobotTrajectory()
        base = Transform(Vector3(0.0, 0.0, STANDING), pose().orientation)
        times = [rospy.Duration.from_sec(0.1 * n) for n in range(len(positions))]
        message.joint_trajectory = JointTrajectory(
            joint_names=[joint],
            points=[
                JointTrajectoryPoint(positions=[p], time_from_start=time)
                for p, time in zip(positions, times)
            ],
        )
        message.multi_dof_joint_trajectory = MultiDOFJointTrajectory(
            joint_names=["base"],
            points=[
                MultiDOFJointTrajectoryPoint(transforms=[base], time_from_start=time)
                for time in times
            ],
        )
        return message

    def test_a_fault_of_a_motion_is_told_with_its_time(self):
        joint = "left_wrist_roll_joint"
        swing = self.joints[joint].upper * np.sin(np.linspace(0.0, np.pi, 31)) ** 2
        answer = self.check_trajectory(self.trajectory(0.99 * swing, joint), [])
        self.assertEqual((answer.success, answer.valid), (True, True), answer.findings)

        answer = self.check_trajectory(self.trajectory(1.02 * swing, joint), [])
        self.assertEqual((answer.success, answer.valid), (True, False))
        (finding,) = answer.findings
        self.assertEqual((finding.check, finding.subject), ("position", [joint]))
        self.assertAlmostEqual(finding.worst_time, 1.5)
        self.assertAlmostEqual(finding.worst, 0.02 * swing.max())
        self.assertTrue(1.3 < finding.first_time < 1.5)
        self.assertTrue(0.0 < finding.share < 0.2)

    def test_what_is_no_motion_is_refused(self):
        wrong = self.trajectory([0.0, 0.1])
        wrong.joint_trajectory.joint_names = ["left_nee_joint"]
        for motion, words in ((RobotTrajectory(), "no points"), (wrong, KNEE)):
            answer = self.check_trajectory(motion, [])
            self.assertFalse(answer.success)
            self.assertIn(words, answer.status_message)

    # Inverse kinematics

    def solve(self, targets, frame="map", node="/quiet_checker", **request):
        """Ask for positions of links, from a standing robot."""
        call = rospy.ServiceProxy(f"{node}/solve_ik", SolveIK)
        call.wait_for_service(DEADLINE)
        if node == "/quiet_checker":
            joints = JointState(name=[KNEE], position=[0.0])
            where = {"joint_state": joints, "has_base": True, "base_pose": pose()}
            request = {**where, **request}
        poses = [PoseStamped(pose=Pose(position=Point(*to))) for to in targets.values()]
        for stamped in poses:
            stamped.header.frame_id = frame
        return call(
            ik_link_names=[*targets],
            pose_stamped_vector=poses,
            position_only=[True] * len(targets),
            **request,
        )

    def places(self, answer):
        """Compute where links are in a solution."""
        robot = Robot(rospy.get_param("/robot_description"))
        p, q = answer.base_pose.position, answer.base_pose.orientation
        base = [p.x, p.y, p.z, q.x, q.y, q.z, q.w]
        positions = dict(zip(answer.solution.name, answer.solution.position))
        return robot.link_poses(positions, base)

    def test_ik_1_a_hand_reaches_while_the_feet_stay(self):
        target = [0.4, 0.25, 0.8]
        answer = self.solve({"left_hand": target}, balance=True, avoid_collisions=True)
        self.assertEqual((answer.success, answer.reached), (True, True), answer)
        self.assertEqual(answer.links, ["left_foot", "right_foot", "left_hand"])
        places = self.places(answer)
        hand = places["left_rubber_hand"][:3]
        np.testing.assert_allclose(hand, target, rtol=0, atol=1e-3)
        still = Robot(rospy.get_param("/robot_description")).link_poses(
            {}, [0, 0, STANDING, 0, 0, 0, 1]
        )
        for foot in ("left_ankle_roll_link", "right_ankle_roll_link"):
            np.testing.assert_allclose(places[foot], still[foot], rtol=0, atol=1e-3)
        checked = self.check_state(answer.solution, True, answer.base_pose, [])
        self.assertTrue(checked.valid, checked.findings)

    def test_ik_2_a_target_may_be_in_any_frame(self):
        place = [1.0, 2.0, 0.0, 0.0, 0.0, 1.0, 0.0]
        self.static.publish(TFMessage([transform(rospy.Time(), "map", "table", place)]))
        answer = self.solve({"left_hand": [0.6, 1.75, 0.8]}, "table")
        self.assertTrue(answer.reached, answer.status_message)
        hand = self.places(answer)["left_rubber_hand"][:3]
        np.testing.assert_allclose(hand, [0.4, 0.25, 0.8], rtol=0, atol=1e-3)

    def test_ik_3_what_is_not_reached_is_told_with_its_distance(self):
        answer = self.solve({"left_hand": [0.4, 0.9, 0.8]}, fixed_base=True)
        self.assertEqual((answer.success, answer.reached), (True, False))
        places = self.places(answer)
        far = np.linalg.norm(places["left_rubber_hand"][:3] - [0.4, 0.9, 0.8])
        self.assertAlmostEqual(answer.position_errors[-1], far, places=6)
        self.assertTrue(math.isnan(answer.rotation_errors[-1]))
        self.assertIn(f"left_hand is {1e3 * far:.3g} mm", answer.status_message)
        self.assertEqual(answer.base_pose, pose())

    def test_ik_4_a_wrong_request_is_refused_in_a_sentence(self):
        hand = {"left_hand": [0.4, 0.25, 0.8]}
        nowhere = JointState()
        knee = JointState(name=[KNEE], position=[math.nan])
        for targets, request, words in (
            ({"left_hnad": [0.0] * 3}, {}, "Unknown link 'left_hnad'"),
            ({"left_hand": [math.nan, 0.0, 0.0]}, {}, "position of left_hand must be"),
            (hand, {"frame": "nowhere"}, "nothing publishes it on /tf"),
            (hand, {"joint_state": nowhere}, "state of the robot is unknown"),
            (hand, {"joint_state": knee}, "must be finite"),
            (hand, {"hold": ["foot"]}, "Unknown link 'foot'"),
            (hand, {"hold_nothing": True, "balance": True}, "Balance needs links"),
        ):
            answer = self.solve(targets, **request)
            self.assertEqual((answer.success, answer.reached), (False, False), words)
            self.assertIn(words, answer.status_message)
            self.assertEqual(answer.solution.name, [])
        call = rospy.ServiceProxy("/quiet_checker/solve_ik", SolveIK)
        answer = call(ik_link_names=["left_hand"])
        self.assertIn("must have the same length", answer.status_message)
        twice = [PoseStamped(), PoseStamped()]
        answer = call(ik_link_names=["head", "head"], pose_stamped_vector=twice)
        self.assertIn("head has several targets", answer.status_message)

    # The robot that is there

    def show(self, height=STANDING, speed=0.0, **positions):
        """Publish a state of the robot, with its base where it has a height."""
        TestChecks.time += self.step
        TestChecks.place += self.step * speed
        stamp = rospy.Time.from_sec(self.time)
        everywhere = {**dict.fromkeys(self.joints, 0.0), **positions}
        joints = JointState(name=[*everywhere], position=[*everywhere.values()])
        joints.header.stamp = stamp
        if height is not None:
            place = [self.place, 0, height, 0, 0, 0, 1]
            edge = transform(stamp, "map", "left/base_link", place)
            self.tf.publish(TFMessage([edge]))
        self.states.publish(joints)
        return stamp

    def shown_until(self, listener, accept, what, *args, **positions):
        """Show a state again and again until a message is accepted; return both."""
        listener.clear()
        found, stamps = [], []

        def came():
            stamps.append(self.show(*args, **positions))
            found.extend(m for m in list(listener.messages) if accept(m))
            return found

        wait_for(came, what)
        return found[0], stamps

    def levels(self):
        """Return the levels of all statuses that came."""
        statuses = [s for message in self.diagnostics.messages for s in message.status]
        return [s.level for s in statuses if s.name == "left/checker: checks"]

    def wait_for_status(self, level, *words, height=STANDING, speed=0.0, **positions):
        """Show a state until /diagnostics tells this of it; return the values."""
        name = "left/checker: checks"

        def statuses(message):
            return [
                status
                for status in message.status
                if status.name == name
                and status.level == level
                and all(word in status.message for word in words)
            ]

        what = f"{name} {level} {words}"
        message, _ = self.shown_until(
            self.diagnostics, statuses, what, height, speed, **positions
        )
        return {value.key: value.value for value in statuses(message)[0].values}

    def wait_for_markers(self, accept, what, *args, **positions):
        """Show a state until there are markers of it; return those by namespace."""

        def sorted_markers(message):
            found = {}
            for marker in message.markers:
                found.setdefault((marker.ns, marker.action), []).append(marker)
            return found

        message, stamps = self.shown_until(
            self.markers, lambda m: accept(sorted_markers(m)), what, *args, **positions
        )
        return sorted_markers(message), stamps

    def see_colliding_links_late(self):
        """Subscribe to the markers: all come, maybe after those that move."""
        late = Connected("/left/checker/markers", MarkerArray)
        late.wait(
            lambda message: any(m.ns == "colliding links" for m in message.markers),
            "all markers for a newcomer",
        )
        late.close()

    def test_live_1_without_a_base_the_floor_is_not_checked(self):
        values = self.wait_for_status(OK, "no findings", height=None)
        reason = values["penetration is not checked"]
        self.assertIn("left/pelvis", reason)
        values = self.wait_for_status(ERROR, "torso_link", height=None, **ARM_IN_TORSO)
        self.assertTrue(any("self_collision" in key for key in values))
        edge = transform(rospy.Time(), "left/base_link", "left/pelvis", [0] * 6 + [1])
        self.static.publish(TFMessage([edge]))
        values = self.wait_for_status(OK, "no findings")
        self.assertNotIn("penetration is not checked", values)
        self.assertIn("left_ankle_roll_link", values["in contact with the floor"])

    def test_live_2_what_is_wrong_is_on_diagnostics(self):
        lower = self.joints[KNEE].lower
        self.wait_for_status(ERROR, "0.25 rad beyond", KNEE, **{KNEE: lower - 0.25})
        self.wait_for_status(ERROR, "penetrates the floor", height=STANDING - 0.03)
        self.wait_for_status(WARN, "above the floor", height=STANDING + 0.03)
        self.wait_for_status(OK, "no findings")

    def test_live_3_balance_is_seen_below_the_robot(self):
        support, center = (
            ("support polygon", Marker.ADD),
            ("centre of mass", Marker.ADD),
        )
        begin = rospy.Time.from_sec(self.time)
        found, stamps = self.wait_for_markers(
            lambda m: support in m and m[support][0].header.stamp > begin,
            "a support polygon",
        )
        outline = next(m for m in found[support] if m.type == Marker.LINE_STRIP)
        self.assertEqual(outline.header.frame_id, "map")
        self.assertIn(outline.header.stamp, stamps)
        self.assertEqual(outline.points[0], outline.points[-1])
        corners = np.array([(p.x, p.y, p.z) for p in outline.points])
        self.assertTrue((np.abs(corners[:, 2]) < 0.01).all())
        ball = next(m for m in found[center] if m.type == Marker.SPHERE)
        middle = np.array([ball.pose.position.x, ball.pose.position.y])
        self.assertTrue((corners[:, :2].min(axis=0) < middle).all())
        self.assertTrue((corners[:, :2].max(axis=0) > middle).all())
        self.assertGreater(outline.color.g, outline.color.r)
        forces = ("contact forces", Marker.ADD)
        found, _ = self.wait_for_markers(lambda m: forces in m, "contact forces")
        arrows = [np.array([(p.x, p.y, p.z) for p in m.points]) for m in found[forces]]
        self.assertEqual([m.color.b > 0.5 for m in found[forces]], [True, True])
        self.assertAlmostEqual(sum(np.ptp(a[:, 2]) for a in arrows), LENGTH, places=2)

    def test_live_4_links_that_collide_are_red_until_they_do_not(self):
        red, contact = ("colliding links", Marker.ADD), ("contacts", Marker.ADD)
        found, _ = self.wait_for_markers(
            lambda markers: red in markers, "a red link", **ARM_IN_TORSO
        )
        frames = {marker.header.frame_id for marker in found[red]}
        self.assertIn("left/torso_link", frames)
        self.assertTrue(all(marker.frame_locked for marker in found[red]))
        self.assertTrue(all(marker.color.r > 0.8 for marker in found[red]))
        self.assertIn(contact, found)

        self.see_colliding_links_late()

        gone = ("colliding links", Marker.DELETE)
        found, _ = self.wait_for_markers(lambda m: gone in m, "red links to go")
        self.assertNotIn(contact, found)

    def test_live_5_joints_near_their_limits_are_marked(self):
        lower, limits = self.joints[KNEE].lower, ("joint limits", Marker.ADD)
        for position, word in ((lower + 0.01, "to lower"), (lower - 0.2, "beyond")):
            found, _ = self.wait_for_markers(
                lambda markers, word=word: any(
                    "left_knee" in marker.text and word in marker.text
                    for marker in markers.get(("labels", Marker.ADD), ())
                ),
                f"a label with {word}",
                **{KNEE: position},
            )
            self.assertEqual(len(found[limits]), 1)
        self.wait_for_markers(lambda m: limits not in m, "no joint near its limit")

    def test_live_6_only_a_robot_at_rest_floats_or_falls_over(self):
        self.wait_for_status(ERROR, "above the floor", height=STANDING + 0.05)
        values = self.wait_for_status(
            OK, "no findings", height=STANDING + 0.05, speed=1.0
        )
        self.assertEqual(values["center_of_mass is not checked"], "the robot moves")

    def test_live_7_joints_wait_for_the_base_of_their_time(self):
        """States whose base is not known yet collide; none of them is checked.

        They follow each other so closely that the base does not become a second older
        than the joints, however late TF is read: from then on it would be unknown.
        """
        self.step = 1e-5
        self.wait_for_status(OK, "no findings")
        self.diagnostics.clear()

        def three_reports():
            self.show()
            self.show(height=None, **ARM_IN_TORSO)
            return self.levels().count(OK) > 2

        wait_for(three_reports, "three reports")
        self.assertNotIn(ERROR, self.levels())

    def test_live_8_time_may_begin_again(self):
        self.wait_for_status(OK, "no findings")
        TestChecks.time = 10.0
        self.wait_for_status(ERROR, "torso_link", **ARM_IN_TORSO)
        values = self.wait_for_status(OK, "no findings")
        self.assertIn("left_ankle_roll_link", values["in contact with the floor"])

    def test_live_8_a_motion_in_another_frame_takes_nothing_from_it(self):
        """It stands where the robot stands."""
        stopped = threading.Event()
        thread = threading.Thread(target=self.show_until, args=[stopped])
        thread.start()
        try:
            motion = self.trajectory([0.0, 0.0])
            motion.multi_dof_joint_trajectory.header.frame_id = "left/base_link"
            for point in motion.multi_dof_joint_trajectory.points:
                point.transforms[0].translation.z = 0.0
            answer = self.check_trajectory(motion, [])
        finally:
            stopped.set()
            thread.join()
        self.assertTrue(answer.success, answer.status_message)
        self.assertTrue(answer.valid, answer.findings)
        values = self.wait_for_status(OK, "no findings")
        self.assertIn("left_ankle_roll_link", values["in contact with the floor"])

    def show_until(self, stopped):
        """Show the robot standing again and again."""
        while not stopped.wait(0.02):
            self.show()

    def test_live_9_who_comes_late_sees_a_robot_that_stands_still(self):
        self.markers.close()
        self.wait_for_status(ERROR, "torso_link", **ARM_IN_TORSO)
        self.see_colliding_links_late()

    def test_live_91_silence_is_told(self):
        """And what was found before it is no longer."""
        self.wait_for_status(ERROR, "torso_link", **ARM_IN_TORSO)
        self.diagnostics.clear()
        found = self.diagnostics.wait(
            lambda message: any("no joint_states" in s.message for s in message.status),
            "a word on silence",
        )
        (status,) = (s for s in found.status if s.name == "left/checker: checks")
        self.assertEqual(status.level, WARN)
        self.assertRegex(status.message, r"^no joint_states for [0-9]+ s$")
        (age,) = status.values
        self.assertEqual(age.key, "age of the last state in s")

    def test_live_92_robot_state_counts_while_it_is_published(self):
        """The robot of joint states and TF stands, that of robot_state is too low."""
        states = rospy.Publisher("/left/robot_state", RobotState, queue_size=10)
        state = RobotState(name=[*self.joints], position=[0.0] * len(self.joints))
        state.has_base, state.base_pose = True, pose(STANDING - 0.03)
        state.header.frame_id = "map"

        def levels():
            state.header.stamp = self.show()
            states.publish(state)
            return self.levels()

        wait_for(lambda: ERROR in levels(), "the robot in the floor")
        self.diagnostics.clear()
        wait_for(lambda: len(levels()) > 2, "three reports")
        self.assertEqual({*self.levels()[1:]}, {ERROR})
        states.unregister()
        self.wait_for_status(OK, "no findings")

    def test_live_93_ik_starts_at_the_robot_that_is_there(self):
        answers = []

        def bent():
            self.show(0.7, left_elbow_joint=1.2)
            answers.append(self.solve({}, node="/left/checker", hold_nothing=True))
            solution = answers[-1].solution
            found = dict(zip(solution.name, solution.position))
            return abs(found.get("left_elbow_joint", 0.0) - 1.2) < 1e-9

        wait_for(bent, "an answer for the state that is shown")
        self.assertTrue(answers[-1].reached)
        self.assertAlmostEqual(answers[-1].base_pose.position.z, 0.7)

    def test_a_checker_without_a_rate_has_only_services(self):
        rospy.wait_for_service("/quiet_checker/check_state", DEADLINE)
        published, subscribed, served = rosgraph.Master("/test").getSystemState()
        node = "/quiet_checker"
        topics = {topic for topic, nodes in published + subscribed if node in nodes}
        objects = {"/gazebo/scene", "/gazebo/object_states"}
        self.assertLessEqual(topics, {"/rosout", "/clock", *objects})
        services = {name for name, nodes in served if node in nodes}
        self.assertIn("/quiet_checker/check_trajectory", services)
