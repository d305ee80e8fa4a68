"""Descriptions that use what xacro can today are expanded, as by ROS' own."""

import math
import os
import shutil

import numpy as np
import pytest
from forked import run_script

from g1_description.errors import DescriptionError
from g1_description.robot.load import read_model

PACKAGES = os.environ.get("ROS_PACKAGE_PATH", "")

LIMITS = """
joint_limits:
  shoulder: {has_limits: true, min: !degrees -90, max: !degrees 2*45.0, effort: 87}
  elbow: {has_limits: true, min: !radians -1.5, max: !radians pi/2, effort: 12}
offsets: {upper: [0.0, 0.0, 0.25], lower: !millimeters 500}
names: [upper, lower]
"""

ARM = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="limits" default="$(find my_arm)/config/limits.yaml"/>
  <xacro:arg name="hand" default="false"/>
  <xacro:include filename="$(find my_arm)/urdf/parts.xacro"/>
  <xacro:property name="limits_file" value="$(arg limits)"/>
  <xacro:property name="config" value="${xacro.load_yaml(limits_file)}"/>
  <xacro:property name="joints" value="${config['joint_limits']}" scope="global"/>
  <xacro:property name="prefix" value="left_" lazy_eval="false"/>
  <xacro:body name="base"/>
  <xacro:body name="upper" mass="${2 * 1.5}"/>
  <xacro:body name="lower"/>
  <xacro:moving name="shoulder" parent="base" child="upper">
    <origin xyz="0 0 ${config.offsets.upper[2]}" rpy="0 0 ${radians(90)}"/>
  </xacro:moving>
  <xacro:moving name="elbow" parent="upper" child="lower">
    <origin xyz="0 0 ${config['offsets']['lower']}"/>
  </xacro:moving>
  <xacro:if value="$(arg hand)">
    <xacro:body name="hand"/>
    <xacro:call macro="weld" parent="lower" child="hand"/>
  </xacro:if>
  <xacro:unless value="${'sensor' in config or len(config.names) != 2}">
    <xacro:weld_all names="${config.names}"/>
  </xacro:unless>
  <xacro:property name="mount" default="unused"/>
  ${xacro.warning('an arm', 'to be warned of')}${xacro.message('and told of')}
</robot>
"""

PARTS = """<?xml version="1.0"?>
<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:property name="box">
    <geometry><box size="0.1 0.1 ${side}"/></geometry>
  </xacro:property>
  <xacro:macro name="body" params="name mass:=1 side:=${0.1*2} prefix:=^|">
    <link name="${prefix}${name}">
      <visual><xacro:insert_block name="box"/></visual>
      <inertial>
        <mass value="${mass}"/>
        <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
      </inertial>
    </link>
  </xacro:macro>
  <xacro:macro name="moving" params="name parent child *origin prefix:=^">
    <joint name="${prefix}${name}" type="revolute">
      <xacro:insert_block name="origin"/>
      <parent link="${prefix}${parent}"/>
      <child link="${prefix}${child}"/>
      <axis xyz="0 0 1"/>
      <xacro:property name="own" value="${joints[name]}"/>
      <limit lower="${own.min}" upper="${own['max']}" effort="${own.effort}"
             velocity="${xacro.arg('speed') if False else 2.0}"/>
    </joint>
  </xacro:macro>
  <xacro:macro name="weld" params="parent child prefix:=^|">
    <joint name="${prefix}${child}_weld" type="fixed">
      <parent link="${prefix}${parent}"/><child link="${prefix}${child}"/>
    </joint>
  </xacro:macro>
  <xacro:macro name="weld_all" params="names">
    <xacro:if value="${names}">
      <link name="${prefix}${names[0]}_tool"/>
      <xacro:weld parent="${names[0]}" child="${names[0]}_tool"/>
      <xacro:weld_all names="${names[1:]}"/>
    </xacro:if>
  </xacro:macro>
</robot>
"""


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Make a ROS package, and give its folder."""
    folder = tmp_path / "my_arm"
    for name, text in (
        ("package.xml", "<package><name>my_arm</name></package>"),
        ("config/limits.yaml", LIMITS),
        ("urdf/parts.xacro", PARTS),
        ("urdf/arm.urdf.xacro", ARM),
    ):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path))
    return folder


def test_what_todays_descriptions_use_is_expanded(package, capfd):
    robot = read_model(str(package / "urdf" / "arm.urdf.xacro")).description
    names = ("base", "upper", "lower", "upper_tool", "lower_tool")
    assert robot.link_names == tuple(f"left_{name}" for name in names)
    shoulder, elbow = robot.movable_joints
    np.testing.assert_allclose(
        [shoulder.lower, shoulder.upper, elbow.lower, elbow.upper],
        [-math.pi / 2, math.pi / 2, -1.5, math.pi / 2],
    )
    assert (shoulder.effort, elbow.effort, elbow.velocity) == (87.0, 12.0, 2.0)
    np.testing.assert_allclose(shoulder.pose[:3], [0, 0, 0.25])
    np.testing.assert_allclose(shoulder.pose[5:], [math.sqrt(0.5)] * 2)
    np.testing.assert_allclose(elbow.pose[:3], [0, 0, 0.5])
    masses = [link.inertial.mass for link in robot.links if link.inertial]
    assert masses == [1.0, 3.0, 1.0]
    assert robot.links[0].visuals[0].size == (0.1, 0.1, 0.2)
    told = capfd.readouterr()
    assert "an arm to be warned of" in told.err
    assert "and told of" in told.err
    assert told.out == ""


def test_conditions_follow_the_arguments(package):
    file = package / "urdf" / "arm.urdf.xacro"
    for word, there in (("1", True), ("False", False)):
        names = read_model(f"{file} hand:={word}").description.link_names
        assert ("left_hand" in names) == there


def test_a_value_of_yaml_that_is_missing_is_told_with_the_file(package):
    file = package / "urdf" / "arm.urdf.xacro"
    file.write_text(ARM.replace("config.offsets.upper[2]", "config.offsets.middle"))
    with pytest.raises(DescriptionError, match=r"no key 'middle'.*arm\.urdf\.xacro"):
        read_model(str(file))


def test_what_is_not_found_is_told_in_one_sentence(package):
    file = package / "r.xacro"
    file.write_text('<robot name="r"><link name="$(find no_such_package)"/></robot>')
    with pytest.raises(DescriptionError) as caught:
        read_model(str(file))
    told = str(caught.value)
    assert "no_such_package" in told
    assert told.count("o such file") + told.count("no package") == 1
    assert "<class" not in told
    assert "\n" not in told


def test_unknown_arguments_are_ignored_and_told(package, capfd):
    file = package / "urdf" / "arm.urdf.xacro"
    robot = read_model(f"{file} hnad:=true speed:=3").description
    assert "left_hand" not in robot.link_names
    assert "Ignored: " in capfd.readouterr().err


@pytest.mark.parametrize(
    "text",
    [
        ARM,
        '<robot name="r"><link name="l"><visual><geometry><sphere radius="${r}"/>'
        "</geometry></visual></link></robot>",
    ],
)
def test_xacro_under_the_name_of_urdf_gets_a_hint(tmp_path, text):
    file = tmp_path / "arm.urdf"
    file.write_text(text)
    with pytest.raises(DescriptionError) as caught:
        read_model(str(file))
    assert str(caught.value).endswith(
        "This looks like unexpanded xacro: run xacro on it, or name the file .xacro."
    )


def test_what_is_no_xacro_gets_none(tmp_path):
    file = tmp_path / "arm.urdf"
    file.write_text(
        '<robot name="r"><link name="a"/><link name="b"/><gazebo>'
        '<plugin filename="${x}"><p v="${y}"/></plugin></gazebo></robot>'
    )
    with pytest.raises(DescriptionError, match="a and b") as caught:
        read_model(str(file))
    assert "xacro" not in str(caught.value)


@pytest.mark.slow
def test_launch_files_find_the_program(package):
    roslaunch = shutil.which("roslaunch")
    if not roslaunch or not shutil.which("rospack"):
        pytest.skip("ROS is not there")
    file = package / "arm.launch"
    arm = "$(find my_arm)/urdf/arm.urdf.xacro"
    command = f"$(find xacro)/xacro --inorder '{arm}' hand:=true"
    file.write_text(f'<launch><param name="arm" command="{command}"/></launch>')
    packages = os.pathsep.join([str(package.parent), PACKAGES])
    environment = {**os.environ, "ROS_PACKAGE_PATH": packages}
    run = run_script(roslaunch, "--dump-params", file, environment=environment)
    assert run.returncode == 0, run.stderr
    assert "left_hand_weld" in run.stdout
