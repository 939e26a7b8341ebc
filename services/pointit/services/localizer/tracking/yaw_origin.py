"""Detection of a changed origin of the IMU's yaw, which makes a pose's yaw useless."""

from typing import Literal

from pointit.schemas import NS_PER_S, ImuSample

BACK_NS = NS_PER_S
"""Device time that falls by more is a restart; by less, samples came out of order."""

Change = Literal["", "set", "restarted"]
"""No change, a new yaw origin, or a restarted device."""


class YawOrigin:
    """Compares each sample with the ones before."""

    def __init__(self) -> None:
        self._epoch: int | None = None
        self._device_ns: int | None = None

    def add(self, sample: ImuSample) -> Change:
        """Return the change since the sample before."""
        epoch = self._epoch
        self._epoch = now = sample.yaw_epoch
        before_ns, device_ns = self._device_ns, sample.device_time_ns
        fallen_ns = 0 if before_ns is None or device_ns is None else before_ns - device_ns
        if device_ns is not None and not 0 < fallen_ns <= BACK_NS:
            self._device_ns = device_ns
        if fallen_ns > BACK_NS:
            return "restarted"
        return "set" if epoch is not None and epoch != now else ""
