"""An imported robot is the robot it was, in a folder that every reader takes."""

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh
from conftest import REPOSITORY, VENDOR
from dae import box, collada, node, use
from forked import run_script
from hypothesis import given, settings
from robots import chains
from waiting import DEADLINE, wait_for

from g1_description.errors import DescriptionError
from g1_description.files import model_files
from g1_description.files.uris import local_path, with_absolute_uris
from g1_description.importer.import_model import run
from g1_description.robot.load import read_model
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.urdf import parse_urdf

LINK = '<link name="{}"><inertial><mass value="2"/><inertia {}/></inertial>{}</link>'
ROUND = 'ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"'


def shape(kind, filename, scale="1 1 1"):
    return (
        f'<{kind}><geometry><mesh filename="{filename}" scale="{scale}"/></geometry>'
        f"</{kind}>"
    )


def robot(inside, *, links=""):
    return f'<robot name="r">{LINK.format("base", ROUND, inside)}{links}</robot>'


def stl(path, extents=(1.0, 2.0, 3.0), header=b"solid made by a CAD program"):
    path.parent.mkdir(parents=True, exist_ok=True)
    data = trimesh.creation.box(extents).export(file_type="stl")
    path.write_bytes(header.ljust(80) + data[80:])


def dae(inside=""):
    """Write a DAE of a box, with something more in it."""
    text = collada([box("a", [1.0] * 3)], [node(use("a"))])
    return text.replace("<library_effects>", f"{inside}<library_effects>")


def contents(folder):
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(Path(folder).rglob("*"))
        if path.is_file()
    }


def mesh_files(urdf):
    """Find the meshes of a file as the stand-in does."""
    text = with_absolute_uris(urdf.read_text(), urdf.parent)
    description = parse_urdf(text)
    return {
        (link.name, kind, index): (
            local_path(shape.filename, model_files.find_folder),
            shape.size,
        )
        for link in description.links
        for kind, shapes in (("v", link.visuals), ("c", link.collisions))
        for index, shape in enumerate(shapes)
        if shape.kind == "mesh"
    }


def assert_same_robot(one, other):
    assert one.link_names == other.link_names
    assert one.mass == other.mass
    for first, second in zip(one.joints, other.joints):
        assert (first.name, first.kind, first.parent, first.child) == (
            second.name,
            second.kind,
            second.parent,
            second.child,
        )
        np.testing.assert_array_equal(first.pose, second.pose)
        np.testing.assert_array_equal(first.axis, second.axis)
        assert (first.lower, first.upper) == (second.lower, second.upper)
    for first, second in zip(one.links, other.links):
        assert first.inertial is None or first.inertial == second.inertial


@pytest.fixture
def source(tmp_path):
    return tmp_path / "source"


@pytest.fixture
def out(tmp_path):
    return tmp_path / "out"


@pytest.fixture
def bring(source, out):
    """Write a URDF, import it, give the imported file."""

    def bring(text, *options):
        source.mkdir(exist_ok=True)
        (source / "r.urdf").write_text(text)
        bring.told = run([str(source / "r.urdf"), "--out", str(out), *options])
        return out / "urdf" / "r.urdf"

    return bring


@settings(max_examples=10)
@given(chains())
def test_any_robot_stays_what_it_is(tmp_path_factory, drawn):
    folder = tmp_path_factory.mktemp("any")
    (folder / "r.urdf").write_text(drawn[0])
    run([str(folder / "r.urdf"), "--out", str(folder / "out")])
    imported = parse_urdf((folder / "out" / "urdf" / "r.urdf").read_text())
    assert_same_robot(parse_urdf(drawn[0]), imported)


def test_meshes_come_along_and_the_source_stays(bring, source):
    stl(source / "meshes" / "a.STL")
    stl(source / "my meshes" / "b b.stl", (3, 2, 1))
    stl(source / "unused.stl")
    text = robot(
        shape("visual", "meshes/a.STL", "2 1 1")
        + shape("collision", "my meshes/b b.stl")
    )
    (source / "r.urdf").parent.mkdir(exist_ok=True)
    (source / "r.urdf").write_text(text)
    before = contents(source)
    urdf = bring(text)
    assert contents(source) == before
    assert set(contents(urdf.parents[1])) == {
        "urdf/r.urdf",
        "meshes/meshes/a.STL",
        "meshes/my_meshes/b_b.stl",
        *("robot.yaml", "poses.yaml", "report.md"),
    }
    found = mesh_files(urdf)
    assert found["base", "v", 0][1] == (2.0, 1.0, 1.0)
    for (path, _), extents in zip(found.values(), ([1, 2, 3], [3, 2, 1])):
        np.testing.assert_allclose(trimesh.load(path).extents, extents, atol=1e-6)
        assert not path.read_bytes().startswith(b"solid")
    report = (urdf.parents[1] / "report.md").read_text()
    assert 'a.STL | 12 | header no longer begins with "solid" |' in report


def test_all_kinds_of_names_are_found(bring, source, tmp_path, monkeypatch):
    stl(tmp_path / "models" / "arm" / "x.stl")
    monkeypatch.setenv("GAZEBO_MODEL_PATH", str(tmp_path / "models"))
    path = tmp_path / "models" / "arm" / "x.stl"
    stl(source / "../source_mesh.stl")
    names = [f"file://{path}", str(path), "model://arm/x.stl", "package://arm/x.stl"]
    names += ["../source_mesh.stl", "package://source/../source_mesh.stl"]
    urdf = bring(robot("".join(shape("visual", name) for name in names)))
    paths = [path for path, _ in mesh_files(urdf).values()]
    assert len(paths) == 6
    assert len(set(paths)) == 2


def test_a_name_that_goes_up_leads_out_of_no_folder(bring, source, out):
    stl(source / "meshes" / "a.stl")
    stl(source.parent / "z.stl")
    before = contents(source.parent)
    names = ("meshes/a.stl", "package://source/meshes/../../z.stl")
    urdf = bring(robot("".join(shape("visual", name) for name in names)))
    after = contents(source.parent)
    assert all(after[name] == data for name, data in before.items())
    written = set(after) - set(before) - {"source/r.urdf"}
    assert all(name.startswith("out/") for name in written)
    assert all(out in path.parents for path, _ in mesh_files(urdf).values())


def test_a_missing_mesh_is_named_and_taken_out(bring, source):
    stl(source / "a.stl")
    stl(source / "cut.stl")
    os.truncate(source / "cut.stl", 100)
    inside = shape("visual", "a.stl") + shape("visual", "nowhere.stl")
    inside += shape("collision", "package://no_such_package/x.stl")
    inside += shape("collision", "cut.stl")
    urdf = bring(robot(inside))
    assert list(mesh_files(urdf)) == [("base", "v", 0)]
    for words in (
        "nowhere.stl (visual of link base) does not exist; removed",
        "package://no_such_package/x.stl (collision of link base) does not exist",
        "cut.stl (collision of link base) cannot be read: it is not text that begins",
    ):
        assert words in bring.told
        assert words in (urdf.parents[1] / "report.md").read_text()


def test_an_stl_of_text_or_without_normals_becomes_binary_with_them(bring, source):
    source.mkdir()
    ball = trimesh.creation.icosphere(2)
    (source / "text.stl").write_text(ball.export(file_type="stl_ascii"))
    data = bytearray(ball.export(file_type="stl"))
    for start in range(84, len(data), 50):
        data[start : start + 12] = bytes(12)
    (source / "zero.stl").write_bytes(data)
    urdf = bring(robot(shape("visual", "text.stl") + shape("visual", "zero.stl")))
    for path, _ in mesh_files(urdf).values():
        written = np.frombuffer(path.read_bytes(), "12<f4, <u2", offset=84)[
            "f0"
        ].reshape(-1, 4, 3)
        np.testing.assert_allclose(written[:, 0], ball.face_normals, atol=1e-3)
        np.testing.assert_allclose(written[:, 1:], ball.triangles, atol=1e-6)
    report = (urdf.parents[1] / "report.md").read_text()
    assert "| 320 | text made binary |" in report
    assert "| 320 | normals computed |" in report


def test_a_missing_mesh_stays_if_asked_for(bring):
    urdf = bring(robot(shape("visual", "nowhere.stl")), "--keep-missing")
    assert 'filename="nowhere.stl"' in urdf.read_text()
    assert "; kept in the URDF" in bring.told


def test_materials_and_textures_come_along(bring, source):
    (source / "obj").mkdir(parents=True)
    (source / "pictures").mkdir()
    for name in ("obj/skin 1.png", "pictures/w.png", "pictures/t.png", "a b.png"):
        (source / name).write_bytes(b"PNG " + name.encode())
    box = trimesh.creation.box().export(file_type="obj", header="")
    (source / "obj" / "x.obj").write_text(f"mtllib x.mtl\n{box}")
    (source / "obj" / "x.mtl").write_text(
        "newmtl m\nmap_Kd -s 1 1 1 ../pictures/w.png\nbump skin 1.png\nmap_Ks no.png\n"
    )
    (source / "y.dae").write_text(
        dae(
            "<library_images>"
            '<image id="a"><init_from>pictures/t.png</init_from></image>'
            '<image id="b"><init_from>a%20b.png</init_from></image></library_images>'
        )
    )
    material = (
        '<material name="m"><texture filename="pictures/t.png"/></material>'
        '<material name="n"><texture filename="none.png"/></material>'
    )
    meshes = shape("visual", "obj/x.obj") + shape("visual", "y.dae")
    urdf = bring(robot(meshes, links=material))
    written = contents(urdf.parents[1] / "meshes")
    assert set(written) == {
        *("obj/x.obj", "obj/x.mtl", "obj/skin 1.png"),
        *("y.dae", "pictures/w.png", "pictures/t.png", "a b.png"),
    }
    assert all(data == (source / name).read_bytes() for name, data in written.items())
    assert "obj/x.obj refers to no.png, which does not exist" in bring.told
    assert "none.png (material n) does not exist" in bring.told
    assert "../meshes/pictures/t.png" in urdf.read_text()


def test_links_without_mass_are_told_apart(bring):
    text = robot(
        "",
        links='<link name="held"/><link name="loose"/><link name="tip"/>'
        '<joint name="a" type="fixed"><parent link="base"/><child link="held"/></joint>'
        '<joint name="b" type="continuous"><parent link="base"/><child link="loose"/>'
        '</joint><joint name="c" type="fixed"><parent link="loose"/><child link="tip"/>'
        "</joint>",
    )
    urdf = bring(text)
    found = {link.name: link.inertial for link in parse_urdf(urdf.read_text()).links}
    assert found["held"].mass == 0.0
    assert found["loose"] is None
    assert found["tip"] is None
    assert (
        "Massless links fixed to a body with mass got an explicit mass of 0: held"
        in (bring.told)
    )
    assert "Link loose has no mass and is not fixed" in bring.told
    again = run([str(urdf)])
    assert "explicit mass" not in again


@pytest.mark.parametrize(
    ("inertia", "words"),
    [
        (
            ROUND.replace('izz="1"', 'izz="2.1"'),
            "must satisfy the triangle",
        ),
        (ROUND.replace('iyy="1"', 'iyy="-1"'), "moments must be positive"),
        (ROUND.replace('izz="1"', 'izz="2"'), ""),
    ],
)
def test_an_impossible_inertia_is_named(bring, inertia, words):
    joint = (
        '<joint name="j" type="fixed"><parent link="base"/><child link="odd"/></joint>'
    )
    urdf = bring(robot("", links=LINK.format("odd", inertia, "") + joint))
    assert ("Link odd" in bring.told) == bool(words)
    assert words in bring.told
    assert inertia in urdf.read_text()


def test_hulls_and_fewer_triangles_are_made_once(bring, source):
    mesh = trimesh.creation.annulus(0.5, 1.0, 0.3)
    source.mkdir()
    mesh.export(source / "ring.stl")
    mesh.export(source / "ring.obj")
    (source / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (source / "x.dae").write_text(dae())
    names = ("ring.stl", "ring.obj", "flat.obj", "x.dae")
    inside = "".join(shape(k, n) for k in ("visual", "collision") for n in names)
    urdf = bring(
        robot(inside), "--convex-collisions", "--decimate", "50", "--tolerance", "1"
    )
    found = {key: path for key, (path, _) in mesh_files(urdf).items()}
    assert {path.name for path in found.values()} == {
        *("ring.stl", "ring_2.stl", "ring_hull.stl", "ring_hull_2.stl"),
        *("flat.obj", "x.dae"),
    }
    for index in (0, 1):
        hull = trimesh.load(found["base", "c", index])
        assert hull.is_convex
        assert len(hull.faces) <= 50
        assert len(trimesh.load(found["base", "v", index]).faces) <= 50
    assert "flat.obj kept unchanged: it is flat" in bring.told
    assert "x.dae kept unchanged: .dae meshes are not converted" in bring.told


@pytest.mark.slow
def test_fewer_triangles_move_no_mesh_farther_than_is_allowed(bring, source):
    """In metres of the robot, whatever the unit of the file; trimesh measures it."""
    unit = 1000.0
    source.mkdir()
    ball = trimesh.creation.icosphere(2, radius=0.1 * unit)
    ball.export(source / "x.stl")
    counts = {}
    for tolerance in (0.003, 0.012):
        options = ["--decimate", "8", "--tolerance", str(tolerance), "--force"]
        options += ["--convex-collisions"]
        urdf = bring(robot(shape("visual", "x.stl", "0.001 0.001 -0.001")), *options)
        ((path, _),) = mesh_files(urdf).values()
        mesh = trimesh.load(path)
        farthest = max(
            trimesh.proximity.closest_point_naive(there, points)[1].max() / unit
            for there, points in (
                (ball, np.concatenate([mesh.vertices, mesh.triangles_center])),
                (mesh, np.concatenate([ball.vertices, ball.triangles_center])),
            )
        )
        assert 0.2 * tolerance < farthest <= tolerance
        counts[tolerance] = len(mesh.faces)
        moved = re.search(r"moved no mesh by more than (\S+) mm \(x", bring.told)
        assert float(moved[1]) / 1000.0 == pytest.approx(farthest, rel=0.1)
        report = (urdf.parents[1] / "report.md").read_text()
        assert f"moved by {moved[1]} mm" in report
        assert f"has {len(mesh.faces)} triangles: fewer would move" in bring.told
    assert (np.diff([320, *counts.values()]) < 0).all()


def test_a_folder_brings_all_its_robots_and_their_meshes_once(source, out):
    stl(source / "m" / "x.stl")
    for name in ("a", "b"):
        (source / f"{name}.urdf").write_text(robot(shape("visual", "m/x.stl")))
    (source / "m" / "deeper").mkdir()
    (source / "m" / "deeper" / "c.urdf").write_text(robot(shape("visual", "../x.stl")))
    (source / ".git").mkdir()
    (source / ".git" / "d.urdf").write_text(robot(""))
    told = run([str(source), "--out", str(out)])
    written = {f"urdf/{name}.urdf" for name in "abc"} | {"meshes/x.stl", "report.md"}
    assert set(contents(out)) == written
    report = (out / "report.md").read_text()
    assert report.count("| x.stl |") == 1
    assert re.findall("^## (.*)", report, re.M) == [
        *("a.urdf", "b.urdf", "c.urdf"),
        "Meshes",
    ]
    assert f"c.urdf from {source}/m/deeper/c.urdf: robot r" in told
    for name in "abc":
        assert mesh_files(out / "urdf" / f"{name}.urdf")["base", "v", 0][0].is_file()


def test_one_wrong_file_of_a_folder_is_named_and_left_out(source, out):
    (source / "sub").mkdir(parents=True)
    (source / "a.urdf").write_text(robot(""))
    for name in ("b", "sub/c"):
        (source / f"{name}.urdf").write_text("<sdf/>")
    told = run([str(source), "--out", str(out)])
    profile = {"robot.yaml", "poses.yaml"}
    assert set(contents(out)) == {"urdf/a.urdf", "report.md"} | profile
    for name in ("b", "sub/c"):
        words = f"Cannot use the model {source}/{name}.urdf: "
        assert words in told
        assert words in (out / "report.md").read_text()
    (source / "a.urdf").unlink()
    words = r"b\.urdf: .*<sdf>.*\(2 files, but no robot\)"
    with pytest.raises(DescriptionError, match=words):
        run([str(source), "--out", str(out), "--force"])


def test_xacro_is_expanded(source, out):
    source.mkdir()
    text = robot("").replace("<robot", "<robot xmlns:xacro='http://ros.org/wiki/xacro'")
    (source / "r.urdf.xacro").write_text(text.replace('"base"', '"$(arg name)"'))
    run([f"{source}/r.urdf.xacro name=trunk", "--out", str(out)])
    assert read_model(str(out / "urdf" / "r.urdf")).description.root == "trunk"


def test_comments_and_unknown_tags_stay(bring):
    text = robot("<!-- here --><my_tag/>", links='<gazebo reference="base"/>')
    text = "<!-- before -->\n" + text.replace(
        "</robot>", '<mujoco><compiler meshdir="meshes" a="b"/></mujoco></robot>'
    )
    urdf = bring(text)
    assert "meshdir was changed from meshes to ../meshes" in bring.told
    assert "meshdir" not in run([str(urdf)])
    written = urdf.read_text()
    for part in ("<!-- before -->", "<!-- here -->", "<my_tag/>", "<gazebo reference"):
        assert part in written
    assert '<compiler meshdir="../meshes" a="b"/>' in written


def test_nothing_is_overwritten_without_force(bring, out):
    bring(robot(""))
    (out / "mine.txt").write_text("mine")
    before = contents(out)
    with pytest.raises(
        DescriptionError, match=r"report\.md already exists; use --force to repl"
    ):
        bring(robot("<!-- new -->"))
    assert contents(out) == before
    assert "<!-- new -->" in bring(robot("<!-- new -->"), "--force").read_text()
    assert (out / "mine.txt").read_text() == "mine"
    assert not list(out.parent.glob(".import*"))


def test_the_source_is_never_replaced(tmp_path):
    stl(tmp_path / "meshes" / "x.stl")
    path = tmp_path / "urdf" / "r.urdf"
    path.parent.mkdir()
    path.write_text(robot(shape("visual", "../meshes/x.stl")))
    before = contents(tmp_path)
    with pytest.raises(
        DescriptionError, match=r"r\.urdf, which is one of the imported files"
    ):
        run([str(path), "--out", str(tmp_path), "--force"])
    path.rename(tmp_path / "r2.urdf")
    (tmp_path / "r2.urdf").write_text(robot(shape("visual", "meshes/x.stl")))
    with pytest.raises(
        DescriptionError, match=r"x\.stl, which is one of the imported files"
    ):
        run([str(tmp_path / "r2.urdf"), "--out", str(tmp_path), "--force"])
    assert contents(tmp_path)["meshes/x.stl"] == before["meshes/x.stl"]
    assert set(contents(tmp_path)) == {"r2.urdf", "meshes/x.stl"}


def test_without_out_nothing_is_written(source, tmp_path):
    stl(source / "x.stl")
    (source / "r.urdf").write_text(robot(shape("visual", "x.stl")))
    before = contents(tmp_path)
    told = run([str(source / "r.urdf")])
    assert "1 mesh files, 1 changed" in told
    assert "use --out to write" in told
    assert contents(tmp_path) == before


def test_in_a_package_meshes_are_named_by_it(source, tmp_path, monkeypatch):
    package = tmp_path / "ws" / "my_robots"
    package.mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>my_robots</name></package>")
    stl(source / "x.stl")
    (source / "r.urdf").write_text(robot(shape("visual", "x.stl")))

    def imported(name):
        model_files.packages.cache_clear()
        told = run([str(source / "r.urdf"), "--out", str(package / name)])
        urdf = package / name / "urdf" / "r.urdf"
        ((path, _),) = mesh_files(urdf).values()
        assert path.is_file()
        return told, urdf.read_text()

    try:
        told, text = imported("a")
        assert 'filename="../meshes/x.stl"' in text
        assert "named relative" in told
        monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "ws"))
        told, text = imported("b")
        assert 'filename="package://my_robots/b/meshes/x.stl"' in text
        assert "`package://my_robots/b/meshes/...`" in told
        assert 'filename="../meshes/x.stl"' in imported("c c")[1]
    finally:
        model_files.packages.cache_clear()


def command(*arguments, first="", ignored=(), **options):
    """Start the command as a shell does: interrupts end it, whatever ended this one.

    Args:
        arguments: Its arguments.
        first: A folder that Python looks into first.
        ignored: Signals that it is to ignore.
        options: Of subprocess.Popen.
    """

    def as_in_a_shell():
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        for number in ignored:
            signal.signal(number, signal.SIG_IGN)

    script = REPOSITORY / "scripts" / "import_model"
    path = os.pathsep.join([str(first), str(REPOSITORY / "src"), *sys.path])
    return subprocess.Popen(
        [sys.executable, str(script), *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": path},
        preexec_fn=as_in_a_shell,
        **options,
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["no.urdf"], "Cannot use the model no.urdf: There is no file no.urdf"),
        (["."], "The folder . and its subfolders have no .urdf"),
        (["r.urdf", "--decimate", "3"], "must be a whole number at least 4 (got 3)"),
        (["r.urdf", "--out", "/proc/x"], "/proc/.import_model-"),
        ([], "the following arguments are required: MODEL"),
    ],
)
def test_a_mistake_is_answered_with_one_sentence(
    arguments, words, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    if "r.urdf" in arguments:
        (tmp_path / "r.urdf").write_text(robot(""))
    run = run_script(REPOSITORY / "scripts" / "import_model", *arguments)
    assert run.returncode == 2
    told = run.stderr
    assert told.startswith("import_model: ")
    assert told.count("\n") == 1
    assert words in told


@pytest.mark.slow
def test_an_interrupted_import_leaves_nothing(source, out, tmp_path):
    source.mkdir()
    ball = trimesh.creation.icosphere(5)
    names = [f"{number}.stl" for number in range(9)]
    data = ball.export(file_type="stl")
    for name in names:
        (source / name).write_bytes(data)
    inside = "".join(shape("visual", name) for name in names)
    (source / "r.urdf").write_text(robot(inside))
    process = command(
        source / "r.urdf", "--out", out, "--decimate", "9", "--tolerance", "9"
    )
    wait_for(
        lambda: process.poll() is None and [*tmp_path.glob(".import*/meshes/0.stl")],
        "the first mesh",
    )
    process.send_signal(signal.SIGTERM)
    _, told = process.communicate(timeout=DEADLINE)
    assert told.endswith("import_model: interrupted, nothing is written.\n")
    assert process.returncode == 130
    assert [path.name for path in tmp_path.iterdir()] == ["source"]


@pytest.fixture(scope="module")
def vendor(tmp_path_factory):
    if not VENDOR.exists():
        pytest.skip("the vendor's g1_29dof.urdf is not beside the repository")
    folder = tmp_path_factory.mktemp("vendor") / "out"
    run([str(VENDOR), "--out", str(folder)])
    return folder


def test_the_vendors_robot_stays_what_it_is(vendor):
    source = read_model(str(VENDOR)).description
    imported = read_model(str(vendor / "urdf" / "g1_29dof.urdf")).description
    assert_same_robot(source, imported)
    assert len(imported.movable_joints) == 29
    before, after = mesh_files(VENDOR), mesh_files(vendor / "urdf" / "g1_29dof.urdf")
    assert before.keys() == after.keys()
    for key, (path, scale) in after.items():
        assert scale == before[key][1]
        assert path.read_bytes()[80:] == before[key][0].read_bytes()[80:]


def checked(urdf):
    """Give what check_urdf, which reads as RViz does, says of a file."""
    command = ["check_urdf", str(urdf)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.skipif(not shutil.which("check_urdf"), reason="check_urdf is not there")
def test_names_that_rviz_wants_are_given_and_told(bring, source):
    seen = (
        '<visual><geometry><box size="1 1 1"/></geometry>'
        '<material><color rgba="0 1 0 1"/></material></visual>'
    )
    text = f"<!-- mine -->{robot(2 * seen)}".replace('<robot name="r">', "<robot>")
    urdf = bring(text)
    assert "No name given for the robot" in checked(source / "r.urdf").stderr
    found = checked(urdf)
    assert found.returncode == 0
    assert "rror" not in found.stdout + found.stderr
    assert '<robot name="r">' in urdf.read_text()
    assert ": robot r, 1 links" in bring.told
    report = (urdf.parents[1] / "report.md").read_text()
    changed = report[report.index("### Changed") :]
    for sentence in (
        "The robot has no name; using that of its file: r.",
        "Materials without a name were named: material_1 (link base), material_2 "
        "(link base).",
    ):
        assert sentence in changed
        assert sentence in bring.told


STANDING = np.array([0.0, 0.0, 0.793, 0.0, 0.0, 0.0, 1.0])


SIMPLER = ["--decimate", "500", "--convex-collisions"]


KEPT = {"left_ankle_pitch_link", "left_ankle_roll_link"}


"""Links of the simpler robot: a hull, spheres, and few triangles to look at."""


def vendors():
    """Write some links of the vendor's robot."""
    root = ElementTree.fromstring(with_absolute_uris(VENDOR.read_text(), VENDOR.parent))
    for element in list(root):
        names = [element.get("name")]
        if element.tag == "joint":
            names = [element.find(end).get("link") for end in ("parent", "child")]
        if not KEPT.issuperset(names):
            root.remove(element)
    return ElementTree.tostring(root, encoding="unicode")


@pytest.mark.slow
def test_the_vendors_robot_loads_with_all_its_shapes(make_world, tmp_path):
    if not VENDOR.exists():
        pytest.skip("the vendor's g1_29dof.urdf is not beside the repository")
    out, given = tmp_path / "out", tmp_path / "g1_29dof.urdf"
    given.write_text(vendors())
    run([str(given), "--out", str(out), *SIMPLER])
    model = read_model(str(out / "urdf" / "g1_29dof.urdf"))
    text = with_absolute_uris(model.text, model.path.parent)
    world = make_world("hold")
    assert world.spawn_urdf("g1", text, STANDING) == ()
    source = lump_fixed_joints(read_model(str(given)).description)
    lumped = world.model("g1").assembly.description
    assert lumped.link_names == source.description.link_names
    assert lumped.mass == pytest.approx(source.description.mass, abs=1e-9)
    for one, other in zip(lumped.links, source.description.links):
        assert one.inertial == other.inertial
        assert len(one.collisions) == len(other.collisions)
