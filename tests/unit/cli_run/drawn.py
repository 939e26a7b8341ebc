"""Monitors fed by hand, and what the terminal view shows of them."""

import io
from typing import Any

from rich.console import Console

from pointit.cli.view import ConsoleView
from pointit.launch.run.monitor import Monitor, RunScore
from pointit.runtime.clock import WallClock
from pointit.schemas import Cursor, Environment, Strip, StripFrame, StripsFrame

RED = (255, 0, 0)
BLUE = (0, 0, 255)
DARK = (0, 0, 0)
FRAME = 2
"""Columns of the border and its padding on the left."""


def strip(name: str = "0", pixels: int = 40, direction: int = 1) -> Strip:
    return Strip.model_validate(
        {"id": name, "line_m": ((0.0, 0.0, 1.0), (4.0, 0.0, 1.0)), "pixels": pixels, "direction": direction}
    )


def frame(pixels: list[tuple[int, int, int]], name: str = "0") -> StripsFrame:
    shown = StripFrame(id=name, rgb=b"".join(bytes(pixel) for pixel in pixels))
    return StripsFrame(stamp_ns=1, strips=(shown,))


def monitor_of(*strips: Strip, targets: tuple[str, ...] = ("red",)) -> Monitor:
    monitor = Monitor(RunScore(targets), WallClock())
    if strips:
        monitor.environment = Environment(stamp_ns=1, name="test", strips=strips)
    return monitor


def cursor(position_m: float, surface_id: str = "0", surface: str = "strip") -> Cursor:
    return Cursor.model_validate(
        {"stamp_ns": 1, "surface": surface, "surface_id": surface_id, "position_m": position_m}
    )


def shown(
    monitor: Monitor, width: int = 100, left_s: float = 0.0, height: int = 60, **about: Any
) -> list[str]:
    """Return the lines of the view without colours, with more to say `about` it."""
    console = Console(
        file=io.StringIO(), width=width, height=height, color_system="truecolor", force_terminal=True
    )
    lines = console.render_lines(
        ConsoleView(monitor, "PointIt test", lambda: left_s, **about), console.options
    )
    texts = ["".join(segment.text for segment in line) for line in lines]
    assert all(len(text) == width for text in texts), texts
    return texts
