"""Our own selection methods as plug-ins. Their parameters are those of the selector itself."""

import math
from collections.abc import Collection
from typing import Literal

from pointit.schemas import NS_PER_S
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.methods.dwell import Dwell
from pointit.services.selector.methods.gauge import Gauges, RaySpeedEstimator
from pointit.services.selector.selection_methods import PointingSample, SelectionMethod, SelectionProgress

NOTHING = SelectionProgress()


class DwellMethod:
    """Method `hold` or `fraction` for one person."""

    def __init__(self, name: Literal["hold", "fraction"], config: SelectorConfig) -> None:
        self._dwell = Dwell(
            name,
            window_s=config.window_s,
            timestep_s=config.timestep_s,
            fraction=config.fraction,
            release_s=config.release_s,
            longest_gap_s=config.longest_gap_s,
        )
        self.latch = self._dwell.latch

    @property
    def latched(self) -> Collection[str]:
        """Return the objects that fired and were not left since."""
        return self._dwell.latched

    def step(self, pointing: PointingSample) -> SelectionProgress:
        """Process a cursor."""
        cursor, under, _, acts = pointing
        fired = self._dwell.step(cursor.stamp_ns, under)
        if under is None and fired is None:
            return NOTHING
        if under is None or not acts(under):
            return SelectionProgress(under, 0.0, fired)
        return SelectionProgress(under, self._dwell.progress(under), fired)


class GaugeMethod:
    """Method `gauge` for one person."""

    def __init__(self, config: SelectorConfig) -> None:
        self._config = gauge = config.gauge
        self._snap_rad = math.radians(gauge.snap_deg)
        self._sparse_rad = math.radians(gauge.sparse_deg)
        self._steady_rad_s = math.radians(gauge.steady_deg_per_s)
        self._gap_ns = round(config.longest_gap_s * NS_PER_S)
        self._steadiness = RaySpeedEstimator(gauge.speed_window_s)
        self._gauges = Gauges(
            drain_share=gauge.drain_share,
            leave_s=gauge.leave_s,
            longest_gap_s=config.longest_gap_s,
            full_s=gauge.full_s,
        )
        self.latch = self._gauges.latch
        self._hovered: str | None = None
        self._stamp_ns: int | None = None

    @property
    def latched(self) -> Collection[str]:
        """Return the objects that fired and were not left since."""
        return self._gauges.latched

    def step(self, pointing: PointingSample) -> SelectionProgress:
        """Process a cursor."""
        cursor, hovered, view, acts = pointing
        gauge = self._config
        gauges = self._gauges
        if self._stamp_ns is not None and cursor.stamp_ns - self._stamp_ns > self._gap_ns:
            self._steadiness.clear()
        self._stamp_ns = cursor.stamp_ns
        fills, full_s, near = True, gauge.full_s, set[str]()
        if cursor.direction is not None:
            self._steadiness.add(cursor.stamp_ns, cursor.direction)
        if view is not None:
            hovered = view.pick(self._hovered, self._snap_rad, gauge.hysteresis)
            latched = gauges.latched
            if latched:
                near = view.near(latched, self._snap_rad, gauge.leave_factor)
        elif hovered is not None:
            near = {hovered}
        if hovered is not None and view is not None:
            rate = self._steadiness.rate()
            fills = rate is not None and view.relative_rate(hovered, rate) < self._steady_rad_s
            if gauge.sparse_full_s != full_s and view.is_isolated(self._sparse_rad):
                full_s = gauge.sparse_full_s
        fills = fills and hovered is not None and acts(hovered)
        fired = gauges.step(cursor.stamp_ns, hovered, fills=fills, full_s=full_s, near=near)
        self._hovered = hovered
        if hovered is None:
            return SelectionProgress(None, fired=fired)
        return SelectionProgress(hovered, gauges.fill(hovered), fired, gauges.filled_s(hovered))


HOLD = SelectionMethod(
    summary="the same object at every timestep of a window",
    config=SelectorConfig,
    make=lambda config, _surroundings: DwellMethod("hold", config),
)
FRACTION = SelectionMethod(
    summary="the same object at most timesteps of a window",
    config=SelectorConfig,
    make=lambda config, _surroundings: DwellMethod("fraction", config),
)
GAUGE = SelectionMethod(
    summary="a gauge that fills during steady pointing, and drains otherwise",
    config=SelectorConfig,
    make=lambda config, _surroundings: GaugeMethod(config),
    by_angle=True,
)
