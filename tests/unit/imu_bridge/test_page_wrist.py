"""A wrist that a page moves, without a bus: valid samples, arm orientation, yaw origins."""

import itertools
import math
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry import rotation, vector
from pointit.geometry.rotation import Quaternion
from pointit.schemas import NS_PER_S, ImuSample, WristSample
from pointit.services.imu_bridge.arm_frame import MOUNTINGS
from pointit.services.imu_bridge.page_wrist import PageOrientation, PageWrist
from pointit.services.localizer.pose_manager import YawOrigin

START_NS = 1_700_000_000 * NS_PER_S
Device = Literal["arm", "phone"]


def at(time_s: float) -> int:
    return START_NS + round(time_s * NS_PER_S)


class Hand:
    """A page at a time in seconds, as it comes to a bridge at once unless told otherwise."""

    def __init__(self) -> None:
        self.page = PageWrist(MOUNTINGS["phone"], itertools.count(1))
        self.home: int | None = 0

    def send(
        self,
        time_s: float,
        device: Device = "arm",
        turned: Quaternion = rotation.IDENTITY,
        *,
        session: int = 0,
        comes_s: float | None = None,
        device_time_ns: int | None = None,
    ) -> PageOrientation | None:
        sample = WristSample(
            stamp_ns=at(time_s),
            orientation_xyzw=turned,
            device=device,
            session=session,
            device_time_ns=device_time_ns,
        )
        return self.page.take(sample, at(time_s if comes_s is None else comes_s), home=self.home)

    def epoch(self, time_s: float, device: Device = "arm", session: int = 0) -> int:
        turned = self.send(time_s, device, session=session)
        assert turned is not None
        return turned.yaw_epoch


def finger(turned: PageOrientation | None) -> vector.Vec3:
    assert turned is not None
    return rotation.rotate(turned.orientation_xyzw, (1.0, 0.0, 0.0))


def test_a_mouses_arm_is_taken_as_it_is_and_a_phone_points_with_its_top() -> None:
    hand = Hand()
    arm = rotation.from_azimuth_elevation(0.4, -0.2)
    assert finger(hand.send(0.0, "arm", arm)) == pytest.approx(vector.direction(0.4, -0.2))
    flat = hand.send(0.1, "phone", rotation.from_yaw(0.3))
    assert finger(flat) == pytest.approx(vector.direction(0.3 + math.pi / 2.0, 0.0))
    hand.page.set_phone_mounting(MOUNTINGS["plus_x"])
    assert finger(hand.send(0.2, "phone", rotation.from_yaw(0.3))) == pytest.approx(vector.direction(0.3, 0))


def test_it_has_the_wrist_until_its_patience_is_over() -> None:
    hand = Hand()
    assert not hand.page.is_active(at(0.0))
    hand.send(0.0)
    assert hand.page.is_active(at(1.0))
    assert not hand.page.is_active(at(1.01))
    assert hand.page.is_active(at(9.0), speed=10.0)  # a second of the wall is ten of the site


def test_what_is_older_than_what_came_is_left_out_and_still_keeps_the_wrist() -> None:
    hand = Hand()
    assert hand.send(0.2) is not None
    assert hand.send(0.1, comes_s=0.9) is None
    assert hand.page.late == 1
    assert hand.page.is_active(at(1.8))
    assert hand.send(0.2, comes_s=1.0) is not None  # said again, not older


def test_one_from_the_future_is_left_out_and_does_not_make_the_others_late() -> None:
    hand = Hand()
    assert hand.send(7.0, comes_s=0.0) is None
    assert hand.page.ahead_ns == 7 * NS_PER_S
    assert hand.send(0.1) is not None
    assert hand.page.ahead_ns is None  # pyrefly: ignore[unnecessary-comparison]  # changed meanwhile


def test_a_clock_that_is_set_back_does_not_lock_the_page_out() -> None:
    hand = Hand()
    hand.send(1000.0)
    assert hand.send(10.0) is not None
    assert hand.page.late == 0


def test_a_mouse_leaves_the_origin_as_it_is_and_a_phone_has_its_own_in_each_session() -> None:
    hand = Hand()
    assert hand.epoch(0.0) == 0
    assert hand.epoch(5.0) == 0  # gave back, took again
    first = hand.epoch(10.0, "phone", 1)
    assert first != 0
    assert hand.epoch(10.1, "phone", 1) == first
    assert hand.epoch(20.0, "phone", 1) == first  # the same session is back
    assert hand.epoch(20.1, "arm") == first  # the pose may be of the phone's yaw by now
    assert hand.epoch(20.2, "phone", 1) == first
    second = hand.epoch(20.3, "phone", 2)
    assert second not in (0, first)
    assert hand.epoch(30.0, "arm", 7) == 0  # the own source continued meanwhile
    hand.home = None
    assert hand.epoch(40.0, "phone", 2) == second
    assert hand.epoch(50.0, "arm") == second  # nobody else has it, so the pose is the phone's still


def test_device_time_is_passed_on_for_a_phone_alone_and_for_a_still_one_only_once() -> None:
    """A mouse's page would seem to be a restarted wristband. A repeated time would mean a repeated sample."""
    hand = Hand()
    devices: list[tuple[Device, int]] = [("arm", 5), ("phone", 6), ("phone", 6), ("phone", 6), ("phone", 7)]
    turned = [hand.send(0.1, device, device_time_ns=time_ns) for device, time_ns in devices]
    assert [each and each.device_time_ns for each in turned] == [None, 6, None, None, 7]


def test_a_phone_is_centred_and_stays_so_a_mouses_arm_until_it_lets_go() -> None:
    hand = Hand()
    devices: tuple[Device, ...] = ("phone", "arm")
    for began_s, device in enumerate(devices):
        before = hand.epoch(10.0 * began_s, device)
        hand.page.turn_to(0.5)
        turned = hand.send(10.0 * began_s + 0.1, device)
        assert vector.azimuth(finger(turned)) == pytest.approx(0.5)
        assert turned is not None
        assert turned.yaw_epoch != before
    assert vector.azimuth(finger(hand.send(20.0, "phone"))) == pytest.approx(0.5)
    assert vector.azimuth(finger(hand.send(30.0, "arm"))) == pytest.approx(0.0)
    assert hand.epoch(30.1, "arm") == 0


def test_an_arm_that_points_up_has_no_azimuth_and_one_that_never_came_neither() -> None:
    hand = Hand()
    with pytest.raises(ValueError, match="nothing yet"):
        hand.page.turn_to(0.0)
    hand.send(0.0, "arm", rotation.from_azimuth_elevation(0.0, math.radians(85)))
    with pytest.raises(ValueError, match="hold it level"):
        hand.page.turn_to(0.0)


def test_a_phone_worn_otherwise_has_another_origin() -> None:
    hand = Hand()
    hand.page.set_phone_mounting(MOUNTINGS["minus_x"])  # nobody has seen one yet
    assert hand.epoch(0.0, "phone") == 1
    hand.page.set_phone_mounting(MOUNTINGS["plus_x"])
    assert hand.epoch(0.1, "phone") == 2


Step = tuple[Device, int, bool]


@given(st.lists(st.tuples(st.sampled_from(["arm", "phone"]), st.integers(1, 3), st.booleans()), max_size=30))
def test_the_localizer_is_told_of_every_new_origin_and_of_no_other(steps: list[Step]) -> None:
    """Between pages a simulated person moves the wrist, with samples of number 0."""
    hand, origin = Hand(), YawOrigin()
    time_s, session, phone, was = 0.0, 0, "", "home"

    def change(epoch: int) -> bool:
        sample = ImuSample(stamp_ns=at(time_s), orientation_xyzw=rotation.IDENTITY, yaw_epoch=epoch)
        return bool(origin.add(sample))

    change(0)
    for device, of_phone, gives_back in steps:
        time_s += 0.1
        if device == "phone" and of_phone != session:
            session, now = of_phone, f"phone, {time_s}"
            phone = now
        elif device == "phone":
            now = phone
        else:
            now = was
        assert change(hand.epoch(time_s, device, of_phone)) == (now != was)
        was = now
        if gives_back:
            time_s += 5.0
            assert change(0) == (was != "home")
            was = "home"
