"""A small room of strips, and photographs of it."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.scan.views import CameraView, LampSpec, StripSighting, StripSpec

Array = NDArray[np.float64]

PITCH_M = 1 / 60
FOCAL_PX = 950.0
SIZE_PX = (1280, 720)
LINES: dict[str, list[list[float]]] = {
    "left": [[0.0, 1.0, 1.0], [0.0, 2.5, 1.0]],
    "back": [[0.5, 3.0, 1.6], [2.5, 3.0, 1.6]],
    "post": [[1.2, 3.0, 0.3], [1.2, 3.0, 1.3]],
    "table": [[1.4, 1.9, 0.75], [2.4, 2.1, 0.75]],
    "bent": [[1.6, 3.0, 0.9], [3.0, 3.0, 0.9], [3.0, 1.8, 0.9]],
}
LAMP: Vec3 = (2.0, 2.9, 2.1)
PLACES: tuple[Vec3, ...] = ((1.0, -1.6, 1.5), (2.6, -1.4, 1.6), (0.2, -1.0, 1.4), (1.8, -2.0, 1.7))


def specs(lines: Mapping[str, Sequence[Sequence[float]]] = LINES) -> list[StripSpec]:
    """Return the strips of `lines`, 60 pixels a metre."""
    return [StripSpec(name, round(_line(line).length_m / PITCH_M), PITCH_M) for name, line in lines.items()]


def _line(line: Sequence[Sequence[float]]) -> Polyline:
    return Polyline([(float(x), float(y), float(z)) for x, y, z in line])


def photograph(
    at: Vec3,
    rng: np.random.Generator,
    *,
    lines: Mapping[str, Sequence[Sequence[float]]] = LINES,
    wrong: float = 0.0,
    gravity: bool = True,
    marks: int = 14,
    names: Mapping[str, str] | None = None,
) -> CameraView:
    """Return a view from `at` towards the room's middle, 0.5 px noise; `names` replaces names of strips."""
    forward = np.array([1.5, 2.4, 1.1]) - np.array(at)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.array([right, np.cross(forward, right), forward])
    sightings: list[StripSighting] = []
    for spec in specs(lines):
        pixels = np.unique(np.linspace(0, spec.count - 1, marks).round())
        line = _line(lines[spec.name])
        points = line.points_at((pixels + 0.5) * line.length_m / spec.count)
        for pixel, (u, v) in zip(pixels, _images(points, at, rotation, rng), strict=True):
            number = int(rng.choice(pixels)) if rng.random() < wrong else int(pixel)
            sightings.append(StripSighting((names or {}).get(spec.name, spec.name), number, u, v))
    if lines is LINES:
        ((u, v),) = _images(np.array([LAMP]), at, rotation, rng)
        sightings.append(StripSighting("lamp", 0, u, v))
    down = rotation @ [0.0, 0.0, -1.0]
    return CameraView(
        *SIZE_PX, tuple(sightings), (float(down[0]), float(down[1]), float(down[2])) if gravity else None
    )


def _images(points: Array, at: Vec3, rotation: Array, rng: np.random.Generator) -> list[tuple[float, float]]:
    camera = (points - np.array(at)) @ rotation.T
    uv = (
        FOCAL_PX * camera[:, :2] / camera[:, 2:]
        + np.array(SIZE_PX) / 2
        + rng.normal(0.0, 0.5, (len(points), 2))
    )
    return [(float(u), float(v)) for u, v in uv]


def photographs(
    count: int, seed: int = 1, *, wrong: float = 0.0, gravity: bool = True, marks: int = 14
) -> list[CameraView]:
    """Return views of the room from the first `count` places."""
    rng = np.random.default_rng(seed)
    return [photograph(at, rng, wrong=wrong, gravity=gravity, marks=marks) for at in PLACES[:count]]


LAMPS = [LampSpec("lamp")]
