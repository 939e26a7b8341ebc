"""Checks of a map's unit: in another one a room is too high or too wide, and its strips are too sparse."""

import math
from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.polyline import Polyline
from pointit.maps.checks.finding import MapFinding, warning
from pointit.maps.checks.strips import is_even
from pointit.maps.checks.things import line_places
from pointit.maps.model import MapFile

MAX_HEIGHT_M = 20.0
"""Height in a room above which its unit is probably another, m."""
MAX_CLOUD_HEIGHT_M = 50.0
"""Vertical extent of a point cloud above which its unit is probably another, m. A scan may show a facade."""
MAX_WIDTH_M = 1000.0
"""Horizontal extent above which the unit is probably another, m."""
MIN_DENSITY = 1.5
"""Pixels per metre of strips below which the unit is probably another. Strips have 30 to 144, strings 5."""
_USUAL_WIDTH_M = 6.0
_USUAL_HEIGHT_M = 2.0
_USUAL_DENSITY = 60.0
_UNITS_M = {"centimetres": 0.01, "millimetres": 0.001}


def check_extent(file: MapFile, clouds: Mapping[str, NDArray[np.float64]]) -> Iterator[MapFinding]:
    """Yield a map and clouds with extents of a room in another unit; `clouds` are n x 3, in {W}."""
    centers = [box.center for box in file.boxes.values()]
    centers += [cylinder.center for cylinder in file.cylinders.values()]
    centers += [sphere.center for sphere in file.spheres.values()]
    centers += [thing.center for thing in file.things.values() if thing.center is not None]
    places = np.array([*line_places(file), *centers]).reshape(-1, 3)
    if len(places):
        width_m, height_m = float(np.ptp(places[:, :2], axis=0).max()), float(places[:, 2].max())
        density = _density(file)
        if height_m > MAX_HEIGHT_M or width_m > MAX_WIDTH_M or density < MIN_DENSITY:
            unit = _likely_unit(width_m, height_m, density)
            sparse = f", its strips have {density:.2g} pixels a metre" if density < MIN_DENSITY else ""
            text = f"{_extent(width_m, height_m)}{sparse}; give positions in metres, if these are {unit}"
            yield warning("map", text)
    for name, points in clouds.items():
        extent_m = np.ptp(points, axis=0).tolist()
        width_m, height_m = max(extent_m[:2]), extent_m[2]
        if height_m > MAX_CLOUD_HEIGHT_M or width_m > MAX_WIDTH_M:
            unit = _likely_unit(width_m, height_m)
            scale = (file.clouds[name].scale or 1.0) * _UNITS_M[unit]
            yield warning(
                f"clouds.{name}", f"{_extent(width_m, height_m)}; set scale: {scale:g}, if these are {unit}"
            )


def _extent(width_m: float, height_m: float) -> str:
    return f"is {width_m:.0f} m wide" + (f" and {height_m:.0f} m high" if height_m > MAX_HEIGHT_M else "")


def _density(file: MapFile) -> float:
    """Return the median of the pixels per metre of strips, infinite if none has enough pixels."""
    densities = [
        strip.pixels / Polyline(strip.line).length_m for strip in file.strips.values() if is_even(strip)
    ]
    return float(np.median(densities)) if densities else math.inf


def _likely_unit(width_m: float, height_m: float, density: float = math.inf) -> str:
    """Return the unit with which the extents are nearest to those of a usual room."""

    def distance(unit_m: float) -> float:
        ratios = [
            width_m * unit_m / _USUAL_WIDTH_M,
            height_m * unit_m / _USUAL_HEIGHT_M,
            density / unit_m / _USUAL_DENSITY,
        ]
        return sum(abs(math.log(ratio)) for ratio in ratios if 0.0 < ratio < math.inf)

    return min(_UNITS_M, key=lambda unit: distance(_UNITS_M[unit]))
