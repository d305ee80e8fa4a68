"""What may be broken: for each fault a sentence, and the command that mends it."""

from __future__ import annotations

from dataclasses import dataclass

DISPLAY = "roslaunch g1_description display.launch"
GAZEBO = "roslaunch g1_description gazebo.launch"
BROWSER = "roslaunch g1_description web.launch"
RESTART = "kill {process}  # on its machine; then: " + GAZEBO
"""A launch file refuses to start beside a simulator, and rosnode does not end the real
Gazebo."""

ASKED_PROCESS = "$(rosnode info {node} | sed -n 's/^Pid: //p')"
"""Stands for the number of a node's process that is not seen on this machine."""

TABLE = {
    "wrong_python": (
        "The Python of this command is {python}, which is not that of ROS: {reason}.",
        "export PATH={folder}:$PATH",
    ),
    "no_workspace": (
        "The workspace of this package is not sourced in this shell: {reason}.",
        "source {setup}",
    ),
    "no_package": (
        "{python} lacks what the nodes need: {reason}.",
        "{python} -m pip install {package}",
    ),
    "no_pybullet": (
        "{python} lacks PyBullet, without which the simulator cannot start: {reason}.",
        "{python} -m pip install {package}",
    ),
    "bad_master_uri": (
        "ROS_MASTER_URI is '{uri}', which is no address like http://localhost:11311.",
        "export ROS_MASTER_URI={meant}",
    ),
    "no_master": ("There is no master at {uri}: {reason}.", DISPLAY),
    "no_remote_master": (
        "There is no master at {uri}: {reason}.",
        "{cure}",
    ),
    "wrong_ros_ip": (
        "{variable} is {value}, and {reason}: no node of this shell can be reached.",
        "{cure}",
    ),
    "wrong_node_address": (
        "{node} gives {uri} as its address, and {reason}.",
        "unset ROS_HOSTNAME; export ROS_IP=$(hostname -I | cut -d' ' -f1)  "
        "# on its machine, in the shell that starts {node} again",
    ),
    "dead_node": (
        "{node} is registered at {uri}, but nothing answers there: {reason}.",
        "yes | rosnode cleanup",
    ),
    "hung_node": (
        "{node} is registered at {uri} and hangs: {reason}.",
        "yes | rosnode cleanup  # once its process has been ended",
    ),
    "stopped_node": (
        "{node} at {uri} has been stopped, as by Ctrl-Z: {reason}.",
        "kill -CONT {process}",
    ),
    "no_description": (
        "There is no robot on the parameter {parameter}, in /{namespace} or above.",
        "{cure}",
    ),
    "bad_description": (
        "The parameter {parameter} does not hold a robot: {reason}",
        "{cure}",
    ),
    "missing_meshes": (
        "The robot on {parameter} has meshes that are not on this machine: {meshes}.",
        "{cure}",
    ),
    "no_simulator": ("There is no simulator: nothing serves {service}.", GAZEBO),
    "hung_simulator": (
        "{node} does not answer {service} within {seconds:g} s.",
        # One that hangs or is stopped may not end by itself.
        RESTART.replace("kill", "kill -9"),
    ),
    "no_link_states": (
        "{node} runs, but nothing publishes {topic}, so the bridge is blind.",
        RESTART,
    ),
    "no_clock": (
        "/use_sim_time is true, but nothing publishes /clock: time never begins.",
        "rosparam set /use_sim_time false  # then start the nodes again",
    ),
    "two_clocks": (
        "/clock comes from {nodes}, so time jumps to and fro.",
        "rosnode kill {other}",
    ),
    "paused": (
        "Simulated time is paused: the robot and what is shown of it stand still.",
        "rosservice call {gazebo}/unpause_physics",
    ),
    "silent_clock": (
        "{node} is not paused, but nothing came on /clock within {seconds:g} s.",
        RESTART,
    ),
    "silent_simulator": (
        "{node} runs, but nothing came on {topic} within {seconds:g} s.",
        RESTART,
    ),
    "no_bridge": (
        "There is no link_states_bridge that publishes {topic}{others}.",
        "{cure}",
    ),
    "two_bridges": (
        "Several bridges publish {topic}, {nodes}: readers get the states of all.",
        "rosnode kill {other}",
    ),
    "no_model": (
        "The simulator has no model called {model}, which {bridge} shows; it has "
        "{models}.",
        "{cure}",
    ),
    "other_urdf": (
        "The model {model} in the simulator is not the robot on {parameter}: {reason}.",
        "rosservice call {gazebo}/delete_model {model} && {cure}",
    ),
    "two_joint_states": (
        "{topic} comes from {nodes}, and {own} is its owner: readers get both.",
        "rosnode kill {other}",
    ),
    "no_joint_states": (
        "{node} runs, but nothing came on {topic} within {seconds:g} s.",
        "rosnode kill {node}  # its launch file starts it again",
    ),
    "no_state_publisher": (
        "There is no robot_state_publisher that turns {topic} into TF.",
        "{cure}",
    ),
    "two_tf_owners": (
        "TF gets {edge} from {nodes}, so the robot jumps to and fro.",
        "rosnode kill {other}",
    ),
    "no_tf": ("TF lacks {edges}, which {owner} should send.", "{cure}"),
    "bad_diagnostics": (
        "{node} reports on /diagnostics: {text}.",
        "rostopic echo /diagnostics  # which has the figures",
    ),
    "no_diagnostics": (
        "{node} runs, but sent no report on /diagnostics within {seconds:g} s.",
        "rosnode kill {node}  # its launch file starts it again",
    ),
    "dead_display": (
        "Nothing shows the robot, and RViz cannot: no X server answers on DISPLAY "
        "{display}.",
        BROWSER,
    ),
    "no_gl": (
        "Nothing shows the robot, and RViz cannot: {reason} on DISPLAY {display}, not "
        "even in software.",
        BROWSER,
    ),
    "only_software_gl": (
        "Nothing shows the robot, and RViz cannot without software rendering: "
        "{reason} on DISPLAY {display}.",
        "LIBGL_ALWAYS_SOFTWARE=1 roslaunch g1_description rviz.launch",
    ),
    "no_picture": (
        "Nothing shows the robot: neither RViz nor the browser view runs.",
        "roslaunch g1_description rviz.launch",
    ),
    "unfinished": (
        "The walk cannot go on at the link '{link}': {reason}.",
        "rosrun g1_description doctor  # again, when this machine is less busy",
    ),
    "no_answer": (
        "The walk took more than {seconds:g} s in all, and stopped at the link "
        "'{link}'.",
        "rosrun g1_description doctor  # again, when this machine is less busy",
    ),
}
"""Sentence and command by the fault's name, with what is filled in."""


@dataclass(frozen=True)
class Fault:
    """A broken link."""

    name: str
    """As in ``TABLE``."""

    sentence: str
    """What is wrong."""

    cure: str
    """The command that mends it."""


def fault(name: str, **words: object) -> Fault:
    """Fill in what the table has of a fault.

    Args:
        name: The fault.
        words: What its sentence and its command name.
    """
    sentence, cure = TABLE[name]
    return Fault(name, sentence.format(**words), cure.format(**words))


OK, BROKEN, NOT_LOOKED_AT = "ok", "broken", "not looked at"

LINKS = {
    "python": "this Python is that of ROS, and the workspace is sourced",
    "packages": "the nodes have what they import",
    "master": "a master answers",
    "address": "nodes of this shell give an address that is theirs",
    "nodes": "all nodes are where they say",
    "description": "a robot is on the parameter server",
    "meshes": "its meshes are on this machine",
    "simulator": "a simulator runs and answers",
    "clock": "one node publishes the time",
    "time": "time is not paused, and comes",
    "link_states": "link states come",
    "bridge": "one bridge turns link states into joint states",
    "model": "the simulator has the model that the bridge shows",
    "urdf": "that model is the robot of the parameter server",
    "joint_states": "joint states come, and from one node",
    "state_publisher": "a robot_state_publisher turns them into TF",
    "tf": "TF is whole, and each edge has one owner",
    "diagnostics": "the bridge reports no fault",
    "picture": "RViz or the browser view shows the robot",
}
"""What holds if a link is whole, by its name. They are walked in this order: each needs
those before it."""


@dataclass(frozen=True)
class Walked:
    """What was found of a link."""

    name: str
    state: str
    """``OK``, ``BROKEN`` or ``NOT_LOOKED_AT``."""

    remark: str = ""
    """What was seen, in few words."""

    fault: Fault | None = None
