"""Elevation bias of the person, which a calibration replaces and whose end restores it."""

from pointit.schemas import PointingRay


class Bias:
    """Bias of a pose, and the part that the person's offset already removes from the rays.

    Rays of a calibrated person have no bias. Without the offset the bias is again what it was.
    """

    def __init__(self) -> None:
        self._calibration_rad: float | None = None
        """Remaining elevation uncertainty of the person's calibration, by the newest ray."""
        self._correction_rad = 0.0
        """Elevation correction of the offset, by the newest ray."""
        self._raw_rad = 0.0
        """Elevation of rays above the targets without the offset."""

    def found(self, bias_rad: float) -> None:
        """Set the bias of rays as they are now."""
        self._raw_rad = bias_rad - self._correction_rad

    def given(self) -> None:
        """Reset the bias to 0, since it is unknown."""
        self._raw_rad = 0.0

    def on_ray(self, ray: PointingRay) -> float | None:
        """Update the offset from `ray`. Return the bias if it changed, else None."""
        self._correction_rad = ray.elevation_correction_rad
        sigma_rad = ray.elevation_sigma_rad
        if sigma_rad == self._calibration_rad:
            return None
        self._calibration_rad = sigma_rad
        return self._raw_rad if sigma_rad is None else 0.0
