"""Hold our G1 against the vendor's: what is seen, what collides, how it stands.

Called by tools/compare_shapes. Silhouettes are those of PyBullet's software renderer,
without perspective; where both show the robot, over where at least one does.
"""

from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from g1_description.core.camera import Camera
from g1_description.core.description import parse_urdf
from g1_description.core.kinematics import Kinematics
from g1_description.core.lumping import lump_fixed_joints
from g1_description.core.resources import with_absolute_uris
from g1_description.core.transform import IDENTITY
from g1_description.sim.picture import silhouette
from g1_description.sim.scene import NOTHING, Scene
from g1_description.sim.world import World

ROOT = Path(__file__).resolve().parents[2]
OURS = ROOT / "urdf" / "g1_29dof.urdf"
VENDORS = ROOT.parent / "shared" / "data" / "unitree_g1" / "g1_29dof.urdf"
VIEWS = {
    "front": (0, 0),
    "left side": (90, 0),
    "back": (180, 0),
    "left, from above": (40, 20),
    "right, from below": (-50, -20),
}
"""Yaw and pitch in degrees, as of a Camera."""
PIXELS = 1200
WIDTH = 1.7
"""What a picture shows, in [m]."""
HELD = 10.0
"""How long the robot stands by its motors, in [s]."""


def read(file):
    """Read a robot; its meshes have absolute URIs."""
    return parse_urdf(with_absolute_uris(file.read_text(encoding="utf-8"), file.parent))


def package_folder(name):
    """Find this package, and no other."""
    return str(ROOT) if name == ROOT.name or name == "g1_description" else None


def outline(scene, view):
    """Mark the pixels that show the robot."""
    yaw, pitch = np.radians(VIEWS[view])
    camera = Camera(np.array([0.0, 0.0, -0.13]), yaw, pitch, WIDTH)
    return silhouette(scene, camera, PIXELS, PIXELS) != NOTHING


def compare_outlines(bench, robots, poses, folder):
    """Measure how far silhouettes cover each other; draw them where that is wanted."""
    scenes = [Scene(), Scene()]
    for scene, robot in zip(scenes, robots):
        scene.add(robot, package_folder)
    for name in ("zero", "squat"):
        for scene in scenes:
            scene.place(0, np.array(IDENTITY), poses[name])
        for view in VIEWS:
            bench.say(f"{name}, {view}")
            ours, theirs = (outline(scene, view) for scene in scenes)
            share = (ours & theirs).sum() / (ours | theirs).sum()
            bench.add(f"{name}, {view}: overlap", share, "", ">= 0.93")
            if folder:
                draw(ours, theirs, folder / f"{name}_{view.replace(', ', '_')}.png")
    for scene in scenes:
        scene.close()


def draw(ours, theirs, file):
    """Draw two silhouettes: grey is in both, blue in ours only, red in theirs."""
    picture = np.full((*ours.shape, 3), 255, dtype=np.uint8)
    picture[ours & theirs] = 190, 190, 190
    picture[ours & ~theirs] = 40, 60, 220
    picture[theirs & ~ours] = 220, 40, 40
    Image.fromarray(picture).save(file)


def boxes(robot):
    """Give the box around what is seen of each link, in its frame, in [m]."""
    found = {}
    for link in robot.links:
        corners = [trimesh.load(shape.geometry.file).bounds for shape in link.visuals]
        if corners:
            corners = np.array(corners)
            found[link.name] = corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
    return found


def compare_boxes(bench, robots):
    """Measure how far the boxes of links are apart, and those of the whole robots."""
    ours, theirs = (boxes(robot) for robot in robots)
    apart = {
        name: 1e3 * np.abs(np.array(ours[name]) - np.array(theirs[name])).max()
        for name in theirs
    }
    worst = max(apart, key=apart.get)
    bench.add(f"box of a link, at most ({worst})", apart[worst], "mm", "<= 8")
    low, high = zip(*(extent(robot, box) for robot, box in zip(robots, (ours, theirs))))
    bench.add("soles", 1e3 * abs(low[0] - low[1]), "mm", "<= 3")
    heights = np.subtract(high, low)
    bench.add("height", 1e3 * abs(heights[0] - heights[1]), "mm", "<= 3")
    bench.add("height of ours", heights[0], "m")


def extent(robot, found):
    """Find from where to where a robot reaches at the zero pose, along z, in [m].

    Its uppermost and lowermost links are level there: their boxes are along z.
    """
    still = np.zeros(len(robot.movable_joints))
    poses = Kinematics(robot).link_poses(np.array(IDENTITY), still)
    by_link = dict(zip(robot.link_names, poses))
    low = min(by_link[name][2] + box[0][2] for name, box in found.items())
    return low, max(by_link[name][2] + box[1][2] for name, box in found.items())


def count_meshes(bench):
    """Count triangles and bytes of our meshes."""
    sizes = [file.stat().st_size for file in (ROOT / "meshes").rglob("*.stl")]
    bench.add("triangles", sum((size - 84) // 50 for size in sizes), "", "< 40000")
    bench.add("size of all meshes", sum(sizes) / 1e6, "MB", "< 2")


def stand(bench, robot, poses):
    """Let the robot stand by its motors, and measure how far the pelvis drifts."""
    for name in ("zero", "stand"):
        bench.say(f"{name}, held for {HELD:.0f} s")
        world = World("hold", package_folder=package_folder)
        pose = np.array([0.0, 0.0, poses[name].height, 0.0, 0.0, 0.0, 1.0])
        world.spawn("g1", lump_fixed_joints(robot), pose)
        world.set_joint_positions("g1", poses[name].positions)
        for _ in range(round(HELD / world.properties.time_step)):
            world.step()
        drift = world.model("g1").pose[:3] - pose[:3]
        bench.add(f"{name}: drift of the pelvis", 1e3 * np.linalg.norm(drift), "mm")
        world.close()
