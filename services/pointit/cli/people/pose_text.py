"""A person's pose in readable units, and messages on unknown poses and positions outside the map; pure."""

import math
from collections.abc import Collection, Mapping
from typing import Any

from pointit.api.press import add_or_similar
from pointit.diagnosis.writers import silence_reason
from pointit.forearm.true_pose import PoseError
from pointit.runtime.bus.contract import AnyTopic
from pointit.schemas import NS_PER_S, Environment, Localization, UserPose
from pointit.schemas.base import Vec3
from pointit.services.registry import person_of

UNKNOWN_DRIFT_DEGPMIN = 10.0
"""1 sigma from which a drift counts as unknown; real IMUs drift by as much."""

METHODS = {
    "fixed": "given",
    "static_targets": "found by pointing at lamps",
    "moving_target": "found by pointing at a moving robot",
    "external": "from a tracker",
}

FAR_M = 5.0
"""Distance outside the map's contents beyond which a position is likely a mistake."""


def sigmas(pose: UserPose) -> tuple[float, float]:
    """Return 1 sigma of the position along its worse direction, m, and of the yaw, rad."""
    c = pose.covariance
    middle, difference = (c[0] + c[4]) / 2.0, math.hypot((c[0] - c[4]) / 2.0, c[1])
    return math.sqrt(max(0.0, middle + difference)), math.sqrt(max(0.0, c[8]))


def sigma_text(pose: UserPose) -> str:
    """Return 1 sigma as `to 0.05 m and 1.2°`; a pose that was given counts as exact."""
    position_m, yaw_rad = sigmas(pose)
    if position_m == yaw_rad == 0.0:
        return "exactly, as it was given"
    return f"to {position_m:.2f} m and {math.degrees(yaw_rad):.1f}°"


def drift_degpmin(pose: UserPose) -> float:
    """Return the yaw drift of the pose by the IMU, °/min."""
    return math.degrees(pose.yaw_rate_radps) * 60.0


def fields(pose: UserPose, now_ns: int, error: PoseError | None = None) -> dict[str, Any]:
    """Return `pose` and its `error` for programs; angles in degrees, ages in seconds, None if unknown."""
    yaw_error_rad = None if error is None else error.yaw_rad
    position_sigma_m, yaw_sigma_rad = sigmas(pose)
    rate_sigma = pose.yaw_rate_sigma_radps
    return {
        "position_m": pose.position_m,
        "position_sigma_m": position_sigma_m,
        "yaw_deg": math.degrees(math.remainder(pose.yaw_rad, math.tau)),
        "yaw_sigma_deg": math.degrees(yaw_sigma_rad),
        "elevation_bias_deg": math.degrees(pose.elevation_bias_rad),
        "remembered_localizations": pose.remembered_bias.localizations if pose.remembered_bias else 0,
        "drift_deg_per_min": drift_degpmin(pose),
        "drift_sigma_deg_per_min": None if rate_sigma is None else math.degrees(rate_sigma) * 60.0,
        "anchor_age_s": _age_s(pose.anchored_ns, now_ns) if pose.anchored_ns else None,
        "method": pose.method,
        "age_s": _age_s(pose.stamp_ns, now_ns),
        "position_error_m": None if error is None else error.position_m,
        "yaw_error_deg": None if yaw_error_rad is None else math.degrees(yaw_error_rad),
    }


def lines(shown: Mapping[str, Any]) -> list[str]:
    """Return the result of `fields` as lines for people."""
    x, y, z = shown["position_m"]
    is_exact = shown["position_sigma_m"] == shown["yaw_sigma_deg"] == 0.0
    place, turn = f"x {x:.2f} m, y {y:.2f} m, z {z:.2f} m", f"{shown['yaw_deg']:.1f}°"
    if not is_exact:
        place += f"; 1 sigma {shown['position_sigma_m']:.2f} m"
        turn += f"; 1 sigma {shown['yaw_sigma_deg']:.1f}°"
    drift = "not estimated"
    sigma = shown["drift_sigma_deg_per_min"]
    if sigma is not None and sigma >= UNKNOWN_DRIFT_DEGPMIN and abs(shown["drift_deg_per_min"]) < sigma:
        drift = "not known yet"
    elif sigma is not None:
        drift = f"{shown['drift_deg_per_min']:.1f} °/min; 1 sigma {sigma:.1f} °/min"
    anchor = "never" if shown["anchor_age_s"] is None else f"{_age(shown['anchor_age_s'])} ago"
    rows = [
        ("position", place),
        ("yaw", turn),
        ("drift", drift),
        ("last anchor", anchor),
        ("method", METHODS[shown["method"]] + (", counts as exact" if is_exact else "")),
        ("published", f"{_age(shown['age_s'])} ago"),
    ]
    if count := shown["remembered_localizations"]:
        rows.insert(2, ("remembered", f"elevation bias of {count} localization{'s' * (count > 1)}"))
    if shown["elevation_bias_deg"]:
        which = "high" if shown["elevation_bias_deg"] > 0 else "low"
        rows.insert(2, (f"rays too {which}", f"by {abs(shown['elevation_bias_deg']):.1f}°"))
    if shown["position_error_m"] is not None:
        turn = "not known" if shown["yaw_error_deg"] is None else f"{shown['yaw_error_deg']:+.1f}°"
        rows.append(
            ("true error", f"position {shown['position_error_m']:.2f} m, yaw {turn}, by motion capture")
        )
    return [f"{name:<14}{text}" for name, text in rows]


def _age_s(stamp_ns: int, now_ns: int) -> float:
    return max(0, now_ns - stamp_ns) / NS_PER_S


def _age(age_s: float) -> str:
    return f"{age_s:.1f} s" if age_s < 10 else f"{age_s:.0f} s" if age_s < 120 else f"{age_s / 60:.0f} min"


def people(present: Collection[str]) -> list[str]:
    """Return the users of the services in `present`."""
    return sorted({user for user in map(person_of, present) if user})


def missing_reason(topic: AnyTopic, user: str, present: Collection[str]) -> str:
    """Return a clause with the reason why `topic` of `user` is silent, and the remedy."""
    there = people(present)
    if user in there:
        return silence_reason(topic, user, present)
    who = f"there {'is' if len(there) == 1 else 'are'} {', '.join(there)}" if there else "there are no people"
    return f"no {user} is on this site, {who}; {add_or_similar(user, there)}"


def localizing(user: str, localization: Localization | None) -> str:
    """Return the progress of a person's localization, or `""` if there is none."""
    if localization is None or localization.phase != "sampling":
        return ""
    if localization.ahead:
        ahead = localization.ahead[0]
        return f"{user} waits for the lamps, which {ahead} points at; wait until it is their turn"
    if localization.purpose == "anchor":
        return f"{user} is pointing at {localization.target_id or 'a lamp'} to correct the pose; wait"
    lamp = (
        f", lamp {localization.target_index + 1} of {localization.target_count}"
        if localization.target_count > 1
        else ""
    )
    return f"{user} is being localized{lamp}; wait until that is done"


def out_of_map_warning(place: Vec3, room: Environment) -> str:
    """Return a warning if `place` is farther than `FAR_M` outside the map's contents, else `""`."""
    points = [lamp.position_m for lamp in room.lamps]
    lines = [*(strip.line_m for strip in room.strips), *(belt.line_m for belt in room.belts)]
    points += [point for line in lines for point in line]
    if not points:
        return ""
    spans = [(min(point[axis] for point in points), max(point[axis] for point in points)) for axis in (0, 1)]
    away_m = max(max(low - place[axis], place[axis] - high) for axis, (low, high) in enumerate(spans))
    if away_m <= FAR_M:
        return ""
    (x_low, x_high), (y_low, y_high) = spans
    return (
        f"{place[0]:g}, {place[1]:g} m is {away_m:.0f} m outside the contents of map {room.name!r}: "
        f"x {x_low:.1f} to {x_high:.1f} m, y {y_low:.1f} to {y_high:.1f} m"
    )
