"""Which lamps of the room a person can be asked to point at."""

from pointit.schemas import Environment, Lamp
from pointit.services.localizer.estimator import Refusal


def usable(room: Environment | None, wanted: tuple[str, ...]) -> list[Lamp] | Refusal:
    """Return the lamps called `wanted`, in that order, or all when none are named; or why that cannot be."""
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


def for_a_pose(room: Environment | None, wanted: tuple[str, ...]) -> list[Lamp] | Refusal:
    """Return lamps at two or more places, or why there are none."""
    lamps = usable(room, wanted)
    if isinstance(lamps, Refusal) or len({lamp.position_m for lamp in lamps}) >= 2:
        return lamps
    name = "" if room is None else room.name
    return Refusal(f"pointing at lamps needs two at different places, map {name!r} gives {len(lamps)}")


def for_an_anchor(room: Environment | None, wanted: tuple[str, ...], asked: str) -> list[Lamp] | Refusal:
    """Return the lamp that was `asked` for, or those to choose from; or why there is none."""
    lamps = usable(room, (asked,) if asked else wanted)
    if isinstance(lamps, Refusal):
        return (
            Refusal(lamps.reason.replace("; correct `lamps`", "; ask for one of those")) if asked else lamps
        )
    if not lamps:
        name = "" if room is None else room.name
        return Refusal(f"pointing at a lamp needs one, map {name!r} has none; add it to the map")
    return lamps
