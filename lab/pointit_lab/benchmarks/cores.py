"""Cores without a bus: a cursor and its hover before few and many things, frames of a large site."""

import asyncio
import math
import socket
import time
from typing import Any

import numpy as np

from pointit.geometry import vector
from pointit.runtime.service.plugin_guard import NullHealth, Surroundings
from pointit.schemas import (
    NS_PER_S,
    Cursor,
    Environment,
    PointingRay,
    Strip,
    Thing,
    TrackedObject,
    TrackedObjects,
    UserPose,
)
from pointit.schemas.codec import decode, encode
from pointit.services.led_driver.config import LedDriverConfig
from pointit.services.led_driver.light_state import LightState
from pointit.services.led_driver.outputs import GuardedOutput, make_outputs
from pointit.services.pui.cursor import PersonCursor
from pointit.services.pui.surfaces import Surfaces
from pointit.services.pui.tracked_objects import PERIOD_S, TRACKER, listing
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.selection_engine import SelectionEngine

EYES_M = (0.0, 0.0, 1.64)
SAMPLES = 300
ROUNDS = 5
COUNTS = ((4, 1), (20, 10))
"""Columns and rows of shelves of few and of many things."""
SHELVES = {"boxes .4 m": (0.4, 0.7, 2.6), "boxes .15 m": (0.15, 0.2, 1.5)}
"""Size of the things, distance between them, and distance from the eyes, m."""
RATE_HZ = 50

NOW_NS = 1_700_000_000 * NS_PER_S
LARGE_SITES = ((10_000, 10), (65_000, 1), (65_000, 10))
"""Pixels and outputs."""
STRIP_PIXELS = 1000
STRIP_M = 20.0
FAST_MPS = 0.6
"""Speed at which an object moves by more than a pixel from frame to frame."""
STEP_NS = NS_PER_S // 25
FRAMES = 100
WARM_FRAMES = 10
PAUSE_S = 0.02
"""Time after each frame of a large site, in which it is sent."""


def run() -> list[dict[str, Any]]:
    """Return alternating CPU times of a cursor and its hover before few and many things of a shelf.

    The list of things, made by `pui` every `PERIOD_S`, comes as to a selector that is a process of its own.
    """
    rows: list[dict[str, Any]] = []
    for name, shelf in SHELVES.items():
        people = [PersonBeforeThings(shelf, *counts) for counts in COUNTS]
        for _ in range(ROUNDS):
            for person in people:
                person.point(SAMPLES)
        for (columns, shelves), person in zip(COUNTS, people, strict=True):
            for part, times_s in person.times_s.items():
                median_us = 1e6 * float(np.median(times_s))
                core = f"{part}, {columns * shelves} things"
                rows.append({"core": core, "map": name, "us": round(median_us, 1)})
    return rows


class PersonBeforeThings:
    """A person whose ray wanders over four things in the middle of a shelf, judged by method `estimate`."""

    def __init__(self, shelf: tuple[float, float, float], columns: int, rows: int) -> None:
        """Create from size of the things, distance between them and from the eyes, m, and their number."""
        # The middle of the shelf is in front of the person.
        size_m, apart_m, away_m = shelf
        self._wide_rad = math.atan(2.0 * apart_m / away_m)
        left_m = -(columns - 1) / 2.0 * apart_m
        lowest_m = 1.4 - (rows - 1) / 2.0 * apart_m
        size = (size_m, size_m, size_m)
        things: list[Thing] = []
        for column in range(columns):
            for row in range(rows):
                y_m = left_m + column * apart_m
                z_m = lowest_m + row * apart_m
                name = f"t{column}_{row}"
                things.append(Thing(id=name, center_m=(away_m, y_m, z_m), size_m=size, lamp="lamp"))
        self._room = Environment(stamp_ns=0, name="shelf", things=tuple(things))

        # the person at the origin, before a selector that knows the shelf
        pose = UserPose(stamp_ns=0, position_m=(0.0, 0.0, 0.0), yaw_rad=0.0)
        self._cursors = PersonCursor(Surfaces(self._room))
        self._cursors.set_pose(pose)
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
            azimuth = self._wide_rad * math.sin(sample / 40)
            elevation = 0.15 * math.sin(sample / 13) - 0.09
            direction = vector.direction(azimuth, elevation)
            ray = PointingRay.model_construct(stamp_ns=now_ns, origin_m=EYES_M, direction=direction)
            start_s = time.thread_time()
            cursor = self._cursors.cursor(ray)
            drawn_s = time.thread_time()
            if cursor is not None:
                self._selector.on_cursor("anna", cursor)
            end_s = time.thread_time()
            self.times_s["cursor and hover"].append(end_s - start_s)
            self.times_s["hover alone"].append(end_s - drawn_s)
        self._samples += samples

    def _list(self, now_ns: int) -> None:
        # encoded and decoded, as for a selector in another process
        start_s = time.thread_time()
        listed = self._listed.model_copy(update={"stamp_ns": now_ns})
        sent = encode(listed)
        self._selector.on_objects(TRACKER, decode(TrackedObjects, sent))
        spent_s = time.thread_time() - start_s
        self.times_s["list"].append(spent_s)


def large_site_rows() -> list[dict[str, Any]]:
    """Return the milliseconds of CPU of a frame that is sent by UDP, and of drawing it."""
    rows: list[dict[str, Any]] = []
    for pixels, outputs in LARGE_SITES:
        for kind in ("ddp", "e131"):
            for changes in ("one strip", "all strips"):
                row = _row(pixels, outputs, kind, changes)
                rows.append(asyncio.run(row))
    return rows


async def _row(pixels: int, count: int, kind: str, changes: str) -> dict[str, Any]:
    strips = pixels // STRIP_PIXELS
    ids = [f"s{number}" for number in range(strips)]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("", 0))
        _, port = receiver.getsockname()
        outputs = _outputs(ids, count, kind, port)
        room = _room(ids)
        lights = LightState(LedDriverConfig(objects_timeout_s=60.0))
        lights.on_map(room)
        if changes == "all strips":
            lights.content.set_objects("tracker", _packages(ids), NOW_NS)
        for output in outputs:
            output.set_map(room)
        tasks = [asyncio.create_task(output.run()) for output in outputs]

        # Both times begin after the first frames, which also set up what the outputs need.
        start_s = 0.0
        drawn_s = 0.0
        for number in range(WARM_FRAMES + FRAMES):
            if number == WARM_FRAMES:
                start_s = time.process_time()
                drawn_s = 0.0
            drawn_s += await _draw(lights, outputs, ids, number)
        spent_s = time.process_time() - start_s
        for task in tasks:
            task.cancel()
        await asyncio.wait(tasks)
    drawing_ms = drawn_s / FRAMES * 1e3
    frame_ms = spent_s / FRAMES * 1e3
    return {
        "pixels": pixels,
        "outputs": count,
        "kind": kind,
        "changes": changes,
        "drawing_ms": round(drawing_ms, 2),
        "frame_ms": round(frame_ms, 2),
    }


async def _draw(lights: LightState, outputs: list[GuardedOutput], ids: list[str], number: int) -> float:
    """Show a frame in which a cursor has moved, and let it be sent. Return the CPU time of drawing, s."""
    now_ns = NOW_NS + number * STEP_NS
    place_m = 1.0 + number * STRIP_M / STRIP_PIXELS
    cursor = Cursor(stamp_ns=now_ns, surface="strip", surface_id=ids[0], position_m=place_m)
    lights.on_cursor("anna", cursor, now_ns)
    began_s = time.thread_time()
    frame = lights.frame(now_ns)
    drawn_s = time.thread_time() - began_s
    if frame is None:
        raise RuntimeError("there is a map")
    for output in outputs:
        output.show(frame, 0.0)
    await asyncio.sleep(PAUSE_S)
    return drawn_s


def _outputs(ids: list[str], count: int, kind: str, port: int) -> list[GuardedOutput]:
    """Return outputs of one protocol, each at an address of its own with its share of the strips."""
    outputs: list[dict[str, Any]] = []
    for number in range(count):
        segments = [{"strip": name} for name in ids[number::count]]
        output = {
            "kind": kind,
            "host": f"127.0.0.{1 + number}",
            "port": port,
            "max_rate_hz": 1000.0,
            "segments": segments,
        }
        outputs.append(output)
    config = LedDriverConfig.model_validate({"outputs": outputs})
    surroundings = Surroundings.detached()

    def same(_kind: str, _name: str, _user: str, _which: str) -> Surroundings:
        return surroundings

    return make_outputs(config.outputs, same, NullHealth())


def _room(ids: list[str]) -> Environment:
    strips: list[Strip] = []
    for number, name in enumerate(ids):
        line_m = ((0, number, 0), (STRIP_M, number, 0))
        strips.append(Strip(id=name, line_m=line_m, pixels=STRIP_PIXELS))
    return Environment(stamp_ns=1, name="large", strips=tuple(strips))


def _packages(ids: list[str]) -> TrackedObjects:
    """Return a moving object on each strip."""
    objects: list[TrackedObject] = []
    for name in ids:
        package = TrackedObject(
            id=name,
            kind="red",
            position_m=(0.0, 0.0, 0.0),
            length_m=0.3,
            surface="strip",
            surface_id=name,
            surface_position_m=1.0,
            surface_speed_mps=FAST_MPS,
        )
        objects.append(package)
    return TrackedObjects(stamp_ns=NOW_NS, objects=tuple(objects))
