"""The person's elevation bias, which a calibration takes over and gives back."""

from pointit.schemas import PointingRay


class Bias:
    """What a pose says of the bias, and what the person's offset takes out of the rays already.

    A calibrated person's rays do not lie too high any more: their bias is nil. Without the offset it is again
    what it was.
    """

    def __init__(self) -> None:
        self._calibration_rad: float | None = None
        """What is left of the person's elevation error, by the newest ray."""
        self._correction_rad = 0.0
        """What their offset adds to the elevation, by the newest ray."""
        self._raw_rad = 0.0
        """How much higher than the targets rays lie without the offset."""

    def found(self, bias_rad: float) -> None:
        """Take the bias of rays as they are now."""
        self._raw_rad = bias_rad - self._correction_rad

    def given(self) -> None:
        """Take that nothing is known of it."""
        self._raw_rad = 0.0

    def on_ray(self, ray: PointingRay) -> float | None:
        """Mind the offset; return the bias when it is another one from now on."""
        self._correction_rad = ray.elevation_correction_rad
        if ray.elevation_sigma_rad == self._calibration_rad:
            return None
        self._calibration_rad = ray.elevation_sigma_rad
        return self._raw_rad if ray.elevation_sigma_rad is None else 0.0
