"""The wrist on the bus, and that of pages."""

import itertools
import math
from collections.abc import Iterable
from typing import Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.geometry import rotation, vector
from pointit.geometry.rotation import Quaternion
from pointit.schemas import NS_PER_S, ImuSample, WristSample
from pointit.services.imu_bridge.arm_frame import MOUNTINGS
from pointit.services.imu_bridge.device_clock import MAX_AGE_NS, DeviceClock, slope_below
from pointit.services.imu_bridge.device_wrist import STORM, WristMonitor
from pointit.services.imu_bridge.orientation_check import FROZEN_S, Values
from pointit.services.imu_bridge.page_wrist import PageOrientation, PageWrist
from pointit.services.imu_bridge.page_wrist import warnings as page_warnings
from pointit.services.localizer.pose_manager import YawOrigin

STEP = 1e-4


def monitor() -> WristMonitor:
    monitor = WristMonitor("anna's wrist (fake)", silence_s=3.0)
    monitor.on_connected(0.0)
    return monitor


def send(wrist: WristMonitor, times_s: Iterable[float], values: Values | None = None) -> None:
    """Send readings, with a report after each second; other values each time unless they are given."""
    for number, time_s in enumerate(times_s):
        wrist.on_reading(values or (number * STEP, 0.0, 0.0, 1.0), time_s)
        if number % 50 == 49:
            list(wrist.report(time_s))


def at_50_hz(first_s: float, last_s: float) -> list[float]:
    return [first_s + number / 50 for number in range(round(50 * (last_s - first_s)))]


def figures(wrist: WristMonitor, now_s: float) -> dict[str, float | None]:
    return {name: value for name, value, _unit in wrist.report(now_s)}


def said(wrist: WristMonitor, now_s: float, *, is_explained: bool = False) -> list[str]:
    return [text for _topic, text in wrist.warnings(now_s, is_explained=is_explained) if text]


def test_rate_and_gaps_are_counted() -> None:
    wrist = monitor()
    send(wrist, at_50_hz(0.0, 10.0))
    send(wrist, at_50_hz(10.25, 20.25))
    found = figures(wrist, 20.25)
    assert found["rate"] == pytest.approx(50.0, rel=0.03)
    assert found["gaps"] == 1
    assert found["latest gap"] == pytest.approx(270)
    assert not said(wrist, 20.25)
    send(wrist, at_50_hz(20.25, 90.0))
    assert figures(wrist, 90.0)["gaps"] == 0


def test_pauses_of_a_slow_device_are_no_gaps() -> None:
    wrist = monitor()
    for second in range(20):
        for number in range(5):
            wrist.on_reading((second + number * STEP, 0.0, 0.0, 1.0), second + number / 5)
        list(wrist.report(second + 0.9))
    assert figures(wrist, 20.0)["gaps"] == 0


def test_silence_is_not_judged_after_this_machine_has_stalled() -> None:
    wrist = monitor()
    send(wrist, at_50_hz(0.0, 5.0))
    list(wrist.report(5.0))
    list(wrist.report(15.0))
    assert not said(wrist, 15.0)
    list(wrist.report(16.0))
    assert len(said(wrist, 16.0)) == 1


def test_orientation_that_stays_equal_is_a_warning() -> None:
    wrist = monitor()
    send(wrist, at_50_hz(0.0, 5.0))
    send(wrist, at_50_hz(5.0, 5.0 + FROZEN_S - 0.5), (0.0, 0.0, 0.0, 1.0))
    assert not said(wrist, 9.5)
    send(wrist, at_50_hz(9.5, 12.0), (0.0, 0.0, 0.0, 1.0))
    assert [text.partition(":")[0] for text in said(wrist, 12.0)] == [
        "anna's wrist (fake) has sent the same orientation for 7 s"
    ]
    send(wrist, at_50_hz(12.0, 13.0))
    assert not said(wrist, 13.0)


def test_device_with_two_decimals_is_not_taken_for_frozen() -> None:
    wrist = monitor()
    for number, time_s in enumerate(at_50_hz(0.0, 20.0)):
        wrist.on_reading((0.01 * (number // 400), 0.0, 0.0, 1.0), time_s)
        if number % 50 == 0:
            list(wrist.report(time_s))
            assert not said(wrist, time_s)


def test_raw_values_that_never_change_are_of_a_frozen_device() -> None:
    wrist = monitor()
    send(wrist, at_50_hz(0.0, 7.0), (0.0, 0.0, 0.0, 0.0, 0.0, 9.81))
    assert len(said(wrist, 7.0)) == 1


def test_connections_again_and_again_are_named() -> None:
    wrist = monitor()
    for number in range(STORM):
        wrist.on_connected(100.0 + number / 10)
    assert [text.partition(":")[0] for text in said(wrist, 101.0)] == [
        "anna's wrist (fake) was connected 5 times within 10 s"
    ]
    assert not said(wrist, 120.0, is_explained=True)


MS = NS_PER_S // 1000
HOST_NS = 1_700_000_000 * NS_PER_S
SEEDS = 5
Link = tuple[list[int], list[int], list[int]]
"""True captures, device times and arrivals, ns."""


def radio(seed: int, *, drift: float = 3e-5, interval_s: float = 0.015, seconds: int = 40) -> Link:
    """Return 100 samples a second through a radio with connection events, some of which are lost."""
    random = np.random.default_rng(seed)
    captured_s = np.arange(0.0, seconds, 0.01) + random.uniform(0.0, 0.01)
    events_s = np.arange(0.0, seconds + 5.0, interval_s)
    is_good = random.random(len(events_s)) > 0.1
    for start in np.nonzero(random.random(len(events_s)) < 0.01)[0]:  # bursts of loss
        is_good[start : start + int(random.exponential(0.08) / interval_s) + 1] = False
    good_s = events_s[is_good]
    sent_s = good_s[np.searchsorted(good_s, captured_s + 0.0015)]
    busy_s = (random.random(len(sent_s)) < 0.01) * random.exponential(0.01, len(sent_s))
    arrived_s = np.maximum.accumulate(sent_s + 0.001 + random.exponential(0.0005, len(sent_s)) + busy_s)
    device_s = captured_s * (1.0 + drift) + random.uniform(0.0, 1000.0)
    return (
        [HOST_NS + round(each * 1e9) for each in captured_s.tolist()],
        [round(each * 1e6) * 1000 for each in device_s.tolist()],
        [HOST_NS + round(each * 1e9) for each in arrived_s.tolist()],
    )


def spread_ms(stamps_ns: list[int], captured_ns: list[int]) -> float:
    """Return the standard deviation of the errors of stamps, after the first 5 s, ms."""
    errors = np.array(stamps_ns[500:]) - np.array(captured_ns[500:])
    return float(errors.std()) / MS


@pytest.mark.parametrize(
    ("drift", "interval_s", "limit_ms"), [(3e-5, 0.015, 1.0), (-1e-4, 0.045, 2.0), (5e-3, 0.015, 2.0)]
)
def test_jitter_of_a_radio_is_removed(drift: float, interval_s: float, limit_ms: float) -> None:
    before: list[float] = []
    after: list[float] = []
    drifts: list[float] = []
    for seed in range(SEEDS):
        captured_ns, device_ns, arrived_ns = radio(seed, drift=drift, interval_s=interval_s)
        clock = DeviceClock()
        stamps_ns = [clock.capture_ns(*each) for each in zip(device_ns, arrived_ns, strict=True)]
        assert clock.jumps == 0
        before.append(spread_ms(arrived_ns, captured_ns))
        after.append(spread_ms(stamps_ns, captured_ns))
        drifts.append(clock.drift)
    assert min(before) > 5.0
    assert max(after) < limit_ms
    assert np.mean(drifts) == pytest.approx(drift, abs=2e-5 + 0.02 * abs(drift))


@given(
    st.lists(
        st.tuples(st.integers(-3 * NS_PER_S, 3 * NS_PER_S), st.integers(0, 3 * NS_PER_S)),
        min_size=1,
        max_size=60,
    )
)
def test_stamps_are_never_in_the_future_nor_decreasing_nor_old(steps: list[tuple[int, int]]) -> None:
    clock = DeviceClock()
    device_ns = 0
    arrival_ns = HOST_NS
    before_ns = 0
    for device_step_ns, arrival_step_ns in steps:
        device_ns += device_step_ns
        arrival_ns += arrival_step_ns
        stamp_ns = clock.capture_ns(device_ns, arrival_ns)
        assert arrival_ns - MAX_AGE_NS <= stamp_ns <= arrival_ns
        assert stamp_ns >= before_ns
        before_ns = stamp_ns


def fed(clock: DeviceClock, device_ns: int, arrival_ns: int, seconds: float) -> tuple[int, int]:
    """Feed 100 samples a second without jitter. Return the next device time and arrival."""
    for _ in range(round(100 * seconds)):
        stamp_ns = clock.capture_ns(device_ns, arrival_ns)
        assert stamp_ns <= arrival_ns
        device_ns = device_ns + 10 * MS
        arrival_ns = arrival_ns + 10 * MS
    return device_ns, arrival_ns


@pytest.mark.parametrize("step_s", [-30.0, -1.0, 1.0, 30.0])
def test_clock_that_is_set_is_recognized_and_followed(step_s: float) -> None:
    clock = DeviceClock()
    device_ns, arrival_ns = fed(clock, 7 * NS_PER_S, HOST_NS, 20.0)
    device_ns, arrival_ns = fed(clock, device_ns + round(step_s * NS_PER_S), arrival_ns, 5.0)
    assert clock.jumps == 1
    assert clock.jump_s == pytest.approx(step_s, abs=0.1)
    assert clock.capture_ns(device_ns, arrival_ns) == pytest.approx(arrival_ns, abs=5 * MS)


def oldest_ms(clock: DeviceClock, device_ns: int, arrival_ns: int, seconds: float) -> float:
    """Feed 100 samples a second, which arrive at once. Return the largest age of their stamps, ms."""
    ages_ns = [
        arrival_ns + passed_ns - clock.capture_ns(device_ns + passed_ns, arrival_ns + passed_ns)
        for passed_ns in range(0, round(seconds * NS_PER_S), 10 * MS)
    ]
    return max(ages_ns) / MS


@pytest.mark.parametrize(("step_s", "jumps"), [(-0.45, 1), (-0.2, 1), (0.2, 0), (0.45, 0)])
def test_small_step_of_a_clock_is_followed_within_a_second(step_s: float, jumps: int) -> None:
    clock = DeviceClock()
    device_ns, arrival_ns = fed(clock, 7 * NS_PER_S, HOST_NS, 60.0)
    device_ns, arrival_ns = fed(clock, device_ns + round(step_s * NS_PER_S), arrival_ns, 1.1)
    assert oldest_ms(clock, device_ns, arrival_ns, 60.0) < 5.0
    assert clock.jumps == jumps  # a step ahead may be a link that was slow until then


@pytest.mark.parametrize("ahead_s", [0.2, 0.45, 3.0])
def test_single_device_time_ahead_is_ignored(ahead_s: float) -> None:
    clock = DeviceClock()
    device_ns, arrival_ns = fed(clock, 7 * NS_PER_S, HOST_NS, 60.5)
    assert clock.capture_ns(device_ns + round(ahead_s * NS_PER_S), arrival_ns) == arrival_ns
    assert oldest_ms(clock, device_ns + 10 * MS, arrival_ns + 10 * MS, 60.0) < 5.0
    assert clock.jumps == 0


def test_link_that_stalls_is_no_jump() -> None:
    clock = DeviceClock()
    device_ns, arrival_ns = fed(clock, 0, HOST_NS, 20.0)
    for number in range(150):  # all that the device has sent meanwhile
        clock.capture_ns(device_ns + number * 10 * MS, arrival_ns + 1500 * MS)
    fed(clock, device_ns + 1500 * MS, arrival_ns + 1500 * MS, 5.0)
    assert clock.jumps == 0


@pytest.mark.parametrize("speed", [0.0, 1e-3, 1000.0])
def test_stopped_device_clock_or_one_with_wrong_unit_is_unused(speed: float) -> None:
    clock = DeviceClock()
    for number in range(2000):
        clock.capture_ns(round(number * 10 * MS * speed), HOST_NS + number * 10 * MS)
    assert not clock.is_used
    arrival_ns = HOST_NS + 20 * NS_PER_S
    assert clock.capture_ns(round(20 * NS_PER_S * speed), arrival_ns) == arrival_ns


def test_clock_that_runs_again_is_used_again() -> None:
    clock = DeviceClock()
    for number in range(1200):
        clock.capture_ns(5, HOST_NS + number * 10 * MS)
    assert not clock.is_used
    fed(clock, 5, HOST_NS + 12 * NS_PER_S, 60.0)
    assert clock.is_used


def test_slope_is_that_of_the_hull_below_the_points() -> None:
    points = [(0, 5.0), (10, 1.0), (20, 9.0), (30, 3.0), (40, 8.0)]
    assert slope_below(points) == pytest.approx(2.0 / 20)
    assert slope_below([(0, 1.0)]) == 0.0


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
        return self.page.process_sample(sample, at(time_s if comes_s is None else comes_s), home=self.home)

    def epoch(self, time_s: float, device: Device = "arm", session: int = 0) -> int:
        turned = self.send(time_s, device, session=session)
        assert turned is not None
        return turned.yaw_epoch


def finger(turned: PageOrientation | None) -> vector.Vec3:
    assert turned is not None
    return rotation.rotate(turned.orientation_xyzw, (1.0, 0.0, 0.0))


def test_mouse_gives_the_arm_and_a_phone_points_its_top() -> None:
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


def test_late_sample_is_dropped_and_still_holds_the_wrist() -> None:
    hand = Hand()
    assert hand.send(0.2) is not None
    assert hand.send(0.1, comes_s=0.9) is None
    assert hand.page.late == 1
    assert hand.page.is_active(at(1.8))
    assert hand.send(0.2, comes_s=1.0) is not None  # said again, not older


def test_sample_from_the_future_is_dropped_without_making_others_late() -> None:
    hand = Hand()
    assert hand.send(7.0, comes_s=0.0) is None
    assert hand.page.ahead_ns == 7 * NS_PER_S
    assert hand.send(0.1) is not None
    assert hand.page.ahead_ns is None  # pyrefly: ignore[unnecessary-comparison]  # changed meanwhile


def test_page_moves_the_wrist_after_the_clock_was_set_back() -> None:
    hand = Hand()
    hand.send(1000.0)
    assert hand.send(10.0) is not None
    assert hand.page.late == 0


def test_mouse_keeps_the_yaw_origin_and_phone_sessions_bring_theirs() -> None:
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


def test_device_time_is_published_once_and_of_a_phone_alone() -> None:
    """A mouse's page would seem to be a restarted wristband. A repeated time would mean a repeated sample."""
    hand = Hand()
    devices: list[tuple[Device, int]] = [("arm", 5), ("phone", 6), ("phone", 6), ("phone", 6), ("phone", 7)]
    turned = [hand.send(0.1, device, device_time_ns=time_ns) for device, time_ns in devices]
    assert [each and each.device_time_ns for each in turned] == [None, 6, None, None, 7]


def test_phone_stays_centred_but_a_mouse_only_until_release() -> None:
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


def test_azimuth_is_refused_when_the_arm_is_steep_or_missing() -> None:
    hand = Hand()
    with pytest.raises(ValueError, match="nothing yet"):
        hand.page.turn_to(0.0)
    hand.send(0.0, "arm", rotation.from_azimuth_elevation(0.0, math.radians(85)))
    with pytest.raises(ValueError, match="hold it level"):
        hand.page.turn_to(0.0)


def test_phone_has_another_yaw_origin_when_its_mounting_changes() -> None:
    hand = Hand()
    hand.page.set_phone_mounting(MOUNTINGS["minus_x"])  # nobody has seen one yet
    assert hand.epoch(0.0, "phone") == 1
    hand.page.set_phone_mounting(MOUNTINGS["plus_x"])
    assert hand.epoch(0.1, "phone") == 2


Step = tuple[Device, int, bool]


@given(st.lists(st.tuples(st.sampled_from(["arm", "phone"]), st.integers(1, 3), st.booleans()), max_size=30))
def test_yaw_epoch_changes_with_new_origins_only(steps: list[Step]) -> None:
    """Between pages a simulated person moves the wrist, with samples of number 0."""
    hand = Hand()
    origin = YawOrigin()
    time_s = 0.0
    session = 0
    phone = ""
    was = "home"

    def change(epoch: int) -> bool:
        sample = ImuSample(stamp_ns=at(time_s), orientation_xyzw=rotation.IDENTITY, yaw_epoch=epoch)
        return bool(origin.add(sample))

    change(0)
    for device, of_phone, gives_back in steps:
        time_s += 0.1
        if device == "phone" and of_phone != session:
            session = of_phone
            now = f"phone, {time_s}"
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


def phone_trouble(hand: Hand) -> str:
    sample = WristSample(stamp_ns=0, orientation_xyzw=rotation.IDENTITY, device="phone")
    return dict(page_warnings("anna", hand.page, sample))["phone"]


def test_phone_whose_sensors_are_all_zero_is_named_after_seconds() -> None:
    hand = Hand()
    for time_s in range(5):
        hand.send(time_s, "phone")
        assert phone_trouble(hand) == ""
    for time_s in range(5, 9):
        hand.send(time_s, "phone")
    assert "anna's phone has sent the same orientation for 8 s: it lies on a table, or" in phone_trouble(hand)
    hand.send(9.0, "phone", rotation.from_yaw(0.01))
    assert phone_trouble(hand) == ""


def test_phone_without_an_azimuth_is_named_once_it_has_turned() -> None:
    """A browser without gyroscope and compass gives `alpha` 0: only the tilt changes (W3C)."""
    hand = Hand()
    for step in range(100):
        beta_rad = 0.5 + 0.3 * math.sin(step)
        gamma_rad = 0.2 * math.cos(step)
        pitch = rotation.from_axis_angle((1.0, 0.0, 0.0), beta_rad)
        roll = rotation.from_axis_angle((0.0, 1.0, 0.0), gamma_rad)
        hand.send(0.1 * step, "phone", rotation.multiply(pitch, roll))
    assert "its azimuth is the same for 10 s: its browser reads neither gyroscope" in phone_trouble(hand)
    hand.send(10.0, "phone", session=1)
    assert phone_trouble(hand) == "", "another phone"


def test_arm_that_tilts_or_rests_has_a_trembling_azimuth_and_no_trouble() -> None:
    hand = Hand()
    for step in range(200):
        tremor_rad = 0.007 * math.sin(7.0 * step)
        tilt = rotation.from_axis_angle((1.0, 0.0, 0.0), 0.5 + 0.3 * math.sin(0.1 * step))
        hand.send(0.1 * step, "phone", rotation.multiply(rotation.from_yaw(tremor_rad), tilt))
        assert phone_trouble(hand) == ""


def test_mouse_at_rest_is_no_phone_without_sensors() -> None:
    hand = Hand()
    for time_s in range(20):
        hand.send(time_s, "arm")
    sample = WristSample(stamp_ns=0, orientation_xyzw=rotation.IDENTITY, device="arm")
    assert dict(page_warnings("anna", hand.page, sample))["phone"] == ""
