"""Localization by pointing at lamps that are lit one after the other (paper, §III-B).

The information of one pointing is its Fisher information about x, y, yaw and the person's elevation bias;
holds add up. The position is that of the pose so far, or any in the room before there is one. The pose's yaw
does not matter, since turning the person turns all rays equally.

In the order given (two of them are the paper's case) or the most informative one first: as many as
configured, or until the pose is certain enough. Pure: rays and the time go in; progress and the pose come
out.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pointit.geometry.array_types import Array
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S, Environment, Lamp, PointingRay
from pointit.schemas.text import all_of, first_of
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.estimation import unfiltered_rays
from pointit.services.localizer.estimation.estimator import (
    SAME_PLACE_M,
    Pointings,
    Refusal,
    Solution,
    SolverSettings,
    solve,
)
from pointit.services.localizer.outputs import Output, pose_message
from pointit.services.localizer.procedure import LampProcedure
from pointit.services.localizer.verification import held, outlier_lamps

ROUNDS = 2
"""Largest number of holds at each lamp without a configured number."""

MAX_NAMED = 4
"""Largest number of lamps that a message names."""

EYES_M = 1.64
"""Eye height above the floor before a ray has given it."""

AROUND_M = 1.5
"""Largest distance of people outside the rectangle of the lamps."""

NEAREST_M = 0.7
"""Smallest horizontal distance of people from a lamp."""

PLACES = 7
"""Number of assumed positions along each side of the room, before a pose is known."""

PARAMETERS = 4
"""x, y, yaw, elevation bias."""

VAGUE_M = 10.0
VAGUE_RAD = math.pi
"""Standard deviations of an unknown pose."""

_SETTINGS = SolverSettings()

MIN_LAMPS = 2
"""Number of lamps before a pose can be solved."""


def select_lamps(
    room: Environment | None, wanted: tuple[str, ...], remedy: str = "correct `lamps`"
) -> list[Lamp] | Refusal:
    """Return the lamps called `wanted`, in that order, or all if none are named; or a refusal.

    `remedy`: what to do if the map lacks one.
    """
    if room is None:
        return Refusal("there is no map yet; start pui, which publishes it")
    lamp_of_id = {lamp.id: lamp for lamp in room.lamps}
    missing = [lamp_id for lamp_id in wanted if lamp_id not in lamp_of_id]
    if missing:
        lamp_ids = ", ".join(lamp_of_id) or "none"
        return Refusal(
            f"lamps {', '.join(missing)} are not on map {room.name!r}, which has {lamp_ids}; {remedy}"
        )
    if not wanted:
        return list(lamp_of_id.values())
    return [lamp_of_id[lamp_id] for lamp_id in wanted]


def max_holds(config: LocalizerConfig, lamps: int) -> int:
    """Return the largest number of holds of a localization with `lamps` lamps."""
    if config.order == "given":
        return min(config.targets, lamps) if config.targets else lamps
    return config.targets or ROUNDS * lamps


def usable(config: LocalizerConfig, lamps: Sequence[Lamp]) -> Sequence[Lamp]:
    """Return those of `lamps` that may be lit."""
    if config.order != "given":
        return lamps
    return lamps[: max_holds(config, len(lamps))]


def lamps_for_pose(room: Environment | None, config: LocalizerConfig) -> list[Lamp] | Refusal:
    """Return the configured lamps of `room` (None: no map yet), or a refusal if they determine no pose."""
    lamps = select_lamps(room, config.lamps)
    if isinstance(lamps, Refusal):
        return lamps
    used = usable(config, lamps)
    needs = "pointing at lamps needs two at different places"
    if len(used) < 2:
        name = "" if room is None else room.name
        return Refusal(f"{needs}, map {name!r} gives {len(used)}; add lamps to the map, or correct `lamps`")
    spread_m = np.ptp([lamp.position_m for lamp in used], axis=0)
    if float(spread_m.max()) < SAME_PLACE_M:
        return Refusal(f"{needs}, and {_named(used)} are at one; add one elsewhere, or correct the map")
    if float(spread_m[:2].max()) < SAME_PLACE_M:
        return Refusal(
            f"{_named(used)} are above one another, so the direction is open; add a lamp to the side, or "
            "correct the map"
        )
    return lamps


def map_change_reason(lamps: Sequence[Lamp], room: Environment) -> str:
    """Return the change of `lamps` on a new map, as in `lamp a left`, or `""` if they are where they were."""
    places = {lamp.id: lamp.position_m for lamp in room.lamps}
    for lamp in lamps:
        place_m = places.get(lamp.id)
        if place_m is None:
            return f"lamp {lamp.id} left"
        moved_m = math.dist(place_m, lamp.position_m)
        if moved_m > SAME_PLACE_M:
            return f"lamp {lamp.id} moved by {moved_m:.2f} m"
    return ""


def _named(lamps: Sequence[Lamp]) -> str:
    names = [lamp.id for lamp in lamps]
    return all_of(names) if len(names) <= MAX_NAMED else first_of(names, MAX_NAMED)


def lamp_for_anchor(room: Environment | None, wanted: tuple[str, ...], asked: str) -> list[Lamp] | Refusal:
    """Return the lamp `asked`, or those to choose from if `""`; or a refusal."""
    if asked:
        lamps = select_lamps(room, (asked,), remedy="ask for one of those")
    else:
        lamps = select_lamps(room, wanted)
    if isinstance(lamps, Refusal):
        return lamps
    if not lamps:
        name = "" if room is None else room.name
        return Refusal(f"pointing at a lamp needs one, map {name!r} has none; add it to the map")
    return lamps


@dataclass(frozen=True, kw_only=True)
class ObservationModel:
    """Noise of a hold, which is one pointing, however long: a reach errs until the next one."""

    ray_sigma_rad: float = _SETTINGS.act_sigma_rad
    """Standard deviation of one pointing sideways."""
    elevation_sigma_rad: float = _SETTINGS.elevation_sigma_rad
    """The same upwards."""
    bias_sigma_rad: float = _SETTINGS.bias_sigma_rad
    """Standard deviation of the person's elevation bias."""
    body_sigma_m: float = _SETTINGS.body_sigma_m
    """Standard deviation of the eyes' position, which makes near targets less informative."""
    eyes_m: float = EYES_M
    """Eye height above the floor."""


def fisher_information(targets_m: Array, eyes_m: Array, observation_model: ObservationModel) -> Array:
    """Return the information about (x, y, yaw, bias) of one hold at each target.

    Args:
        targets_m: n x 3, {W}.
        eyes_m: p x 3, {W}: positions of the eyes, not straight above or below a target.
        observation_model: noise of a hold.

    Returns:
        p x n x 4 x 4, in 1/m², 1/(m·rad), 1/rad².
    """
    # Bearing of each target from each pair of eyes
    offsets = targets_m - eyes_m[:, None, :]
    x, y, z = offsets.transpose(2, 0, 1)
    distance = np.maximum(np.linalg.norm(offsets, axis=2), 1e-3)
    level = np.maximum(np.hypot(x, y), 1e-3)
    east = x / level
    north = y / level
    cos_el = level / distance
    sin_el = z / distance

    # Derivatives of the angles sideways (row 0) and upwards (row 1)
    slopes = np.zeros((*distance.shape, 2, 4))
    slopes[..., 0, 0] = north / distance
    slopes[..., 0, 1] = -east / distance
    slopes[..., 0, 2] = -cos_el
    slopes[..., 1, 0] = sin_el * east / distance
    slopes[..., 1, 1] = sin_el * north / distance
    slopes[..., 1, 3] = 1.0

    # The eyes' position is uncertain, which turns rays at near targets more
    sigmas = np.array([observation_model.ray_sigma_rad, observation_model.elevation_sigma_rad])
    body_sigmas = observation_model.body_sigma_m / distance[..., None]
    variance = sigmas**2 + body_sigmas**2
    information: Array = np.einsum("pnij,pnik,pni->pnjk", slopes, slopes, 1.0 / variance)
    return information


def log_det_information(information_of_pose: Array) -> Array:
    """Return -log det of the covariance of (x, y, yaw) with an unknown elevation bias.

    Args:
        information_of_pose: ... x 4 x 4, of (x, y, yaw, bias).
    """
    _, whole = np.linalg.slogdet(information_of_pose)
    bias_information = information_of_pose[..., 3, 3]
    return np.asarray(whole - np.log(bias_information), dtype=np.float64)


def next_target(
    lamps_m: Sequence[Vec3],
    visits: Sequence[int],
    observation_model: ObservationModel,
    *,
    floor_m: float = 0.0,
    place_m: tuple[float, float] | None = None,
) -> int:
    """Return the index of the lamp to point at next.

    A lamp that was not visited is preferred to one that was; among equals the first.

    Args:
        lamps_m: positions of the lamps, {W}.
        visits: number of holds at each.
        observation_model: noise of a hold.
        floor_m: height of the floor in {W}.
        place_m: x and y of the person. None if unknown: anywhere in the room.
    """
    # Information of one hold at each lamp from each place, and what there is after it (places x lamps)
    lamps = np.array(lamps_m, dtype=np.float64)
    counts = np.array(visits)
    places = _possible_places(lamps) if place_m is None else np.array([place_m])
    eyes_z_m = np.full(len(places), floor_m + observation_model.eyes_m)
    eyes = np.column_stack([places, eyes_z_m])
    gained = fisher_information(lamps, eyes, observation_model)
    visited = np.einsum("n,pnij->pij", counts, gained)
    so_far = visited + prior(observation_model)
    after = so_far[:, None] + gained
    gains = log_det_information(after).mean(axis=0)

    # One hold determines no pose: the first lamp is the more informative one of the best pair
    if not counts.any():
        if len(lamps) == 1:
            return 0
        after_pair = after[:, :, None] + gained[:, None, :]
        pair_gains = log_det_information(after_pair).mean(axis=0)
        np.fill_diagonal(pair_gains, -np.inf)
        best = int(np.argmax(pair_gains))
        row, column = np.unravel_index(best, pair_gains.shape)
        first, second = sorted((int(row), int(column)))
        return second if gains[second] > gains[first] else first
    is_least_visited = counts == counts.min()
    return int(np.argmax(np.where(is_least_visited, gains, -np.inf)))


def prior(observation_model: ObservationModel) -> Array:
    """Return the prior information (4 x 4) about (x, y, yaw, bias)."""
    sigmas = [VAGUE_M, VAGUE_M, VAGUE_RAD, observation_model.bias_sigma_rad]
    return np.diag([sigma**-2 for sigma in sigmas])


def _possible_places(lamps: Array) -> Array:
    """Return possible positions of people (p x 2), evenly over the room but not close to a lamp."""
    low = lamps[:, :2].min(axis=0) - AROUND_M
    high = lamps[:, :2].max(axis=0) + AROUND_M
    east, north = np.linspace(low, high, PLACES).T
    grid = np.stack(np.meshgrid(east, north), axis=-1)
    places: Array = grid.reshape(-1, 2)
    offsets = places[:, None, :] - lamps[:, :2]
    distances_m = np.linalg.norm(offsets, axis=2)
    free: Array = places[distances_m.min(axis=1) >= NEAREST_M]
    return free if len(free) else places


def best_for_yaw(
    lamps_m: Sequence[Vec3],
    place_m: tuple[float, float],
    covariance: Array,
    observation_model: ObservationModel,
    *,
    floor_m: float = 0.0,
) -> int:
    """Return the index of the lamp that makes the yaw of a known pose most certain.

    Mostly that is a far one at eye height, since an uncertain position turns it less. After that one, a lamp
    in another direction separates position and yaw.

    Args:
        lamps_m: positions of the lamps, {W}, at least one.
        place_m: x and y of the person.
        covariance: 3 x 3, of x, y, yaw.
        observation_model: noise of a hold.
        floor_m: height of the floor in {W}.
    """
    lamps = np.array(lamps_m, dtype=np.float64)
    eyes = np.array([[*place_m, floor_m + observation_model.eyes_m]])
    offsets = lamps[:, :2] - eyes[0, :2]
    distances_m: Array = np.linalg.norm(offsets, axis=1)
    is_usable = distances_m >= NEAREST_M
    if not is_usable.any():
        return 0

    # Covariance after one hold at each lamp, (I + C F)⁻¹ C: unlike C⁻¹ it exists for an exact pose, too
    information: Array = fisher_information(lamps, eyes, observation_model)[0]
    gained = information[:, :3, :3]
    covariances = np.broadcast_to(covariance, gained.shape)
    remaining = np.linalg.solve(np.eye(3) + covariance @ gained, covariances)
    yaw_variances = remaining[:, 2, 2]
    return int(np.argmin(np.where(is_usable, yaw_variances, np.inf)))


class StaticTargets(LampProcedure):
    """One run of the procedure."""

    def __init__(self, lamps: Sequence[Lamp], config: LocalizerConfig) -> None:
        """Create the procedure for `lamps`, at least one, in the order of lighting."""
        self._lamps = tuple(lamps)
        self._settings = config.believed()
        self._max_holds = max_holds(config, len(self._lamps))
        is_fixed_number = config.order == "given" or bool(config.targets)
        fewest_holds = self._max_holds if is_fixed_number else MIN_LAMPS
        min_rays = -(-self._settings.min_samples // fewest_holds)
        super().__init__((lamp.id for lamp in lamps), config, min_rays, "start again")

    @property
    def targets(self) -> Sequence[Lamp]:
        """Return the lamps that are, were or may be pointed at."""
        return usable(self._config, self._lamps)

    @property
    def times_ns(self) -> tuple[int, int]:
        """Return the stamps of the first and the middle ray, -1 if there are none."""
        rays = self._rays
        if not rays:
            return -1, -1
        middle = rays[len(rays) // 2]
        return rays[0].stamp_ns, middle.stamp_ns

    @property
    def _rays(self) -> list[PointingRay]:
        rays: list[PointingRay] = []
        for hold, _ in self._holds:
            rays += hold.rays
        return rays

    def _next_lamp(self) -> Lamp:
        if self._config.order == "given":
            return self._lamps[len(self._holds)]
        settings = self._settings
        rays = self._rays
        solution = self._solution
        observation_model = ObservationModel(
            ray_sigma_rad=settings.act_sigma_rad,
            elevation_sigma_rad=settings.elevation_sigma_rad,
            bias_sigma_rad=unfiltered_rays.believed(settings, rays).bias_sigma_rad,
            body_sigma_m=settings.body_sigma_m,
            eyes_m=rays[-1].origin_m[2] if rays else EYES_M,
        )
        held_ids = [lamp.id for _, lamp in self._holds]
        place_m = None if solution is None else (solution.x_m, solution.y_m)
        best = next_target(
            [lamp.position_m for lamp in self._lamps],
            [held_ids.count(lamp.id) for lamp in self._lamps],
            observation_model,
            floor_m=self._config.floor_m,
            place_m=place_m,
        )
        return self._lamps[best]

    def _held(self, now_ns: int) -> list[Output]:
        count = len(self._holds)
        if self._config.order == "given":
            if count < self._max_holds:
                return self._light(now_ns)
            return self._finish(now_ns, self._solve())

        # A pose that is refused as uncertain still helps to choose the next lamp
        result = self._solve() if count >= MIN_LAMPS else None
        so_far = self._so_far() if isinstance(result, Refusal) else result
        self._solution = so_far if isinstance(so_far, Solution) else None

        if result is None:
            return self._light(now_ns)
        if count < self._max_holds and self._needs_another_hold(result):
            return self._light(now_ns)
        return self._finish(now_ns, result)

    def _needs_another_hold(self, result: Solution | Refusal) -> bool:
        """Return True if another hold is useful. A second one at a lamp, if accepted, has the same error."""
        if isinstance(result, Refusal) or self._config.targets:
            return True
        if len(self._lit) >= len(self._lamps):
            return False
        enough = self._config.enough
        yaw_sigma_deg = math.degrees(result.yaw_sigma_rad)
        return result.position_sigma_m > enough.position_m or yaw_sigma_deg > enough.yaw_deg

    def _solve(self) -> Solution | Refusal:
        return held(self._pointings(), self._believed(), floor_m=self._config.floor_m, lamps=self._lit)

    def _so_far(self) -> Solution | Refusal:
        """Return the pose however uncertain it is, to choose the next lamp."""
        return solve(self._pointings(), self._believed().unlimited(), floor_m=self._config.floor_m)

    def _believed(self) -> SolverSettings:
        return unfiltered_rays.believed(self._settings, self._rays)

    def _pointings(self) -> Pointings:
        rays = self._rays
        stamps_s = np.array([ray.stamp_ns - rays[0].stamp_ns for ray in rays]) / NS_PER_S
        origins_m = unfiltered_rays.origins(rays)
        directions = unfiltered_rays.directions(rays)
        lamps_m: list[Vec3] = []
        for hold, lamp in self._holds:
            lamps_m += [lamp.position_m] * len(hold.rays)
        targets_m = np.array(lamps_m, dtype=np.float64).reshape(-1, 3)
        return Pointings(stamps_s, origins_m, directions, targets_m)

    def _finish(self, now_ns: int, result: Solution | Refusal) -> list[Output]:
        if isinstance(result, Refusal):
            reason = result.reason
            tried = len(self._holds)
            if self._config.order == "informative" and tried > MIN_LAMPS:
                reason = f"after pointing {tried} times {reason}"
            return self._end(now_ns, "refused", reason, result.residual_rad)
        self._solution = result
        self._running = False
        pose = pose_message(result, "static_targets", self._rays[-1].stamp_ns, self._config)
        localization = self._localization(
            now_ns, "solved", residual_rad=result.residual_rad, reason=self._outlier_note(), progress=1.0
        )
        return [pose, localization]

    def _outlier_note(self) -> str:
        """Return a note that a lamp was missed and left out, or `""`."""
        outliers = outlier_lamps(self._pointings(), self._believed(), floor_m=self._config.floor_m)
        if not outliers:
            return ""
        return f"the pointing at {self._lit[outliers[0]]} missed it by far and does not count"

    @property
    def _lit(self) -> list[str]:
        """Return the ids of the lamps, in the order of their first holds."""
        return list(dict.fromkeys(lamp.id for _, lamp in self._holds))

    @property
    def _count(self) -> int:
        expected = self._max_holds
        if self._config.order == "informative":
            expected = self._config.targets or len(self._lamps)
        return max(len(self._holds), expected)
