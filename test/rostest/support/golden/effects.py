"""What the cases with requests did before them, and how their effects are seen."""

import math

import rospy

from .simulator import QUARTER, SCENES, UP

OTHER = [2.0, 1.0, 0.5, *QUARTER]
G1_POSE = [0.0, 0.0, 0.79, *UP]
SHORT = {
    "knee": "left_knee_joint",
    "elbow": "left_elbow_joint",
    "knee_link": "left_knee_link",
    "wrist_twist": "left_wrist_yaw_link",
    "pelvis_twist": "pelvis",
}
"""The file's short names of joints and links."""


def _run(simulator):
    simulator.call("unpause_physics")


def _push_box(simulator):
    fields = {"body_name": "box::body", "wrench": {"force": {"x": 1.0}}}
    simulator.call("apply_body_wrench", duration={"secs": 100}, **fields)


def _push_joint(simulator):
    fields = {"joint_name": "swing", "effort": 0.1}
    simulator.call("apply_joint_effort", duration={"secs": 100}, **fields)


def _roll_box(simulator):
    """Turn the box: what the file has tells that it was turned by 90 degrees."""
    simulator.put("box", [0.0, 0.0, 1.0, math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)])


BEFORE = {
    "set_model_configuration.same_value_also_stops_links": lambda simulator: (
        simulator.put("g1_robot", G1_POSE, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    ),
    "set_model_state.robot_keeps_its_joints": lambda simulator: simulator.set_joints(
        "g1_robot", {"left_knee_joint": 1.0}
    ),
    "set_model_state.zero_twist_stops": lambda simulator: simulator.put(
        "box", [0.0, 0.0, 1.0, *UP], [1.0, 2.0, 3.0, 0.4, 0.5, 0.6]
    ),
    "set_model_state.running_stays_running": _run,
    "set_model_configuration.with_gravity_running": _run,
    "spawn_urdf_model.while_running": _run,
    "delete_model.while_running": _run,
    "delete_model.with_pending_wrench": _push_box,
    "set_link_state.frame_with_speed": lambda simulator: simulator.put(
        "other", OTHER, [0.25, 0.0, 0.0, 0.0, 0.0, 0.5]
    ),
    "apply_body_wrench.frame_own_link": _roll_box,
    "apply_body_wrench.frame_other_model": _roll_box,
    "delete_model.with_pending_joint_effort": _push_joint,
}
"""What had been done when the requests came."""

UNSEEN = {"set_model_configuration.with_gravity_running": ("elbow", "pelvis_z")}
"""Effects that cannot be compared: the file does not tell when they were seen, and
the falling robot is elsewhere with each step by which the command is late."""


class Effects:
    """See a case's effects by their names in the file."""

    def __init__(self, simulator, case, log):
        """Take the case and the lines that its requests logged."""
        self._simulator = simulator
        self._case = case
        self._log = log
        self._main, self._word, _ = (SCENES[case["scene"]] or ((None,) * 3,))[0]

    def see(self, name, expected):
        """See one effect; None is also a pose that is not there.

        Args:
            name: Its name.
            expected: What was observed; its form tells poses from twists.
        """
        if name in UNSEEN.get(self._case["id"], ()):
            return expected
        reader = getattr(self, f"_see_{name}", None)
        if reader is not None:
            return reader()
        full = SHORT.get(name, name)
        if isinstance(expected, list) and len(expected) == 7:
            return self._link(full)
        if isinstance(expected, list) and len(expected) == 6:
            return self._simulator.link_twist(self._main, full)
        joints = self._joints()
        if full in joints:
            return self._turned(full, joints[full])
        raise AssertionError(f"nobody knows how to see the effect {name}")

    def _turned(self, joint, position):
        """Add whole turns, which poses do not show but get_joint_properties tells."""
        told = self._simulator.joint(joint)["position"][0]
        return position + math.tau * round((told - position) / math.tau)

    def _joints(self):
        return self._simulator.joints(self._main, self._word)

    def _link(self, link):
        place = self._simulator.link_pose(self._main, link)
        return None if place is None else [*place[0].tolist(), *place[1].as_quat()]

    def _subject(self):
        """Find the model that the last request is about, or the scene's."""
        request = self._case["request"][-1]
        if "model_name" not in request.get("model_state", request):
            return self._main
        name = request.get("model_state", request)["model_name"]
        spawned = request["service"].startswith("spawn")
        return name if spawned or name in self._simulator.models() else self._main

    def _see_pose(self):
        state = self._simulator.state(self._subject())
        return state["pose"] if state["success"] else None

    def _see_twist(self):
        if self._case["request"][0]["service"] == "apply_body_wrench":
            self._simulator.run(self._lasting())
        return self._simulator.state(self._subject())["twist"]

    def _see_z(self):
        self._simulator.run(0.5)
        return self._simulator.state(self._main)["pose"][2]

    def _see_rate(self):
        self._simulator.run(self._lasting())
        return self._simulator.joint("swing")["rate"][0]

    def _lasting(self):
        duration = self._case["request"][0]["duration"]
        return duration["secs"] + 1e-9 * duration["nsecs"]

    def _see_top(self):
        return self._after_setting(1.0)

    def _see_bottom(self):
        return self._after_setting(-1.0)

    def _after_setting(self, position):
        self._simulator.set_joints("arm", {"hinge": position})
        return self._simulator.joint("hinge")["position"][0]

    def _see_acceleration(self):
        """Watch the box for a tenth of a second."""
        before = self._simulator.state("box")["twist"][2]
        self._simulator.run(0.1)
        return (self._simulator.state("box")["twist"][2] - before) / 0.1

    def _see_acceleration_first(self):
        before = self._simulator.state("box")["twist"][0]
        self._simulator.run(0.5)
        return (self._simulator.state("box")["twist"][0] - before) / 0.5

    _see_acceleration_second = _see_acceleration_first

    def _see_acceleration_after_clear(self):
        if self._main == "box":
            return self._see_acceleration_first()
        before = self._simulator.joint("swing")["rate"][0]
        self._simulator.run(0.5)
        return (self._simulator.joint("swing")["rate"][0] - before) / 0.5

    def _see_param_gravity_z(self):
        return rospy.get_param("/gazebo/gravity_z")

    def _see_gravity_z(self):
        return self._simulator.physics()["gravity"][2]

    def _see_model(self):
        return self._simulator.state(self._main)["pose"]

    def _see_joints(self):
        """Give all joints; those at zero are not in the file."""
        return self._joints()

    def _see_log(self):
        return self._log

    def _see_models(self):
        return self._simulator.models()

    def _see_paused(self):
        return self._simulator.is_paused()

    _see_paused_after_call = _see_paused

    def _see_link_gone(self):
        return self._simulator.link_pose("box", "body") is None

    def _see_sim_time_is_number(self):
        return isinstance(self._simulator.time(), float)
