"""A wrist that a page moves: its activity, its valid samples, its yaw origins, and its health metrics.

A page's mouse gives the arm in {H} by the person's pose, so taking over and releasing leaves the yaw origin
as it is. A phone has its own yaw, another one in each session.
"""

from collections.abc import Iterator
from typing import Literal, NamedTuple

from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion
from pointit.runtime.bus.timeliness import MAX_AHEAD_NS
from pointit.schemas import NS_PER_S, WRIST_PATIENCE_S, WristSample
from pointit.services.imu_bridge.arm_frame import ArmFrame
from pointit.services.imu_bridge.orientation_check import AzimuthCheck, FrozenCheck

Device = Literal["arm", "phone"]
DEVICE_NAMES: dict[Device, str] = {"arm": "mouse or ROS", "phone": "phone"}
"""Names of the devices; orientations from ROS arrive like those of a page's mouse."""
LOW_BATTERY = 0.1
"""Charge of a phone below which there is a warning."""


class PageOrientation(NamedTuple):
    """The arm as a page turned it; fields as in `ImuSample`."""

    orientation_xyzw: Quaternion
    device_time_ns: int | None
    yaw_epoch: int


class PageWrist:
    """Processes the samples of a page.

    Numbers of yaw origins (`yaw_epoch`): each phone session, and each requested origin, has a new one from
    `numbers`; a session that comes back has its own again. An arm keeps the number at its takeover, or has a
    new one after its own yaw was turned, until it releases the wrist.
    """

    def __init__(self, phone: Quaternion, numbers: Iterator[int]) -> None:
        """Set the mounting of a phone, sensor_from_arm, and the source of new numbers."""
        self._numbers = numbers
        self._frames: dict[Device, ArmFrame] = {"arm": ArmFrame(rotation.IDENTITY), "phone": ArmFrame(phone)}
        self._epochs: dict[Device, int | None] = {"arm": None, "phone": None}
        self._epoch = 0
        """Number of the last sample."""
        self._session: int | None = None
        """Session of the phone."""
        self.frozen = FrozenCheck(is_fine=True)
        """Whether the phone's orientation changes at all, as one in a hand does."""
        self.azimuth = AzimuthCheck()
        """Whether the phone's azimuth changes as it turns."""
        self._received_ns: int | None = None
        self._newest: WristSample | None = None
        self.late = 0
        """Number of dropped samples that were older than earlier ones."""
        self.ahead_ns: int | None = None
        """Lead of the last sample if it is too far in the future, else None."""

    @property
    def device(self) -> Device:
        """Return the device that moves the wrist, or moved it last."""
        return "arm" if self._newest is None else self._newest.device

    def is_active(self, now_ns: int, speed: float = 1.0) -> bool:
        """Return True if a page moved the wrist within the timeout. `speed`: clock over wall time."""
        received_ns = self._received_ns
        if received_ns is None:
            return False
        timeout_ns = WRIST_PATIENCE_S * NS_PER_S * speed
        return abs(now_ns - received_ns) <= timeout_ns

    def process_sample(
        self, sample: WristSample, now_ns: int, *, home: int | None, speed: float = 1.0
    ) -> PageOrientation | None:
        """Process a sample. Return the arm's orientation, or None if the sample is late or from the future.

        Args:
            sample: as received.
            now_ns: the time.
            home: number of the yaw origin while no page moves the wrist, or None if nothing else moves it.
            speed: of the clock, relative to wall time.
        """
        goes_on = self.is_active(now_ns, speed)
        self._received_ns = now_ns

        # Drop samples too far ahead, and late ones. If the clock was set back, the newest is not believed.
        latest_ns = now_ns + round(MAX_AHEAD_NS * speed)
        if sample.stamp_ns > latest_ns:
            self.ahead_ns = sample.stamp_ns - now_ns
            return None
        self.ahead_ns = None
        newest = self._newest
        if newest is not None and sample.stamp_ns < newest.stamp_ns <= latest_ns:
            self.late += 1
            return None

        # An arm begins in {H} whenever it takes over, a phone at a new yaw in each session
        device = sample.device
        previous: WristSample | None = None
        if newest is not None and newest.device == device:
            previous = newest
        is_takeover = previous is None or not goes_on
        if device == "arm" and is_takeover:
            self._frames[device].set_yaw_origin(0.0)
            self._epochs[device] = None
        if device == "phone" and sample.session != self._session:
            self._session = sample.session
            self._start_new_epoch(device)
            self.frozen = FrozenCheck(is_fine=True)
            self.azimuth = AzimuthCheck()
        if device == "phone":
            now_s = now_ns / NS_PER_S / speed
            self.frozen.on_values(sample.orientation_xyzw, now_s)
            self.azimuth.on_orientation(sample.orientation_xyzw, now_s)
        self._newest = sample

        # Its own yaw origin, else that of what moved the wrist before
        own_epoch = self._epochs[device]
        if own_epoch is not None:
            self._epoch = own_epoch
        elif home is not None and not goes_on:
            self._epoch = home

        # a mouse has no clock of its own, and that of its page would look like a restarted device;
        # the page repeats the orientation of a phone at rest, which is a new sample nevertheless
        previous_ns = None if previous is None else previous.device_time_ns
        device_time_ns: int | None = None
        if device == "phone" and sample.device_time_ns != previous_ns:
            device_time_ns = sample.device_time_ns
        orientation = self._frames[device].orientation(sample.orientation_xyzw)
        return PageOrientation(orientation, device_time_ns, self._epoch)

    def turn_to(self, yaw_rad: float) -> None:
        """Set the yaw origin so that the arm points to azimuth `yaw_rad` in {H} with the device as it is now.

        Raises:
            ValueError: If nothing was received yet, or the arm is too steep to have an azimuth.
        """
        if self._newest is None:
            raise ValueError("the page has sent nothing yet")
        self._frames[self.device].set_azimuth(yaw_rad, self._newest.orientation_xyzw)
        self._start_new_epoch(self.device)

    def set_phone_mounting(self, sensor_from_arm: Quaternion) -> None:
        """Set the mounting of a phone on the arm."""
        self._frames["phone"].set_mounting(sensor_from_arm)
        if self._session is not None:
            self._start_new_epoch("phone")

    def _start_new_epoch(self, device: Device) -> None:
        self._epochs[device] = next(self._numbers)


def mover_name(sample: WristSample | None) -> str:
    """Return the name of the device of the page (or ROS) that sent `sample`, or `""` without one."""
    if sample is None:
        return ""
    return sample.source or DEVICE_NAMES[sample.device]


def figures(page: PageWrist, sample: WristSample | None) -> Iterator[tuple[str, float | None, str]]:
    """Yield name, value and unit of the health metrics of the newest `sample`. None removes a metric.

    `sample` is None after the page has released the wrist.
    """
    mover = mover_name(sample)
    for name in (*DEVICE_NAMES.values(), "headset"):
        is_mover = 1.0 if name == mover else None
        yield f"moved by a page's {name}", is_mover, ""
    battery = _phone_battery(sample)
    battery_percent = None if battery is None else round(100.0 * battery)
    yield "battery of the phone", battery_percent, "%"
    late = float(page.late) if page.late else None
    yield "late samples of a page or ROS", late, ""


def warnings(user: str, page: PageWrist, sample: WristSample | None) -> Iterator[tuple[str, str]]:
    """Yield topics and messages of warnings; `""` clears a warning."""
    message = ""
    if sample is not None and page.ahead_ns is not None:
        message = (
            f"the wrist that a page or ROS moves is stamped {page.ahead_ns / NS_PER_S:.1f} s ahead of this "
            "machine's clock and left out: synchronize the clocks of the machines"
        )
    yield "page", message

    # A browser without motion sensors, or without the right to read them, sends zeros
    message = ""
    is_phone = sample is not None and sample.device == "phone"
    frozen_s = page.frozen.frozen_s
    still_s = page.azimuth.still_s
    if is_phone and frozen_s:
        message = (
            f"{user}'s phone has sent the same orientation for {frozen_s:.0f} s: it lies on a table, or its "
            "browser gives no motion; in a hand, allow the page the motion sensors, or take another browser"
        )
    elif is_phone and still_s:
        message = (
            f"{user}'s phone has turned, and its azimuth is the same for {still_s:.0f} s: its browser reads "
            "neither gyroscope nor compass; allow the page the motion sensors, or take another phone"
        )
    yield "phone", message

    battery = _phone_battery(sample)
    message = ""
    if battery is not None and battery < LOW_BATTERY:
        message = f"the battery of {user}'s phone is at {battery:.0%}: plug it in"
    yield "battery", message


def _phone_battery(sample: WristSample | None) -> float | None:
    """Return the charge that `sample` states, or None if it is not a phone's."""
    if sample is None or sample.device != "phone":
        return None
    return sample.battery
