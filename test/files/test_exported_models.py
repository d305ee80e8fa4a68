"""Models and media are found where Gazebo with gazebo_ros finds them."""

from pathlib import Path
from xml.etree import ElementTree

import pytest
from conftest import REPOSITORY

pytest.importorskip("rospkg", reason="rospkg is not installed")

from g1_description.files import model_files
from g1_description.files.uris import local_path
from g1_description.gazebo.programs import gzclient, gzserver
from g1_description.gazebo.programs.gzserver import find_world
from g1_description.robot.load import read_model

PACKAGE = """<package format="2"><name>{}</name><version>0.0.0</version>
<description>d</description><maintainer email="a@b.c">m</maintainer>
<license>none</license><exec_depend>gazebo_ros</exec_depend>
<export>{}</export></package>"""


def write(path, text=""):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Make packages in a workspace of their own, without a home and a model path."""
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "src"))
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    for variable in (model_files.MODEL_PATH, model_files.RESOURCE_PATH):
        monkeypatch.delenv(variable, raising=False)
    model_files.packages.cache_clear()

    def make(name, export):
        folder = tmp_path / "src" / name
        write(folder / "package.xml", PACKAGE.format(name, export))
        return folder

    yield make
    model_files.packages.cache_clear()


def test_models_are_found_where_packages_export_them(package, tmp_path):
    export = '<gazebo_ros gazebo_model_path="{}"/>'
    other = f"{tmp_path}/other"
    one = package("one", export.format("${prefix}/models:${prefix}/more"))
    two = package("two", export.format(other) * 2 + "<gazebo_ros plugin_path='x'/>")
    package("none", "")
    write(
        two.parent / "broken" / "package.xml", "<package><name>broken</name></package>"
    )
    for folder, model in ((one / "models", "a"), (one / "more", "b"), (other, "c")):
        file = write(tmp_path / folder / model / "model.sdf", f"<sdf>{model}</sdf>")
        assert model_files.find_folder(model) == str(file.parent)
        assert model_files.find_model(f"model://{model}") == f"<sdf>{model}</sdf>"
    assert model_files.find_folder("d") is None


def test_files_of_this_package_are_its_own_where_ros_finds_another_of_its_name(
    package, capsys
):
    foreign = package("g1_description", "")
    assert model_files.find_folder("g1_description") == str(foreign)
    assert read_model("g1_29dof").path.samefile(REPOSITORY / "urdf" / "g1_29dof.urdf")
    assert Path(gzclient.rviz()[-1]).samefile(REPOSITORY / "rviz" / "g1.rviz")
    with pytest.raises(SystemExit):
        gzserver.parse(["--version"])
    version = ElementTree.parse(REPOSITORY / "package.xml").findtext("version")
    assert f"g1_description {version}, " in capsys.readouterr().out


def test_the_environment_goes_before_packages_and_these_before_home(
    package, tmp_path, monkeypatch
):
    exported = package("one", '<gazebo_ros gazebo_model_path="${prefix}"/>')
    places = [tmp_path / "env", exported, tmp_path / "home" / ".gazebo" / "models"]
    monkeypatch.setenv(model_files.MODEL_PATH, str(places[0]))
    for place in reversed(places):
        (place / "box").mkdir(parents=True)
        assert model_files.find_folder("box") == str(place / "box")


def test_worlds_and_media_are_found_where_packages_export_them(
    package, tmp_path, monkeypatch
):
    export = '<gazebo_ros gazebo_media_path="${prefix}:${prefix}/media"/>'
    folder = package("one", export)
    world = write(folder / "worlds" / "a.world")
    mesh = write(folder / "media" / "models" / "x.stl")
    write(folder / "worlds" / "empty.world")
    monkeypatch.chdir(tmp_path)
    assert find_world("worlds/a.world") == str(world)
    assert find_world("worlds/empty.world") == ""
    assert local_path("file://models/x.stl", lambda _: None) == mesh
    assert local_path("file://models/y.stl", lambda _: None) is None
    assert local_path(f"file://{mesh}", lambda _: None) == mesh
