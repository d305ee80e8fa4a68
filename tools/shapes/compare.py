"""Hold our G1 against another model of it: what is seen, what touches, how it stands.

Called by tools/compare_shapes. Silhouettes are those of PyBullet's software renderer
without perspective: where both show the robot, over where at least one does.
"""

import argparse
import sys
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import trimesh
from bench import report
from bench.figures import Bench
from PIL import Image

from g1_description.errors import DescriptionError
from g1_description.files.model_files import find_folder
from g1_description.files.uris import local_path
from g1_description.render.camera import Camera
from g1_description.render.picture import silhouette
from g1_description.render.scene import NOTHING, Scene
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.load import absolute_urdf
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.poses import parse_poses
from g1_description.robot.rotation import rotate
from g1_description.robot.transform import IDENTITY
from g1_description.robot.urdf import parse_urdf
from g1_description.sim.bullet.body import Body
from g1_description.sim.bullet.client import connect
from g1_description.sim.bullet.create_body import create_body
from g1_description.sim.model import Model
from g1_description.sim.standing import standing_height
from g1_description.sim.world import World

ROOT = Path(__file__).resolve().parents[2]
VIEWS = {
    "front": (0, 0),
    "left side": (90, 0),
    "back": (180, 0),
    "left, from above": (40, 20),
    "right, from below": (-50, -20),
}
"""Yaw and pitch in degrees, as of a Camera."""
PIXELS = 1200
WIDTH = 1.7  # [m] what a picture shows
MIDDLE = np.array([0.0, 0.0, -0.13])  # [m] of the standing robot, seen from the pelvis
HELD = 10.0  # [s] how long the robot stands by its motors
POSES = {
    name: pose.positions
    for name, pose in parse_poses(
        (ROOT / "config" / "poses.yaml").read_text(encoding="utf-8"), "poses.yaml"
    ).items()
}


def compare_outlines(bench, robots, folder):
    """Measure how far silhouettes cover each other; draw them where that is wanted."""
    bench.part = "silhouettes, overlap"
    scenes = [Scene(), Scene()]
    for scene, robot in zip(scenes, robots):
        scene.add(robot)
    for name in ("zero", "squat"):
        bench.say(name)
        for scene in scenes:
            scene.place(0, np.array(IDENTITY), POSES[name])
        for view in VIEWS:
            ours, theirs = (outline(scene, view) for scene in scenes)
            share = (ours & theirs).sum() / (ours | theirs).sum()
            bench.add(f"{name}, {view}", share, "", ">= 0.93")
            if folder:
                file = f"{name}_{view.replace(', ', '_').replace(' ', '_')}.png"
                draw(ours, theirs, folder / file)
    for scene in scenes:
        scene.close()


def outline(scene, view):
    """Mark the pixels that show the robot."""
    yaw, pitch = np.radians(VIEWS[view])
    camera = Camera(MIDDLE, yaw, pitch, WIDTH)
    return silhouette(scene, camera, PIXELS, PIXELS) != NOTHING


def draw(ours, theirs, file):
    """Draw two silhouettes: grey is in both, blue in ours only, red in theirs."""
    picture = np.full((*ours.shape, 3), 255, dtype=np.uint8)
    picture[ours & theirs] = 190, 190, 190
    picture[ours & ~theirs] = 40, 60, 220
    picture[theirs & ~ours] = 220, 40, 40
    Image.fromarray(picture).save(file)


def compare_sizes(bench, robots):
    """Measure how far boxes of links are apart, soles and heights."""
    bench.part = "sizes"
    bench.say("boxes of links")
    ours, theirs = (surfaces(robot) for robot in robots)
    apart = {
        name: 1e3 * np.abs(box(ours[name]) - box(theirs[name])).max() for name in theirs
    }
    worst = max(apart, key=apart.get)
    bench.add(f"box of a link, at most ({worst})", apart[worst], "mm", "<= 8")
    lows, highs = zip(*(reach(*pair) for pair in zip(robots, (ours, theirs))))
    bench.add("soles, apart", 1e3 * abs(lows[0] - lows[1]), "mm", "<= 3")
    heights = np.subtract(highs, lows)
    bench.add("height, apart", 1e3 * abs(heights[0] - heights[1]), "mm", "<= 3")
    bench.add("height", heights[0], "m")
    sizes = [file.stat().st_size for file in (ROOT / "meshes").rglob("*.stl")]
    bench.add("triangles", sum((size - 84) // 50 for size in sizes), "", "< 40000")
    bench.add("all meshes", sum(sizes) / 1e6, "MB", "< 2")


def surfaces(robot):
    """Give the vertices of what is seen of each link, in its frame, in [m]."""
    found = {}
    for link in robot.links:
        meshes = [shape for shape in link.visuals if shape.kind == "mesh"]
        if meshes:
            loaded = [
                (shape, trimesh.load(str(local_path(shape.filename, find_folder))))
                for shape in meshes
            ]
            found[link.name] = np.concatenate(
                [
                    rotate(shape.pose[3:], mesh.vertices * shape.size) + shape.pose[:3]
                    for shape, mesh in loaded
                ]
            )
    return found


def box(points):
    """Give the box around points, shape (2, 3)."""
    return np.array([points.min(axis=0), points.max(axis=0)])


def reach(robot, points):
    """Find from where to where a robot reaches at the zero pose, along z, in [m]."""
    still = np.zeros(len(robot.movable_joints))
    poses = Kinematics(robot).link_poses(np.array(IDENTITY), still)
    placed = dict(zip(robot.link_names, poses))
    heights = np.concatenate(
        [rotate(placed[n][3:], p)[:, 2] + placed[n][2] for n, p in points.items()]
    )
    return heights.min(), heights.max()


def count_contacts(bench, assembly):
    """Count the pairs of links that touch and are no neighbours, in every pose."""
    bench.part = "pairs of links in contact, but for neighbours"
    bench.say("all poses")
    client = connect()
    model = Model("g1", assembly, np.array(IDENTITY))
    body = Body(client, create_body(client, model), model)
    number = body.number
    joined = {frozenset((j.parent, j.child)) for j in assembly.description.joints}
    indices = range(-1, client.getNumJoints(number))
    for name, positions in POSES.items():
        model.set_positions({joint: 0.0 for joint in model.joint_names})
        model.set_positions(positions)
        body.write()
        touching = [
            pair
            for pair in combinations(indices, 2)
            if frozenset(map(body.link_name, pair)) not in joined
            and client.getClosestPoints(number, number, 0.0, *pair)
        ]
        bench.add(name, len(touching), "", "= 0")
    client.disconnect()


def stand(bench, assembly):
    """Let the robot stand by its motors, and measure how far the pelvis drifts."""
    bench.part = f"drift of the pelvis in {HELD:.0f} s of hold"
    for name in ("zero", "stand"):
        bench.say(name)
        posed = replace(assembly, positions=POSES[name])
        height = standing_height(posed, np.array(IDENTITY[3:]))
        world = World("hold")
        pose = np.array([0.0, 0.0, height, *IDENTITY[3:]])
        world.spawn("g1", posed, pose)
        for _ in range(round(HELD / world.properties.time_step)):
            world.step()
        drift = np.linalg.norm(world.model("g1").pose[:3] - pose[:3])
        bench.add(name, 1e3 * drift, "mm", "< 10")
        world.close()


def arguments():
    """Read the command line."""
    parser = argparse.ArgumentParser(prog="tools/compare_shapes")
    parser.add_argument("model", help="the other model of the G1, as model:= takes it")
    parser.add_argument("--pictures", type=Path, metavar="FOLDER")
    given = parser.parse_args()
    if given.pictures and not given.pictures.is_dir():
        parser.error(f"there is no folder {given.pictures}")
    return given


def main():
    """Measure and print."""
    given = arguments()
    try:
        other = parse_urdf(absolute_urdf(given.model))
    except DescriptionError as error:
        sys.exit(f"tools/compare_shapes: {error}")
    own = parse_urdf(absolute_urdf(str(ROOT / "urdf" / "g1_29dof.urdf")))
    missing = sorted({link.name for link in other.links} - set(own.link_names))
    if missing:
        sys.exit(
            f"tools/compare_shapes: {given.model} is no G1 of 29 joints: {missing}"
        )
    bench = Bench()
    compare_outlines(bench, (own, other), given.pictures)
    compare_sizes(bench, (own, other))
    assembly = lump_fixed_joints(own)
    count_contacts(bench, assembly)
    stand(bench, assembly)
    report.print_table(bench, report.command_line("tools/compare_shapes"))


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        sys.exit("tools/compare_shapes: interrupted")
