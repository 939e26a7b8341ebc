"""Classification of samples: fresh, stale (too old, from the future, out of order) or repeated.

Devices and bridges repeat samples (a quarter of all samples in recordings of the ROS toolkit are repeats): a
repeat has the device time of the sample before. Equal orientations are no evidence, since an arm at rest has
them, too.
"""

from typing import Literal

from pointit.schemas import NS_PER_S, ImuSample

Verdict = Literal["fresh", "stale", "repeated"]


class Freshness:
    """Compares each sample of one wrist with those before."""

    def __init__(self, stale_after_s: float) -> None:
        """Accept samples at most `stale_after_s` old or in the future."""
        self._stale_ns = int(stale_after_s * NS_PER_S)
        self._newest_ns = -1
        self._device_ns: int | None = None
        self.count = 0
        """Number of all samples."""
        self.stale = 0
        """Number of samples that came too late, out of order, or from the future."""
        self.repeated = 0
        """Number of samples that repeat the one before."""
        self.restarts = 0
        """Number of times that the device's clock went back: it was restarted, or two devices send."""

    def classify(self, sample: ImuSample, now_ns: int) -> Verdict:
        """Return the class of `sample`, and store it if it is fresh.

        A step back of the device's clock is followed. Device times that go back by at most `stale_after_s`
        are samples out of order.
        """
        self.count += 1
        if abs(now_ns - sample.stamp_ns) > self._stale_ns or sample.stamp_ns < self._newest_ns:
            self.stale += 1
            return "stale"
        device_ns, before_ns = sample.device_time_ns, self._device_ns
        if device_ns is not None:
            if before_ns is not None and device_ns <= before_ns:
                if device_ns == before_ns:
                    self.repeated += 1
                    return "repeated"
                if before_ns - device_ns <= self._stale_ns:
                    self.stale += 1
                    return "stale"
                self.restarts += 1
            self._device_ns = device_ns
        self._newest_ns = sample.stamp_ns
        return "fresh"
