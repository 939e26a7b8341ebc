"""Markers for RViz and Foxglove (visualization_msgs) from our units."""

from collections.abc import Iterable
from typing import Any, Literal

from pointit.bridges.ros2.outbound import values
from pointit.bridges.ros2.routing.route_types import ConversionContext
from pointit.bridges.ros2.types.types import Types
from pointit.geometry import rotation
from pointit.geometry.vector import Vec3
from pointit.schemas import NS_PER_S
from pointit.schemas.base import Rgb

MARKER = "visualization_msgs/msg/Marker"

Shape = Literal["arrow", "cube", "sphere", "cylinder", "line", "text", "triangles"]

SHAPES: dict[Shape, int] = {
    "arrow": 0,
    "cube": 1,
    "sphere": 2,
    "cylinder": 3,
    "line": 4,
    "text": 9,
    "triangles": 11,
}
"""Constants of the message; a line is a LINE_STRIP, triangles are a TRIANGLE_LIST."""

ADD, DELETE, DELETE_ALL = 0, 2, 3

WHITE: Rgb = (255, 255, 255)

Place = Iterable[float]


class MarkerBuilder:
    """Builds markers with one stamp, in one frame."""

    def __init__(self, context: ConversionContext, lifetime_s: float = 0.0) -> None:
        """Build for the route of `context`; lifetime 0 is for ever."""
        self._types: Types = context.state.types
        self._header = values.header(self._types, context.stamp_ns, context.frame)
        seconds, rest_ns = divmod(round(lifetime_s * NS_PER_S), NS_PER_S)
        self._lifetime = self._types.make("builtin_interfaces/msg/Duration", sec=seconds, nanosec=rest_ns)

    def shape(
        self,
        shape: Shape,
        group: str,
        number: int,
        *,
        size_m: Vec3,
        rgb: Rgb,
        at_m: Vec3 = (0.0, 0.0, 0.0),
        turned: rotation.Quaternion = rotation.IDENTITY,
        alpha: float = 1.0,
        places_m: Iterable[Vec3] = (),
        words: str = "",
    ) -> Any:
        """Return a marker with namespace `group` and id `number`."""
        types = self._types
        return types.make(
            MARKER,
            header=self._header,
            ns=values.text(group),
            id=number,
            type=SHAPES[shape],
            action=ADD,
            pose=values.pose(types, at_m, turned),
            scale=values.vector3(types, size_m),
            color=values.color(types, rgb, alpha),
            lifetime=self._lifetime,
            points=[values.point(types, place_m) for place_m in places_m],
            text=values.text(words),
        )

    def label(self, words: str, group: str, number: int, at_m: Vec3, high_m: float = 0.14) -> Any:
        """Return a label that always faces the viewer."""
        size_m = (0.0, 0.0, high_m)
        return self.shape("text", group, number, size_m=size_m, rgb=WHITE, at_m=at_m, words=words)

    def gone(self, group: str, number: int) -> Any:
        """Return a marker that deletes another."""
        return self._types.make(MARKER, header=self._header, ns=group, id=number, action=DELETE)

    def blank(self) -> Any:
        """Return a marker that deletes all markers of the topic."""
        return self._types.make(MARKER, header=self._header, action=DELETE_ALL)

    def array(self, markers: list[Any]) -> Any:
        """Return the message."""
        return self._types.make("visualization_msgs/msg/MarkerArray", markers=markers)
