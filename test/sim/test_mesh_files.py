"""Meshes are where and as large as RViz and Gazebo have them; trimesh is the oracle."""

import os
import re
import struct

import numpy as np
import pytest
import trimesh
from dae import box, collada, node, use
from waiting import DEADLINE

from g1_description.render.camera import Camera
from g1_description.render.scene import Picture, draw
from g1_description.robot.description import Shape
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.transform import IDENTITY
from g1_description.robot.urdf import parse_urdf
from g1_description.sim.meshes import shapes as mesh_contents
from g1_description.sim.meshes.shapes import find_meshes
from g1_description.sim.standing import standing_height

pytestmark = pytest.mark.slow

UP = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
ASIDE = np.array([1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
INERTIAL = (
    '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" '
    'iyz="0"/></inertial>'
)
RED, BLUE = ("red", "0.9 0.1 0.1 1"), ("blue", "0.1 0.2 0.9 1")
BALL = trimesh.creation.icosphere(2)


def body(*names, color="", scale="1 1 1"):
    """Write a robot of one link, whose meshes are seen and collide."""
    material = f'<material name="m"><color rgba="{color}"/></material>' if color else ""
    shapes = "".join(
        f'<{kind}><geometry><mesh filename="{name}" scale="{scale}"/></geometry>'
        f"{material if kind == 'visual' else ''}</{kind}>"
        for name in names
        for kind in ("visual", "collision")
    )
    return f'<robot name="r"><link name="a">{INERTIAL}{shapes}</link></robot>'


def read(*files):
    """Read meshes as the simulator does; give what was found, in their order."""
    names = [f"file://{file}" for file in files]
    found, left_out = find_meshes(
        [Shape("mesh", (1.0,) * 3, np.array(IDENTITY), name) for name in names]
    )
    for message in left_out:
        (name,) = (n for n in names if message.startswith(f"mesh {n} "))
        found[name] = message
    return [found[name] for name in names]


def bounds(mesh):
    corners = np.concatenate([part.corners for part in mesh.parts]).reshape(-1, 3)
    return np.array([corners.min(axis=0), corners.max(axis=0)])


def two_boxes(meter="1", up="Z_UP"):
    """Write a red box in front, and above a blue one on a turned and scaled node."""
    unit = 1.0 / float(meter)
    inner = node(
        use("cube", "blue"),
        f"<rotate>0 0 1 90</rotate><translate>{0.1 * unit} 0 0</translate>",
    )
    outer = f"<translate>0 0 {unit}</translate><scale>1 2 1</scale>"
    return collada(
        [
            box("long", np.array([0.2, 0.4, 0.6]) * unit, "red"),
            box("cube", np.array([0.1, 0.1, 0.1]) * unit, "blue"),
        ],
        [
            node(use("long", "red"), f"<translate>{unit} 0 0</translate>"),
            node(inner, outer),
        ],
        meter=meter,
        up=up,
        colors=[RED, BLUE],
    )


def broken_meshes(folder):
    """Write a file of each kind that is no mesh; give their URIs."""
    noise = bytes(range(256)) * 40
    files = {
        "random.stl": noise,
        "random.obj": noise,
        "random.dae": noise,
        "empty.dae": b"",
        "many.stl": b"\0" * 80 + struct.pack("<I", 2**32 - 1) + b"\0" * 1000,
        "half.stl": b"\0" * 80 + struct.pack("<I", 100) + b"\0" * 333,
        "zero.stl": b"\0" * 80 + struct.pack("<I", 0),
        "nan.stl": b"\0" * 80 + struct.pack("<I", 2) + b"\xff" * 100,
        "index.obj": b"v 0 0 0\nf 1 2 3\nf 999999999 -5 0\n",
        "huge.obj": b"v 1e300 1e300 nan\nv inf 0 0\nv 0 1 0\nf 1 2 3\n",
        "half.dae": b'<?xml version="1.0"?><COLLADA><library_geometries><geometry>',
    }
    for name, content in files.items():
        (folder / name).write_bytes(content)
    (folder / "folder.stl").mkdir()
    (folder / "memory.stl").symlink_to("/proc/self/mem")
    names = [*files, "folder.stl", "memory.stl"]
    return {name: f"file://{folder}/{name}" for name in names}


def test_a_dae_counts_its_unit_and_not_its_up_axis(tmp_path):
    units = {"Z_UP": "1", "Y_UP": "0.01", "X_UP": "0.0254"}
    files = {tmp_path / f"{up}.dae": (unit, up) for up, unit in units.items()}
    for file, unit_and_up in files.items():
        file.write_text(two_boxes(*unit_and_up))
    for mesh, (file, (unit, _)) in zip(read(*files), files.items()):
        wanted = [[-0.05, -0.2, -0.3], [1.1, 0.3, 1.05]]
        np.testing.assert_allclose(bounds(mesh), wanted, atol=1e-6)
        seen = trimesh.load(file).bounds * float(unit)
        np.testing.assert_allclose(bounds(mesh), seen, atol=1e-6)
        assert len(mesh.parts) == 2


def write_ball(file, kind, shift):
    """Write a ball aside; return it."""
    ball = BALL.copy().apply_translation(shift)
    data = ball.export(file_type=kind)
    file.write_bytes(data if isinstance(data, bytes) else data.encode())
    return ball


@pytest.mark.parametrize("kind", ["stl", "obj"])
def test_a_robot_stands_on_its_mesh(tmp_path, kind):
    file = tmp_path / f"ball.{kind}"
    write_ball(file, kind, [0.0, 0.0, 0.25])
    robot = lump_fixed_joints(parse_urdf(body(f"file://{file}")))
    height = standing_height(robot, IDENTITY[3:])
    assert height == pytest.approx(0.75, abs=0.004)  # PyBullet's margin


def test_a_text_stl_has_the_triangles_that_are_written_there(tmp_path):
    text = BALL.export(file_type="stl_ascii").encode()
    shifted = BALL.copy().apply_translation([3.0, 0.0, 0.0])
    more = shifted.export(file_type="stl_ascii").encode()
    texts = {
        "plain": text,
        "CRLF": text.replace(b"\n", b"\r\n"),
        "tabs": text.replace(b" ", b"\t"),
        "two solids": text + b"\n" + more,
        "no name": b"solid\n" + text.split(b"\n", 1)[1],
        "no end": text.rsplit(b"endsolid", 1)[0],
        "byte order mark": b"\xef\xbb\xbf" + text,
        "far to the right": b" " * 100 + text,
    }
    files = [tmp_path / f"{name}.stl" for name in texts]
    for file, data in zip(files, texts.values()):
        file.write_bytes(data)
    for mesh, data in zip(read(*files), texts.values()):
        seen = np.concatenate([part.corners for part in mesh.parts])
        lines = re.findall(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", data)
        written = np.array(lines).astype("<f4").reshape(-1, 9)
        # Two readers round the last digit of a number each in its own way.
        np.testing.assert_allclose(
            *(np.unique(t, axis=0) for t in (seen.reshape(-1, 9), written)), atol=1e-6
        )


def test_parts_of_a_mesh_are_hulls_of_their_own(make_world, tmp_path):
    """Something small fits between two boxes of one mesh, and into neither.

    One geometry in two places is there twice.
    """
    file = tmp_path / "x.dae"
    nodes = [node(use("a"), f"<translate>{x} 0 0</translate>") for x in (-1, 1)]
    file.write_text(collada([box("a", [0.2] * 3)], nodes))
    (mesh,) = read(file)
    np.testing.assert_allclose(bounds(mesh)[:, 0], [-1.1, 1.1], atol=1e-6)
    assert [len(part.corners) for part in mesh.parts] == [12, 12]
    world = make_world()
    assert world.spawn_urdf("two", body(f"file://{file}"), UP) == ()
    cube = f'<robot name="c"><link name="b">{INERTIAL}<collision><geometry>'
    cube += '<box size="0.1 0.1 0.1"/></geometry></collision></link></robot>'
    world.spawn_urdf("cube", cube, UP)
    assert world.engine.contacts() == set()
    world.put("cube", ASIDE, np.zeros(6))
    assert world.engine.contacts() == {("cube::b", "two::a")}


def test_a_static_mesh_is_hollow_where_its_file_is(make_world, tmp_path):
    """As in Gazebo, whose meshes are no hulls: what is inside of walls is free."""
    file = tmp_path / "ring.obj"
    trimesh.creation.annulus(1.0, 1.2, 1.0).export(file)
    world = make_world(engine="bullet")
    walls = (
        '<sdf version="1.6"><model name="walls"><static>true</static><link name="l">'
        f'<collision name="c"><geometry><mesh><uri>file://{file}</uri></mesh>'
        "</geometry></collision></link></model></sdf>"
    )
    assert world.spawn_sdf("walls", walls, UP) == ()
    cube = f'<robot name="c"><link name="b">{INERTIAL}<collision><geometry>'
    cube += '<box size="0.1 0.1 0.1"/></geometry></collision></link></robot>'
    world.spawn_urdf("cube", cube, UP)
    assert world.engine.contacts() == set()
    world.put("cube", ASIDE, np.zeros(6))
    assert world.engine.contacts() == {("cube::b", "walls::l")}


def shades(scene, places, camera):
    """Give the colours seen at places in the plane of a view, from 0 to 1."""
    picture = draw(scene, camera, 200, 200) / 255.0
    seen = camera.seen(np.array(places)) * [200, -200] + [100, 100]
    return [picture[int(y), int(x)] for x, y in seen]


def assert_colors(seen, wanted):
    """Compare hues: light makes what is seen darker or brighter as a whole."""
    for one, other in zip(seen, np.array(wanted, dtype=float)):
        shade = one @ other / (other @ other)
        np.testing.assert_allclose(one, shade * other, atol=0.06)
        assert 0.6 < shade < 1.4


FRONT = Camera(np.array([0.0, 0.0, 0.0]), 0.0, 0.0, width=3.0)


def side_by_side(first="", second=""):
    """Write two boxes beside each other, seen from the front, with materials."""
    return [
        node(use(name, material), f"<translate>0 {y} 0</translate>")
        for name, material, y in (("a", first, -0.5), ("b", second, 0.5))
    ]


def test_each_material_of_a_dae_has_its_colour_whatever_the_urdf_says(tmp_path):
    """As in RViz: a colour of the URDF is for what has none."""
    file = tmp_path / "x.dae"
    geometries = [box("a", [0.5] * 3, "red"), box("b", [0.5] * 3, "blue")]
    file.write_text(
        collada(geometries, side_by_side("red", "blue"), colors=[RED, BLUE])
    )
    for color in ("", "0 1 0 1"):
        scene = Picture()
        assert scene.add(parse_urdf(body(f"file://{file}", color=color))) == (0, ())
        seen = shades(scene, [[0, -0.5, 0], [0, 0.5, 0]], FRONT)
        assert_colors(seen, [[0.9, 0.1, 0.1], [0.1, 0.2, 0.9]])


def test_what_has_no_material_has_the_colour_of_the_urdf(tmp_path):
    bare = collada([box("a", [0.5] * 3), box("b", [0.5] * 3)], side_by_side())
    (tmp_path / "x.dae").write_text(bare)
    both = trimesh.util.concatenate(
        [
            trimesh.creation.box([0.5] * 3).apply_translation([0, y, 0])
            for y in (-0.5, 0.5)
        ]
    )
    both.export(tmp_path / "x.stl")
    text = trimesh.exchange.export.export_mesh(both, None, "stl_ascii")
    (tmp_path / "text.stl").write_text(text)
    names = ("x.dae", "x.stl", "text.stl")
    read(*(tmp_path / name for name in names))
    for name in names:
        scene = Picture()
        mesh = f"file://{tmp_path / name}"
        scene.add(parse_urdf(body(mesh, color="0.2 0.8 0.4 1")))
        seen = shades(scene, [[0, -0.5, 0], [0, 0.5, 0]], FRONT)
        assert_colors(seen, [[0.2, 0.8, 0.4]] * 2)


def with_normals(mesh, normals):
    """Write a binary STL with the normals of others than its own."""
    data = np.frombuffer(mesh.export(file_type="stl"), np.uint8).copy()
    written = np.zeros((len(mesh.faces), 3), "<f4")
    written[:] = normals
    data[84:].reshape(-1, 50)[:, :12] = written.view(np.uint8)
    return data.tobytes()


def test_an_stl_without_normals_is_lit_as_with_them(tmp_path):
    wrong = {"zero": [0, 0, 0], "NaN": [np.nan] * 3, "short": [0.005, 0.01, 0.0]}
    right = BALL.face_normals
    shapes = {"sound": BALL.export(file_type="stl")}
    for name, normal in wrong.items():
        shapes[name] = with_normals(BALL, normal)
        half = np.where(right[:, :1] > 0.0, normal, right)
        shapes[f"half {name}"] = with_normals(BALL, half)
    files = [tmp_path / f"{name}.stl" for name in shapes]
    for file, data in zip(files, shapes.values()):
        file.write_bytes(data)
    read(*files)
    pictures = []
    for file in files:
        scene = Picture()
        scene.add(parse_urdf(body(f"file://{file}", color="0.2 0.8 0.4 1")))
        pictures.append(draw(scene, FRONT, 100, 100).astype(int))
    for name, picture in zip(shapes, pictures):
        assert np.abs(picture - pictures[0]).max() <= 3, name


@pytest.mark.parametrize(
    ("kind", "scale"), [("stl", (1, -1, 1)), ("obj", (-2, 1, 0.5))]
)
def test_a_mirrored_mesh_is_drawn_as_what_it_becomes(tmp_path, kind, scale):
    """Not as what is seen from within."""
    points = [(0, 0, 0), (0.8, 0, 0), (0, 0.6, 0), (0.2, 0.2, 0.4), (0.6, 0.4, 1)]
    solid = trimesh.convex.convex_hull(np.array(points, dtype=float))
    (tmp_path / "solid.stl").write_bytes(solid.export(file_type="stl"))
    text = solid.export(file_type="obj", include_normals=False)
    (tmp_path / "solid.obj").write_text(text)
    turn = 1 if np.prod(scale) > 0 else -1
    image = trimesh.Trimesh(solid.vertices * scale, solid.faces[:, ::turn])
    image.export(tmp_path / "image.stl")
    drawn = []
    for name, size in ((f"solid.{kind}", scale), ("image.stl", (1, 1, 1))):
        text = body(f"file://{tmp_path / name}", scale="{} {} {}".format(*size))
        scene = Picture()
        assert scene.add(parse_urdf(text)) == (0, ())
        drawn.append(draw(scene, FRONT, 100, 100).astype(int))
    differs = np.abs(drawn[0] - drawn[1]).max(axis=2) > 3
    assert differs.sum() < 10  # on edges


def test_materials_of_an_obj_have_their_colours_and_pictures_their_mean(tmp_path):
    """A picture whose name is too long for a file costs its colour alone."""
    from PIL import Image

    stripes = np.zeros((4, 4, 3), np.uint8)
    stripes[:, ::2] = [200, 100, 0]
    (tmp_path / "ä").mkdir()
    Image.fromarray(stripes).save(tmp_path / "ä" / "b c.png")
    (tmp_path / "x.mtl").write_text(
        "newmtl one\nKd 0.1 0.2 0.9\nnewmtl two\nKd 1 1 1\nmap_Kd ä/b c.png\n"
        f"newmtl three\nKd 1 0 0\nmap_Kd {'p' * 300}.png\n"
    )
    lines, corners = ["mtllib x.mtl"], np.indices((2, 2, 2)).reshape(3, 8).T - 0.5
    shown = (("one", -0.5), ("two", 0.5), ("three", 1.5))
    for number, (material, y) in enumerate(shown):
        lines += [f"usemtl {material}"]
        lines += ["v {} {} {}".format(*c) for c in corners * 0.5 + [0, y, 0]]
        for face in ([1, 2, 4, 3], [5, 7, 8, 6], [1, 5, 6, 2], [3, 4, 8, 7]):
            lines += ["f " + " ".join(str(i + 8 * number) for i in face)]
    (tmp_path / "x.obj").write_text("\n".join(lines))
    scene = Picture()
    scene.add(parse_urdf(body(f"file://{tmp_path}/x.obj")))
    seen = shades(scene, [[0, -0.5, 0], [0, 0.5, 0]], FRONT)
    assert_colors(seen, [[0.1, 0.2, 0.9], [100 / 255, 50 / 255, 0]])


@pytest.mark.parametrize(
    ("kind", "scale"), [("obj", "2 2 2"), ("stl", "1 -1 1"), ("dae", "-0.5 1 2")]
)
def test_a_scale_may_mirror(make_world, tmp_path, kind, scale):
    file = tmp_path / f"x.{kind}"
    ball = write_ball(file, kind, [0.3, 2.0, -0.4])
    text = body(f"file://{file}", scale=scale)
    factors = np.array([float(word) for word in scale.split()])
    wanted = np.sort(ball.bounds * factors, axis=0)
    scene = Picture()
    assert scene.add(parse_urdf(text)) == (0, ())
    corners = scene.corners()
    seen = [corners.min(axis=0), corners.max(axis=0)]
    np.testing.assert_allclose(seen, wanted, atol=0.005)
    world = make_world()
    world.spawn_urdf("r", text, np.array(IDENTITY))
    number = world.body("r").number
    np.testing.assert_allclose(world.client.getAABB(number), wanted, atol=0.005)


def node_bomb(depth):
    """Write nodes that use each other ten times each."""
    nodes = [f'<node id="n0">{use("a")}</node>']
    for n in range(1, depth):
        uses = f'<instance_node url="#n{n - 1}"/>' * 10
        nodes.append(f'<node id="n{n}">{uses}</node>')
    text = collada(
        [box("a", [1.0] * 3)], [node(f'<instance_node url="#n{depth - 1}"/>')]
    )
    library = f"<library_nodes>{''.join(nodes)}</library_nodes>"
    return text.replace("<library_visual_scenes>", f"{library}<library_visual_scenes>")


@pytest.fixture
def counted(monkeypatch):
    """Count the processes that read meshes."""
    calls = []
    run = mesh_contents._run
    monkeypatch.setattr(mesh_contents, "_run", lambda *a: calls.append(a) or run(*a))
    return calls


def test_all_files_of_a_robot_are_read_by_one_process(tmp_path, counted, monkeypatch):
    """It takes no module of the working directory."""
    (tmp_path / "resource.py").write_text("raise ImportError")
    monkeypatch.chdir(tmp_path)
    files = []
    for number, kind in enumerate(("obj", "dae", "stl_ascii", "obj")):
        files.append(tmp_path / f"{number}.{kind[:3]}")
        write_ball(files[-1], kind, [0.0, 0.0, 0.0])
    for found in read(*files):
        np.testing.assert_allclose(bounds(found), BALL.bounds, atol=1e-6)
    assert len(counted) == 1
    read(*files)
    assert len(counted) == 1
    time_ns = files[0].stat().st_mtime_ns + 10**9
    BALL.copy().apply_scale(2.0).export(files[0])
    os.utime(files[0], ns=(time_ns, time_ns))
    np.testing.assert_allclose(bounds(read(*files)[0]), 2 * BALL.bounds, atol=1e-6)
    assert len(counted) == 2


def test_hostile_files_end_no_one_and_take_no_other_file_with_them(
    make_world, tmp_path, counted, monkeypatch
):
    monkeypatch.setattr(mesh_contents, "FILE_PROCESSOR_TIMEOUT", 0.5)
    monkeypatch.setattr(mesh_contents, "FILE_TIMEOUT", DEADLINE)
    monkeypatch.setattr(mesh_contents, "READ_TIMEOUT", 2 * DEADLINE)
    names = broken_meshes(tmp_path)
    (tmp_path / "nodes.dae").write_text(node_bomb(9))
    (tmp_path / "self.dae").write_text(
        node_bomb(2).replace(
            '<node id="n0">', '<node id="n0"><instance_node url="#n1"/>'
        )
    )
    for name in ("a_good.obj", "z_good.obj"):
        BALL.export(tmp_path / name)
    names = [
        *names.values(),
        *(f"file://{tmp_path}/{n}.dae" for n in ("nodes", "self")),
    ]
    good = [f"file://{tmp_path}/{name}_good.obj" for name in "az"]
    left_out = make_world().spawn_urdf("r", body(good[0], *names, good[1]), UP)
    assert len(counted) < 6
    for name in names:
        (clause,) = (clause for clause in left_out if name in clause)
        assert "its reader exited" not in clause
    assert not [clause for clause in left_out if "good" in clause]
    (bomb,) = (clause for clause in left_out if "nodes.dae" in clause)
    assert bomb.endswith("cannot be read: it took more than 0.5 s of processor time")
    scene = Picture()
    _, left_out = scene.add(parse_urdf(body(good[0], *names, good[1])))
    assert not [clause for clause in left_out if "good" in clause]


@pytest.fixture
def waiting(tmp_path):
    """Write a mesh that a reader waits in, between two good ones; give all three."""
    files = [tmp_path / f"{name}.obj" for name in ("a_good", "waiting", "z_good")]
    text = BALL.export(file_type="obj", include_texture=False)
    for file in files:
        file.write_text(text)
    files[1].write_text(f"mtllib pipe.mtl\n{text}")
    os.mkfifo(tmp_path / "pipe.mtl")
    return files


def mend(files):
    """Let the reader find what it waited for."""
    pipe = files[1].parent / "pipe.mtl"
    pipe.unlink()
    pipe.write_text("newmtl m\nKd 1 0 0\n")


def test_a_file_that_takes_long_is_told_and_costs_no_other(
    waiting, counted, monkeypatch
):
    """Its reader died of it, which is remembered for a while."""
    monkeypatch.setattr(mesh_contents, "FILE_TIMEOUT", 4.0)
    before, clause, after = read(*waiting)
    assert clause.endswith("waiting.obj cannot be read: it took more than 4 s")
    for found in (before, after):
        np.testing.assert_allclose(bounds(found), BALL.bounds, atol=1e-6)
    assert len(counted) == 2
    mend(waiting)
    assert read(waiting[1]) == [clause]
    assert len(counted) == 2
    monkeypatch.setattr(mesh_contents, "FAILURE_LIFETIME", 0.0)
    (found,) = read(waiting[1])
    np.testing.assert_allclose(bounds(found), BALL.bounds, atol=1e-6)


BINARY = BALL.export(file_type="stl")
TEXT = BALL.export(file_type="stl_ascii").encode()
UPPER_COUNT = int.from_bytes(TEXT.upper()[80:84], "little")
UPPER_NEEDS = f"{84 + 50 * UPPER_COUNT} of {UPPER_COUNT}"
NO_STL = 'it is not text that begins with "solid" in small letters, and its '


FAR = "it has vertices that are not finite, or beyond 1e+09 m"
WRONG = {
    "cut.stl": (BINARY[:200], f"{NO_STL}200 bytes are not the 16084 of 320 triangles"),
    "solid.stl": (
        b"solid x".ljust(80) + BINARY[80:-1],
        f"{NO_STL}16083 bytes are not the 16084 of 320 triangles",
    ),
    "capitals.STL": (
        TEXT.upper(),
        f"{NO_STL}{len(TEXT)} bytes are not the {UPPER_NEEDS} triangles",
    ),
    "nan.stl": (BINARY[:96] + b"\0\0\xc0\x7f" + BINARY[100:], FAR),
    "nan.obj": (b"v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n", FAR),
    "large.dae": (b"", "it takes more than 4 GiB of memory"),
    "no.dae": (b"<COLLADA", ""),
}


def test_what_is_wrong_with_a_file_is_told(tmp_path):
    for name, (data, _) in WRONG.items():
        (tmp_path / name).write_bytes(data)
    os.truncate(tmp_path / "large.dae", 5 * 2**30)
    told = read(*(tmp_path / name for name in WRONG))
    for clause, (name, (_, words)) in zip(told, WRONG.items()):
        begin, _, found = clause.partition(" cannot be read: ")
        assert begin == f"mesh file://{tmp_path / name}"
        assert found == words or (found and not words)


def test_without_the_library_the_reason_is_told(tmp_path, monkeypatch):
    hidden = "import ctypes.util\nctypes.util.find_library = lambda name: None\n"
    (tmp_path / "sitecustomize.py").write_text(hidden)
    monkeypatch.syspath_prepend(str(tmp_path))
    BALL.export(tmp_path / "x.obj")
    (clause,) = read(tmp_path / "x.obj")
    assert clause.endswith("x.obj cannot be read: the library assimp is not installed")
