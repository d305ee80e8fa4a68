"""The MoveIt configuration: read as MoveIt, Pinocchio and roslaunch would."""

import re
from itertools import chain as joined
from itertools import combinations

import numpy as np
import pytest
import yaml
from lxml import etree

pytest.importorskip("rospy", reason="rospy is not installed")

from pages import ROOT, programs
from roslaunch.config import ROSLaunchConfig
from roslaunch.xmlloader import XmlLoader

from g1_description import Robot, Scene
from g1_description.bridge.controllers import read_controllers
from g1_description.cli.moveit_config import MoveItOptions, run
from g1_description.errors import InvalidValueError

ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow")
WRIST = ("wrist_roll", "wrist_pitch", "wrist_yaw")
TREE = """<robot name="gripper_on_a_rail">
  <link name="world"/>
  <link name="cart"/><link name="finger_a"/><link name="finger_b"/><link name="tip"/>
  <joint name="rail" type="prismatic"><parent link="world"/><child link="cart"/>
    <limit lower="0" upper="1" effort="1" velocity="2"/></joint>
  <joint name="a" type="revolute"><parent link="cart"/><child link="finger_a"/>
    <limit lower="0" upper="1" effort="1" velocity="3"/></joint>
  <joint name="b" type="continuous"><parent link="cart"/><child link="finger_b"/>
  </joint>
  <joint name="nail" type="fixed"><parent link="finger_b"/><child link="tip"/></joint>
</robot>"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("moveit") / "g1_moveit"
    scene = Scene()
    scene.sphere("ball", 0.1, [0.5, 0, 1])
    scene.save(out.parent / "scene.yaml")
    run(MoveItOptions(out, scene=out.parent / "scene.yaml"))
    return out


@pytest.fixture(scope="module")
def srdf(folder):
    return etree.parse(str(folder / "robot.srdf")).getroot()


def test_groups_are_chains_of_the_limbs(srdf):
    robot = Robot()
    carriers = {joint.child: joint for joint in robot.description.joints}
    joints = {}
    for group in srdf.findall("group"):
        for chain in group.findall("chain"):
            link, found = chain.get("tip_link"), []
            while link != chain.get("base_link"):
                found.insert(0, carriers[link].name)
                link = carriers[link].parent
            joints[group.get("name")] = found
    arm = [f"left_{part}_joint" for part in (*ARM, *WRIST)]
    assert joints["left_arm"] == arm
    assert joints["right_arm"] == [name.replace("left", "right") for name in arm]
    all_joints = joined.from_iterable(joints.values())
    assert sorted(all_joints) == sorted(robot.joint_names)
    whole = srdf.find("group[@name='whole_body']").findall("joint")
    assert [joint.get("name") for joint in whole] == [*robot.joint_names]


def test_the_program_of_the_page_raises_the_arm_that_it_plans_for(srdf):
    (program,) = programs(ROOT / "docs" / "tutorials" / "moveit.md")
    group = re.search(r'MoveGroupCommander\("(\w+)"\)', program)[1]
    pose = re.search(r'set_named_target\("(\w+)"\)', program)[1]
    assert srdf.find(f"group_state[@name='{pose}'][@group='{group}']") is not None
    hand = srdf.find(f"end_effector[@parent_group='{group}']").get("parent_link")
    robot = Robot()
    places = robot.link_poses(robot.named_configuration(pose))
    assert places[hand][2] > places["head_link"][2]


def test_end_effectors_share_no_link_with_their_arm(srdf):
    for end in srdf.findall("end_effector"):
        hand = srdf.find(f"group[@name='{end.get('group')}']/link").get("name")
        chain = srdf.find(f"group[@name='{end.get('parent_group')}']/chain")
        assert chain.get("tip_link") == end.get("parent_link") != hand
    assert len(srdf.findall("end_effector")) == 2


def test_pinocchio_reads_it_and_checks_the_same_pairs(folder):
    """Those that are left are those of the checks; the states are the named poses."""
    pinocchio = pytest.importorskip("pinocchio", reason="Pinocchio is not installed")
    robot = Robot()
    file = str(ROOT / "urdf" / "g1_29dof.urdf")
    model = pinocchio.buildModelFromUrdf(file, pinocchio.JointModelFreeFlyer())
    shapes = pinocchio.GeometryModel()
    names = [*robot.checker().collisions.links]
    for name in names:
        number = model.getFrameId(name)
        frame = model.frames[number]
        ends = number, frame.parent, pinocchio.hppfcl.Sphere(0.01), frame.placement
        shapes.addGeometryObject(pinocchio.GeometryObject(f"{name}_0", *ends))
    shapes.addAllCollisionPairs()
    pinocchio.removeCollisionPairs(model, shapes, str(folder / "robot.srdf"))
    left = {frozenset((p.first, p.second)) for p in shapes.collisionPairs}
    checked = {frozenset(map(names.index, pair)) for pair in robot.collision_pairs}
    assert checked <= left
    for pair in combinations(range(len(names)), 2):
        if frozenset(pair) in left - checked:  # Pinocchio leaves out rigid pairs itself
            one, other = (shapes.geometryObjects[n].parentJoint for n in pair)
            assert one == other
    pinocchio.loadReferenceConfigurations(model, str(folder / "robot.srdf"), False)
    for name in robot.pose_names:
        found = model.referenceConfigurations[name]
        rows = [model.joints[model.getJointId(n)].idx_q for n in robot.joint_names]
        np.testing.assert_allclose(
            found[rows], robot.named_configuration(name), atol=1e-9
        )


def test_settings_are_those_of_the_robot(folder):
    robot = Robot()
    files = {f.stem: yaml.safe_load(f.read_text()) for f in folder.glob("*.yaml")}
    limits = files["joint_limits"]["joint_limits"]
    assert [*limits] == [*robot.joint_names]
    found = [limits[name]["max_velocity"] for name in robot.joint_names]
    np.testing.assert_array_equal(found, robot.velocity_limits)
    assert not any(limit["has_acceleration_limits"] for limit in limits.values())
    listed = files["controllers"]["controller_list"]
    ours = read_controllers(files["bridge"]["controllers"], robot.joint_names, "file")
    assert [(c.name, [*c.joints]) for c in ours] == [
        (entry["name"], entry["joints"]) for entry in listed
    ]
    all_joints = joined.from_iterable(entry["joints"] for entry in listed)
    assert sorted(all_joints) == sorted(robot.joint_names)
    groups = {"left_leg", "right_leg", "waist", "left_arm", "right_arm"}
    assert {*files["kinematics"]} == groups
    assert groups | {"whole_body"} <= {*files["ompl_planning"]}


def test_roslaunch_reads_the_launch_file(folder):
    config = ROSLaunchConfig()
    loader = XmlLoader(resolve_anon=False)
    words = ["rviz:=false", f"{folder}/moveit.launch"]
    loader.load(words[-1], config, argv=words, verbose=False)
    values = {name: param.value for name, param in config.params.items()}
    semantic = values["/robot_description_semantic"]
    assert semantic == (folder / "robot.srdf").read_text()
    pipeline = "/move_group/planning_pipelines/ompl"
    assert values[f"{pipeline}/planning_plugin"] == "ompl_interface/OMPLPlanner"
    assert len(values["/link_states_bridge/controllers"]) == 5
    nodes = {node.name for node in config.nodes}
    assert {"gazebo", "link_states_bridge", "move_group", "publish_objects"} <= nodes
    assert "planning_scene" in nodes
    assert "* ball" in (folder / "objects.scene").read_text().splitlines()


def test_a_robot_without_a_profile_has_groups_of_its_own_links(tmp_path, capsys):
    (tmp_path / "rail.urdf").write_text(TREE)
    run(MoveItOptions(tmp_path / "out", str(tmp_path / "rail.urdf")))
    assert "groups to_cart, to_finger_a, to_tip, whole_body;" in capsys.readouterr().out
    root = etree.parse(str(tmp_path / "out" / "robot.srdf")).getroot()
    chain = root.find("group[@name='to_tip']/chain")
    assert dict(chain.attrib) == {"base_link": "cart", "tip_link": "tip"}
    limits = yaml.safe_load((tmp_path / "out" / "joint_limits.yaml").read_text())
    assert limits["joint_limits"]["b"]["has_velocity_limits"] is False
    assert limits["joint_limits"]["rail"]["max_velocity"] == 2.0


def test_existing_files_are_kept(folder, tmp_path):
    (tmp_path / "kinematics.yaml").write_text("mine")
    with pytest.raises(InvalidValueError, match=r"kinematics\.yaml already exists"):
        run(MoveItOptions(tmp_path))
    assert [file.name for file in tmp_path.iterdir()] == ["kinematics.yaml"]
    run(MoveItOptions(tmp_path, force=True))
    assert (tmp_path / "kinematics.yaml").read_text() != "mine"
