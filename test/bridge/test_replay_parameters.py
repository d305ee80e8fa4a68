"""What the node replay refuses."""

import pytest

pytest.importorskip("rospy", reason="rospy is not installed")

from g1_description.bridge.replay import ReplayParameters
from g1_description.errors import InvalidValueError


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({}, "No motion file; give motion:=FILE or bag:=FILE."),
        ({"motion": "/a", "bag": "/b"}, "motion:= and bag:= cannot be combined."),
        ({"motion": "a.csv"}, "absolute path (got 'a.csv'); try $PWD/a.csv."),
        ({"bag": "~/a.bag"}, "absolute path (got '~/a.bag')."),
        ({"motion": "/a", "speed": 0.0}, "~speed must be from 0.001 to 1000.0"),
        ({"motion": "/a", "fps": -1.0}, "~fps must be from 0.0"),
        ({"motion": "/a", "publish_rate": 0.0}, "~publish_rate must be from 0.1"),
    ],
)
def test_wrong_parameters_are_told(given, told):
    with pytest.raises(InvalidValueError) as caught:
        ReplayParameters(**given)
    assert told in str(caught.value)


def test_a_file_of_either_kind():
    assert ReplayParameters(motion="/a").file == "/a"
    assert ReplayParameters(bag="/b", speed=1e-3, publish_rate=0.1).file == "/b"
