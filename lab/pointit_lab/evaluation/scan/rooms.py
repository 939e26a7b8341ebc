"""Random rooms with strips, mirrors and furniture, and what a camera sees of them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.scan.views import CameraView, LampSpec, StripSighting, StripSpec

Array = NDArray[np.float64]

PER_M = (30, 60, 96, 144)
MARKS = 16
"""Pixels of a strip that blink their numbers, spread over it."""
WRONG = 0.10
UNSEEN = 0.15
NOISE_PX = 0.7
SIZE_PX = (1280, 720)
HELD_M = 1.5
TRIES = 12
"""Number of poses that a person considers for each photograph."""
SHARED = 3
"""Number of strips that a photograph has to share with an earlier one."""
MIRRORED = 0.8
"""Share of pixels that are also seen in a mirror if it is in the way."""


@dataclass(frozen=True)
class TrueStrip:
    """A strip as it is; `line_m` through its pixels' edges, as in a map."""

    spec: StripSpec
    line_m: tuple[Vec3, ...]

    def points(self, pixels: Array) -> Array:
        """Return the positions of `pixels`, k x 3."""
        line = Polyline(self.line_m)
        return line.points_at((pixels + 0.5) * line.length_m / self.spec.count)


@dataclass(frozen=True)
class Mirror:
    """A rectangle that reflects: `centre`, unit `normal` into the room, half width and height."""

    centre: Array
    normal: Array
    half_m: tuple[float, float]

    def image_of(self, points: Array) -> Array:
        """Return the mirrored `points`, n x 3."""
        away = (points - self.centre) @ self.normal
        return points - 2.0 * away[:, None] * self.normal

    def is_hit(self, camera: Array, points: Array) -> NDArray[np.bool_]:
        """Return True for mirrored `points` that are seen through the rectangle."""
        to, here = (points - self.centre) @ self.normal, float((camera - self.centre) @ self.normal)
        share = here / np.maximum(here - to, 1e-9)
        at = camera + share[:, None] * (points - camera) - self.centre
        side = np.cross(self.normal, [0.0, 0.0, 1.0] if abs(self.normal[2]) < 0.9 else [1.0, 0.0, 0.0])
        up = np.cross(side, self.normal)
        inside = (np.abs(at @ side) < self.half_m[0]) & (np.abs(at @ up) < self.half_m[1])
        return np.asarray(inside & (to < 0) & (here > 0))


@dataclass(frozen=True)
class ScanRoom:
    """A room. `box_m`: furniture, low and high corner, or None. `pitch_error`: of all strips, relative."""

    size_m: tuple[float, float, float]
    strips: tuple[TrueStrip, ...]
    lamps: tuple[tuple[LampSpec, Vec3], ...]
    mirrors: tuple[Mirror, ...]
    box_m: tuple[Array, Array] | None
    kind: str


@dataclass(frozen=True)
class CameraPose:
    """Position of a camera, and the rotation of the room into its frame."""

    at: Array
    rotation: Array


@dataclass(frozen=True)
class SimulatedPhone:
    """A camera and its sensor of gravity."""

    focal_px: float
    distortion: float
    has_gravity: bool
    gravity_bias: Array

    @classmethod
    def random(cls, rng: np.random.Generator) -> "SimulatedPhone":
        """Return a phone: 58 to 78 degrees wide, with some distortion."""
        wide = math.radians(rng.uniform(58.0, 78.0))
        return cls(
            SIZE_PX[0] / 2.0 / math.tan(wide / 2.0),
            float(rng.uniform(-0.06, 0.06)),
            rng.random() < 0.85,
            rng.normal(0.0, math.radians(0.5), 3),
        )


def random_room(rng: np.random.Generator) -> ScanRoom:
    """Return a room of 2 to 22 strips: on all walls, on one plane, or round corners too."""
    width, depth, height = rng.uniform(3.0, 6.0), rng.uniform(3.0, 6.0), rng.uniform(2.4, 3.0)
    kind = str(rng.choice(["walls", "plane", "corners", "mixed"]))
    count = int(rng.integers(2, 23))
    pitch_error = rng.normal(0.0, 0.006)
    strips = tuple(
        _strip(rng, f"s{number}", kind, (width, depth, height), pitch_error) for number in range(count)
    )
    lamps = tuple(
        (LampSpec(f"l{number}"), _lamp(rng, kind, (width, depth, height)))
        for number in range(int(rng.integers(0, 5)))
    )
    mirrors: list[Mirror] = []
    if rng.random() < 0.4:
        mirrors.append(Mirror(np.array([0.0, depth / 2, 0.0]), np.array([0.0, 0.0, 1.0]), (width, depth)))
    if rng.random() < 0.4:
        mirrors.append(
            Mirror(
                np.array([rng.uniform(0.6, width - 0.6), depth, 1.3]), np.array([0.0, -1.0, 0.0]), (0.5, 0.8)
            )
        )
    box = None
    if rng.random() < 0.5:
        low = np.array([rng.uniform(0.8, width - 1.6), rng.uniform(0.8, depth - 1.6), 0.0])
        box = (low, low + rng.uniform([0.3, 0.3, 0.5], [0.8, 0.8, 1.2]))
    return ScanRoom((width, depth, height), strips, lamps, tuple(mirrors), box, kind)


def _on_wall(
    rng: np.random.Generator, size: tuple[float, float, float], low: float
) -> tuple[Vec3, Vec3, int]:
    """Return a point on a wall, the direction along it, and the wall's number."""
    width, depth, height = size
    wall = int(rng.integers(0, 4))
    z = float(rng.uniform(low, height - 0.1))
    share = float(rng.uniform(0.08, 0.6))
    corners = [(0.0, 0.0), (width, 0.0), (width, depth), (0.0, depth)]
    a, b = np.array(corners[wall]), np.array(corners[(wall + 1) % 4])
    along = (b - a) / np.linalg.norm(b - a)
    x, y = a + share * (b - a)
    return (float(x), float(y), z), (float(along[0]), float(along[1]), 0.0), wall


def _lamp(rng: np.random.Generator, kind: str, size: tuple[float, float, float]) -> Vec3:
    """Return the position of a lamp: on a wall, or above the plane of the strips."""
    if kind == "plane":
        x, y, z = rng.uniform([0.3, 0.5, 0.9], [0.8 * size[0], 0.8 * size[1], 1.4])
        return (float(x), float(y), float(z))
    return _on_wall(rng, size, 0.3)[0]


def _strip(
    rng: np.random.Generator, name: str, kind: str, size: tuple[float, float, float], pitch_error: float
) -> TrueStrip:
    width, depth, _ = size
    per_m = int(rng.choice(PER_M))
    pitch_m = (1.0 + pitch_error) * (1.0 + rng.normal(0.0, 0.003)) / per_m
    length = float(np.exp(rng.uniform(math.log(0.6), math.log(3.0))))
    if kind == "plane":
        angle = float(rng.choice([0.0, math.pi / 2])) + rng.normal(0.0, 0.05)
        start = np.array([rng.uniform(0.3, width * 0.6), rng.uniform(0.5, depth * 0.6), 0.9])
        along = np.array([math.cos(angle), math.sin(angle), 0.0])
        line = [start, start + length * along]
    else:
        point, along_wall, wall = _on_wall(rng, size, 0.15)
        start = np.array(point)
        along = np.array(along_wall)
        corners = np.array([[width, 0.0], [width, depth], [0.0, depth], [0.0, 0.0]])
        corner = np.array([*corners[wall], start[2]])
        to_corner = float(np.linalg.norm(corner - start))
        is_bent = (kind == "corners" and rng.random() < 0.5) or (kind == "mixed" and rng.random() < 0.25)
        if is_bent:
            first = min(to_corner, float(rng.uniform(0.5, 2.0)))
            turn = np.array([-along[1], along[0], 0.0]) if rng.random() < 0.6 else np.array([0.0, 0.0, 1.0])
            second = float(rng.uniform(0.5, 1.6))
            if turn[2]:
                second = min(second, 2.9 - start[2]) if start[2] < 2.2 else second
                turn *= 1.0 if start[2] < 2.2 else -1.0
            line = [corner - first * along, corner, corner + second * turn]
        elif rng.random() < 0.25:
            start[2] = rng.uniform(0.1, 0.8)
            line = [start, start + np.array([0.0, 0.0, min(length, 1.8)])]
        else:
            line = [start, start + min(length, to_corner) * along]
    if rng.random() < 0.5:
        line = line[::-1]
    total = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
    count = max(12, round(total / pitch_m))
    factor = count * pitch_m / total  # a whole number of pixels: the line ends a little sooner or later
    vertices = [line[0]]
    for a, b in pairwise(line):
        vertices.append(vertices[-1] + factor * (b - a))
    return TrueStrip(
        StripSpec(name, count, 1.0 / per_m), tuple((float(v[0]), float(v[1]), float(v[2])) for v in vertices)
    )


def next_pose(
    rng: np.random.Generator,
    room: ScanRoom,
    phone: SimulatedPhone,
    poses: Sequence[CameraPose],
    *,
    wanted: str = "",
    advised: tuple[Array, Array] | None = None,
) -> CameraPose:
    """Return the next camera pose of a person who is told when a photograph shares too little.

    It is the one of some tries that shows `wanted`, and the most strips and lamps not yet seen twice, of
    those that share three strips (or all) with one of `poses`. `advised` is a position, and a point to look
    at, that the person tries to follow.
    """
    tries = [_somewhere(rng, room) if advised is None else _near(rng, room, *advised) for _ in range(TRIES)]
    shown = [_sights(room, phone, pose) for pose in poses]
    seen_twice = {name for name in frozenset[str]().union(*shown) if sum(name in each for each in shown) > 1}

    strips = {strip.spec.name for strip in room.strips}

    def worth(pose: CameraPose) -> float:
        sight = _sights(room, phone, pose)
        shared = max((len(sight & each & strips) for each in shown), default=0)
        is_useful = 100.0 * (min(shared, SHARED) + (wanted in sight))
        return is_useful + len(sight - seen_twice) + 0.1 * len(sight)

    return max(tries, key=worth)


def standing(rng: np.random.Generator, room: ScanRoom, phone: SimulatedPhone, count: int) -> list[CameraPose]:
    """Return camera poses of a person who goes round."""
    poses: list[CameraPose] = []
    for _ in range(count):
        poses.append(next_pose(rng, room, phone, poses))
    return poses


def _somewhere(rng: np.random.Generator, room: ScanRoom) -> CameraPose:
    """Return a pose near a wall that looks across the room."""
    width, depth, _ = room.size_m
    angle, reach = rng.uniform(0, 2 * math.pi), rng.uniform(0.5, 0.95)
    at = np.array(
        [
            width / 2 + reach * (width / 2 - 0.1) * math.cos(angle),
            depth / 2 + reach * (depth / 2 - 0.1) * math.sin(angle),
            rng.normal(HELD_M, 0.15),
        ]
    )
    if room.kind == "plane":
        aim = np.mean([strip.points(np.zeros(1))[0] for strip in room.strips], axis=0)
    else:
        aim = np.array([width / 2, depth / 2, 1.2]) - 0.6 * (at - [width / 2, depth / 2, at[2]])
    return _looking(rng, at, aim + rng.normal(0.0, 0.4, 3))


def _near(rng: np.random.Generator, room: ScanRoom, at: Array, aim: Array) -> CameraPose:
    """Return a pose within the room, a step or less from `at`, that looks at about `aim`."""
    inside = np.clip(at + rng.normal(0.0, 0.3, 3), 0.1, np.array(room.size_m) - 0.1)
    return _looking(rng, inside, aim + rng.normal(0.0, 0.5, 3))


def _looking(rng: np.random.Generator, at: Array, aim: Array) -> CameraPose:
    """Return the pose at `at` towards `aim`, held roughly upright."""
    forward = aim - at
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    down, roll = np.cross(forward, right), rng.normal(0.0, 0.05)
    cosine, sine = math.cos(roll), math.sin(roll)
    return CameraPose(at, np.array([cosine * right + sine * down, cosine * down - sine * right, forward]))


def _sights(room: ScanRoom, phone: SimulatedPhone, pose: CameraPose) -> frozenset[str]:
    """Return the names of the lamps in the image, and of the strips of which a good part is in it."""
    places = np.array([place for _, place in room.lamps]).reshape(-1, 3)
    names = [room.lamps[index][0].name for index in np.flatnonzero(_visible(room, phone, pose, places)[1])]
    for strip in room.strips:
        points = strip.points(np.linspace(0, strip.spec.count - 1, 12))
        if _visible(room, phone, pose, points)[1].sum() >= 6:
            names.append(strip.spec.name)
    return frozenset(names)


def _visible(
    room: ScanRoom, phone: SimulatedPhone, pose: CameraPose, points: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Return the images of `points`, n x 2, and True for those within the image that no box hides."""
    camera = (points - pose.at) @ pose.rotation.T
    flat = camera[:, :2] / np.maximum(camera[:, 2:], 0.2)
    square = np.sum(flat**2, axis=1, keepdims=True)
    uv = phone.focal_px * flat * (1.0 + phone.distortion * square) + np.array(SIZE_PX) / 2.0
    visible = (camera[:, 2] > 0.2) & (square[:, 0] < 1.0) & np.all((uv >= 0) & (uv < SIZE_PX), axis=1)
    if room.box_m is not None:
        visible &= ~_is_behind(pose.at, points, *room.box_m)
    return uv, visible


def photograph(
    rng: np.random.Generator, room: ScanRoom, phone: SimulatedPhone, pose: CameraPose
) -> CameraView:
    """Return the view of `phone` from `pose`: with noise, gaps, wrong numbers and reflections."""
    sightings: list[StripSighting] = []
    for strip in room.strips:
        count = strip.spec.count
        marks = np.unique(np.linspace(0, count - 1, min(MARKS, count)).round())
        sightings += _seen(rng, room, phone, pose, (strip.spec.name, marks, strip.points(marks)))
    for lamp, place in room.lamps:
        sightings += _seen(rng, room, phone, pose, (lamp.name, np.zeros(1), np.array([place])))
    order: list[int] = rng.permutation(len(sightings)).tolist()
    gravity = None
    if phone.has_gravity:
        sunk = pose.rotation @ [0.0, 0.0, -1.0] + phone.gravity_bias + rng.normal(0.0, math.radians(1.0), 3)
        sunk /= np.linalg.norm(sunk)
        gravity = (float(sunk[0]), float(sunk[1]), float(sunk[2]))
    return CameraView(*SIZE_PX, tuple(sightings[index] for index in order), gravity)


def _seen(
    rng: np.random.Generator,
    room: ScanRoom,
    phone: SimulatedPhone,
    pose: CameraPose,
    named: tuple[str, Array, Array],
) -> list[StripSighting]:
    """Return the sightings of a strip or lamp (name, pixels, their positions), also in mirrors."""
    name, marks, points = named
    sightings: list[StripSighting] = []
    for mirror in (None, *room.mirrors):
        shown = points if mirror is None else mirror.image_of(points)
        uv, visible = _visible(room, phone, pose, shown)
        if mirror is not None:
            visible &= mirror.is_hit(pose.at, shown) & (rng.random(len(points)) < MIRRORED)
        visible &= rng.random(len(points)) >= UNSEEN
        uv += rng.normal(0.0, NOISE_PX, uv.shape)
        for index in np.flatnonzero(visible):
            is_wrong = len(marks) > 1 and rng.random() < WRONG
            number = int(rng.choice(marks)) if is_wrong else int(marks[index])
            sightings.append(StripSighting(name, number, float(uv[index, 0]), float(uv[index, 1])))
    return sightings


def _is_behind(at: Array, points: Array, low: Array, high: Array) -> NDArray[np.bool_]:
    """Return True for `points` that a box hides from `at`."""
    step = points - at
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (low - at) / step, (high - at) / step
    enters = np.nanmax(np.minimum(first, second), axis=1)
    leaves = np.nanmin(np.maximum(first, second), axis=1)
    return np.asarray((enters < leaves) & (leaves > 0) & (enters < 1.0))
