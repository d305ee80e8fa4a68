"""Stamps rise strictly, and are the states' own wherever they can be."""

from hypothesis import given
from hypothesis import strategies as st

from g1_description.core.bridge.stamps import INSTANT, RisingStamps

times = st.integers(1, 10**12)


@given(st.lists(times, min_size=1, unique=True).map(sorted))
def test_stamps_that_rise_stay_as_they_are(stamps):
    rising = RisingStamps()
    assert [rising.next(stamp) for stamp in stamps] == [
        (stamp, False) for stamp in stamps
    ]


@given(st.lists(st.one_of(times, st.none()), min_size=1))
def test_no_stamp_comes_twice_between_two_resets(stamps):
    """None is the last state once more."""
    rising, last = RisingStamps(), 0
    for stamp in stamps:
        given, went_back = (
            (rising.again(), False) if stamp is None else (rising.next(stamp))
        )
        assert given > (0 if went_back else last)
        last = given


def test_states_of_one_instant_are_a_nanosecond_apart():
    rising = RisingStamps()
    assert rising.next(5_000_000) == (5_000_000, False)
    assert rising.next(5_000_000) == (5_000_001, False)
    assert rising.again() == 5_000_002
    assert rising.next(5_000_000) == (5_000_003, False)
    assert rising.next(6_000_000) == (6_000_000, False)


def test_time_that_goes_back_is_told():
    rising = RisingStamps()
    rising.next(10 * INSTANT)
    assert rising.next(9 * INSTANT + 1) == (10 * INSTANT + 1, False)
    assert rising.next(9 * INSTANT) == (9 * INSTANT, True)
    assert rising.next(9 * INSTANT + 5) == (9 * INSTANT + 5, False)


def test_a_reset_after_a_single_step_is_told():
    rising = RisingStamps()
    rising.next(1_000_000)
    assert rising.next(0) == (1, True)
    assert rising.next(1_000_000) == (1_000_000, False)


def test_time_zero_is_no_stamp():
    """A header with it means in ROS that it has none."""
    assert RisingStamps().next(0) == (1, False)
    assert RisingStamps().again() == 1
