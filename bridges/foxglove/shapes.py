"""Foxglove's primitives from PointIt's units: metres, {W}, colours 0 to 255."""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from foxglove.messages import (
    ArrowPrimitive,
    Color,
    CylinderPrimitive,
    Duration,
    KeyValuePair,
    LinePrimitive,
    LinePrimitiveLineType,
    Point3,
    Pose,
    Quaternion,
    SceneEntity,
    SpherePrimitive,
    TextPrimitive,
    Timestamp,
    TriangleListPrimitive,
    Vector3,
)
from numpy.typing import NDArray

from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.plugins import rotation
from pointit.schemas import NS_PER_S
from pointit.schemas.base import Rgb

Places = NDArray[np.float64]
"""Positions, n x 3, m."""

WORLD = "world"
"""The frame {W}."""

WHITE: Rgb = (255, 255, 255)
_LINES = {
    "strip": LinePrimitiveLineType.LineStrip,
    "loop": LinePrimitiveLineType.LineLoop,
    "list": LinePrimitiveLineType.LineList,
}
_ORIGIN: Vec3 = (0.0, 0.0, 0.0)
_Z_TO_X = rotation.from_axis_angle((0.0, 1.0, 0.0), np.pi / 2.0)
_HEAD_M = 0.14
_HEAD_WIDTH_M = 0.06

_EDGES = [(i, i | bit) for bit in (1, 2, 4) for i in range(8) if not i & bit]


class NamedEntity(NamedTuple):
    """An entity and its name, since Foxglove's own types cannot be read back."""

    name: str
    entity: SceneEntity


def timestamp(now_ns: int) -> Timestamp:
    """Return a Foxglove timestamp of a time in Unix ns."""
    return Timestamp(now_ns // NS_PER_S, now_ns % NS_PER_S)


def color(rgb: Rgb, alpha: float = 1.0) -> Color:
    """Return a colour."""
    red, green, blue = rgb
    return Color(r=red / 255.0, g=green / 255.0, b=blue / 255.0, a=alpha)


def pose(position_m: Vec3, orientation: rotation.Quaternion = rotation.IDENTITY) -> Pose:
    """Return a pose."""
    x, y, z, w = orientation
    quaternion = Quaternion(x=x, y=y, z=z, w=w)
    return Pose(position=size(*position_m), orientation=quaternion)


def size(x: float, y: float, z: float) -> Vector3:
    """Return extents along x, y and z, m."""
    return Vector3(x=x, y=y, z=z)


def points(places_m: Iterable[Sequence[float]]) -> list[Point3]:
    """Return points."""
    return [Point3(x=x, y=y, z=z) for x, y, z in places_m]


def line(
    places_m: Iterable[Sequence[float]],
    rgb: Rgb,
    *,
    kind: Literal["strip", "loop", "list"] = "strip",
    pixels: float = 2.0,
    alpha: float = 1.0,
) -> LinePrimitive:
    """Return a line, `pixels` of the screen thick."""
    return LinePrimitive(
        type=_LINES[kind],
        pose=pose(_ORIGIN),
        thickness=pixels,
        scale_invariant=True,
        points=points(places_m),
        color=color(rgb, alpha),
    )


def surface(places_m: Places, indices: Sequence[int], rgb: Rgb, alpha: float = 1.0) -> TriangleListPrimitive:
    """Return triangles between `places_m`, three of `indices` each."""
    corners = points(places_m.tolist())
    return TriangleListPrimitive(
        pose=pose(_ORIGIN),
        points=corners,
        color=color(rgb, alpha),
        indices=list(indices),
    )


def sphere(center_m: Vec3, diameter_m: float, rgb: Rgb, alpha: float = 1.0) -> SpherePrimitive:
    """Return a sphere."""
    extents = size(diameter_m, diameter_m, diameter_m)
    return SpherePrimitive(pose=pose(center_m), size=extents, color=color(rgb, alpha))


def cylinder(
    foot_m: Vec3, height_m: float, diameter_m: float, rgb: Rgb, *, alpha: float = 1.0, waist: float = 1.0
) -> CylinderPrimitive:
    """Return an upright cylinder on `foot_m`; its foot is `waist` times as wide."""
    x, y, z = foot_m
    center_m = (x, y, z + height_m / 2.0)
    extents = size(diameter_m, diameter_m, height_m)
    return CylinderPrimitive(
        pose=pose(center_m),
        size=extents,
        bottom_scale=waist,
        top_scale=1.0,
        color=color(rgb, alpha),
    )


def cylinder_between(start_m: Vec3, end_m: Vec3, diameter_m: float, rgb: Rgb) -> CylinderPrimitive:
    """Return a cylinder from one point to another."""
    step_m = vector.subtract(end_m, start_m)
    orientation = rotation.multiply(towards(step_m), _Z_TO_X)
    middle_m = vector.add(start_m, vector.scale(step_m, 0.5))
    length_m = vector.norm(step_m)
    extents = size(diameter_m, diameter_m, length_m)
    return CylinderPrimitive(
        pose=pose(middle_m, orientation),
        size=extents,
        bottom_scale=1.0,
        top_scale=1.0,
        color=color(rgb),
    )


def arrow(
    start_m: Vec3, way_m: Vec3, rgb: Rgb, *, width_m: float = 0.02, alpha: float = 1.0
) -> ArrowPrimitive:
    """Return an arrow from `start_m` along `way_m`, whose tip is at their sum."""
    length_m = vector.norm(way_m)
    head_m = min(_HEAD_M, length_m / 2.0)
    head_width_m = max(_HEAD_WIDTH_M, 2.0 * width_m)
    orientation = towards(way_m)
    return ArrowPrimitive(
        pose=pose(start_m, orientation),
        shaft_length=length_m - head_m,
        shaft_diameter=width_m,
        head_length=head_m,
        head_diameter=head_width_m,
        color=color(rgb, alpha),
    )


def label(text: str, at_m: Vec3, rgb: Rgb = WHITE, height_m: float = 0.14) -> TextPrimitive:
    """Return a label, `height_m` high, that always faces the viewer."""
    return TextPrimitive(pose=pose(at_m), billboard=True, font_size=height_m, color=color(rgb), text=text)


def entity(
    name: str,
    now_ns: int,
    *,
    lifetime_s: float = 0.0,
    facts: Mapping[str, str] | None = None,
    **primitives: Any,
) -> NamedEntity:
    """Return an entity in {W}. `facts` are shown on a click, lifetime 0 is for ever."""
    pairs = (facts or {}).items()
    metadata = [KeyValuePair(key=key, value=value) for key, value in pairs]
    entity = SceneEntity(
        timestamp=timestamp(now_ns),
        frame_id=WORLD,
        id=name,
        lifetime=Duration.from_secs(lifetime_s),
        metadata=metadata,
        **primitives,
    )
    return NamedEntity(name, entity)


def box_edges(center_m: Vec3, size_m: Vec3, orientation: rotation.Quaternion) -> list[Vec3]:
    """Return the twelve edges of a box, two points each."""
    corners: list[Vec3] = []
    length_m, width_m, height_m = size_m
    for x, y, z in itertools.product((-0.5, 0.5), repeat=3):
        corner = (x * length_m, y * width_m, z * height_m)
        offset = rotation.rotate(orientation, corner)
        corners.append(vector.add(center_m, offset))
    ends: list[Vec3] = []
    for start, end in _EDGES:
        ends += (corners[start], corners[end])
    return ends


def towards(step: Vec3) -> rotation.Quaternion:
    """Return the rotation whose x axis is along `step`, and whose y axis is level."""
    return rotation.from_azimuth_elevation(vector.azimuth(step), vector.elevation(step))


def above(place_m: Vec3, height_m: float) -> Vec3:
    """Return the place `height_m` above another."""
    return vector.add(place_m, (0.0, 0.0, height_m))
