"""Relative mesh names become absolute; files behind URIs are found."""

import pytest
from lxml import etree

from g1_description.errors import DescriptionError
from g1_description.files.uris import local_path, with_absolute_uris


def mesh(name):
    return (
        '<robot name="r"><!-- kept --><mujoco><compiler meshdir="meshes"/></mujoco>'
        f'<link name="a"><visual><geometry><mesh filename="{name}"/></geometry>'
        "</visual></link></robot>"
    )


@pytest.mark.parametrize(
    "name", ["package://p/meshes/x.stl", "file:///tmp/x.stl", "http://host/x.stl"]
)
def test_absolute_uris_stay_as_they_are(name, tmp_path):
    assert f'filename="{name}"' in with_absolute_uris(mesh(name), tmp_path)


@pytest.mark.parametrize("name", ["meshes/x.STL", "./meshes/../meshes/x.STL"])
def test_relative_names_start_from_the_folder(name, tmp_path):
    text = with_absolute_uris(mesh(name), tmp_path)
    assert f'filename="file://{tmp_path}/meshes/x.STL"' in text
    assert '<compiler meshdir="meshes"' in text


def test_a_path_with_spaces_comes_back(tmp_path):
    folder = tmp_path / "my robot"
    folder.mkdir()
    (folder / "x y.stl").write_text("solid")
    text = with_absolute_uris(mesh("x y.stl"), folder)
    uri = text.split('filename="')[1].split('"')[0]
    assert local_path(uri, lambda _: None) == folder / "x y.stl"


def test_a_declaration_and_a_leading_comment_do_no_harm(tmp_path):
    text = '<?xml version="1.0" encoding="utf-8"?>\n<!-- head -->\n' + mesh("ä.stl")
    assert "%C3%A4.stl" in with_absolute_uris(text, tmp_path)


def test_what_is_not_xml_is_refused(tmp_path):
    with pytest.raises(DescriptionError, match="not XML"):
        with_absolute_uris("robot", tmp_path)


def test_files_are_found_through_packages_and_paths(tmp_path):
    (tmp_path / "x.stl").write_text("solid")
    packages = {"mine": str(tmp_path)}.get
    assert local_path("package://mine/x.stl", packages) == tmp_path / "x.stl"
    assert local_path(str(tmp_path / "x.stl"), packages) == tmp_path / "x.stl"
    (tmp_path / "y#1?.stl").write_text("solid")
    assert local_path("package://mine/y#1?.stl", packages) == tmp_path / "y#1?.stl"
    for absent in ("package://mine/y.stl", "package://other/x.stl", "x.stl"):
        assert local_path(absent, packages) is None
    assert local_path(f"file://{tmp_path}", packages) is None


def test_a_path_goes_up_no_more_than_it_must(tmp_path):
    (tmp_path / "meshes").mkdir()
    (tmp_path / "x.stl").write_text("solid")
    packages = {"mine": str(tmp_path / "meshes")}.get
    for uri in ("package://mine/../x.stl", f"file://{tmp_path}/meshes/../x.stl"):
        assert local_path(uri, packages) == tmp_path / "x.stl"


def test_a_package_can_be_the_folder_around_the_file(tmp_path):
    folder = tmp_path / "robot" / "urdf"
    folder.mkdir(parents=True)
    (tmp_path / "robot" / "x.stl").write_text("solid")
    elsewhere = {"robot": "/nowhere"}.get
    text = with_absolute_uris(mesh("package://robot/x.stl"), folder, elsewhere)
    assert f'filename="file://{tmp_path}/robot/x.stl"' in text
    text = with_absolute_uris(mesh("package://robot/y.stl"), folder, elsewhere)
    assert 'filename="package://robot/y.stl"' in text


def test_a_package_around_the_file_is_known_by_the_name_in_its_manifest(tmp_path):
    """A clone's folder has any name; of two packages the nearer one counts."""
    outer, inner = tmp_path / "b1-main", tmp_path / "b1-main" / "robots" / "v2"
    (inner / "urdf").mkdir(parents=True)
    for folder in (outer, inner):
        manifest = "<package><name> b1_description </name></package>"
        (folder / "package.xml").write_text(manifest)
        (folder / "x.stl").write_text("solid")
    (outer / "y.stl").write_text("solid")
    uri = "package://b1_description/x.stl"
    text = with_absolute_uris(mesh(uri), inner / "urdf")
    assert f'filename="file://{inner}/x.stl"' in text
    text = with_absolute_uris(mesh(uri), outer / "robots")
    assert f'filename="file://{outer}/x.stl"' in text
    (outer / "package.xml").write_text("<package><name>broken")
    assert uri in with_absolute_uris(mesh(uri), outer / "robots")


def test_a_package_that_has_the_file_is_believed(tmp_path):
    folder = tmp_path / "robot"
    folder.mkdir()
    (folder / "x.stl").write_text("solid")
    uri = "package://robot/x.stl"
    assert uri in with_absolute_uris(mesh(uri), folder, {"robot": str(folder)}.get)


def test_a_robot_without_a_name_gets_one_for_rviz(tmp_path):
    text = with_absolute_uris('<robot><link name="a"/></robot>', tmp_path, name="b1")
    assert text.startswith('<robot name="b1">')
    kept = with_absolute_uris('<robot name="own"/>', tmp_path, name="b1")
    assert 'name="own"' in kept


def test_a_material_without_a_name_gets_one_for_rviz(tmp_path):
    """It leaves out a visual without it. Names that are there are nobody else's."""
    colors = '<color rgba="0 1 0 1"/></material>'
    text = (
        '<robot name="r"><material name="material_1"/><link name="a">'
        f"<visual><material>{colors}</visual><visual><material>{colors}</visual>"
        f'<visual><material name="">{colors}</visual>'
        f'<visual><material name="material_3">{colors}</visual></link>'
        '<gazebo reference="a"><material>Gazebo/Red</material></gazebo></robot>'
    )
    root = etree.fromstring(with_absolute_uris(text, tmp_path, name="r"))
    names = [material.get("name") for material in root.iterfind("link//material")]
    assert names == ["material_2", "material_4", "", "material_3"]
    assert root.find("gazebo/material").attrib == {}
