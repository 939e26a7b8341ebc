"""The pure cores alone, warm: a cursor, a frame, a localization; on the conveyor's map where the data are."""

import math
import os
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from pointit.evaluation.baselines import mean_angle_4dof, mean_angle_z0
from pointit.geometry import vector
from pointit.schemas import Environment
from pointit.services.led_driver.render import CursorMark, ObjectMark, Renderer
from pointit.services.localizer.estimator import Pointings, Solution, solve
from pointit.services.pui.map_file import load_map, read_map
from pointit.services.pui.surfaces import Surfaces

DATA = Path(os.environ.get("POINTIT_DATA", Path(__file__).parents[2] / "shared" / "data"))
CONVEYOR = DATA / "pointit-ros2" / "belt.yaml"
EYES_M = (0.0, 0.0, 1.64)
TARGETS_M = ((2.0, -2.0, 0.5), (3.0, 2.0, 1.0), (-2.0, 1.0, 0.2))
SAMPLES = 300
WHITE = (255, 255, 255)


def run() -> list[dict[str, Any]]:
    """Return the median microseconds of each core on each map there is."""
    rooms = [load_map("lab", 0)]
    if CONVEYOR.exists():
        rooms.append(read_map(CONVEYOR, 0))
    rows: list[dict[str, Any]] = []
    for room in rooms:
        rows += [
            {"core": f"cursor, {method}", "map": room.name, "us": round(_cursor(room, method), 1)}
            for method in ("exact", "kd_tree")
        ]
        rows.append({"core": "frame of all strips", "map": room.name, "us": round(_frame(room), 1)})
    return rows + _localizations()


def _cursor(room: Environment, method: Any) -> float:
    surfaces = Surfaces(room, ("strip", "belt", "lamp"), method=method)
    directions = [vector.direction(azimuth / 50, -0.2) for azimuth in range(314)]
    return _median_us([partial(surfaces.meet, EYES_M, direction) for direction in directions])


def _frame(room: Environment) -> float:
    renderer = Renderer(room.strips)
    objects = [
        ObjectMark(strip_id=strip.id, position_m=0.3, length_m=0.3, kind="red") for strip in room.strips
    ]
    cursors = [CursorMark(strip_id=room.strips[0].id, position_m=0.4, width_m=0.1, color=WHITE)]
    return _median_us([lambda: renderer.render(objects, cursors)] * 200)


def _localizations() -> list[dict[str, Any]]:
    """Return the times of ours, of all starts, and of the baselines, from one start, in turn."""
    random = np.random.default_rng(0)
    targets = np.repeat(np.array(TARGETS_M), SAMPLES // len(TARGETS_M), axis=0)
    origins = np.tile(np.array(EYES_M), (SAMPLES, 1))
    rays = targets - origins + random.normal(0.0, 2.0 * math.radians(2.0), (SAMPLES, 3))
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    pointings = Pointings(
        stamps_s=np.arange(SAMPLES) / 50.0, origins_m=origins, directions=rays, targets_m=targets
    )
    if not isinstance(solve(pointings), Solution):
        raise TypeError("a refusal is no localization")
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
