"""A wrist that waves and a light that writes a file, as a package outside PointIt would have them."""

import asyncio
import math
from collections.abc import Sequence
from pathlib import Path

from pydantic import Field

from pointit.plugins import (
    NS_PER_S,
    Config,
    Deliver,
    ImuSource,
    LedOutput,
    OutputConfig,
    Reading,
    Strip,
    StripsFrame,
    Surroundings,
    rotation,
    sleep,
)


class WavingConfig(Config):
    """Parameters of the wrist."""

    rate_hz: float = Field(default=50, gt=0, description="samples per second")


class Waving:
    """An arm that sweeps from side to side."""

    def __init__(self, config: WavingConfig, surroundings: Surroundings) -> None:
        self._config = config
        self._clock = surroundings.clock

    async def run(self, deliver: Deliver) -> None:
        """Deliver readings until cancelled."""
        while True:
            now_ns = self._clock.now_ns()
            azimuth_rad = math.radians(30) * math.sin(now_ns / NS_PER_S)
            deliver(Reading(now_ns, rotation.from_azimuth_elevation(azimuth_rad, math.radians(2))))
            await sleep(self._clock, 1 / self._config.rate_hz)


class NotebookConfig(OutputConfig):
    """Parameters of the light."""

    path: str = Field(default="", description="file that gets a line for each frame")


class Notebook:
    """A light that writes the brightest byte of each frame to a file."""

    def __init__(self, config: NotebookConfig, _surroundings: Surroundings) -> None:
        self._path = Path(config.path)
        self.light_s = 0.0

    def set_strips(self, strips: Sequence[Strip]) -> None:
        """Write the number of strips."""
        self._write(f"{len(strips)} strips")

    def show(self, frame: StripsFrame, age_s: float = 0.0) -> None:
        """Write the brightest byte of the frame, and the age of what it shows."""
        self._write(f"{max(max(strip.rgb) for strip in frame.strips)} after {age_s:.3f} s")

    async def run(self) -> None:
        """Wait until cancelled, then write that it is dark."""
        try:
            await asyncio.Event().wait()
        finally:
            self._write("dark")

    def _write(self, line: str) -> None:
        with self._path.open("a") as file:
            file.write(f"{line}\n")


WAVING = ImuSource(
    summary="an arm that waves",
    config=WavingConfig,
    make=Waving,
    argument="rate_hz",
)
NOTEBOOK = LedOutput(
    summary="writes frames to a file",
    config=NotebookConfig,
    make=Notebook,
    argument="path",
)
