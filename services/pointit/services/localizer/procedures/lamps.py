"""Selection of the lamps that a person can be asked to point at."""

import math
from collections.abc import Sequence

import numpy as np

from pointit.schemas import Environment, Lamp
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.estimation.estimator import SAME_PLACE_M, Refusal

ROUNDS = 2
"""Largest number of holds at each lamp without a configured number."""

MAX_NAMED = 4
"""Largest number of lamps that a message names."""


def select_lamps(room: Environment | None, wanted: tuple[str, ...]) -> list[Lamp] | Refusal:
    """Return the lamps called `wanted`, in that order, or all if none are named; or a refusal."""
    if room is None:
        return Refusal("there is no map yet; start pui, which publishes it")
    known = {lamp.id: lamp for lamp in room.lamps}
    missing = [lamp_id for lamp_id in wanted if lamp_id not in known]
    if missing:
        return Refusal(
            f"lamps {', '.join(missing)} are not on map {room.name!r}, which has "
            f"{', '.join(known) or 'none'}; correct `lamps`"
        )
    return [known[lamp_id] for lamp_id in wanted] if wanted else list(known.values())


def max_holds(config: LocalizerConfig, lamps: int) -> int:
    """Return the largest number of holds of a localization with `lamps` lamps."""
    if config.order == "given":
        return min(config.targets, lamps) if config.targets else lamps
    return config.targets or ROUNDS * lamps


def usable(config: LocalizerConfig, lamps: Sequence[Lamp]) -> Sequence[Lamp]:
    """Return those of `lamps` that may be lit."""
    return lamps[: max_holds(config, len(lamps))] if config.order == "given" else lamps


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
    names = [lamp.id for lamp in lamps[:MAX_NAMED]]
    if len(lamps) > MAX_NAMED:
        return f"{', '.join(names)} and {len(lamps) - MAX_NAMED} more"
    return f"{', '.join(names[:-1])} and {names[-1]}"


def lamp_for_anchor(room: Environment | None, wanted: tuple[str, ...], asked: str) -> list[Lamp] | Refusal:
    """Return the lamp `asked`, or those to choose from if `""`; or a refusal."""
    lamps = select_lamps(room, (asked,) if asked else wanted)
    if isinstance(lamps, Refusal):
        return (
            Refusal(lamps.reason.replace("; correct `lamps`", "; ask for one of those")) if asked else lamps
        )
    if not lamps:
        name = "" if room is None else room.name
        return Refusal(f"pointing at a lamp needs one, map {name!r} has none; add it to the map")
    return lamps
