"""Method `gauge`: a gauge for each object, filled by steady pointing; the ray's speed (pointing.md §6)."""

import math
from collections.abc import Collection, Container
from statistics import median

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.seen_objects import LEAVE_FACTOR, SPARSE_RAD
from pointit.services.selector.selection_methods import PointingSample, SelectionMethod, SelectionProgress

HYSTERESIS = 0.3
"""The hovered object stays hovered until another angle is smaller by this share."""
SPEED_WINDOW_S = 0.15
"""Window of the estimate of the ray's speed, s."""
DRAIN_SHARE = 0.5
"""Share of the fill rate at which the gauges of other objects drain."""
LEAVE_NS = round(0.3 * NS_PER_S)
"""Time off an object after which its full gauge can fill again, ns."""

MIN_RAYS = 2
"""Number of rays needed for a speed."""


class Gauges:
    """Fill levels of one person's gauges, updated at each cursor.

    Between two cursors, the gauge of the object that the later one hovers fills by the elapsed share of its
    fill time. All others drain at `DRAIN_SHARE` of that rate. So the fill time does not depend on the rate
    of cursors. In a gap longer than `longest_gap_s` everything drains. A full gauge fires once: its object
    is latched until it was left for `LEAVE_NS` without a break.
    """

    def __init__(self, *, longest_gap_s: float, full_s: float) -> None:
        self._drain_per_s = DRAIN_SHARE / full_s
        self._gap_s = longest_gap_s
        self._fill: dict[str, float] = {}
        self._spent_s: dict[str, float] = {}
        """Time spent on each gauge, s. Same keys as `_fill`."""
        self._latched: dict[str, int | None] = {}
        """Fired objects, with the time since which they are left, ns, or None while they are not left."""
        self._stamp_ns: int | None = None

    @property
    def latched(self) -> Collection[str]:
        """Return the objects that fired and were not left since."""
        return self._latched

    def fill(self, object_id: str) -> float:
        """Return the level of the gauge of `object_id`, 0 to 1."""
        return self._fill.get(object_id, 0.0)

    def filled_s(self, object_id: str) -> float:
        """Return the time of filling that led to this level, s."""
        return self._spent_s.get(object_id, 0.0)

    def step(
        self, stamp_ns: int, hovered: str | None, *, fills: bool, full_s: float, not_left: Container[str] = ()
    ) -> str | None:
        """Process a cursor, later than the one before. Return the object whose gauge is full now, or None.

        Args:
            stamp_ns: stamp of the cursor.
            hovered: hovered object.
            fills: True if the gauge of that object fills, else it keeps its level.
            full_s: time that fills it, s.
            not_left: latched objects that this cursor has not left.
        """
        elapsed_s = 0.0
        if self._stamp_ns is not None:
            elapsed_s = (stamp_ns - self._stamp_ns) / NS_PER_S
        self._stamp_ns = stamp_ns
        has_gap = elapsed_s > self._gap_s
        self._unlatch(stamp_ns, not_left, has_gap=has_gap)

        # Others drain; after a gap the hovered object, too
        if self._fill:
            kept = None if has_gap else hovered
            self._drain_others(kept, elapsed_s)
        if hovered is None or has_gap:
            return None
        if not fills or hovered in self._latched:
            return None

        # The hovered object fills, or fires
        fill = self._fill.get(hovered, 0.0) + elapsed_s / full_s
        if fill < 1.0 - 1e-9:
            self._fill[hovered] = fill
            self._spent_s[hovered] = self._spent_s.get(hovered, 0.0) + elapsed_s
            return None
        self.latch(hovered)
        return hovered

    def latch(self, object_id: str) -> None:
        """Block `object_id` until it is left, since it was changed in another way."""
        self._fill.pop(object_id, None)
        self._spent_s.pop(object_id, None)
        self._latched[object_id] = None

    def _drain_others(self, kept: str | None, elapsed_s: float) -> None:
        drained = elapsed_s * self._drain_per_s
        for object_id, fill in list(self._fill.items()):
            if object_id == kept:
                continue
            new_fill = fill - drained
            if new_fill <= 0.0:
                del self._fill[object_id]
                self._spent_s.pop(object_id, None)
            else:
                spent_s = self._spent_s.get(object_id, 0.0)
                self._spent_s[object_id] = spent_s * new_fill / fill
                self._fill[object_id] = new_fill

    def _unlatch(self, stamp_ns: int, not_left: Container[str], *, has_gap: bool) -> None:
        for object_id, since_ns in list(self._latched.items()):
            if object_id in not_left:
                self._latched[object_id] = None
            elif since_ns is None or has_gap:
                self._latched[object_id] = stamp_ns
            elif stamp_ns - since_ns >= LEAVE_NS:
                del self._latched[object_id]


class RaySpeedEstimator:
    """Angular speed of one person's ray, from its last directions.

    The rays of the window are split in two halves. The speed is the change from the median direction of the
    older half to that of the newer, divided by the time between. A single wrong sample changes a median
    little, and tremor of 6 to 12 Hz, whose momentary speed is as high as that of slow pointing, averages out.
    """

    def __init__(self, window_s: float) -> None:
        self._window_ns = round(window_s * NS_PER_S)
        self._stamps_ns: list[int] = []
        self._azimuths: list[float] = []
        """Unwrapped azimuths, rad."""
        self._elevations: list[float] = []

    def clear(self) -> None:
        """Forget all rays."""
        self._stamps_ns.clear()
        self._azimuths.clear()
        self._elevations.clear()

    def add(self, stamp_ns: int, direction: Vec3) -> None:
        """Add the ray of `stamp_ns`, later than those before, with its unit direction in {W}."""
        stamps_ns = self._stamps_ns
        azimuths = self._azimuths
        azimuth = vector.azimuth(direction)
        if azimuths:
            azimuth = azimuths[-1] + vector.wrap(azimuth - azimuths[-1])
        stamps_ns.append(stamp_ns)
        azimuths.append(azimuth)
        self._elevations.append(vector.elevation(direction))
        oldest_ns = stamp_ns - self._window_ns
        old = 0
        while len(stamps_ns) - old > MIN_RAYS and stamps_ns[old] < oldest_ns:
            old += 1
        if old:
            del stamps_ns[:old], azimuths[:old], self._elevations[:old]

    def rate(self) -> tuple[float, float] | None:
        """Return the speed of azimuth (on the sphere) and elevation, rad/s, or None with too few rays."""
        count = len(self._stamps_ns)
        if count < MIN_RAYS:
            return None
        half = count // 2  # with an odd count the middle ray is in neither half
        first_ns = self._stamps_ns[0]  # a Unix time in ns has more digits than a float
        ages_ns = [stamp_ns - first_ns for stamp_ns in self._stamps_ns]
        span_ns = median(ages_ns[-half:]) - median(ages_ns[:half])
        azimuth_change = median(self._azimuths[-half:]) - median(self._azimuths[:half])
        elevation_change = median(self._elevations[-half:]) - median(self._elevations[:half])
        per_s = NS_PER_S / span_ns
        azimuth_rate = azimuth_change * math.cos(self._elevations[-1]) * per_s
        return azimuth_rate, elevation_change * per_s


class GaugeMethod:
    """Method `gauge` for one person."""

    def __init__(self, config: SelectorConfig) -> None:
        gauge = config.gauge
        self._config = gauge
        self._snap_rad = math.radians(gauge.snap_deg)
        self._steady_rad_s = math.radians(gauge.steady_deg_per_s)
        self._gap_ns = round(config.longest_gap_s * NS_PER_S)
        self._ray_speed = RaySpeedEstimator(SPEED_WINDOW_S)
        self._gauges = Gauges(longest_gap_s=config.longest_gap_s, full_s=gauge.full_s)
        self.latch = self._gauges.latch
        self._hovered: str | None = None
        self._stamp_ns: int | None = None

    @property
    def latched(self) -> Collection[str]:
        """Return the objects that fired and were not left since."""
        return self._gauges.latched

    def step(self, pointing: PointingSample) -> SelectionProgress:
        """Process a cursor."""
        cursor, hovered, view, is_actionable = pointing
        gauges = self._gauges

        # Speed of the ray
        if self._stamp_ns is not None and cursor.stamp_ns - self._stamp_ns > self._gap_ns:
            self._ray_speed.clear()
        self._stamp_ns = cursor.stamp_ns
        if cursor.direction is not None:
            self._ray_speed.add(cursor.stamp_ns, cursor.direction)

        # Hovered object, and the latched ones that are not left
        not_left: Container[str] = ()
        if view is not None:
            hovered = view.pick(self._hovered, self._snap_rad, HYSTERESIS)
            if gauges.latched:
                not_left = view.near(gauges.latched, self._snap_rad, LEAVE_FACTOR)
        elif hovered is not None:
            not_left = {hovered}
        self._hovered = hovered

        # Its gauge fills while the ray is steady on it, in less time where nothing else is near
        full_s = self._config.full_s
        is_steady = True
        if hovered is not None and view is not None:
            rate = self._ray_speed.rate()
            is_steady = rate is not None and view.relative_rate(hovered, rate) < self._steady_rad_s
            if self._config.sparse_full_s != full_s and view.is_isolated(SPARSE_RAD):
                full_s = self._config.sparse_full_s
        fills = is_steady and hovered is not None and is_actionable(hovered)
        fired = gauges.step(cursor.stamp_ns, hovered, fills=fills, full_s=full_s, not_left=not_left)
        if hovered is None:
            return SelectionProgress(None, fired=fired)
        return SelectionProgress(hovered, gauges.fill(hovered), fired, gauges.filled_s(hovered))


GAUGE = SelectionMethod(
    summary="a gauge that fills during steady pointing, and drains otherwise",
    config=SelectorConfig,
    make=lambda config, _surroundings: GaugeMethod(config),
    by_angle=True,
)
