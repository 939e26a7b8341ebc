"""An LED output by TCP whose parts the faulty ones replace: lines of hexadecimal digits."""

import asyncio
import contextlib
from collections.abc import Sequence

from pydantic import Field

from pointit.plugins import (
    AddressConfig,
    ConfigError,
    LedOutput,
    OutputConfig,
    Strip,
    StripsFrame,
    Surroundings,
    format_address,
)

RETRY_S = 0.5
CONNECT_S = 3.0
KEEP_ALIVE_S = 0.5
DARK_S = 0.5


class OutputParameters(AddressConfig, OutputConfig):
    """Address of the controller."""

    host: str = Field(default="", description="name or address of the controller")
    port: int = Field(default=4211, gt=0, le=65535, description="TCP port of the controller")


class Output:
    """Sends the newest frame whenever the controller takes one."""

    def __init__(self, config: OutputParameters, surroundings: Surroundings) -> None:
        if not config.host:
            raise ConfigError("host: is missing; give the controller's name or address")
        self._config = config
        self._health = surroundings.health
        self._sizes: dict[str, int] = {}
        self._pixels: bytes | None = None
        self._shown_s = 0.0
        self._age_s = 0.0
        self._changed = asyncio.Event()
        self.light_s = 0.0

    def set_strips(self, strips: Sequence[Strip]) -> None:
        """Set the strips of the map."""
        self._sizes = {strip.id: 3 * strip.pixels for strip in strips}

    def show(self, frame: StripsFrame, age_s: float = 0.0) -> None:
        """Keep `frame` for `run`. It replaces one that was not sent yet."""
        rgb = {strip.id: strip.rgb for strip in frame.strips}
        self._pixels = b"".join(
            rgb.get(name, b"")[:size].ljust(size, b"\0") for name, size in self._sizes.items()
        )
        self._shown_s, self._age_s = asyncio.get_running_loop().time(), age_s
        self._changed.set()

    async def run(self) -> None:
        """Send until cancelled, then switch the strips off."""
        address = format_address(self._config.host, self._config.port)
        while True:
            try:
                await self._connect_and_send()
            except OSError as error:  # TimeoutError is one
                problem = str(error) or "it does not answer"
                self._health.warn("device", f"{address}: {problem}; switch it on, or correct its address")
            await asyncio.sleep(RETRY_S)

    async def _connect_and_send(self) -> None:
        async with asyncio.timeout(CONNECT_S):
            _, writer = await asyncio.open_connection(self._config.host, self._config.port)
        writer.transport.set_write_buffer_limits(0)  # so that `drain` waits until all has left
        try:
            self._health.clear("device")
            self._changed.set()
            while True:
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(KEEP_ALIVE_S):
                        await self._changed.wait()
                is_new = self._changed.is_set()
                self._changed.clear()
                if self._pixels is not None:
                    await self._send(writer, self._pixels, is_new=is_new)
        finally:
            with contextlib.suppress(OSError):
                async with asyncio.timeout(DARK_S):
                    await self._send(writer, bytes(len(self._pixels or b"")))
            writer.transport.abort()

    async def _send(self, writer: asyncio.StreamWriter, pixels: bytes, *, is_new: bool = False) -> None:
        shown_s, age_s = self._shown_s, self._age_s
        writer.write(pixels.hex().encode() + b"\n")
        await writer.drain()
        if is_new:
            self.light_s = asyncio.get_running_loop().time() - shown_s
            self._health.reached(age_s + self.light_s)


OUTPUT = LedOutput(
    summary="a controller in the network that takes lines of hexadecimal digits",
    config=OutputParameters,
    make=Output,
    argument="host",
)
