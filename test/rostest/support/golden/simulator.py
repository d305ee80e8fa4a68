"""The running simulator, as a client sees it: scenes, calls, and where things are."""

import genpy
import numpy as np
import rosgraph
import rospy
import rosservice
from rosgraph_msgs.msg import Log
from scipy.spatial.transform import Rotation

from g1_description.files.uris import with_absolute_uris

from ..ros_testing import DEADLINE, REPOSITORY, Listener, wait_for
from .cases import GOLDEN, plain, with_numbers
from .joints import measure_joints

G1 = REPOSITORY / "urdf" / "g1_29dof.urdf"
FILES = {
    "<box>": "box.urdf",
    "<sdf box>": "box.sdf",
    "<obox>": "obox.urdf",
    "<arm>": "arm.urdf",
    "<sdf lamp>": "lamp.sdf",
    "<sdf static box>": "static_box.sdf",
    "<pendulum>": "pendulum.urdf",
}
INERTIAL = (
    '<inertial><mass value="2"/><inertia ixx="0.0133" iyy="0.0133" izz="0.0133" '
    'ixy="0" ixz="0" iyz="0"/></inertial>'
)
TEXTS = {
    "<one massless link>": '<robot name="r"><link name="only"/></robot>',
    "<box with massless moving link>": (
        f'<robot name="r"><link name="body">{INERTIAL}'
        '<collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision></link>'
        '<joint name="turn" type="continuous"><parent link="body"/>'
        '<child link="ghost"/></joint><link name="ghost"/></robot>'
    ),
    "<garbage>": "this is not xml",
    "<html>": "<html><body/></html>",
    "<empty>": "",
}
UP = [0.0, 0.0, 0.0, 1.0]
QUARTER = [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]
SCENES = {
    "empty": (),
    "box": (("box", "<box>", [0.0, 0.0, 1.0, *UP]),),
    "obox": (("obox", "<obox>", [0.0, 0.0, 1.0, *UP]),),
    "two": (
        ("box", "<box>", [0.0, 0.0, 1.0, *UP]),
        ("other", "<box>", [2.0, 1.0, 0.5, *QUARTER]),
    ),
    "arm": (("arm", "<arm>", [0.0, 0.0, 1.0, *UP]),),
    "pendulum": (("pendulum", "<pendulum>", [0.0, 0.0, 0.0, *UP]),),
    "g1": (("g1_robot", "<robot>", [0.0, 0.0, 0.79, *UP]),),
    "g1_high": (("g1_robot", "<robot>", [0.0, 0.0, 2.0, *UP]),),
}
PHYSICS = {
    "time_step": 0.001,
    "max_update_rate": 1000.0,
    "ode_config": {
        "sor_pgs_iters": 50,
        "sor_pgs_w": 1.3,
        "contact_surface_layer": 0.001,
        "contact_max_correcting_vel": 100.0,
        "erp": 0.2,
        "max_contacts": 20,
    },
}
LOOK = 0.005
"""Simulated time between two looks in [s]."""
LEVELS = {Log.DEBUG: "debug", Log.INFO: "info", Log.WARN: "warn", Log.ERROR: "error"}


def text_of(word):
    """Give the text that stands behind <box> and the like."""
    if word == "<robot>":
        return with_absolute_uris(G1.read_text(encoding="utf-8"), G1.parent)
    if word in FILES:
        return (GOLDEN / "models" / FILES[word]).read_text(encoding="utf-8")
    return TEXTS.get(word, word)


def pose_fields(pose):
    """Write a pose as a request has it."""
    pose = [float(number) for number in pose]
    position, orientation = zip("xyz", pose[:3]), zip("xyzw", pose[3:])
    return {"position": dict(position), "orientation": dict(orientation)}


def twist_fields(twist):
    """Write a twist as a request has it."""
    return {
        "linear": dict(zip("xyz", map(float, twist[:3]))),
        "angular": dict(zip("xyz", map(float, twist[3:]))),
    }


class Simulator:
    """The node /gazebo. It keeps nothing but connections."""

    def __init__(self):
        """Wait for it."""
        self.master = rosgraph.Master("/golden_test")
        self._log = Listener("/rosout", Log)
        self._fences = 0
        self._connect()

    def _connect(self):
        wait_for(self._is_up, "the simulator's services")
        self._proxies = {}
        wait_for(self._hears, "what the simulator logs")

    def _hears(self):
        """Look whether the connection for the log is there."""
        try:
            return self._fence(0.2)
        except AssertionError:
            return False

    def _is_up(self):
        """Look for the service that comes last."""
        try:
            rospy.wait_for_service("/gazebo/reset_world", 1.0)
            rospy.wait_for_service("/gazebo/set_logger_level", 1.0)
        except rospy.ROSException:
            return False
        return True

    def set_physics(self, gravity, **numbers):
        """Set Gazebo's default physics but for gravity and what is given."""
        given = {"gravity": dict(zip("xyz", gravity)), **numbers}
        answer = self.call("set_physics_properties", **{**PHYSICS, **given})
        assert answer["success"], answer

    def proxy(self, service, persistent=True):
        """Give what calls a service."""
        name = f"/gazebo/{service}"
        kind = rosservice.get_service_class_by_name(name)
        return rospy.ServiceProxy(name, kind, persistent=persistent)

    def call(self, service, **fields):
        """Call a service with the fields of a request; give the plain answer."""
        if service not in self._proxies:
            self._proxies[service] = self.proxy(service)
        proxy = self._proxies[service]
        request = proxy.request_class()
        genpy.message.fill_message_args(request, [with_numbers(fields)])
        try:
            return plain(proxy(request))
        except rospy.ServiceException:
            self._proxies.pop(service).close()
            return {"transport": "service_error"}

    def send(self, request):
        """Send a request of the file."""
        fields = dict(request)
        service = fields.pop("service")
        if "model_xml" in fields:
            fields["model_xml"] = text_of(fields["model_xml"])
        return self.call(service, **fields)

    def make_scene(self, scene, gravity):
        """Begin a case: a world with nothing in it but the scene's models."""
        self.call("pause_physics")
        self.set_physics(gravity)
        for name in self.models():
            if name != "ground_plane":
                self.call("delete_model", model_name=name)
        self.call("reset_simulation")
        for name, word, pose in SCENES[scene]:
            self.spawn(name, word, pose)

    def spawn(self, name, word, pose):
        """Add a model; it must succeed."""
        fields = {"model_name": name, "model_xml": text_of(word)}
        answer = self.call("spawn_urdf_model", initial_pose=pose_fields(pose), **fields)
        assert answer["success"], answer

    def put(self, name, pose, twist=(0.0,) * 6):
        """Put a model somewhere; it must succeed."""
        state = {"model_name": name, "pose": pose_fields(pose)}
        state["twist"] = twist_fields(twist)
        answer = self.call("set_model_state", model_state=state)
        assert answer["success"], answer

    def set_joints(self, name, positions):
        """Teleport joints; give the answer."""
        fields = {"joint_names": list(positions), "model_name": name}
        fields["joint_positions"] = list(positions.values())
        return self.call("set_model_configuration", **fields)

    def models(self):
        """List the models."""
        return self.call("get_world_properties")["model_names"]

    def time(self):
        """Tell the simulated time in [s]."""
        return self.call("get_world_properties")["sim_time"]

    def state(self, model, frame=""):
        """Give a model's state seen from a frame."""
        fields = {"model_name": model, "relative_entity_name": frame}
        return self.call("get_model_state", **fields)

    def is_paused(self):
        """Look whether time stands still, for a tenth of a second of wall time.

        Where it runs it may be held up for longer, so there its going on is awaited.
        """
        before, physics = self.time(), self.physics()
        try:
            wait_for(lambda: self.time() != before, "time to go on", 0.1)
        except AssertionError:
            if physics["pause"] or not physics["time_step"]:
                return True
            wait_for(lambda: self.time() != before, "time to go on")
        return False

    def link_pose(self, model, link):
        """Find a link in the world: the model's pose and the model seen from it.

        Returns:
            Position, shape (3,), and rotation; None where there is no such link.
        """
        seen = self.state(model, f"{model}::{link}")
        if not seen["success"]:
            return None
        base = self.state(model)["pose"]
        rotation = (
            Rotation.from_quat(base[3:]) * Rotation.from_quat(seen["pose"][3:]).inv()
        )
        return np.array(base[:3]) - rotation.apply(seen["pose"][:3]), rotation

    def link_twist(self, model, link):
        """Find a link's twist in the world from that of the model seen from it."""
        _, rotation = self.link_pose(model, link)
        seen = np.reshape(self.state(model, f"{model}::{link}")["twist"], (2, 3))
        base = np.reshape(self.state(model)["twist"], (2, 3))
        return (base - rotation.apply(seen)).ravel().tolist()

    def joints(self, model, word):
        """Find all joint positions of a model from its links' poses."""
        return measure_joints(text_of(word), lambda link: self.link_pose(model, link))

    def link(self, name, frame=""):
        """Give a link's state seen from a frame, as get_link_state tells it."""
        answer = self.call("get_link_state", link_name=name, reference_frame=frame)
        return answer["link_state"] if answer["success"] else None

    def joint(self, name):
        """Give what get_joint_properties tells."""
        return self.call("get_joint_properties", joint_name=name)

    def physics(self):
        """Give what get_physics_properties tells."""
        return self.call("get_physics_properties")

    def run(self, seconds):
        """Let simulated time pass, to the step."""
        paused = self.physics()["pause"]
        self.call("pause_physics")
        steps = round(seconds / self.physics()["time_step"])
        assert self.call("step", steps=steps)["success"]
        if not paused:
            self.call("unpause_physics")

    def log_since(self, act):
        """Do something; give what it gives and the lines logged meanwhile.

        A line of our own at both ends tells where the others begin and end.
        """
        self._fence()
        self._log.clear()
        result = act()
        end = self._fence()
        lines = [m for m in self._log.messages if m.name == "/gazebo"]
        lines = [[LEVELS.get(m.level, "fatal"), m.msg] for m in lines]
        return result, [line for line in lines if line[1] != end]

    def _fence(self, deadline=DEADLINE):
        """Have the simulator log a line, and wait for it."""
        self._fences += 1
        name = f"fence {self._fences}"
        line = f"DeleteModel: model [{name}] does not exist"
        self.call("delete_model", model_name=name)
        self._log.wait(lambda message: message.msg == line, line, deadline)
        return line

    def watch(self, model, until):
        """Let time pass and look at a model every few steps.

        Args:
            model: The model.
            until: End in simulated [s] from now.

        Returns:
            Time since the beginning, pose and twist of each look.
        """
        begin = self.time()
        looks = []
        while not looks or looks[-1][0] < until - 1e-9:
            self.run(LOOK)
            state = self.state(model)
            stamp = state["header"]["stamp"]
            now = stamp["secs"] + 1e-9 * stamp["nsecs"] - begin
            looks.append((now, np.array(state["pose"]), np.array(state["twist"])))
        return looks
