"""What is interrupted: all our executables and launch files, with arguments."""

from pathlib import Path

from bench.motion import write_motion
from roslib.packages import find_node

ROOT = Path(__file__).resolve().parents[2]
MODEL = ROOT / "urdf" / "g1_29dof.urdf"
APART = ("__ns:=/apart", "/clock:=/apart/clock")
"""Remappings of a node that runs beside one of its name."""
WITH_RVIZ = " with RViz"
"""How the names of cases end that need a screen."""
MAY_SHOW_RVIZ = {"display.launch", "display_and_gazebo.launch", "two_robots.launch"}
MAY_SHOW_RVIZ |= {"view.launch", "replay.launch"}


def cases(folder, has_screen):
    """List what can be interrupted.

    Args:
        folder: Where the commands may write.
        has_screen: Whether RViz can be shown.

    Returns:
        Words of the command by name. ``{port}`` stands for a free port.
    """
    motion = folder / "motion.csv"
    write_motion(motion)
    found = {}
    for name, words in executables(folder, motion).items():
        program = name.partition(" ")[0]
        is_ours = (ROOT / "scripts" / program).exists()
        package = "g1_description" if is_ours else "gazebo_ros"
        # As rosrun finds it, which is ROS' own.
        found[name] = [find_node(package, program)[0], *words]
    found["tools/demo"] = [ROOT / "tools" / "demo", "rviz:=false"]
    for file in sorted((ROOT / "launch").glob("*.launch")):
        if file.name != "rviz.launch":  # all of it is ROS' own
            command = ["roslaunch", "-p", "{port}", "g1_description", file.name]
            command += launch_arguments(file.name, motion)
            if file.name not in MAY_SHOW_RVIZ:
                found[file.name] = command
                continue
            found[file.name] = [*command, "rviz:=false"]
            if has_screen:
                found[file.name + WITH_RVIZ] = [*command, "rviz:=true"]
    world = ("-p", "{port}", "gazebo_ros", "empty_world.launch", "gui:=false")
    found["empty_world.launch"] = ["roslaunch", *world]
    return {name: [str(word) for word in words] for name, words in found.items()}


def executables(folder, motion):
    """Give arguments by the name of the executable, and more words to tell apart."""
    picture, copy = folder / "picture.png", folder / "copy"
    spawned = ("-urdf", "-file", MODEL, "-model", "another", "-z", "1")
    return {
        "absolute_urdf.py": [MODEL],
        "check": [motion, "--physics"],
        "check --jobs": [motion, motion, "--jobs", 2],
        "checker.py": ["__ns:=/apart"],
        "collision_pairs": [MODEL, "--samples", 200, "-o", folder / "pairs.yaml"],
        "doctor": [],
        "gazebo_stand_in.py": APART,
        "import_model": [MODEL, "--out", copy, "--force"],
        "link_states_bridge.py": ["__ns:=/apart"],
        "play": [motion],
        "play --loop": [motion, "--loop", "--lead-in", 1],
        "pose": ["squat", "--seconds", 1],
        "pose --list": ["--list"],
        "record": [folder / "recorded.csv", "--force"],
        "replay.py": ["__ns:=/apart", f"_motion:={motion}"],
        "snapshot": [picture, "--size", "320x240"],
        "snapshot --model": [picture, "--size", "320x240", "--model", MODEL],
        "snapshot film": [folder / "film.gif", "--motion", motion, "--size", "160x120"],
        "spawn_robot.py": ["__ns:=/apart", "_robot_description:=/robot_description"],
        "web": ["--port", 0],
        "web --motion": ["--motion", motion, "--port", 0],
        "web.py": ["__ns:=/apart", "_port:=0"],
        "gzserver": APART,
        "gzclient": APART,
        "gazebo": APART,
        "debug": APART,
        "spawn_model": spawned,
    }


def launch_arguments(name, motion):
    """Give the arguments of a launch file."""
    words = []
    if name in MAY_SHOW_RVIZ or name == "web.launch":
        words.append("port:=0")
    if name in ("display.launch", "view.launch"):
        words += ["web:=true", "checks:=true"]
    if name == "replay.launch":
        words.append(f"motion:={motion}")
    return words
