"""Times of sensor frames of a watch."""

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.services.imu_bridge.ble.touch_sdk import NS_PER_MS, FrameTimes
from pointit.services.imu_bridge.ble.touch_sdk_messages import SensorFrame, Update


def update(*deltas_ms: int, unix_ms: int = 0, delta_ms: int = 0) -> Update:
    frames = tuple(SensorFrame((0, 0, 0), (0, 0, 9.8), (0, 0, 0, 1), each) for each in deltas_ms)
    return Update(frames, (), (), (), (), delta_ms, unix_ms, None)


def read(*updates: Update) -> list[list[int | None]]:
    """Return the times of the frames of successive messages, ms."""
    times = FrameTimes()
    return [
        [None if each is None else each // NS_PER_MS for each in times.read(message)] for message in updates
    ]


@pytest.mark.parametrize(
    ("updates", "times_ms"),
    [
        ([update(20, unix_ms=1000), update(20, 20, unix_ms=1040)], [[1000], [1020, 1040]]),
        ([update(20), update(20, 10), update(10)], [[20], [40, 50], [60]]),
        ([update(0, delta_ms=20), update(0, 0, delta_ms=30)], [[20], [50, 50]]),
        ([update(20, unix_ms=1000), update(20), update(20, unix_ms=1041)], [[1000], [1020], [1041]]),
        ([update(20, unix_ms=1000), update(20, 90, unix_ms=1040)], [[1000], [1000, 1040]]),
        ([update(20, unix_ms=9000), update(20, unix_ms=1000)], [[9000], [1000]]),
        ([update(20, unix_ms=1000), update(), update(20, unix_ms=1020)], [[1000], [], [1020]]),
        ([update(0), update(0, 0)], [[None], [None, None]]),
        ([update(-5), update(2**31 - 1)], [[None], [None]]),
        ([update(20, unix_ms=-1), update(20, unix_ms=2**63 - 1)], [[20], [40]]),
    ],
)
def test_frames_have_the_time_of_their_message_and_their_distance_before(
    updates: Sequence[Update], times_ms: object
) -> None:
    assert read(*updates) == times_ms


Integers = st.integers(-(2**31), 2**31 - 1)


@given(
    st.lists(
        st.builds(update, Integers, Integers, unix_ms=st.integers(-(2**63), 2**63 - 1), delta_ms=Integers)
    )
)
def test_any_times_give_one_time_a_frame_that_messages_can_hold(updates: list[Update]) -> None:
    for times_ms in read(*updates):
        assert len(times_ms) == 2
        assert all(each is None or 0 <= each < 2**62 // NS_PER_MS for each in times_ms)
