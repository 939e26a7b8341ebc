"""A wrist that a page moves: whether it does, what of its samples is news, and from where its yaw counts.

Who aims with a page's mouse has an arm in {H} as the person's pose says it, so whoever takes over like that
and gives back leaves the yaw's origin as it is. A phone has a yaw of its own, another one in each session.
"""

from collections.abc import Iterator
from typing import Literal, NamedTuple

from pointit.geometry import rotation
from pointit.geometry.rotation import Quaternion
from pointit.schemas import NS_PER_S, WRIST_PATIENCE_S, WristSample
from pointit.services.imu_bridge.arm_frame import ArmFrame

AHEAD_NS = NS_PER_S
"""Samples stamped further in the future are wrong, and would make all that follow look late."""

Device = Literal["arm", "phone"]


class PageOrientation(NamedTuple):
    """The arm as a page turned it; fields as those of an `ImuSample`."""

    orientation_xyzw: Quaternion
    device_time_ns: int | None
    yaw_epoch: int


class PageWrist:
    """Follows the samples of a page.

    Numbers of yaw origins (`yaw_epoch`): each phone session, and each origin that is asked for, has a new
    one, of `numbers`; the same session has its own again when it comes back. An arm has the number that held
    when it took over, and when its own yaw was turned a new one, until it lets go.
    """

    def __init__(self, phone: Quaternion, numbers: Iterator[int]) -> None:
        """Take how a phone is worn, sensor_from_arm, and where numbers of new yaw origins come from."""
        self._numbers = numbers
        self._frames: dict[Device, ArmFrame] = {"arm": ArmFrame(rotation.IDENTITY), "phone": ArmFrame(phone)}
        self._epochs: dict[Device, int | None] = {"arm": None, "phone": None}
        self._epoch = 0
        """Of what came last."""
        self._session: int | None = None
        """Of the phone."""
        self._heard_ns: int | None = None
        self._newest: WristSample | None = None
        self.late = 0
        """Samples older than others before, which were left out."""
        self.ahead_ns: int | None = None
        """How far in the future the last sample is; none: it is not."""

    @property
    def device(self) -> Device:
        """Return what moves the wrist, or did when it was moved last."""
        return "arm" if self._newest is None else self._newest.device

    def is_active(self, now_ns: int, speed: float = 1.0) -> bool:
        """Return True if the page moves the wrist; the time runs `speed` times as fast as the wall's."""
        heard_ns = self._heard_ns
        return heard_ns is not None and abs(now_ns - heard_ns) <= WRIST_PATIENCE_S * NS_PER_S * speed

    def take(
        self, sample: WristSample, now_ns: int, *, home: int | None, speed: float = 1.0
    ) -> PageOrientation | None:
        """Take a sample; return the arm's orientation, or none where the sample is late or from the future.

        Args:
            sample: as it came.
            now_ns: the time.
            home: number of the yaw's origin while no page has the wrist; none: it has nobody else.
            speed: of that time.
        """
        goes_on = self.is_active(now_ns, speed)
        self._heard_ns = now_ns
        latest_ns = now_ns + round(AHEAD_NS * speed)
        if sample.stamp_ns > latest_ns:
            self.ahead_ns = sample.stamp_ns - now_ns
            return None
        self.ahead_ns = None
        newest = self._newest
        if newest is not None and sample.stamp_ns < newest.stamp_ns <= latest_ns:
            self.late += 1
            return None
        device = sample.device
        if not goes_on or newest is None or newest.device != device:
            self._take_over(device)
        if device == "phone" and sample.session != self._session:
            self._session = sample.session
            self._set_anew(device)
        before_ns = None if newest is None or newest.device != device else newest.device_time_ns
        self._newest = sample
        own = self._epochs[device]
        if own is not None:
            self._epoch = own
        elif home is not None and not goes_on:
            self._epoch = home
        # a mouse has no clock of its own, and the one of its page would look like a device switched on anew;
        # of a phone that lies still the page says again how it lies, which is news all the same
        is_told = device == "phone" and sample.device_time_ns != before_ns
        device_time_ns = sample.device_time_ns if is_told else None
        orientation = self._frames[device].orientation(sample.orientation_xyzw)
        return PageOrientation(orientation, device_time_ns, self._epoch)

    def turn_to(self, yaw_rad: float) -> None:
        """Have the arm point to azimuth `yaw_rad` in {H} with the device as it is now.

        Raises:
            ValueError: nothing came yet, or the arm is too steep to have an azimuth.
        """
        if self._newest is None:
            raise ValueError("the page has sent nothing yet")
        self._frames[self.device].set_azimuth(yaw_rad, self._newest.orientation_xyzw)
        self._set_anew(self.device)

    def set_phone_mounting(self, sensor_from_arm: Quaternion) -> None:
        """Take a phone to sit on the arm like this from now on."""
        self._frames["phone"].set_mounting(sensor_from_arm)
        if self._session is not None:
            self._set_anew("phone")

    def _take_over(self, device: Device) -> None:
        if device == "arm":
            self._frames[device].set_yaw_origin(0.0)
            self._epochs[device] = None

    def _set_anew(self, device: Device) -> None:
        self._epochs[device] = next(self._numbers)
