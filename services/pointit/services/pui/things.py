"""The things of a map as tracked objects."""

from pointit.geometry.polyline import Polyline
from pointit.schemas import Environment, Thing, TrackedObject, TrackedObjects

TRACKER = "things"
PERIOD_S = 0.4
"""Period at which the things are listed again, s. Subscribers take silence for the end of their tracker."""


def listing(environment: Environment, stamp_ns: int) -> TrackedObjects:
    """Return the things of `environment`, those with a part of a strip as objects on it."""
    lines = {strip.id: strip.line_m for strip in environment.strips}
    objects = tuple(_tracked(thing, lines) for thing in environment.fixed_things)
    return TrackedObjects(stamp_ns=stamp_ns, objects=objects)


def _tracked(thing: Thing, lines: dict[str, tuple[tuple[float, float, float], ...]]) -> TrackedObject:
    on_strip = thing.strip in lines
    length_m = Polyline(lines[thing.strip]).length_m if on_strip else 0.0
    start_m, end_m = (min(max(at_m, 0.0), length_m) for at_m in thing.part_m)
    return TrackedObject(
        id=thing.id,
        position_m=thing.center_m,
        length_m=end_m - start_m if on_strip else max(thing.size_m[:2]),
        surface="strip" if on_strip else "none",
        surface_id=thing.strip if on_strip else "",
        surface_position_m=(start_m + end_m) / 2.0,
        yaw_rad=thing.yaw_rad,
        size_m=thing.size_m,
        **thing.object_fields,
    )
