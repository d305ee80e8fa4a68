"""The world as a client sees it, to compare before and after; and put in order."""

from ..ros_testing import REPOSITORY
from .xml import sdf
from tcpros import body_of

ROBOT = "g1_robot"
LEAVES = (
    "left_ankle_roll_link",
    "right_ankle_roll_link",
    "left_wrist_yaw_link",
    "right_wrist_yaw_link",
)
"""Each joint of the G1 moves one of these."""
URDF = (REPOSITORY / "urdf" / "g1_29dof.urdf").read_text(encoding="utf-8")
PLANE = "<include><uri>model://ground_plane</uri></include>"
SUN = "<include><uri>model://sun</uri></include>"


class Observer:
    """Looks at the world through services."""

    def __init__(self, services):
        """Find out which links there are.

        Args:
            services: All services of the node.
        """
        self._services = services
        self.links = services.call("get_model_properties", ROBOT).body_names

    def _bytes(self, service, *args):
        """Call a service; give the bytes of its response."""
        connection = self._services[service]
        return connection.send(body_of(connection.request_class(*args)))

    def look(self, every_link=False):
        """Give all that can be seen; equal if nothing has changed."""
        names = self._services.call("get_world_properties").model_names
        links = self.links if every_link else LEAVES
        seen = {
            "world": self._bytes("get_world_properties"),
            "physics": self._bytes("get_physics_properties"),
            "sun": self._bytes("get_light_properties", "sun"),
            "joint": self._bytes("get_joint_properties", "left_elbow_joint"),
            "mass": self._bytes("get_link_properties", f"{ROBOT}::pelvis"),
        }
        for name in names[:10]:
            state = self._services.call("get_model_state", name, "")
            seen[f"model {name[:50]}"] = body_of(state.pose) + body_of(state.twist)
        for link in links if ROBOT in names else ():
            seen[link] = self._bytes("get_link_state", f"{ROBOT}::{link}", "")
        return seen

    def restore(self, defaults):
        """Put the world in order: paused, with the robot, the ground and the sun.

        Args:
            defaults: What get_physics_properties said at first.
        """
        call = self._services.call
        for logger in ("rosout", "rospy", "rospy.internal"):
            call("set_logger_level", logger, "info")
        call("pause_physics")
        physics = defaults.time_step, defaults.max_update_rate
        numbers = *physics, defaults.gravity, defaults.ode_config
        answer = call("set_physics_properties", *numbers)
        assert answer.success, answer
        for name in call("get_world_properties").model_names:
            call("delete_model", name)
        call("delete_light", "sun")
        for name, xml in (("ground_plane", PLANE), ("sun", SUN)):
            answer = call("spawn_sdf_model", model_name=name, model_xml=sdf(xml))
            assert answer.success, answer
        urdf = {"model_name": ROBOT, "model_xml": URDF}
        request = self._services["spawn_urdf_model"].request_class(**urdf)
        request.initial_pose.position.z = 0.793
        connection = self._services["spawn_urdf_model"]
        connection.send(body_of(request))
        call("reset_simulation")
