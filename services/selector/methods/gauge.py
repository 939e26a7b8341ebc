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
"""Share of the fill rate at which gauges of other objects drain."""
LEAVE_NS = round(0.3 * NS_PER_S)
"""Time off an object after which its full gauge can fill again, ns."""


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
        self, stamp_ns: int, hovered: str | None, *, fills: bool, full_s: float, near: Container[str] = ()
    ) -> str | None:
        """Process a cursor, later than the one before. Return the object whose gauge is full now, or None.

        Args:
            stamp_ns: stamp of the cursor.
            hovered: hovered object.
            fills: True if the gauge of that object fills, else it keeps its level.
            full_s: time that fills it, s.
            near: latched objects that this cursor has not left.
        """
        before_ns, self._stamp_ns = self._stamp_ns, stamp_ns
        elapsed_s = 0.0 if before_ns is None else (stamp_ns - before_ns) / NS_PER_S
        self._unlatch(stamp_ns, near, has_gap=elapsed_s > self._gap_s)
        is_filled = elapsed_s <= self._gap_s and hovered is not None
        if self._fill:
            self._drain_others(hovered if is_filled else None, elapsed_s)
        if hovered is None or not is_filled or not fills or hovered in self._latched:
            return None
        fill = self._fill.get(hovered, 0.0) + elapsed_s / full_s
        if fill < 1.0 - 1e-9:
            self._fill[hovered] = fill
            self._spent_s[hovered] = self._spent_s.get(hovered, 0.0) + elapsed_s
            return None
        self._fill.pop(hovered, None)
        self._spent_s.pop(hovered, None)
        self._latched[hovered] = None
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
            left = fill - drained
            if left <= 0.0:
                del self._fill[object_id]
                self._spent_s.pop(object_id, None)
            else:
                self._spent_s[object_id] = self._spent_s.get(object_id, 0.0) * left / fill
                self._fill[object_id] = left

    def _unlatch(self, stamp_ns: int, near: Container[str], *, has_gap: bool) -> None:
        for object_id, since_ns in list(self._latched.items()):
            if object_id in near:
                self._latched[object_id] = None
            elif since_ns is None or has_gap:
                self._latched[object_id] = stamp_ns
            elif stamp_ns - since_ns >= LEAVE_NS:
                del self._latched[object_id]


MIN_RAYS = 2
"""Number of rays needed for a speed."""


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
        stamps_ns, azimuths = self._stamps_ns, self._azimuths
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
        turned = median(self._azimuths[-half:]) - median(self._azimuths[:half])
        raised = median(self._elevations[-half:]) - median(self._elevations[:half])
        per_s = NS_PER_S / span_ns
        return turned * math.cos(self._elevations[-1]) * per_s, raised * per_s


class GaugeMethod:
    """Method `gauge` for one person."""

    def __init__(self, config: SelectorConfig) -> None:
        self._config = gauge = config.gauge
        self._snap_rad = math.radians(gauge.snap_deg)
        self._steady_rad_s = math.radians(gauge.steady_deg_per_s)
        self._gap_ns = round(config.longest_gap_s * NS_PER_S)
        self._steadiness = RaySpeedEstimator(SPEED_WINDOW_S)
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
            hovered = view.pick(self._hovered, self._snap_rad, HYSTERESIS)
            latched = gauges.latched
            if latched:
                near = view.near(latched, self._snap_rad, LEAVE_FACTOR)
        elif hovered is not None:
            near = {hovered}
        if hovered is not None and view is not None:
            rate = self._steadiness.rate()
            fills = rate is not None and view.relative_rate(hovered, rate) < self._steady_rad_s
            if gauge.sparse_full_s != full_s and view.is_isolated(SPARSE_RAD):
                full_s = gauge.sparse_full_s
        fills = fills and hovered is not None and acts(hovered)
        fired = gauges.step(cursor.stamp_ns, hovered, fills=fills, full_s=full_s, near=near)
        self._hovered = hovered
        if hovered is None:
            return SelectionProgress(None, fired=fired)
        return SelectionProgress(hovered, gauges.fill(hovered), fired, gauges.filled_s(hovered))


GAUGE = SelectionMethod(
    summary="a gauge that fills during steady pointing, and drains otherwise",
    config=SelectorConfig,
    make=lambda config, _surroundings: GaugeMethod(config),
    by_angle=True,
)
