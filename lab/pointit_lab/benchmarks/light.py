"""A frame of all strips beside the paper's, Python lists pixel by pixel; frames of a large site."""

import asyncio
import socket
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from pointit.runtime.service.plugin_guard import NullHealth, Surroundings
from pointit.schemas import (
    NS_PER_S,
    Cursor,
    Environment,
    Hover,
    SelectedObject,
    Selection,
    Strip,
    TrackedObject,
    TrackedObjects,
    UserProfile,
)
from pointit.services.led_driver.config import LedDriverConfig
from pointit.services.led_driver.light_state import LightState
from pointit.services.led_driver.outputs import GuardedOutput, make_outputs
from pointit.services.led_driver.render import Layout

NOW_NS = 1_700_000_000 * NS_PER_S
BLOCKS = 10
BLOCK = 40
"""Frames per block."""
PACKAGES = 20
LENGTH_M = 0.3
SPEED_MPS = 0.5
KINDS = ("red", "green", "blue", "yellow")
USERS = ("anna", "ben", "cleo", "dora")
COLORS = ((230, 159, 0), (86, 180, 233), (0, 158, 115), (204, 121, 167))
WIDTH_M = 0.1

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


class _PixelByPixel:
    """Direct implementation of the paper's description (§III-E): a test of every pixel."""

    def __init__(self, room: Environment, objects: list[TrackedObject]) -> None:
        layout = Layout(room.strips, room.belts)
        style = LedDriverConfig().style
        self._strips: list[list[list[tuple[int, float]]]] = [
            [[] for _ in range(strip.pixels)] for strip in room.strips
        ]
        first = np.cumsum([0, *(strip.pixels for strip in room.strips)])
        lines = np.arange(len(room.strips) + len(room.belts))
        owner, entries = layout.lit(lines, np.full(len(lines), -1.0), np.full(len(lines), 1e6))
        for line, entry in zip(owner.tolist(), entries.tolist(), strict=True):
            pixel = int(layout.pixels[entry])
            strip = int(np.searchsorted(first, pixel, side="right")) - 1
            self._strips[strip][pixel - int(first[strip])].append((line, float(layout.at_m[entry])))
        self._objects = [
            (layout.line(item.surface, item.surface_id), item.surface_position_m, item.id, item.kind)
            for item in objects
        ]
        self._colors = style.kind_colors
        self._idle = style.idle_level
        self._edge_m = style.margin_m

    def draw(
        self, elapsed_s: float, cursors: list[tuple[int, float]], hovered: set[str], selected: set[str]
    ) -> list[list[tuple[int, int, int]]]:
        return [[self._pixel(place, elapsed_s, cursors, hovered, selected) for place in strip]
                for strip in self._strips]  # fmt: skip

    def _pixel(
        self,
        places: list[tuple[int, float]],
        elapsed_s: float,
        cursors: list[tuple[int, float]],
        hovered: set[str],
        selected: set[str],
    ) -> tuple[int, int, int]:
        color = (0, 0, 0)
        for line, at_m in places:
            for other, start_m, object_id, kind in self._objects:
                apart_m = abs(start_m + SPEED_MPS * elapsed_s - at_m)
                if other != line or apart_m > LENGTH_M / 2:
                    continue
                red, green, blue = self._colors[kind]
                level = 1.0 if object_id in selected else self._idle
                color = (round(red * level), round(green * level), round(blue * level))
                if apart_m > LENGTH_M / 2 - self._edge_m and (object_id in hovered or object_id in selected):
                    color = (255, 255, 255)
            for number, (other, cursor_m) in enumerate(cursors):
                if other == line and abs(cursor_m - at_m) <= WIDTH_M / 2:
                    color = COLORS[number]
        return color


def frame_rows(room: Environment) -> list[dict[str, Any]]:
    """Return the median microseconds of a frame with 20 packages and 4 people, ours and the paper's."""
    lines = [("belt", belt.id) for belt in room.belts] or [("strip", strip.id) for strip in room.strips]
    objects = [
        TrackedObject(
            id=f"p{n}",
            kind=KINDS[n % len(KINDS)],
            position_m=(0.0, 0.0, 0.0),
            length_m=LENGTH_M,
            surface="belt" if lines[0][0] == "belt" else "strip",
            surface_id=lines[n % len(lines)][1],
            surface_position_m=0.2 + 0.4 * (n // len(lines)),
            surface_speed_mps=SPEED_MPS,
        )
        for n in range(PACKAGES)
    ]
    lights = LightState(LedDriverConfig())
    lights.on_map(room)
    lights.content.set_objects("conveyor", TrackedObjects(stamp_ns=NOW_NS, objects=tuple(objects)), NOW_NS)
    selected = SelectedObject(id="p5", user=USERS[0], since_ns=NOW_NS)
    lights.content.set_selection(Selection(stamp_ns=NOW_NS, objects=(selected,)))
    layout = Layout(room.strips, room.belts)
    on = [objects[number] for number in range(len(USERS))]
    for user, color, item in zip(USERS, COLORS, on, strict=True):
        lights.content.set_profile(
            user, UserProfile(stamp_ns=NOW_NS, cursor_color=color, cursor_width_m=WIDTH_M)
        )
        cursor = Cursor(
            stamp_ns=NOW_NS,
            surface=item.surface,
            surface_id=item.surface_id,
            position_m=item.surface_position_m,
        )
        lights.on_cursor(user, cursor, NOW_NS)
    hover = Hover(stamp_ns=NOW_NS, object_id="p0", progress=0.4, action="select")
    pixel_by_pixel = _PixelByPixel(room, objects)
    marks = [(layout.line(item.surface, item.surface_id) or 0, item.surface_position_m) for item in on]

    def ours(now_ns: int) -> None:
        lights.content.set_hover(USERS[0], hover, NOW_NS)  # a hover comes with every cursor
        lights.frame(now_ns)

    def paper(now_ns: int) -> None:
        pixel_by_pixel.draw((now_ns - NOW_NS) / NS_PER_S, marks, {"p0"}, {"p5"})

    ours_us, paper_us = _medians_us(ours, paper)
    row = {"core": "frame of all strips", "map": room.name, "pixels": layout.count}
    return [
        row | {"us": round(ours_us, 1)},
        row
        | {
            "core": "frame of all strips, pixel by pixel",
            "us": round(paper_us, 1),
            "times_ours": round(paper_us / ours_us, 1),
        },
    ]


def _medians_us(*draws: Callable[[int], None]) -> list[float]:
    """Return the median of each, warm, in alternating blocks, so that load affects all equally."""
    times_s: list[list[float]] = [[] for _ in draws]
    for block in range(BLOCKS):
        for draw, times in zip(draws, times_s, strict=True):
            for number in range(block * BLOCK, (block + 1) * BLOCK):
                began_s = time.perf_counter()
                draw(NOW_NS + number * NS_PER_S // 1000)
                times.append(time.perf_counter() - began_s)
    return [sorted(times)[len(times) // 2] * 1e6 for times in times_s]


def large_site_rows() -> list[dict[str, Any]]:
    """Return the milliseconds of CPU of a frame that is sent by UDP, and of drawing it."""
    return [
        asyncio.run(_row(pixels, outputs, kind, changes))
        for pixels, outputs in LARGE_SITES
        for kind in ("ddp", "e131")
        for changes in ("one strip", "all strips")
    ]


async def _row(pixels: int, count: int, kind: str, changes: str) -> dict[str, Any]:
    ids = [f"s{number}" for number in range(pixels // STRIP_PIXELS)]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("", 0))
        outputs = _outputs(ids, count, kind, receiver.getsockname()[1])
        room = _room(ids)
        lights = LightState(LedDriverConfig(objects_timeout_s=60.0))
        lights.on_map(room)
        if changes == "all strips":
            lights.content.set_objects("tracker", _packages(ids), NOW_NS)
        for output in outputs:
            output.set_map(room)
        tasks = [asyncio.create_task(output.run()) for output in outputs]
        began_s = drawn_s = 0.0
        for number in range(WARM_FRAMES + FRAMES):
            if number == WARM_FRAMES:
                began_s, drawn_s = time.process_time(), 0.0
            drawn_s += await _draw(lights, outputs, ids, number)
        spent_s = time.process_time() - began_s
        for task in tasks:
            task.cancel()
        await asyncio.wait(tasks)
    return {
        "pixels": pixels,
        "outputs": count,
        "kind": kind,
        "changes": changes,
        "drawing_ms": round(drawn_s / FRAMES * 1e3, 2),
        "frame_ms": round(spent_s / FRAMES * 1e3, 2),
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
    outputs = [
        {
            "kind": kind,
            "host": f"127.0.0.{1 + number}",
            "port": port,
            "max_rate_hz": 1000.0,
            "segments": [{"strip": name} for name in ids[number::count]],
        }
        for number in range(count)
    ]
    config = LedDriverConfig.model_validate({"outputs": outputs})
    surroundings = Surroundings.detached()

    def same(_kind: str, _name: str, _user: str, _which: str) -> Surroundings:
        return surroundings

    return make_outputs(config.outputs, same, NullHealth())


def _room(ids: list[str]) -> Environment:
    strips = [
        Strip(id=name, line_m=((0, number, 0), (STRIP_M, number, 0)), pixels=STRIP_PIXELS)
        for number, name in enumerate(ids)
    ]
    return Environment(stamp_ns=1, name="large", strips=tuple(strips))


def _packages(ids: list[str]) -> TrackedObjects:
    """Return a moving object on each strip."""
    objects = [
        TrackedObject(
            id=name,
            kind="red",
            position_m=(0.0, 0.0, 0.0),
            length_m=0.3,
            surface="strip",
            surface_id=name,
            surface_position_m=1.0,
            surface_speed_mps=FAST_MPS,
        )
        for name in ids
    ]
    return TrackedObjects(stamp_ns=NOW_NS, objects=tuple(objects))
