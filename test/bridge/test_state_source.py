"""Stamps rise strictly, and are the states' own wherever they can be."""

from hypothesis import given
from hypothesis import strategies as st

from g1_description.bridge.state_source import (
    MAX_CLOCK_LAG,
    MAX_CLOCK_LEAD,
    MAX_STEP_BACK,
    RisingStamps,
)

times = st.integers(1, 10**12)


def stamp_of(rising, time):
    """Take a state whose time is the clock's."""
    return rising.next(time, time)


@given(st.lists(times, min_size=1, unique=True).map(sorted))
def test_stamps_that_rise_stay_as_they_are(stamps):
    rising = RisingStamps()
    assert [stamp_of(rising, stamp) for stamp in stamps] == [
        (stamp, False) for stamp in stamps
    ]


@given(st.lists(st.one_of(times, st.none()), min_size=1))
def test_no_stamp_comes_twice_between_two_resets(stamps):
    """None is the last state once more."""
    rising, last = RisingStamps(), 0
    for stamp in stamps:
        given, went_back = (
            (rising.again(), False) if stamp is None else stamp_of(rising, stamp)
        )
        assert given > (0 if went_back else last)
        last = given


def test_states_of_one_instant_are_a_nanosecond_apart():
    rising = RisingStamps()
    assert stamp_of(rising, 5_000_000) == (5_000_000, False)
    assert stamp_of(rising, 5_000_000) == (5_000_001, False)
    assert rising.again() == 5_000_002
    assert stamp_of(rising, 5_000_000) == (5_000_003, False)
    assert stamp_of(rising, 6_000_000) == (6_000_000, False)


def test_time_that_goes_back_is_noticed():
    rising, step = RisingStamps(), MAX_STEP_BACK
    stamp_of(rising, 10 * step)
    assert stamp_of(rising, 9 * step + 1) == (10 * step + 1, False)
    assert stamp_of(rising, 9 * step) == (9 * step, True)
    assert stamp_of(rising, 9 * step + 5) == (9 * step + 5, False)


def test_a_reset_after_a_single_step_is_noticed():
    rising = RisingStamps()
    stamp_of(rising, 1_000_000)
    assert stamp_of(rising, 0) == (1, True)
    assert stamp_of(rising, 1_000_000) == (1_000_000, False)


def test_time_zero_is_no_stamp():
    """A header with it means in ROS that it has none."""
    assert stamp_of(RisingStamps(), 0) == (1, False)
    assert RisingStamps().again() == 1


def test_a_state_from_before_a_reset_is_refused_until_one_of_the_new_time_comes():
    rising, late = RisingStamps(), 60 * MAX_CLOCK_LEAD
    stamp_of(rising, late)
    assert rising.is_ahead_of(0)
    for now in (0, 1, 5_000_000):
        assert rising.next(late, now) is None
    assert rising.next(6_000_000, 5_000_000) == (6_000_000, True)
    assert not rising.is_ahead_of(5_000_000)
    assert rising.next(late, 7_000_000) == (late, False)


def test_a_clock_that_is_a_little_late_is_no_reset():
    rising, late = RisingStamps(), 60 * MAX_CLOCK_LEAD
    stamp_of(rising, late)
    assert not rising.is_ahead_of(late - MAX_CLOCK_LAG)
    assert rising.next(late + 1, late - MAX_CLOCK_LAG) == (late + 1, False)
