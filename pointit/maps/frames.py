"""Alignment of trackers: objects in the coordinates of a frame of the map become objects in {W}."""

from collections.abc import Iterable
from typing import Any

from pointit.geometry import vector
from pointit.geometry.rotation import rotate
from pointit.geometry.vector import Vec3
from pointit.runtime.config.nearest_name import did_you_mean
from pointit.runtime.errors import ConfigError
from pointit.schemas import Environment, TrackedObject
from pointit.schemas.environment import Frame


def frame_of(room: Environment, name: str) -> Frame:
    """Return the frame `name` of `room`.

    Raises:
        ConfigError: If the map has none of that name.
    """
    names = [frame.id for frame in room.frames]
    for frame in room.frames:
        if frame.id == name:
            return frame
    known = f"; it has {', '.join(names)}" if names else ""
    advice = did_you_mean(name, names) or "add it to the map's frames."
    raise ConfigError(f"the map {room.name} has no frame {name!r}{known}: {advice[:-1]}")


def frame_or_problem(room: Environment, name: str) -> tuple[Frame | None, str]:
    """Return the frame `name` of `room` and `""`, or None and the reason why there is none."""
    try:
        return frame_of(room, name), ""
    except ConfigError as error:
        return None, str(error)


def aligned(objects: Iterable[TrackedObject], frame: Frame) -> tuple[TrackedObject, ...]:
    """Return `objects`, given in `frame`, in {W}: places, velocities and yaws."""
    return tuple(_aligned(item, frame) for item in objects)


def point_in_world(point_m: Vec3, frame: Frame) -> Vec3:
    """Return a point of `frame` in {W}."""
    return vector.add(frame.position_m, rotate(frame.orientation_xyzw, point_m))


def yaw_in_world(yaw_rad: float, frame: Frame) -> float:
    """Return the azimuth in {W} of what has the azimuth `yaw_rad` in `frame`."""
    return vector.azimuth(rotate(frame.orientation_xyzw, vector.direction(yaw_rad, 0.0)))


def _aligned(item: TrackedObject, frame: Frame) -> TrackedObject:
    fields: dict[str, Any] = dict(item)
    fields["position_m"] = point_in_world(item.position_m, frame)
    fields["velocity_mps"] = rotate(frame.orientation_xyzw, item.velocity_mps)
    if item.yaw_rad is not None:
        fields["yaw_rad"] = yaw_in_world(item.yaw_rad, frame)
    return TrackedObject(**fields)  # checked again: a place far off may leave the room's limits
