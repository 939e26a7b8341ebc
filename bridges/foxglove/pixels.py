"""Positions and colours of all pixels as a point cloud."""

from collections.abc import Mapping

import numpy as np
from foxglove.messages import PackedElementField, PackedElementFieldNumericType, PointCloud

from pointit.bridges.foxglove import shapes
from pointit.bridges.foxglove.shapes import Places
from pointit.geometry.polyline import Polyline
from pointit.schemas import Strip, StripsFrame

FLOOR = 32
"""Minimum grey of pixels that are off, so that they are visible."""

_LAYOUT = np.dtype([("place_m", "<f4", 3), ("rgba", "u1", 4)])
_FIELDS = [
    PackedElementField(name=name, offset=4 * index, type=PackedElementFieldNumericType.Float32)
    for index, name in enumerate("xyz")
] + [
    PackedElementField(name=name, offset=12 + index, type=PackedElementFieldNumericType.Uint8)
    for index, name in enumerate(("red", "green", "blue", "alpha"))
]


class Pixels:
    """Positions of all pixels: pixel i of n is in the middle of the i-th of n equal parts of its strip."""

    def __init__(self, strips: Mapping[str, tuple[Polyline, Strip]]) -> None:
        self.count = sum(strip.pixels for _, strip in strips.values())
        self._slices: dict[str, slice] = {}
        self._points = np.zeros(self.count, dtype=_LAYOUT)
        self._points["rgba"] = (FLOOR, FLOOR, FLOOR, 255)
        first = 0
        for name, (line, strip) in strips.items():
            numbers: Places = np.arange(strip.pixels, dtype=np.float64)
            at_m: Places = (numbers + 0.5) / (strip.pixels / line.length_m)
            part = slice(first, first + strip.pixels)
            place_m = line.points_at(at_m)
            self._points["place_m"][part] = place_m[:: strip.direction]
            self._slices[name] = part
            first = part.stop

    def light(self, frame: StripsFrame) -> None:
        """Set the colours of `frame`. Ignores strips that are not on the map or are longer there."""
        for strip in frame.strips:
            part = self._slices.get(strip.id)
            if part is None:
                continue
            count = part.stop - part.start
            if len(strip.rgb) != 3 * count:
                continue
            values = np.frombuffer(strip.rgb, dtype=np.uint8)
            colors = values.reshape(-1, 3)
            shown = self._points["rgba"][part, :3]
            np.maximum(colors, FLOOR, out=shown)

    def cloud(self, now_ns: int) -> PointCloud:
        """Return the points with fields x, y, z (m, {W}) and red, green, blue, alpha (0 to 255)."""
        at_origin = shapes.pose((0.0, 0.0, 0.0))
        return PointCloud(
            timestamp=shapes.timestamp(now_ns),
            frame_id=shapes.WORLD,
            pose=at_origin,
            point_stride=_LAYOUT.itemsize,
            fields=_FIELDS,
            data=self._points.tobytes(),
        )
