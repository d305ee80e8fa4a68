"""Which limb a joint belongs to, by its name."""

from __future__ import annotations

import pytest

from g1_description.motion.files.conventions import G1_JOINTS
from g1_description.robot.description import OTHER, by_limb, limb_of


def test_the_g1_has_two_legs_a_waist_and_two_arms():
    found = by_limb(G1_JOINTS[29])
    counts = {limb: len(names) for limb, names in found.items()}
    assert counts == {
        "left leg": 6,
        "right leg": 6,
        "waist": 3,
        "left arm": 7,
        "right arm": 7,
    }
    assert [name for names in found.values() for name in names] == [*G1_JOINTS[29]]


def test_hands_are_no_arms():
    fingers = [
        f"{side}_hand_{finger}_joint"
        for side in ("left", "right")
        for finger in ("thumb_0", "thumb_1", "middle_0", "index_1")
    ]
    found = by_limb([*G1_JOINTS[29], *fingers])
    assert found["left hand"] == fingers[:4]
    assert found["right hand"] == fingers[4:]
    assert len(found["left arm"]) == 7


@pytest.mark.parametrize(
    ("name", "limb"),
    [
        ("l_hip_yaw", "left leg"),
        ("R-Ankle-Roll", "right leg"),
        ("left_wrist_yaw_joint", "left arm"),
        ("l_little_finger_2", "left hand"),
        ("R_thumb_proximal", "right hand"),
        ("torso_yaw", "waist"),
        ("neck_pitch", "head"),
        ("elbow", "arm"),
        ("joint_1", OTHER),
        ("left_joint", OTHER),  # a side alone is no limb
        ("shipping_door", OTHER),  # a hip within a word is none
        ("", OTHER),
    ],
)
def test_names_of_others(name, limb):
    assert limb_of(name) == limb


def test_joints_of_a_limb_need_not_stand_together():
    found = by_limb(["left_knee", "lift", "right_knee", "left_ankle", "lid"])
    assert found == {
        "left leg": ["left_knee", "left_ankle"],
        OTHER: ["lift", "lid"],
        "right leg": ["right_knee"],
    }
    assert by_limb([]) == {}
