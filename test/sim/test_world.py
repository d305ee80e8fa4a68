"""The world against mechanics, PyBullet's own state and scipy."""

import numpy as np
import pytest
from oracle import assert_poses_close, forward_kinematics
from scipy.spatial.transform import Rotation
from worlds import OUR_G1, Bench

from g1_description.errors import DescriptionError, UnknownNameError

UPRIGHT = np.array([0.0, 0.0, 0.793, 0.0, 0.0, 0.0, 1.0])
TILTED = np.concatenate(
    [[1.0, -2.0, 3.0], Rotation.from_rotvec([0.4, -0.5, 0.6]).as_quat()]
)
TOP = """<robot name="top"><link name="body"><inertial>
<origin xyz="0.1 0.02 -0.03" rpy="0.3 0.2 0.1"/><mass value="2"/>
<inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0.001" ixz="0.002" iyz="-0.003"/>
</inertial><collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision>
</link></robot>"""
ARM = """<robot name="arm"><link name="base"><inertial><mass value="5"/>
<inertia ixx="0.05" iyy="0.05" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="upper"/>
<origin xyz="0 0 0.1" rpy="0.2 0 0.4"/><axis xyz="0 1 1"/>
<limit lower="-1" upper="1.2" effort="10" velocity="5"/></joint>
<link name="upper"><inertial><origin xyz="0 0 0.2" rpy="0.5 0 0"/><mass value="1"/>
<inertia ixx="0.02" iyy="0.03" izz="0.01" ixy="0.001" ixz="0" iyz="0"/></inertial>
</link><joint name="slide" type="prismatic"><parent link="upper"/><child link="rod"/>
<origin xyz="0.05 0 0.2" rpy="0 0.3 0"/><axis xyz="1 0 0"/>
<limit lower="-0.1" upper="0.3" effort="20" velocity="2"/></joint>
<link name="rod"><inertial><mass value="0.5"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="continuous"><parent link="rod"/><child link="tip"/></joint>
<link name="tip"><inertial><mass value="0.2"/>
<inertia ixx="0.01" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
</robot>"""


def random_positions(model, random):
    low = np.maximum(model.lower, -3.1)
    high = np.minimum(model.upper, 3.1)
    return dict(zip(model.joint_names, random.uniform(low, high)))


def link_poses(world, name):
    return dict(zip(world.models[name].link_names, world.models[name].poses))


def assert_all_close(poses, expected, tolerance):
    wanted = np.array([expected[link] for link in poses])
    assert_poses_close(np.array(list(poses.values())), wanted, tolerance)


@pytest.mark.parametrize(
    ("physics", "fixed_base"), [("kinematic", False), ("hold", True), ("limp", False)]
)
def test_the_g1_weighs_what_its_file_says(make_world, g1_text, physics, fixed_base):
    """The world asserts it against PyBullet at load; here the file's sum is known."""
    world = make_world(physics)
    world.spawn_urdf("g1", g1_text, UPRIGHT, fixed_base)
    assert world.models["g1"].assembly.description.mass == pytest.approx(
        35.115, abs=1e-3
    )
    body = world.body("g1").number
    first = 0 if fixed_base and physics != "kinematic" else -1
    loaded = sum(
        world.client.getDynamicsInfo(body, link)[0]
        for link in range(first, world.client.getNumJoints(body))
    )
    pelvis = 3.814 if first == 0 else 0.0
    assert loaded + pelvis == pytest.approx(35.115, abs=1e-3)


def test_set_configurations_are_where_scipy_puts_them(make_world, g1_text):
    """Random configurations within limits, at a tilted pose, kinematic."""
    world, random = make_world("kinematic"), np.random.default_rng(1)
    world.spawn_urdf("g1", g1_text, UPRIGHT)
    for _ in range(10):
        positions = random_positions(world.models["g1"], random)
        world.set_joint_positions("g1", positions)
        world.put("g1", TILTED, np.zeros(6), "")
        world.step()
        assert dict(
            zip(world.models["g1"].joint_names, world.models["g1"].position)
        ) == (positions)
        expected = forward_kinematics(g1_text, TILTED, positions)
        assert_all_close(link_poses(world, "g1"), expected, 1e-9)


def test_moving_links_are_where_scipy_puts_them(make_world):
    """Random configurations in motion: joints and base as PyBullet has them."""
    world, random = make_world("limp"), np.random.default_rng(2)
    world.spawn_urdf("g1", OUR_G1, UPRIGHT + np.array([0, 0, 1, 0, 0, 0, 0]))
    client, body = world.client, world.body("g1").number
    for _ in range(8):
        world.set_joint_positions("g1", random_positions(world.models["g1"], random))
        world.step()
        positions, theirs = {}, {}
        for joint, index in world.joint_numbers("g1").items():
            positions[joint] = client.getJointState(body, index)[0]
            state = client.getLinkState(body, index, computeForwardKinematics=1)
            theirs[world.body("g1").link_names[index]] = np.concatenate(state[4:6])
        poses = link_poses(world, "g1")
        expected = forward_kinematics(OUR_G1, poses["pelvis"], positions)
        assert_all_close(poses, expected, 1e-6)
        del poses["pelvis"]
        assert_all_close(poses, theirs, 5e-6)  # PyBullet rounds them to floats


@pytest.mark.parametrize("physics", ["kinematic", "hold"])
@pytest.mark.parametrize("robot", [TOP, ARM])
def test_the_root_is_told_by_its_frame_not_its_center_of_mass(
    make_world, robot, physics
):
    """What is written to PyBullet comes back, through the center of mass's frame."""
    world = make_world(physics, gravity=(0.0, 0.0, 0.0))
    world.spawn_urdf("thing", robot, TILTED)
    model = world.models["thing"]
    twist = np.array([0.3, -0.2, 0.1, 0.5, 0.6, -0.7])
    world.put("thing", TILTED, twist, "")
    poses, twists = model.poses.copy(), model.twists.copy()
    assert_poses_close(model.root_poses[0], TILTED, 1e-15)
    world.read_back()
    assert_poses_close(model.poses, poses, 1e-12)
    np.testing.assert_allclose(model.twists[0], twists[0], atol=1e-12)
    if physics != "kinematic":
        lever = Rotation.from_quat(TILTED[3:]).apply(
            model.assembly.description.links[0].inertial.center_of_mass
        )
        at_center = model.twists[0, :3] + np.cross(twist[3:], lever)
        np.testing.assert_allclose(at_center, twist[:3], atol=1e-12)


def test_inertia_reaches_pybullet_whole(make_world):
    world = make_world("limp")
    world.spawn_urdf("arm", ARM, TILTED)
    body = world.body("arm").number
    links = world.models["arm"].assembly.description.links
    for index, link in enumerate(links, start=-1):
        info = world.client.getDynamicsInfo(body, index)
        axes = Rotation.from_quat(info[4])
        columns = np.array([axes.apply(axis) for axis in np.eye(3)]).T
        tensor = columns @ np.diag(info[2]) @ columns.T
        np.testing.assert_allclose(tensor, link.inertial.inertia, atol=1e-6)
        np.testing.assert_allclose(info[3], link.inertial.center_of_mass, atol=1e-7)


def test_twists_are_the_slopes_of_poses_in_free_motion(make_world):
    world = make_world("limp", time_step=1e-5)
    world.spawn_urdf("arm", ARM, TILTED)
    world.put("arm", TILTED, np.array([0.3, 0, 0.1, 1.0, 2.0, -1.0]), "")
    model = world.models["arm"]
    for _ in range(50):
        world.step()
    before = model.poses.copy()
    world.step()
    twists = model.twists.copy()
    world.step()
    after = model.poses
    turn = Rotation.from_quat(after[:, 3:]) * Rotation.from_quat(before[:, 3:]).inv()
    slopes = np.hstack([after[:, :3] - before[:, :3], turn.as_rotvec()]) / 2e-5
    np.testing.assert_allclose(twists, slopes, atol=2e-3)


@pytest.mark.parametrize("fixed_base", [False, True])
def test_a_held_arm_stays_and_a_limp_one_sags(make_world, fixed_base):
    """A horizontal arm needs 3.6 N m, less than its effort."""
    angles = {}
    for physics in ("hold", "limp"):
        world = make_world(physics)
        arm = ARM.replace('xyz="0 1 1"', 'xyz="0 1 0"')
        arm = arm.replace('rpy="0.2 0 0.4"', 'rpy="0 1.57 0"')
        world.spawn_urdf("arm", arm, np.array([0, 0, 1, 0, 0, 0, 1]), fixed_base)
        world.set_joint_positions("arm", {"hinge": -0.5})
        for _ in range(300):
            world.step()
        angles[physics] = world.models["arm"].position[0]
        falls = world.models["arm"].pose[2] < 0.9
        assert falls is not fixed_base
    assert angles["hold"] == pytest.approx(-0.5, abs=0.01)
    if fixed_base:
        assert angles["limp"] > -0.2


def test_commands_to_one_joint_let_no_other_creep(make_world):
    """A sagging joint is held where it was set, not where it has sagged to."""
    world = make_world("hold")
    arm = ARM.replace('xyz="0 1 1"', 'xyz="0 1 0"')
    arm = arm.replace('rpy="0.2 0 0.4"', 'rpy="0 1.57 0"')
    world.spawn_urdf("arm", arm, np.array([0, 0, 1, 0, 0, 0, 1]), True)
    world.set_joint_positions("arm", {"hinge": -0.5})
    world.run(0.3)
    held = world.models["arm"].position[0]
    for step in range(500):
        world.set_joint_positions("arm", {"turn": 0.001 * step})
        world.run(0.002)
    assert world.models["arm"].position[0] == pytest.approx(held, abs=1e-4)
    entity = world.entities.link("arm::tip")
    world.set_link_properties(entity, entity.link.inertial, True)
    world.run(0.3)
    assert world.models["arm"].position[0] == pytest.approx(held, abs=1e-4)


def test_a_command_writes_only_the_joints_that_it_changes(make_world):
    """PyBullet keeps what it alone knows of the other joints."""
    world = make_world("hold", gravity=(0.0, 0.0, 0.0))
    world.spawn_urdf("arm", ARM, UPRIGHT, True)
    client, body = world.client, world.body("arm").number
    hinge, slide, turn = 0, 1, 2
    client.resetJointState(body, slide, 0.2)
    client.setJointMotorControl2(
        body, turn, client.POSITION_CONTROL, targetPosition=0.3, force=9.0
    )
    wanted = {"hinge": 0.5, "slide": 0.0}
    assert world.set_joint_positions("arm", wanted).changed == [hinge]
    positions = [client.getJointState(body, joint)[0] for joint in (hinge, slide)]
    assert positions == [0.5, 0.2]
    world.run(0.5)
    assert world.models["arm"].position[turn] == pytest.approx(0.3, abs=0.01)


def run(world, steps=150):
    """Do the same calls at the same steps; give all states as bytes."""
    states = []
    for step in range(steps):
        if step == 50:
            world.set_joint_positions("arm", {"hinge": 1.0})
        if step == 100:
            world.put("arm", UPRIGHT, np.array([1.0, 0, 0, 0, 0, 1]), "")
        world.step()
        states.append(b"".join(part.tobytes() for part in world.link_states()))
    return states


@pytest.mark.parametrize("physics", ["kinematic", "hold"])
def test_the_same_calls_at_the_same_steps_give_the_same_bits(make_world, physics):
    runs = []
    for _ in range(2):
        world = make_world(physics)
        world.spawn_urdf("arm", ARM, UPRIGHT)
        runs.append(run(world))
    assert runs[0] == runs[1]
    assert len(set(runs[0])) > 1
    world.reset()
    assert world.time_ns == 0
    assert run(world) == runs[0]


def test_reset_models_keeps_joints_and_time(make_world):
    world = make_world()
    world.spawn_urdf("arm", ARM, UPRIGHT)
    world.set_joint_positions("arm", {"hinge": 0.5})
    world.put("arm", TILTED, np.zeros(6), "")
    world.step()
    world.reset_models()
    assert (world.models["arm"].pose == UPRIGHT).all()
    assert world.models["arm"].position[0] == 0.5
    assert world.time_ns == 1_000_000
    world.reset()
    assert world.models["arm"].position[0] == 0.0


def test_states_are_told_in_any_frame(make_world):
    world = make_world("limp", gravity=(0.0, 0.0, 0.0))
    world.spawn_urdf("other", TOP, TILTED)
    world.spawn_urdf("top", TOP, UPRIGHT)
    asked = np.concatenate([[1, 2, 3], Rotation.from_rotvec([1, 0, 0]).as_quat()])
    twist = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    world.put("top", asked, twist, "other::body")
    pose, seen = world.model_state("top", "other")
    assert_poses_close(pose, asked, 1e-12)
    np.testing.assert_allclose(seen[3:], twist[3:], atol=1e-12)
    turn = Rotation.from_quat(TILTED[3:])
    world_pose, world_twist = world.model_state("top", "map")
    np.testing.assert_allclose(
        world_pose[:3], TILTED[:3] + turn.apply(asked[:3]), atol=1e-12
    )
    np.testing.assert_allclose(world_twist[3:], turn.apply(twist[3:]), atol=1e-12)


def test_positions_beyond_the_limits_are_clamped_and_told(make_world):
    world = make_world()
    world.spawn_urdf("arm", ARM, UPRIGHT)
    wanted = {"hinge": 9.0, "turn": 100.0, "tail": 1.0, "slide": -1.0}
    report = world.set_joint_positions("arm", wanted)
    assert report.unknown == ["tail"]
    assert report.clamped == {"hinge": (9.0, 1.2), "slide": (-1.0, -0.1)}
    assert list(world.models["arm"].position) == [1.2, -0.1, 100.0]


@pytest.mark.parametrize(
    ("name", "words"),
    [("none.stl", "does not exist"), ("a.ply", "must be one of .dae, .obj, .stl")],
)
def test_a_mesh_that_cannot_be_used_is_named_and_left_out(
    make_world, tmp_path, name, words
):
    (tmp_path / "a.ply").write_text("ply")
    mesh = f'<mesh filename="file://{tmp_path / name}"/>'
    text = TOP.replace('<box size="0.2 0.2 0.2"/>', mesh)
    (clause,) = make_world().spawn_urdf("top", text, UPRIGHT)
    assert clause == f"mesh file://{tmp_path / name} {words}"


def test_what_cannot_be_spawned_leaves_the_world_as_it_was(make_world):
    world = make_world()
    for text in ("garbage", TOP.replace("mass value", "weight value")):
        with pytest.raises(DescriptionError):
            world.spawn_urdf("top", text, UPRIGHT)
    world.spawn_urdf("top", TOP, UPRIGHT)
    with pytest.raises(DescriptionError, match="'top' already exists"):
        world.spawn_urdf("top", TOP, UPRIGHT)
    assert list(world.models) == ["ground_plane", "top"]
    assert world.client.getNumBodies() == 2


def test_names_that_do_not_exist_are_told_with_those_that_do(make_world):
    world = make_world()
    with pytest.raises(UnknownNameError, match="no model 'g2'; there are ground_plane"):
        world.delete("g2")
    with pytest.raises(
        UnknownNameError, match="physics 'magic'; must be one of kinematic"
    ):
        Bench("magic")


def test_a_robot_without_mass_is_there_without_bodies(make_world):
    world = make_world("limp")
    left_out = world.spawn_urdf(
        "ghost", '<robot name="g"><link name="a"/></robot>', UPRIGHT
    )
    assert left_out == ("link a has no mass", "no part of the model can be simulated")
    world.step()
    assert (world.model_state("ghost", "")[0] == UPRIGHT).all()
    world.delete("ghost")
    assert list(world.models) == ["ground_plane"]


# A count of triangles that is right in PyBullet's 32 bits, for a file of 86 bytes.
def test_a_models_twist_is_its_roots_wherever_the_file_has_it(make_world):
    world = make_world("limp", gravity=(0.0, 0.0, 0.0))
    base = ARM.index('<link name="base">')
    upper = ARM.index('<link name="upper">')
    link = ARM[upper : ARM.index("</link>", upper) + len("</link>")]
    world.spawn_urdf("arm", ARM[:base] + link + ARM[base:].replace(link, ""), UPRIGHT)
    assert world.models["arm"].link_names[0] == "upper"
    world.put("arm", UPRIGHT, np.array([0, 0, 0, 0, 0, 1.0]), "")
    np.testing.assert_allclose(world.model_state("arm", "")[1], [0, 0, 0, 0, 0, 1])
