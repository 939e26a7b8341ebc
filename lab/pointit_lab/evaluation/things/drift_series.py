"""Series of selections by name while the wrist's yaw drifts, with and without landings as anchors."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.schemas import (
    NS_PER_S,
    Announced,
    Cursor,
    Environment,
    PointingRay,
    SelectionEvent,
    SetPose,
    UserPose,
)
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.pose_manager import PoseManager
from pointit_lab.evaluation.things.announced import ANNOUNCED_ROWS, AnnouncedSite
from pointit_lab.evaluation.things.listening_reach import AnnounceWay, ListenerModel, ListeningReach
from pointit_lab.evaluation.things.things import EYES_M, LIMIT_S, PERSON, START_NS, ReachRow, Result, row_of

SERIES_ROW = replace(ANNOUNCED_ROWS[0], name="4 things 0.7 m apart, 2.6 m away", away_m=2.6)
SELECTIONS = 10
PAUSE_S = 8.0
"""Time from the end of a reach to the beginning of the next one, without pointing, s."""
FIX_SIGMAS = (0.05, 0.05, math.radians(3.0))
"""Standard deviations of x and y, m, and of the yaw, rad, of the pose at the beginning, which is exact."""
POSE_PERIOD_NS = NS_PER_S // 5


class DriftingWrist:
    """A wrist whose yaw drifts at a constant rate, and the localizer's pose of its person."""

    def __init__(self, room: Environment, rate_radps: float, *, learns: bool) -> None:
        """Begin with an exact pose. `learns`: landings of confirmed selections correct it."""
        self._rate_radps, self._learns = rate_radps, learns
        self._manager = PoseManager(PERSON, LocalizerConfig(anchor_at_things=learns))
        self._manager.on_map(room, START_NS)
        self._position_m, self._yaw_rad, self._posed_ns = (0.0, 0.0, 0.0), 0.0, START_NS
        x, y, yaw = (sigma**2 for sigma in FIX_SIGMAS)
        pose_query = SetPose(
            position_m=self._position_m, method="static_targets", covariance=(x, 0, 0, 0, y, 0, 0, 0, yaw)
        )
        self._manager.set_pose(pose_query, START_NS)

    def drift_rad(self, now_ns: int) -> float:
        """Return the true yaw of {H} in {W}."""
        return self._rate_radps * (now_ns - START_NS) / NS_PER_S

    def yaw_error_rad(self, now_ns: int) -> float:
        """Return the error of the localizer's yaw."""
        return self._yaw_rad - self.drift_rad(now_ns)

    def cursor(self, direction_w: Vec3, now_ns: int) -> Cursor:
        """Return the cursor of a person who truly points towards `direction_w`, by the localizer's pose."""
        drift_rad = self.drift_rad(now_ns)
        direction_h = vector.rotate_z(direction_w, -drift_rad)
        origin_h = vector.rotate_z(EYES_M, -drift_rad)
        self._manager.on_ray(PointingRay(stamp_ns=now_ns, origin_m=origin_h, direction=direction_h), now_ns)
        if now_ns - self._posed_ns >= POSE_PERIOD_NS:
            self._update(now_ns)
        origin_m = vector.add(self._position_m, vector.rotate_z(origin_h, self._yaw_rad))
        direction = vector.rotate_z(direction_h, self._yaw_rad)
        return Cursor(stamp_ns=now_ns, origin_m=origin_m, direction=direction)

    def on_announced(self, announced: Announced) -> None:
        """Process the name that is spoken to the person."""
        self._manager.on_announced(announced)

    def on_selection(self, event: SelectionEvent) -> None:
        """Process a selection of the person."""
        if self._learns:
            self._manager.on_selection(event, event.stamp_ns)

    def _update(self, now_ns: int) -> None:
        self._posed_ns = now_ns
        for pose in self._manager.due(now_ns):
            if isinstance(pose, UserPose):
                self._position_m, self._yaw_rad = pose.position_m, pose.yaw_rad


@dataclass(frozen=True, kw_only=True)
class SeriesRow:
    """The last selection of each series."""

    drift_degps: float
    learns: bool
    last: ReachRow
    yaw_error_deg: float
    """Root mean square of the error of the yaw at the last selection."""


def drift_series(
    settings: tuple[AnnounceWay, float, bool], piece: tuple[int, int]
) -> list[tuple[Result, float]]:
    """Return the last result, and the yaw error then, rad, of one person each for seeds from the first on.

    `settings`: way, standard deviation of the drift between people, degrees/s, and whether landings count.
    """
    first, count = piece
    return [_series(*settings, seed) for seed in range(first, first + count)]


def _series(way: AnnounceWay, drift_degps: float, learns: bool, seed: int) -> tuple[Result, float]:  # noqa: FBT001
    rng = np.random.default_rng([seed, 13])
    site = AnnouncedSite(SERIES_ROW, way)
    rate_radps = math.radians(drift_degps) * float(rng.standard_normal())
    site.wrist = wrist = DriftingWrist(site.environment, rate_radps, learns=learns)
    begun_s, arm, goal, result = 0.0, None, "", Result("nothing", LIMIT_S, None)
    for _ in range(SELECTIONS):
        others = [name for name in site.positions_m if name != goal]
        goal = others[int(rng.integers(len(others)))]
        arm = ListeningReach(
            EYES_M, site.positions_m, goal, rng, arm, way=way, model=ListenerModel(), cells=site.cells
        )
        result = site.select(arm, goal, begun_s)
        begun_s += result.took_s + PAUSE_S
    return result, wrist.yaw_error_rad(START_NS + round((begun_s - PAUSE_S) * NS_PER_S))


def series_row(drift_degps: float, learns: bool, ends: Sequence[tuple[Result, float]]) -> SeriesRow:  # noqa: FBT001
    """Return the shares of the last selections, and their yaw error."""
    row = replace(SERIES_ROW, name=f"drift {drift_degps:g}°/s, {'landings' if learns else 'nothing'} learned")
    errors_deg = np.degrees([error for _, error in ends])
    return SeriesRow(
        drift_degps=drift_degps,
        learns=learns,
        last=row_of(row, [result for result, _ in ends]),
        yaw_error_deg=float(np.sqrt(np.mean(errors_deg**2))),
    )
