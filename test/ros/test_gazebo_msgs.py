"""Hold our definitions of gazebo_msgs against the md5 sums of gazebo_ros."""

import re

import pytest
from definitions import DESIGN, Definitions

DEFINITIONS = Definitions(
    "gazebo_msgs", ["geometry_msgs", "std_msgs", "trajectory_msgs"]
)
TABLE = DESIGN / "gazebo_msgs.md"

MESSAGES = {
    "ContactState": "48c0ffb054b8c444f870cecea1ee50d9",
    "ContactsState": "acbcb1601a8e525bf72509f18e6f668d",
    "LinkState": "0818ebbf28ce3a08d48ab1eaa7309ebe",
    "LinkStates": "48c080191eb15c41858319b4d8a609c2",
    "ModelState": "9330fd35f2fcd82d457e54bd54e10593",
    "ModelStates": "48c080191eb15c41858319b4d8a609c2",
    "ODEJointProperties": "1b744c32a920af979f53afe2f9c3511f",
    "ODEPhysics": "667d56ddbd547918c32d1934503dc335",
    "PerformanceMetrics": "884f71fd5037b886ec5e126b83c4425a",
    "SensorPerformanceMetric": "01762ded18cfe9ebc7c8222667c99547",
    "WorldState": "de1a9de3ab7ba97ac0e9ec01a4eb481e",
}
SERVICES = {
    "ApplyBodyWrench": "585b9f9618aa0581b207e2f2d90866bc",
    "ApplyJointEffort": "c0039811b8cc919490b3cff748cdf46b",
    "BodyRequest": "5eade9afe7f232d78005bd0cafeab755",
    "DeleteLight": "ae11ea8100d536d5b92c2b5917abf912",
    "DeleteModel": "9ce56b4e9e54616de25d796dc972a262",
    "GetJointProperties": "7b30be900f50aa21efec4a0ec92d91c9",
    "GetLightProperties": "df2cef87e13e2e6990e81e8aaa454c19",
    "GetLinkProperties": "0e06a70386d0ee3fb880c02f23fcd821",
    "GetLinkState": "09d6c98cce97b35f7ab9bd70300657ab",
    "GetModelProperties": "5717f7bd34ed990fa80e28b3015027a3",
    "GetModelState": "4c515e936d3319c9610c559c60bfc3d4",
    "GetPhysicsProperties": "575a5e74786981b7df2e3afc567693a6",
    "GetWorldProperties": "36bb0f2eccf4d8be971410c22818ba3f",
    "JointRequest": "0be1351618e1dc030eb7959d9a4902de",
    "SetJointProperties": "15a76e921b1410c698d82782ea5fa370",
    "SetJointTrajectory": "88f5c10979e3f9649d5ae87a3b12aa65",
    "SetLightProperties": "e6f13430c57278bb364aca53a1bf5ebf",
    "SetLinkProperties": "d534ce1b36ee99de0ffa806c3a6348f0",
    "SetLinkState": "8a5146eb66ae4d26b0860b08f3f271be",
    "SetModelConfiguration": "10e3139d3b669c40afc057d38956fff7",
    "SetModelState": "5b3ab0281d4f5445def017e3a2e4a07b",
    "SetPhysicsProperties": "97e2057080558ce4730434b5fae75c91",
    "SpawnModel": "9ed9c82c96abe1a00c3e8cdaeee24413",
}
TYPES = [("msg", *item) for item in MESSAGES.items()] + [
    ("srv", *item) for item in SERVICES.items()
]


@pytest.mark.parametrize(("kind", "name", "md5"), TYPES)
def test_definition_has_the_md5_sum_of_gazebo_ros(kind, name, md5):
    assert DEFINITIONS.md5_of_file(kind, name) == md5


@pytest.mark.parametrize(("kind", "table"), [("msg", MESSAGES), ("srv", SERVICES)])
def test_every_definition_is_in_the_table(kind, table):
    assert {path.stem for path in (DEFINITIONS.folder / kind).iterdir()} == set(table)


@pytest.mark.parametrize("kind", ["msg", "srv"])
def test_the_build_generates_every_definition(kind):
    listed = re.findall(
        rf"^ +(\w+\.{kind})$", (DEFINITIONS.folder / "CMakeLists.txt").read_text(), re.M
    )
    assert listed == sorted(path.name for path in (DEFINITIONS.folder / kind).iterdir())


@pytest.mark.parametrize("kind", ["msg", "srv"])
def test_the_built_classes_have_the_same_md5_sums(kind):
    built = pytest.importorskip(f"gazebo_msgs.{kind}")
    table = {name: md5 for of_kind, name, md5 in TYPES if of_kind == kind}
    assert {name: getattr(built, name)._md5sum for name in table} == table


def test_the_table_agrees_with_the_design():
    if not TABLE.exists():
        pytest.skip(f"{TABLE} is not there")
    rows = re.findall(r"^\| `(\w+)` \| ([0-9a-f]{32}) \|", TABLE.read_text(), re.M)
    assert dict(rows) == {**MESSAGES, **SERVICES}
    assert len(rows) == len(TYPES)
