"""Messages on unknown poses and on positions outside the map; pure."""

from collections.abc import Collection

from pointit.api.press import add_or_meant
from pointit.diagnosis.writers import silence_reason
from pointit.runtime.bus.contract import AnyTopic
from pointit.schemas import Environment, Localization
from pointit.schemas.base import Vec3
from pointit.services.registry import person_of

FAR_M = 5.0
"""Distance outside the map's contents beyond which a position is likely a mistake."""


def people(present: Collection[str]) -> list[str]:
    """Return the users of the services in `present`."""
    return sorted({user for user in map(person_of, present) if user})


def missing_reason(topic: AnyTopic, user: str, present: Collection[str]) -> str:
    """Return a clause with the reason why `topic` of `user` is silent, and the remedy."""
    there = people(present)
    if user in there:
        return silence_reason(topic, user, present)
    who = f"there {'is' if len(there) == 1 else 'are'} {', '.join(there)}" if there else "there are no people"
    return f"no {user} is on this site, {who}; {add_or_meant(user, there)}"


def localizing(user: str, news: Localization | None) -> str:
    """Return the progress of a person's localization, or `""` if there is none."""
    if news is None or news.phase != "sampling":
        return ""
    if news.ahead:
        return f"{user} waits for the lamps, which {news.ahead[0]} points at; wait until it is their turn"
    if news.purpose == "anchor":
        return f"{user} is pointing at {news.target_id or 'a lamp'} to correct the pose; wait"
    lamp = f", lamp {news.target_index + 1} of {news.target_count}" if news.target_count > 1 else ""
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
