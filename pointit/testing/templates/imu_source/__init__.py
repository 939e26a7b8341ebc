"""An IMU in the network that sends a line of text for each reading: `w,x,y,z`."""

import asyncio
import math

from pydantic import Field

from pointit.plugins import (
    AddressConfig,
    ConfigError,
    Deliver,
    ImuSource,
    Quaternion,
    Reading,
    Reconnected,
    Surroundings,
    format_address,
)

RETRY_S = 0.5
LONGEST_LINE = 1000


class SourceConfig(AddressConfig):
    """Address of the device."""

    host: str = Field(default="", description="name or address of the device")
    port: int = Field(default=4210, gt=0, le=65535, description="TCP port of the device")
    timeout_s: float = Field(default=3.0, gt=0, description="silence after which to connect again, s")


class LineSource:
    """Connects to the device for ever, and delivers what it sends."""

    def __init__(self, config: SourceConfig, surroundings: Surroundings) -> None:
        self._config = config
        self._clock = surroundings.clock
        self._health = surroundings.health

    async def run(self, deliver: Deliver) -> None:
        """Deliver readings until cancelled."""
        address = format_address(self._config.host, self._config.port)
        while True:
            try:
                await self._connect_and_read(deliver)
                problem = "the device closed the connection"
            except OSError as error:  # TimeoutError is one
                problem = str(error) or "the device is silent"
            self._health.warn("device", f"{address}: {problem}; switch it on, or correct its address")
            await asyncio.sleep(RETRY_S)

    async def _connect_and_read(self, deliver: Deliver) -> None:
        async with asyncio.timeout(self._config.timeout_s):
            reader, writer = await asyncio.open_connection(
                self._config.host, self._config.port, limit=LONGEST_LINE
            )
        try:
            self._health.clear("device")
            deliver(Reconnected())
            while True:
                try:
                    async with asyncio.timeout(self._config.timeout_s):
                        line = await reader.readline()
                except ValueError:  # longer than any reading
                    continue
                if not line:
                    return
                orientation = parse(line)
                if orientation is not None:
                    deliver(Reading(self._clock.now_ns(), orientation))
        finally:
            writer.close()


def parse(line: bytes) -> Quaternion | None:
    """Return the orientation x, y, z, w in `line`, or None if it has none."""
    try:
        w, x, y, z = (float(word) for word in line.split(b","))
    except ValueError:
        return None
    norm = math.hypot(w, x, y, z)
    if not abs(norm - 1.0) < 0.05:  # NaN is not, either
        return None
    return (x / norm, y / norm, z / norm, w / norm)


def check(config: SourceConfig) -> None:
    """Refuse parameters that cannot work."""
    if not config.host:
        raise ConfigError("host: is missing; give the device's name or address")


SOURCE = ImuSource(
    summary="an IMU in the network that sends lines of text",
    config=SourceConfig,
    make=LineSource,
    check=check,
    argument="host",
)
