"""Limits of a robot's speed: it can stop before everything in its way, and is slow near people."""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

from pointit.geometry.vector import Vec3, add, azimuth, direction, dot, norm, scale, wrap
from pointit.services.robot.config import RobotConfig
from pointit.services.robot.safety.region import MARGIN_M, Region
from pointit.services.robot.safety.reports import TURN_S

NEAR_M = 1.0
"""Distance beyond a person's own space in which `max_approach_mps` is the limit."""
SPARE_S = 0.1
"""Time by which a robot brakes earlier than it must."""
SPARE = 0.8
"""Share of the acceleration that is planned with."""
LEAD_S = 0.5
"""Time by which a set-point is farther away than the way to stop, so that a robot need not brake for it."""
MIN_MPS = 0.02
"""Speed at which a robot may always go to a permitted place."""
TURN_STEP_RAD = math.radians(30.0)
"""Angle between two directions in which a robot that turns is checked."""


def stopping_m(config: RobotConfig, speed_mps: float) -> float:
    """Return the way to a standstill from `speed_mps`."""
    return speed_mps * config.reaction_s + speed_mps**2 / (2.0 * config.max_acceleration_mps2)


def lead_m(config: RobotConfig, speed_mps: float) -> float:
    """Return the distance of a set-point ahead, which keeps a robot without a limit hardly faster."""
    return stopping_m(config, speed_mps) + speed_mps * LEAD_S


def speed_limit_mps(config: RobotConfig, region: Region, place_m: Vec3, step: Vec3, yaw_rad: float) -> float:
    """Return the greatest speed at `place_m` in the direction of `step`, to which its front turns."""
    limit = config.max_speed_mps
    length = norm(step)
    if length == 0.0:
        return limit
    ahead = scale(step, 1.0 / length)
    horizon_m = stopping_m(config, limit) + limit * SPARE_S + limit**2 / config.max_acceleration_mps2
    for course, margin_m in (
        (ahead, 0.0),
        *((each, MARGIN_M / 2.0) for each in _turn(config, ahead, yaw_rad)),
    ):
        way = region.way(place_m, add(place_m, scale(course, horizon_m)), margin_m)
        if way.blocker is not None:
            limit = min(limit, _from(config, way.share * horizon_m, 0.0))
    for obstacle in region.obstacles:
        if obstacle.kind != "people":
            continue
        gap_m = region.clearance_m(obstacle, place_m) - NEAR_M
        closing = -dot(ahead, region.away(obstacle, place_m))
        if gap_m <= 0.0:
            limit = min(limit, config.max_approach_mps)
        elif closing > 0.0:
            limit = min(
                limit, max(_from(config, gap_m, config.max_approach_mps), config.max_approach_mps) / closing
            )
    return max(limit, MIN_MPS)


def path_limit_mps(config: RobotConfig, region: Region, points_m: Sequence[Vec3]) -> float:
    """Return the greatest speed along all of a path."""
    people = Region((each for each in region.obstacles if each.kind == "people"), region.apart_m)
    is_near = any(
        people.way(a, b, NEAR_M).blocker or people.blocker(a, NEAR_M) for a, b in pairwise(points_m)
    )
    return min(config.max_speed_mps, config.max_approach_mps) if is_near else config.max_speed_mps


def _turn(config: RobotConfig, ahead: Vec3, yaw_rad: float) -> Iterator[Vec3]:
    """Yield the directions in which a ground robot drives before it has turned from `yaw_rad` to `ahead`."""
    if config.kind == "ground":
        left_rad = wrap(azimuth(ahead) - yaw_rad)
        count = math.ceil(abs(left_rad) / TURN_STEP_RAD)
        yield from (direction(yaw_rad + left_rad * index / count, 0.0) for index in range(count))


def predicted_places_m(
    config: RobotConfig, place_m: Vec3, velocity_mps: Vec3, turn_radps: float
) -> tuple[Vec3, ...]:
    """Return where a robot would come to rest if it were stopped now, or after a ground robot's turn.

    It does not sink below the floor.
    """
    speed_mps = norm(velocity_mps)
    turned_rad = azimuth(velocity_mps) + turn_radps * (config.reaction_s + TURN_S)
    turned_mps = scale(direction(turned_rad, 0.0), speed_mps)
    courses_mps = (velocity_mps, turned_mps) if config.kind == "ground" else (velocity_mps,)
    return tuple(_rest_m(config, place_m, each, speed_mps) for each in courses_mps)


def _rest_m(config: RobotConfig, place_m: Vec3, velocity_mps: Vec3, speed_mps: float) -> Vec3:
    end_m = add(place_m, scale(velocity_mps, stopping_m(config, speed_mps) / speed_mps))
    return (end_m[0], end_m[1], max(end_m[2], min(place_m[2], 0.0)))


def _from(config: RobotConfig, way_m: float, end_mps: float) -> float:
    """Return the speed from which `end_mps` is reached within `way_m`."""
    a = SPARE * config.max_acceleration_mps2
    reaction = a * (config.reaction_s + SPARE_S)
    return math.sqrt(reaction**2 + 2.0 * a * way_m + end_mps**2) - reaction
