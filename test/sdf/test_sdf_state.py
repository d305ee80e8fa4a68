"""A world that Gazebo saved begins as it was then, told by scipy and by hand."""

import numpy as np
import pytest
from oracle import angle_of
from scipy.spatial.transform import Rotation

from g1_description.sdf.world import read_sdf

HINGES = """<link name="base"><pose>0.1 0.2 0 0 0 0.5</pose></link>
<link name="arm"><pose relative_to="base">0 0 1 0 0 0</pose></link>
<link name="rod"><pose relative_to="arm">1 0 0 0 0 0</pose></link>
<link name="free"><pose>0 3 0 0 0 0</pose></link>
<joint name="turn" type="revolute"><parent>base</parent><child>arm</child>
<axis><xyz>0 0 1</xyz><limit><lower>-2</lower><upper>2</upper></limit></axis></joint>
<joint name="slide" type="prismatic"><parent>arm</parent><child>rod</child>
<axis><xyz>1 0 0</xyz><limit><lower>-0.5</lower><upper>0.5</upper></limit></axis>
</joint>"""
BASE = np.array([4.0, -1.0, 0.5, 0.3, -0.2, 2.0])
"""Where the base was, as SDF writes it: x y z roll pitch yaw."""


def pose_text(xyz, rotation):
    numbers = [*xyz, *rotation.as_euler("xyz")]
    return " ".join(f"{number:.17g}" for number in numbers)


def world(state, model=HINGES, pose="9 9 9 0 0 0"):
    return read_sdf(
        f'<sdf version="1.7"><world name="w"><model name="m"><pose>{pose}</pose>'
        f'{model}</model><light name="lamp" type="point"/>{state}</world></sdf>'
    )


def saved(turn, slide):
    """Write the state of the model with its joints somewhere."""
    base = Rotation.from_euler("xyz", BASE[3:])
    arm = base * Rotation.from_rotvec([0.0, 0.0, turn])
    elbow = BASE[:3] + base.apply([0.0, 0.0, 1.0])
    places = {
        "base": (BASE[:3], base),
        "arm": (elbow, arm),
        "rod": (elbow + arm.apply([1.0 + slide, 0.0, 0.0]), arm),
        "free": (np.array([7.0, 7.0, 7.0]), Rotation.from_euler("xyz", [0, 1, 0])),
    }
    links = "".join(
        f'<link name="{name}"><pose>{pose_text(*place)}</pose>'
        "<velocity>0 0 0 0 0 0</velocity></link>"
        for name, place in places.items()
    )
    root = f"<pose>{pose_text(*places['base'])}</pose><scale>1 1 1</scale>"
    text = (
        '<state world_name="w"><sim_time>340 20000000</sim_time><iterations>9'
        f'</iterations><model name="m">{root}{links}</model><light name="lamp">'
        "<pose>1 2 3 0 0 0</pose></light></state>"
    )
    return text, places


def test_all_is_where_it_was_when_the_world_was_saved(make_world):
    turn, slide = 1.25, -0.3
    text, places = saved(turn, slide)
    content = world(text)
    assert content.left_out == ()
    assert content.time == pytest.approx(340.02, abs=1e-9)
    assert list(content.lights[0].pose[:3]) == [1.0, 2.0, 3.0]
    simulated = make_world(content=content)
    assert simulated.time_ns == 340_020_000_000
    model = simulated.model("m")
    assert dict(zip(model.joint_names, model.position)) == pytest.approx(
        {"turn": turn, "slide": slide}, abs=1e-9
    )
    base = Rotation.from_euler("xyz", BASE[3:])
    frame = base * Rotation.from_rotvec([0.0, 0.0, -0.5])
    places["the model"] = BASE[:3] - frame.apply([0.1, 0.2, 0.0]), frame
    found = [*zip(model.link_names, model.poses), ("the model", model.pose)]
    for name, pose in found:
        xyz, rotation = places[name]
        np.testing.assert_allclose(pose[:3], xyz, atol=1e-9)
        assert angle_of(Rotation.from_quat(pose[3:]).inv() * rotation) < 1e-9


def test_a_door_that_hangs_on_the_world_is_as_open_as_it_was(make_world):
    """Its first link carries the model's frame, so its pose in the state is turned."""
    door = """<link name="door"><pose>0.5 0 0 0 0 0</pose></link>
    <joint name="hinge" type="revolute"><parent>world</parent><child>door</child>
    <pose>-0.5 0 0 0 0 0</pose><axis><xyz>0 0 1</xyz><limit><lower>-1</lower>
    <upper>1</upper></limit></axis></joint>"""
    turned = Rotation.from_rotvec([0.0, 0.0, 0.8])
    place = turned.apply([0.5, 0.0, 0.0]) + np.array([1.0, 2.0, 0.0])
    state = (
        f'<state><model name="m"><pose>1 2 0 0 0 0.8</pose><link name="door"><pose>'
        f"{pose_text(place, turned)}</pose></link></model></state>"
    )
    model = make_world(content=world(state, door, "1 2 0 0 0 0")).model("m")
    assert model.position == pytest.approx([0.8], abs=1e-9)
    np.testing.assert_allclose(model.poses[0][:3], place, atol=1e-9)


def test_a_joint_beyond_its_limits_begins_at_the_limit():
    """ODE lets joints go beyond their stops."""
    text, _ = saved(2.01, 0.0)
    (model,) = world(text).models
    assert model.assembly.positions["turn"] == 2.0


def test_what_a_state_does_not_tell_stays_as_the_file_has_it(make_world):
    state = (
        '<state><model name="m"><link name="base"/></model><model name="x"/></state>'
    )
    content = world(state, pose="1 2 3 0 0 0")
    model = make_world(content=content).model("m")
    assert model.pose[:3].tolist() == [1.0, 2.0, 3.0]
    assert content.time == 0.0


def test_a_state_that_is_wrong_is_left_out_as_a_whole():
    state = """<state><sim_time>5 0</sim_time><model name="m"><pose>1 1 1 0 0 0</pose>
    </model><model name="m"><pose>one</pose></model></state>"""
    content = world(state, pose="1 2 3 0 0 0")
    (told,) = content.left_out
    assert told.startswith(
        "state is ignored: The pose of the state of m must be a number"
    )
    assert content.time == 0.0
    assert content.models[0].pose[:3].tolist() == [1.0, 2.0, 3.0]


def test_a_later_state_wins_in_what_it_tells():
    first = """<state><sim_time>5 0</sim_time><model name="m"><pose>1 1 1 0 0 0</pose>
    </model></state>"""
    lamp = '<light name="lamp"><pose>1 2 3 0 0 0</pose></light>'
    content = world(f"{first}<state>{lamp}</state>")
    assert content.time == 5.0
    assert content.models[0].pose[:3].tolist() == [1.0, 1.0, 1.0]
    assert content.lights[0].pose[:3].tolist() == [1.0, 2.0, 3.0]
    content = world(f"{first}{first.replace('1 1 1', '2 2 2').replace('5 0', '6 0')}")
    assert (content.time, content.models[0].pose[0]) == (6.0, 2.0)
