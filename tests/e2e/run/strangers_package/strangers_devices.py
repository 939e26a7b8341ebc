"""A wrist, a light, a selection method and a service, as a package outside PointIt would have them."""

import asyncio
import math
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from pydantic import BaseModel, Field

from pointit import plugins


class WavingConfig(plugins.Config):
    """Parameters of the wrist."""

    rate_hz: float = Field(default=50, gt=0, description="samples per second")


class Waving:
    """An arm that sweeps from side to side."""

    def __init__(self, config: WavingConfig, surroundings: plugins.Surroundings) -> None:
        self._config = config
        self._clock = surroundings.clock

    async def run(self, deliver: plugins.Deliver) -> None:
        while True:
            now_ns = self._clock.now_ns()
            azimuth_rad = math.radians(30) * math.sin(now_ns / plugins.NS_PER_S)
            deliver(
                plugins.Reading(now_ns, plugins.rotation.from_azimuth_elevation(azimuth_rad, math.radians(2)))
            )
            await plugins.sleep(self._clock, 1 / self._config.rate_hz)


class NotebookConfig(plugins.OutputConfig):
    """Parameters of the light."""

    path: str = Field(default="", description="file that gets a line for each frame")


class Notebook:
    """A light that writes the brightest byte of each frame to a file."""

    def __init__(self, config: NotebookConfig, _surroundings: plugins.Surroundings) -> None:
        self._path = Path(config.path)
        self.light_s = 0.0

    def set_strips(self, strips: Sequence[plugins.Strip]) -> None:
        self._write(f"{len(strips)} strips")

    def show(self, frame: plugins.StripsFrame, age_s: float = 0.0) -> None:
        self._write(f"{max(max(strip.rgb) for strip in frame.strips)} after {age_s:.3f} s")

    async def run(self) -> None:
        try:
            await asyncio.Event().wait()
        finally:
            self._write("dark")

    def _write(self, line: str) -> None:
        with self._path.open("a") as file:
            file.write(f"{line}\n")


class Chosen(BaseModel):
    """Stored by the method for each person."""

    dwell_s: float


class Eager:
    """A method that selects at first sight."""

    def __init__(self, config: plugins.MethodConfig, surroundings: plugins.Surroundings) -> None:
        surroundings.state_file(Chosen).write(Chosen(dwell_s=config.dwell_s))
        self.latched: set[str] = set()

    def step(self, pointing: plugins.PointingSample) -> plugins.SelectionProgress:
        under = pointing.under
        if under is None or under in self.latched or not pointing.acts(under):
            return plugins.SelectionProgress(under)
        self.latch(under)
        return plugins.SelectionProgress(under, fired=under)

    def latch(self, object_id: str) -> None:
        self.latched.add(object_id)


class Witnessed(plugins.Message):
    """Number of cursors of a person."""

    cursors: int = 0


WITNESSED = plugins.Topic(
    key="witness/{user}", message=Witnessed, delivery=plugins.Delivery.STATE, rate_hz=None,
    writers=("witness",), about="number of cursors",
)  # fmt: skip


class WitnessConfig(plugins.Config):
    """Parameters of the service."""

    path: str = Field(default="", description="file that gets the number of cursors of each report")


class Witness(plugins.Service[WitnessConfig]):
    """Counts cursors and reads its own reports."""

    NAME: ClassVar[str] = "witness"
    SCOPE: ClassVar = "site"
    CONFIG = WitnessConfig

    def __init__(self, config: WitnessConfig, context: plugins.Context) -> None:
        super().__init__(config, context)
        self._count = 0
        self._reports = self.bus.publisher(WITNESSED, "user1")
        self.bus.subscribe(WITNESSED, self._on_report)
        self.bus.subscribe(plugins.topics.CURSOR, self._on_cursor)

    def _on_cursor(self, cursor: plugins.Cursor, _user: str) -> None:
        self._count += 1
        self._reports.put(Witnessed(stamp_ns=cursor.stamp_ns, cursors=self._count))

    def _on_report(self, report: Witnessed, user: str) -> None:
        with Path(self.config.path).open("a") as file:
            file.write(f"{user} {report.cursors}\n")


WAVING = plugins.ImuSource(summary="an arm that waves", config=WavingConfig, make=Waving, argument="rate_hz")
NOTEBOOK = plugins.LedOutput(
    summary="writes frames to a file", config=NotebookConfig, make=Notebook, argument="path"
)
EAGER = plugins.SelectionMethod(summary="selects at first sight", config=plugins.MethodConfig, make=Eager)
WITNESS = plugins.ServicePlugin(
    summary="counts cursors",
    config=WitnessConfig,
    make=Witness,
    reads=(plugins.topics.CURSOR, WITNESSED),
    writes=(WITNESSED,),
)
