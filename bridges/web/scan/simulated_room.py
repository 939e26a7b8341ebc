"""A room for a simulated camera: true places of its lights, which the site's map does not know."""

import math
from itertools import chain
from pathlib import Path

import numpy as np

from pointit.bridges.web.scan.wire import ScanRoom, ScanRoomStrip
from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.maps.file import load_map
from pointit.schemas import Strip

ROOM = Path(__file__).with_name("simulated_room.yaml")
"""The map of the room."""
AWAY = 1.3
"""Level distance of the camera's places from the middle of the strips, in widths or depths of the room."""
PLACES = ((0.0, 1.5), (-38.0, 1.1), (35.0, 1.9), (-18.0, 2.1), (20.0, 0.8), (-52.0, 1.7), (50.0, 1.2))
"""Azimuth (deg) of each of the camera's places from the strips' front, and height, m."""


class SimulatedRoom:
    """Lights that a simulated camera sees, and its places, which lie in front of them: on the side of -y."""

    def __init__(self, name_or_path: str = str(ROOM)) -> None:
        """Read the room's map, a shipped one or a file.

        Raises:
            ConfigError: If it cannot be read.
        """
        room = load_map(name_or_path, 0)
        lights: dict[str, tuple[Vec3, ...]] = {lamp.id: (lamp.position_m,) for lamp in room.lamps}
        lights |= {strip.id: pixel_places(strip) for strip in room.strips}

        # The camera stands on an arc around the middle of all lights
        positions_m = np.array(list(chain.from_iterable(lights.values())))
        x_m, y_m = np.mean(positions_m, axis=0)[:2]
        widths_m = np.ptp(positions_m[:, :2], axis=0)
        radius_m = AWAY * float(np.max(widths_m))
        cameras: list[Vec3] = []
        for azimuth_deg, height_m in PLACES:
            angle_rad = math.radians(azimuth_deg)
            camera_x_m = x_m + radius_m * math.sin(angle_rad)
            camera_y_m = y_m - radius_m * math.cos(angle_rad)
            cameras.append((camera_x_m, camera_y_m, height_m))

        strips = tuple(ScanRoomStrip(name=name, places_m=places) for name, places in lights.items())
        self.seen = ScanRoom(strips=strips, places_m=tuple(cameras))


def pixel_places(strip: Strip) -> tuple[Vec3, ...]:
    """Return the position of each pixel of `strip` in {W}, m, pixel 0 first."""
    line = Polyline(strip.line_m)
    at_m = (np.arange(strip.pixels) + 0.5) * line.length_m / strip.pixels
    points = line.points_at(at_m)
    ordered = points if strip.direction == 1 else points[::-1]
    return tuple((float(x), float(y), float(z)) for x, y, z in ordered)
