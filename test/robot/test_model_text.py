"""What a launch file's model:= may be, and the sentence for what it may not."""

import os
import sys

import numpy as np
import pytest

from g1_description.errors import DescriptionError
from g1_description.gazebo.programs import launched_robot
from g1_description.importer.robot import open_robot
from g1_description.robot.load import read_absolute, read_model
from g1_description.robot.urdf import parse_urdf

ROBOT = '<robot name="r"><link name="a"/></robot>'
XACRO = """<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="hand" default="none"/>
  <link name="a"/>
  <xacro:unless value="${'$(arg hand)' == 'none'}">
    <link name="$(arg hand)"/>
    <joint name="j" type="fixed"><parent link="a"/><child link="$(arg hand)"/></joint>
  </xacro:unless>
</robot>
"""


@pytest.fixture
def write(tmp_path):
    def write(name, text=ROBOT):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return path

    return write


def refusal(asked):
    with pytest.raises(DescriptionError) as caught:
        read_model(str(asked))
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("name", ["my robot.urdf", "hand=true x=1.urdf"])
def test_a_path_is_read(write, name):
    assert read_model(str(write(name))).text == ROBOT


def test_a_byte_order_mark_does_no_harm(write):
    assert read_model(str(write("r.urdf", "\ufeff" + ROBOT))).text == ROBOT


DECLARATION = '<?xml version="1.0" encoding="utf-8"?>'


@pytest.mark.parametrize(
    "before",
    ["\n", "  \t\r\n", "<!-- by hand -->\n", "\n<!-- a --><!-- <b/> -->", "\ufeff\n"],
)
def test_what_stands_before_the_declaration_does_no_harm(write, before):
    file = write("r.urdf", before + DECLARATION + "\n" + ROBOT)
    assert read_model(str(file)).description.name == "r"
    text = read_absolute(str(file)).text
    assert parse_urdf(text).link_names == ("a",)
    assert open_robot(read_model(str(file))).root.get("name") == "r"


LATIN = '<?xml version="1.0" encoding="{}"?>\n<robot name="é"><link name="a"/></robot>'


def test_a_file_is_in_the_encoding_that_it_declares(write):
    file = write("r.urdf")
    file.write_bytes(LATIN.format("windows-1252").encode("windows-1252"))
    model = read_model(str(file))
    assert model.description.name == "é"
    assert model.text.startswith("\n<robot")
    assert parse_urdf(read_absolute(str(file)).text).name == "é"


@pytest.mark.parametrize("encoding", ["ISO-8859-1", "none"])
def test_what_is_utf_8_is_read_as_that_whatever_it_declares(write, encoding):
    file = write("r.urdf", LATIN.format(encoding))
    assert read_model(str(file)).description.name == "é"


@pytest.mark.parametrize(
    "encoding", ["us-ascii", "utf-8", "utf-16", "cp037", "zlib", "punycode", "no"]
)
def test_bytes_that_are_in_no_encoding_of_the_file_are_refused(write, encoding):
    file = write("r.urdf")
    file.write_bytes(LATIN.format(encoding).encode("latin-1"))
    assert f"Line 2 of {file} is not UTF-8, and no other encoding" in refusal(file)


def test_a_mesh_is_no_robot(tmp_path):
    file = tmp_path / "link.stl"
    file.write_bytes(b"binary STL".ljust(80) + np.arange(30, dtype="<f4").tobytes())
    assert f"{file} is a binary file; a robot description must be text" in refusal(file)


def test_uris_are_read(write, tmp_path, monkeypatch):
    path = write("mine/urdf/r 1.urdf")
    assert read_model("file://" + str(path).replace(" ", "%20")).path == path
    monkeypatch.setenv("GAZEBO_MODEL_PATH", str(tmp_path))
    assert read_model("package://mine/urdf/r 1.urdf").path == path


def test_the_home_is_known(write, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    path = write("r.urdf")
    assert read_model("~/r.urdf").path == path


def test_xacro_takes_arguments(write):
    file = write("r.urdf.xacro", XACRO)
    assert read_model(str(file)).description.link_names == ("a",)
    for words in ("hand=left", "hand:=left", "  hand:= left"):
        names = read_model(f"{file} {words}").description.link_names
        assert names == ("a", "left")


def test_xacro_finds_packages_as_ros_does(write):
    text = ROBOT.replace("<link", "<!-- --><link").replace('"a"', '"$(env HOME)"')
    home = read_model(str(write("r.xacro", text))).description.root
    assert home == os.environ["HOME"]
    wrong = text.replace("$(env HOME)", "$(find no_such_package)")
    told = refusal(write("w.xacro", wrong))
    assert told.endswith("no_such_package (in " + str(write("w.xacro", wrong)) + ").")


def test_the_file_that_xacro_fails_in_is_named(write):
    write("part.xacro", XACRO.replace('name="a"', 'name="${wrong}"'))
    include = '<xacro:include filename="part.xacro"/>'
    outer = write("r.xacro", XACRO.replace('<link name="a"/>', include))
    told = refusal(outer)
    assert "name 'wrong' is not defined" in told
    assert "part.xacro" in told
    assert "mismatched tag: line 2" in refusal(write("x.xacro", "<robot>\n</link>"))


def test_an_error_of_xacro_is_read_in_any_encoding(write, monkeypatch):
    monkeypatch.setenv("PYTHONIOENCODING", "latin-1")
    told = refusal(write("größe.xacro", "<robot>\n</link>"))
    assert "mismatched tag" in told
    assert "größe.xacro" in told


def test_an_argument_for_what_takes_none_is_refused(write):
    assert "takes no arguments (got hand" in refusal(f"{write('r.urdf')} hand=true")


def test_what_is_not_there_is_told_with_what_is_near(write, tmp_path):
    write("robots/urdf/g1.urdf")
    assert refusal(tmp_path / "robots" / "urdf" / "g1x.urdf").endswith(
        "g1x.urdf (did you mean g1.urdf?)."
    )
    write("robots/urdf/g1.md")
    assert refusal(tmp_path / "robots" / "urdf" / "g1x.md").endswith("mean g1.md?).")
    with pytest.raises(DescriptionError, match=r"mean g1\.md\?\)\.$"):
        read_absolute(str(tmp_path / "robots" / "urdf" / "g1x.md"))
    assert refusal(tmp_path / "robots" / "x").endswith("robots/x.")
    write("robot.urdf")
    assert refusal(tmp_path / "nope.urdf").endswith("nope.urdf.")
    assert refusal(tmp_path / "robt" / "a.urdf").endswith(
        "robt (did you mean robots?)."
    )
    assert refusal(tmp_path / "robot" / "g1.urdf").endswith(
        f"There is no folder {tmp_path}/robot (did you mean robots?)."
    )
    folder = refusal(tmp_path / "robots")
    assert folder.endswith("robots is a folder; it contains urdf/g1.urdf.")
    assert "There is no package 'no_such_package'" in refusal(
        "package://no_such_package/r.urdf"
    )
    assert "http://" in refusal("http://host/r.urdf")


def test_a_package_that_is_nearly_right_is_named(monkeypatch, tmp_path):
    from g1_description.files import model_files

    package = tmp_path / "robot_arm"
    package.mkdir()
    (package / "package.xml").write_text("<package><name>robot_arm</name></package>")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path))
    model_files.packages.cache_clear()
    try:
        assert "did you mean robot_arm?" in refusal("package://robot_am/r.urdf")
    finally:
        model_files.packages.cache_clear()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "not XML"),
        ("<robot>\n<link>\n</robot>", "line 3"),
        ("<sdf/>", "root element is <sdf>"),
        (
            '<robot name="r"><link name="a"/>\n<link name="b"><inertial>'
            '<mass value="x"/></inertial></link></robot>',
            "<link> b, line 2: could not convert string to float: 'x'.",
        ),
        (
            ROBOT.replace("/></r", "><visual><geometry/></visual></link></r"),
            "<link> a, line 1: One element only",
        ),
        ('<!DOCTYPE r [<!ENTITY a "aa">]><robot name="&a;"/>', "DOCTYPE"),
    ],
)
def test_what_is_no_robot_is_refused(write, text, words):
    assert words in refusal(write("r.urdf", text))


def test_what_no_robot_can_be_is_not_read(write, tmp_path):
    large = write("large.urdf")
    os.truncate(large, 100_000_000)
    assert "100 MB" in refusal(large)
    os.mkfifo(tmp_path / "pipe.urdf")
    assert "not a regular file" in refusal(tmp_path / "pipe.urdf")
    (tmp_path / "latin.urdf").write_bytes(b"<robot>\n\xe4</robot>")
    assert "Line 2" in refusal(tmp_path / "latin.urdf")
    assert "too long" in refusal(tmp_path / ("x" * 300))
    assert "null" in refusal("x\0.urdf")


NEWER = """<robot name="r" version="1.1"><link name="a">
<visual><geometry><ellipsoid radii="1 1 2"/></geometry></visual>
<visual name="v"><origin xyz="1 2 3" quat_xyzw="0 0.6 0 0.8"/>
<geometry><capsule radius="0.1" length="0.5"/></geometry></visual>
<collision><geometry><capsule radius="0.2" length="0.4"/></geometry></collision>
</link><link name="b"/><joint name="j" type="fixed"><parent link="a"/><child link="b"/>
<origin xyz="0 0 1" quat_xyzw="0.6 0 0 0.8"/></joint></robot>"""


def test_a_launch_file_passes_on_what_urdfdom_reads(write, monkeypatch, capfd):
    """Pinocchio reads with urdfdom, of a version that knows URDF 1.0 only."""
    pinocchio = pytest.importorskip("pinocchio")
    file = write("r.urdf", NEWER)
    monkeypatch.setattr(sys, "argv", ["absolute_urdf", str(file)])
    launched_robot.main()
    text, said = capfd.readouterr()
    assert said == "r: unsupported shapes: ellipsoid in visual of link a\n"
    copy = open_robot(read_model(str(file)))
    assert repr(parse_urdf(copy.text().decode())) == repr(parse_urdf(text))
    assert copy.changes and copy.findings == [f"U{said[4:-1]}."]
    model = pinocchio.buildModelFromXML(text)
    turned = model.frames[model.getFrameId("b")].placement
    np.testing.assert_allclose(turned.rotation[:, 1], [0, 0.28, 0.96], atol=1e-12)
    drawn, solid = (
        pinocchio.buildGeomFromUrdfString(model, text, kind).geometryObjects
        for kind in (pinocchio.VISUAL, pinocchio.COLLISION)
    )
    for shapes, center, along, radius in (
        (drawn, [1, 2, 3], [0.24, 0, 0.07], 0.1),
        (solid, [0, 0, 0], [0, 0, 0.2], 0.2),
    ):
        rod, *balls = (shape.geometry for shape in shapes)
        assert [rod.radius, *(ball.radius for ball in balls)] == [radius] * 3
        assert 2.0 * rod.halfLength == pytest.approx(2.0 * np.linalg.norm(along))
        wanted = np.array(center) + np.outer([0, 1, -1], along)
        places = [shape.placement.translation for shape in shapes]
        np.testing.assert_allclose(places, wanted, atol=1e-12)


def test_the_command_prints_the_robot_or_one_sentence(write, monkeypatch, capfd):
    file = write("r.urdf", ROBOT.replace('"a"', '"ä"'))
    monkeypatch.setattr(sys, "argv", ["absolute_urdf", str(file)])
    launched_robot.main()
    assert 'name="ä"' in capfd.readouterr().out
    monkeypatch.setattr(sys, "argv", ["absolute_urdf", f"{file}x"])
    with pytest.raises(SystemExit, match=r"Cannot use the model .*: There is no"):
        launched_robot.main()
