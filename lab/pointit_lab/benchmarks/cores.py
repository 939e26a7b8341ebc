"""The pure cores alone, warm: a cursor, a frame, a localization; ours and the paper's in one run."""

import math
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pointit.geometry import vector
from pointit.geometry.polyline import Polyline
from pointit.geometry.vector import Vec3
from pointit.maps.file import load_map
from pointit.schemas import NS_PER_S, Cloud, Environment, PointingRay, Thing, TrackedObjects, UserPose
from pointit.schemas.codec import decode, encode
from pointit.services.localizer.estimation.estimator import Pointings, Solution, solve
from pointit.services.pui.cursor import PersonCursor
from pointit.services.pui.surfaces import Kind, Surfaces
from pointit.services.pui.tracked_objects import PERIOD_S, TRACKER, listing
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.selection_engine import SelectionEngine
from pointit_lab.benchmarks.light import frame_rows
from pointit_lab.evaluation.localization.baselines import mean_angle_4dof, mean_angle_z0

Array = NDArray[np.float64]

STEP_M = 0.05
REACH_M = 20.0
TOLERANCE_M = 0.7
EYES_M = (0.0, 0.0, 1.64)
TARGETS_M = ((2.0, -2.0, 0.5), (3.0, 2.0, 1.0), (-2.0, 1.0, 0.2))
SAMPLES = 300
POINTS = 1_000_000
ROUNDS = 5
COUNTS = ((4, 1), (20, 10))
"""Columns and rows of shelves of few and of many things."""
SHELVES = {"boxes .4 m": (0.4, 0.7, 2.6), "boxes .15 m": (0.15, 0.2, 1.5)}
"""Size of the things, distance between them, and distance from the eyes, m."""
RATE_HZ = 50


def run() -> list[dict[str, Any]]:
    """Return the median microseconds of each core on each map."""
    rows: list[dict[str, Any]] = _clouds()
    rooms = [load_map("lab", 0), load_map("conveyor", 0)]
    for room in rooms:
        rows += _cursors(room)
        rows += frame_rows(room)
    return rows + _things() + _localizations()


def _cursors(room: Environment) -> list[dict[str, Any]]:
    """Return alternating times of our and the paper's cursor on one map."""
    kinds: tuple[Kind, ...] = ("strip", "belt", "lamp")
    points = discretized(room)
    surfaces = Surfaces(room, kinds)
    person = PersonCursor(surfaces)
    person.set_pose(UserPose(stamp_ns=0, position_m=(0.0, 0.0, 0.0), yaw_rad=0.0))
    ways: dict[str, Callable[[Vec3, Vec3], object]] = {
        "exact": surfaces.hit_test,
        "message and all": lambda eyes, direction: person.cursor(
            PointingRay.model_construct(stamp_ns=0, origin_m=eyes, direction=direction)
        ),
        "kd_tree": Surfaces(room, kinds, method="kd_tree").hit_test,
        "the paper's": PaperCursor(points).meet,
        "the paper's, told the tolerance": PaperCursor(points, bounded=True).meet,
    }
    rays = [(EYES_M, vector.direction(azimuth / 50, -0.2)) for azimuth in range(-157, 157)]
    return _in_turn(ways, rays, "cursor", room.name)


def _clouds() -> list[dict[str, Any]]:
    """Return alternating times of our and the paper's cursor on a room of a million points."""
    points = walls(POINTS)
    cloud = Cloud(id="walls", points=len(points), low_m=(0.0, 0.0, 0.0), high_m=(10.0, 8.0, 3.0))
    room = Environment(stamp_ns=0, name="a million points", clouds=(cloud,))
    clouds = {"walls": points}
    ways: dict[str, Callable[[Vec3, Vec3], object]] = {
        "exact": Surfaces(room, ("points",), clouds=clouds).hit_test,
        "exact, metres": Surfaces(room, ("points",), clouds=clouds, tolerance_m=TOLERANCE_M).hit_test,
        "kd_tree": Surfaces(room, ("points",), clouds=clouds, method="kd_tree").hit_test,
        "the paper's": PaperCursor(points).meet,
        "the paper's, told the tolerance": PaperCursor(points, bounded=True).meet,
    }
    random = np.random.default_rng(1)
    rays = [
        ((4.0, 3.0, 1.64), vector.direction(random.uniform(-3.1, 3.1), random.uniform(-0.8, 0.4)))
        for _ in range(150)
    ]
    return _in_turn(ways, rays, "cursor", room.name)


def _in_turn(
    ways: dict[str, Callable[[Vec3, Vec3], object]], rays: list[tuple[Vec3, Vec3]], core: str, room: str
) -> list[dict[str, Any]]:
    """Return for each method, ours first, the median of rounds of the median of all rays."""
    times_us: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(ROUNDS):
        for name, way in ways.items():
            times_us[name].append(_median_us([partial(way, *ray) for ray in rays]))
    medians = {name: sorted(times)[ROUNDS // 2] for name, times in times_us.items()}
    ours_us = next(iter(medians.values()))
    return [
        {"core": f"{core}, {name}", "map": room, "us": round(us, 1), "times_ours": round(us / ours_us, 1)}
        for name, us in medians.items()
    ]


def _things() -> list[dict[str, Any]]:
    """Return alternating CPU times of a cursor and its hover before few and many things of a shelf.

    The list of things, made by `pui` every `PERIOD_S`, comes as to a selector that is a process of its own.
    """
    rows: list[dict[str, Any]] = []
    for name, shelf in SHELVES.items():
        people = [PersonBeforeThings(shelf, *counts) for counts in COUNTS]
        for _ in range(ROUNDS):
            for person in people:
                person.point(SAMPLES)
        few, many = (
            {part: 1e6 * float(np.median(times)) for part, times in one.times_s.items()} for one in people
        )
        rows += [
            {
                "core": f"{part}, {columns * shelves} things",
                "map": name,
                "us": round(us, 1),
                "times_ours": round(us / few[part], 2),
            }
            for (columns, shelves), parts in zip(COUNTS, (few, many), strict=True)
            for part, us in parts.items()
        ]
    return rows


class PersonBeforeThings:
    """A person whose ray wanders over four things in the middle of a shelf, judged by method `estimate`."""

    def __init__(self, shelf: tuple[float, float, float], columns: int, rows: int) -> None:
        """Create from size of the things, distance between them and from the eyes, m, and their number."""
        size_m, apart_m, away_m = shelf
        self._wide_rad = math.atan(2.0 * apart_m / away_m)
        y_m, z_m = -(columns - 1) / 2.0 * apart_m, 1.4 - (rows - 1) / 2.0 * apart_m
        things = tuple(
            Thing(
                id=f"t{column}_{row}",
                center_m=(away_m, y_m + column * apart_m, z_m + row * apart_m),
                size_m=(size_m, size_m, size_m),
                lamp="lamp",
            )
            for column in range(columns)
            for row in range(rows)
        )
        self._room = Environment(stamp_ns=0, name="shelf", things=things)
        self._cursors = PersonCursor(Surfaces(self._room))
        self._cursors.set_pose(UserPose(stamp_ns=0, position_m=(0.0, 0.0, 0.0), yaw_rad=0.0))
        self._selector = SelectionEngine(SelectorConfig(method="estimate"), lambda _record: None)
        self._selector.on_map(self._room)
        self._listed = listing(self._room, 0)
        self._samples = 0
        self.times_s: dict[str, list[float]] = {"cursor and hover": [], "hover alone": [], "list": []}

    def point(self, samples: int) -> None:
        """Point with that number of further samples."""
        for sample in range(self._samples, self._samples + samples):
            now_ns = 100 * NS_PER_S + sample * (NS_PER_S // RATE_HZ)
            if sample % round(PERIOD_S * RATE_HZ) == 0:
                self._list(now_ns)
            azimuth, elevation = self._wide_rad * math.sin(sample / 40), 0.15 * math.sin(sample / 13) - 0.09
            ray = PointingRay.model_construct(
                stamp_ns=now_ns, origin_m=EYES_M, direction=vector.direction(azimuth, elevation)
            )
            began_s = time.thread_time()
            cursor = self._cursors.cursor(ray)
            drawn_s = time.thread_time()
            if cursor is not None:
                self._selector.on_cursor("anna", cursor)
            ended_s = time.thread_time()
            self.times_s["cursor and hover"].append(ended_s - began_s)
            self.times_s["hover alone"].append(ended_s - drawn_s)
        self._samples += samples

    def _list(self, now_ns: int) -> None:
        began_s = time.thread_time()
        sent = encode(self._listed.model_copy(update={"stamp_ns": now_ns}))
        self._selector.on_objects(TRACKER, decode(TrackedObjects, sent))
        self.times_s["list"].append(time.thread_time() - began_s)


def _localizations() -> list[dict[str, Any]]:
    """Return alternating times of ours, from all starts, and of the baselines, from one start."""
    random = np.random.default_rng(0)
    targets = np.repeat(np.array(TARGETS_M), SAMPLES // len(TARGETS_M), axis=0)
    origins = np.tile(np.array(EYES_M), (SAMPLES, 1))
    rays = targets - origins + random.normal(0.0, 2.0 * math.radians(2.0), (SAMPLES, 3))
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    pointings = Pointings(
        stamps_s=np.arange(SAMPLES) / 50.0, origins_m=origins, directions=rays, targets_m=targets
    )
    if not isinstance(solve(pointings), Solution):
        raise TypeError("a refusal is not a localization")
    solvers: dict[str, Callable[[Pointings], object]] = {
        "ours": solve,
        "mean angle, 4-DoF BFGS": mean_angle_4dof,
        "mean angle, z = 0 BFGS": mean_angle_z0,
    }
    times_us: dict[str, list[float]] = {name: [] for name in solvers}
    for _ in range(10):
        for name, solver in solvers.items():
            times_us[name].append(_median_us([partial(solver, pointings)] * 5))
    ours_us = sorted(times_us["ours"])[5]
    return [
        {
            "core": f"localization, {SAMPLES} samples, {name}",
            "map": "-",
            "us": round(sorted(times)[5], 1),
            "times_ours": round(sorted(times)[5] / ours_us, 1),
        }
        for name, times in times_us.items()
    ]


def _median_us(calls: list[Callable[[], object]]) -> float:
    calls[0]()
    times_s: list[float] = []
    for call in calls:
        began_s = time.perf_counter()
        call()
        times_s.append(time.perf_counter() - began_s)
    return sorted(times_s)[len(times_s) // 2] * 1e6


class PaperCursor:
    """The paper's cursor (§III-C), a baseline: points in a k-d tree, the ray as points, the nearest one.

    Objects of the room and the ray, to 20 m, are points 5 cm apart. The tree is queried for the neighbour of
    every point of the ray, and the nearest of all counts if it is within 0.7 m.
    """

    def __init__(self, points: Array, *, bounded: bool = False) -> None:
        """Build the tree; `bounded` also passes it the tolerance, which the paper does not mention."""
        self._points = points
        self._tree = cKDTree(points)
        self._steps = np.arange(0.0, REACH_M + STEP_M / 2, STEP_M)[:, None]
        self._bound_m = TOLERANCE_M if bounded else np.inf

    def meet(self, origin_m: Vec3, direction: Vec3) -> Vec3 | None:
        """Return the cursor."""
        on_ray = np.array(origin_m) + self._steps * np.array(direction)
        distances, found = self._tree.query(on_ray, distance_upper_bound=self._bound_m)
        best = int(np.argmin(distances))
        if not np.asarray(distances)[best] <= TOLERANCE_M:
            return None
        x, y, z = self._points[int(np.asarray(found)[best])].tolist()
        return (x, y, z)


def discretized(room: Environment) -> Array:
    """Return the lamps, strips and belts of a map as points."""
    points: list[Sequence[Vec3] | Array] = [[lamp.position_m for lamp in room.lamps]] if room.lamps else []
    for line in [strip.line_m for strip in room.strips] + [belt.line_m for belt in room.belts]:
        polyline = Polyline(line)
        points.append(polyline.points_at(np.arange(0.0, polyline.length_m, STEP_M)))
    return np.concatenate([np.asarray(some, dtype=np.float64) for some in points])


def walls(count: int, size_m: Vec3 = (10.0, 8.0, 3.0)) -> Array:
    """Return about `count` points on floor, ceiling and walls of a room, with 5 mm of scanner noise."""
    random = np.random.default_rng(0)
    sides: list[Array] = []
    size = np.array(size_m)
    areas = [size[(axis + 1) % 3] * size[(axis + 2) % 3] for axis in range(3)]
    for axis in range(3):
        for end in (0.0, size_m[axis]):
            side = random.uniform(0.0, 1.0, (round(count * areas[axis] / sum(areas) / 2.0), 3)) * size
            side[:, axis] = end
            sides.append(side)
    points = np.concatenate(sides)
    return np.asarray(points + random.normal(0.0, 0.005, points.shape))
