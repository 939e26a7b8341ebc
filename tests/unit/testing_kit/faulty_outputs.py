"""LED outputs with one fault each, and the test that must catch it."""

import time
from collections import deque
from dataclasses import replace
from pathlib import Path

import serial

from pointit.plugins import Config, LedOutput, SerialOutput, SerialOutputConfig, StripsFrame, Surroundings
from pointit.runtime.service.plugin_guard import NullHealth
from pointit.services.led_driver.output.serial_output import SerialFrame
from pointit.testing import PtyDevice
from pointit.testing.templates.led_output.promises import OutputPromises
from tests.unit.testing_kit.faults import CaughtBy


class Output(SerialOutput):
    """Lines of hexadecimal digits."""

    def encode(self, pixels: bytes) -> bytes:
        return pixels.hex().encode() + b"\n"


class SerialContract(OutputPromises):
    plugin = LedOutput(summary="lines", config=SerialOutputConfig, make=Output)
    wrong_parameters = ()
    device = PtyDevice

    def parameters(self, device: PtyDevice) -> dict[str, object]:
        return {"port": str(device.path), "baud": 4_000_000}


caught_by = CaughtBy(SerialContract)


@caught_by("parameters", "`make` raised FileNotFoundError")
class OpensTooEarly(Output):
    def __init__(self, config: SerialOutputConfig, surroundings: Surroundings) -> None:
        super().__init__(config, surroundings)
        Path(config.port).read_bytes()


@caught_by("newest_wins", "`show` took")
class WritesInShow(Output):
    def show(self, frame: StripsFrame, age_s: float = 0.0) -> None:
        time.sleep(0.05)
        super().show(frame, age_s)


@caught_by("newest_wins", "were sent, not just the newest")
class Queues(Output):
    """Sends every frame, in its order."""

    limit: int | None = 1000

    def __init__(self, config: SerialOutputConfig, surroundings: Surroundings) -> None:
        super().__init__(config, surroundings)
        self.waiting = deque[bytes](maxlen=self.limit)

    def send_pixels(self, pixels: bytes, age_s: float) -> None:
        self.waiting.append(self.encode(pixels))
        super().send_pixels(pixels, age_s)

    def _transmit(self, port: serial.Serial, picture: SerialFrame, *, is_new: bool = False) -> None:
        while self.waiting:
            super()._transmit(port, replace(picture, data=self.waiting.popleft()))
        super()._transmit(port, picture, is_new=is_new)


@caught_by("newest_wins", "it held")
class QueuesWithoutLimit(Queues):
    limit = None


@caught_by("reconnects", "came back, and did not get the newest .* again every second")
class SendsOnce(Output):
    """Sends no frame a second time, so that a port that comes back shows nothing."""

    sent: SerialFrame | None = None

    def _transmit(self, port: serial.Serial, picture: SerialFrame, *, is_new: bool = False) -> None:
        if picture != self.sent:
            super()._transmit(port, picture, is_new=is_new)
        if is_new:
            self.sent = picture


@caught_by("shows", "left lit")
class LeavesLit(Output):
    def _transmit(self, port: serial.Serial, picture: SerialFrame, *, is_new: bool = False) -> None:
        if picture.data != picture.dark:
            super()._transmit(port, picture, is_new=is_new)


@caught_by("shows", "after the first `show` `light_s` was")
class Milliseconds(Output):
    def _on_sent(self, picture: SerialFrame, wire_s: float, took_s: float, new_s: float | None) -> None:
        super()._on_sent(picture, wire_s, took_s, new_s)
        self.health.light_s = 1e3


@caught_by("shows", "did not get the newest frame")
class BlueFirst(Output):
    def encode(self, pixels: bytes) -> bytes:
        return super().encode(b"".join(pixels[at : at + 3][::-1] for at in range(0, len(pixels), 3)))


@caught_by("odd_frames", "`show` raised KeyError")
class TrustsTheFrame(Output):
    def show(self, frame: StripsFrame, age_s: float = 0.0) -> None:
        sizes = {strip.id: 3 * strip.pixels for strip in self._strips or ()}
        for strip in frame.strips:
            assert len(strip.rgb) == sizes[strip.id]
        super().show(frame, age_s)


@caught_by("reconnects", "no warning said so")
class NeverWarns(Output):
    def __init__(self, config: SerialOutputConfig, surroundings: Surroundings) -> None:
        super().__init__(config, replace(surroundings, health=NullHealth()))


caught_by("shows", "is no OutputConfig", config=Config)(Output)
