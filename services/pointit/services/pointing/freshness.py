"""Which samples are news: neither too old, nor from the future, nor out of order, nor said before.

Devices and bridges repeat themselves (a quarter of all samples in recordings of the ROS toolkit are repeats):
a repeat carries the device time of the sample before. Equal orientations prove nothing, a still arm has them
honestly.
"""

from typing import Literal

from pointit.schemas import NS_PER_S, ImuSample

Verdict = Literal["fresh", "stale", "repeated"]


class Freshness:
    """Judges each sample of one wrist against those before."""

    def __init__(self, stale_after_s: float) -> None:
        """Take samples no older, and no further in the future, than `stale_after_s`."""
        self._stale_ns = int(stale_after_s * NS_PER_S)
        self._newest_ns = -1
        self._device_ns: int | None = None
        self.judged = 0
        """All samples."""
        self.stale = 0
        """Samples that came too late, out of order, or from the future."""
        self.repeated = 0
        """Samples that were the one before, sent again."""
        self.restarts = 0
        """How often the device's clock went back: it was restarted, or two devices send."""

    def classify(self, sample: ImuSample, now_ns: int) -> Verdict:
        """Return what `sample` is, and remember it if it is fresh.

        When the host's clock is set back, or the device's, it begins anew with that clock. Device times
        that go back by no more than the age allowed are samples that overtook each other.
        """
        self.judged += 1
        if self._newest_ns > now_ns + self._stale_ns:
            self._newest_ns = -1
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
