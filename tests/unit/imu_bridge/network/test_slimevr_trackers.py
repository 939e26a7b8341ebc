"""Choice of a tracker; restarts, losses and late datagrams."""

from hypothesis import given
from hypothesis import strategies as st

from pointit.services.imu_bridge.network.slimevr_protocol import Datagram, Handshake
from pointit.services.imu_bridge.network.slimevr_trackers import MOST_CALLERS, Admission, Trackers

ANNA, BEN = ("192.168.1.5", 6969), ("192.168.1.6", 6969)
BOARD = Handshake(1, 2, 19, "0.6.0", "A4:E5:7C:B6:01:02")
OTHER_BOARD = Handshake(1, 2, 19, "0.6.0", "A4:E5:7C:B6:01:03")
PHONE = Handshake(13, 3, 8, "owoTrack8", "")
FIRST, AGAIN = Admission(is_reconnected=True), Admission(is_reconnected=True, keeps_yaw=True)
NEXT = Admission()


def sent(number: int) -> Datagram:
    return Datagram(number, ())


def connected(trackers: Trackers, handshake: Handshake = BOARD, number: int = 5) -> None:
    assert trackers.called(ANNA, handshake, 0.0) is not None
    assert trackers.admit(ANNA, sent(number), 0.1) == FIRST


def test_a_tracker_that_goes_on_calling_beside_the_one_in_use_is_named() -> None:
    trackers = Trackers()
    for second in range(100, 120):
        assert trackers.called(ANNA, BOARD, second) is not None
        trackers.admit(ANNA, sent(second), second + 0.1)
        assert trackers.called(BEN, OTHER_BOARD, second + 0.2) is None
        trackers.step(second + 0.3)
    assert len(trackers.others(119.5)) == 1


def test_datagrams_that_are_late_or_repeated_are_dropped() -> None:
    trackers = Trackers()
    connected(trackers)
    assert trackers.admit(ANNA, sent(8), 0.2) == NEXT
    for late in (8, 7, 1):
        assert trackers.admit(ANNA, sent(late), 0.3) is None
    assert trackers.admit(ANNA, sent(9), 0.4) == NEXT


def test_echoes_and_trackers_without_numbers_pass() -> None:
    trackers = Trackers()
    connected(trackers)
    assert trackers.admit(ANNA, sent(0), 0.2) == NEXT
    assert trackers.admit(ANNA, sent(5), 0.3) is None  # numbers go on where they were


def test_numbers_that_fall_far_are_a_restart() -> None:
    trackers = Trackers()
    connected(trackers, number=5000)
    assert trackers.admit(ANNA, sent(1), 0.2) == FIRST
    assert trackers.admit(ANNA, sent(2), 0.3) == NEXT


def test_a_handshake_in_between_keeps_the_yaw_only_if_the_numbers_run_on() -> None:
    trackers = Trackers()
    connected(trackers, number=50)
    assert trackers.called(ANNA, BOARD, 1.0) is not None
    assert trackers.admit(ANNA, sent(51), 1.1) == AGAIN
    assert trackers.called(ANNA, BOARD, 2.0) is not None
    assert trackers.admit(ANNA, sent(3), 2.1) == FIRST  # restarted, though its numbers fell by few


def test_loss_is_told_once_and_the_same_tracker_may_come_back_without_a_handshake() -> None:
    trackers = Trackers()
    connected(trackers, number=50)
    assert [trackers.step(time_s) for time_s in (1.0, 3.0, 3.2, 4.0)] == [False, False, True, False]
    assert trackers.is_lost
    assert trackers.admit(ANNA, sent(60), 5.0) == AGAIN
    assert not trackers.is_lost


def test_two_phones_without_a_mac_do_not_displace_each_other() -> None:
    trackers = Trackers()
    connected(trackers, PHONE)
    assert trackers.called(BEN, PHONE, 0.2) is None
    assert trackers.admit(BEN, sent(100), 0.3) is None
    assert trackers.admit(ANNA, sent(6), 0.4) == NEXT
    assert trackers.called(BEN, PHONE, 1.4) is None
    assert trackers.others(1.5) == ["192.168.1.6 (owoTrack8)"]
    assert trackers.called(BEN, PHONE, 9.0) is None  # a gap of the first does not hand its place over
    assert trackers.called(BEN, PHONE, 10.5) is not None
    assert trackers.admit(BEN, sent(1), 10.6) == FIRST


def test_a_board_that_comes_back_at_another_address_is_the_same() -> None:
    trackers = Trackers()
    connected(trackers, number=50)
    elsewhere = ("192.168.1.77", 6969)
    assert trackers.called(elsewhere, BOARD, 0.5) is None  # while the first is there, it is another one
    assert trackers.called(elsewhere, BOARD, 2.0) is not None
    assert trackers.admit(elsewhere, sent(60), 2.1) == AGAIN
    assert trackers.admit(ANNA, sent(61), 2.2) is None


def test_only_the_named_tracker_is_answered() -> None:
    for name in (OTHER_BOARD.mac, BEN[0]):
        trackers = Trackers(name)
        assert trackers.called(ANNA, BOARD, 0.0) is None
        assert trackers.called(ANNA, BOARD, 2.0) is None
        assert trackers.admit(ANNA, sent(1), 2.1) is None
        assert trackers.others(2.2) == ["A4:E5:7C:B6:01:02 (0.6.0 at 192.168.1.5)"]
        assert trackers.called(BEN, OTHER_BOARD, 2.3) is not None
        assert trackers.admit(BEN, sent(1), 2.4) == FIRST
        assert [each.address for each in trackers.answered(2.5)] == [BEN]
        assert trackers.answered(20.0) == []


def test_a_second_tracker_that_was_answered_in_vain_is_let_go() -> None:
    trackers = Trackers()
    for address, board in ((ANNA, BOARD), (BEN, OTHER_BOARD)):
        assert trackers.called(address, board, 0.0) is not None
    assert trackers.admit(ANNA, sent(1), 0.1) == FIRST
    assert trackers.admit(BEN, sent(1), 0.1) is None
    assert [each.address for each in trackers.answered(0.2)] == [ANNA]


def test_callers_beyond_the_limit_are_ignored_but_for_the_named_one() -> None:
    trackers = Trackers(BOARD.mac)
    for number in range(100):
        trackers.called((f"10.0.0.{number}", 6969), PHONE, 0.0)
        trackers.called((f"10.0.1.{number}", 6969), BOARD, 0.0)
        assert len(trackers._known) <= MOST_CALLERS
    assert trackers.called(ANNA, BOARD, 0.1) is not None
    assert trackers.admit(ANNA, sent(1), 0.2) == FIRST
    trackers.step(20.0)
    assert len(trackers._known) == 1


@given(
    st.lists(
        st.tuples(
            st.integers(0, 30),
            st.sampled_from([BOARD, OTHER_BOARD, PHONE, None]),
            st.integers(0, 300),
            st.floats(0, 5),
        ),
        max_size=80,
    ),
    st.sampled_from(["", BOARD.mac, "10.0.0.1"]),
)
def test_any_sequence_of_datagrams_is_bounded_and_uses_one_tracker(
    events: list[tuple[int, Handshake | None, int, float]], wanted: str
) -> None:
    trackers, now_s = Trackers(wanted), 0.0
    for host, handshake, number, wait_s in events:
        now_s += wait_s
        address = (f"10.0.0.{host}", 6969)
        if handshake is not None:
            trackers.called(address, handshake, now_s)
        elif trackers.admit(address, sent(number), now_s) is not None:
            assert trackers.used is not None
            assert trackers.used.address == address
            assert not wanted or trackers.used.is_named(wanted)
        trackers.step(now_s)
        assert len(trackers._known) <= MOST_CALLERS
