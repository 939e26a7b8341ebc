"""From a serial IMU to the LED controller's bytes, through all services on a real bus.

Everything that is expected here is computed here: the geometry of pointing and of the strips, and the
decoder of the controller's protocol, which is written from its table and not from our encoder.
"""

import asyncio
import math
import threading
import time
import zlib
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from pathlib import Path

from pointit.runtime.bus.contract import Bus
from pointit.runtime.clock import WallClock
from pointit.runtime.link.link import Link
from pointit.runtime.service.service import Launch, run_services
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Health
from pointit.schemas.topics import HEALTH
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.imu_bridge.serial.detection import SerialConfig
from pointit.services.imu_bridge.service import ImuBridge
from pointit.services.led_driver.config import LedDriverConfig
from pointit.services.led_driver.output.expander import ExpanderConfig
from pointit.services.led_driver.service import LedDriver
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.service import Localizer
from pointit.services.pointing.service import Pointing, PointingConfig
from pointit.services.pui.config import PuiConfig
from pointit.services.pui.service import Pui
from tests.support.bench import until
from tests.support.pace import within
from tests.support.pty_device import Listener, PtyDevice, Talker, pty_device

FEET_M = (1.5, 1.0)
YAW_DEG = 20.0
EYES_M = 1.64
"""Height of the default person's eyes; then of the shoulder, and the reach."""
SHOULDER_M = 1.43
ARM_M = 0.73

STRIPS = (  # (start, end, direction) of the paper's lab, 150 pixels on 5 m each
    ((4.85, -1.425, 0.9), (4.85, 3.575, 0.9), -1),
    ((4.83, 3.595, 0.9), (-0.17, 3.595, 0.9), 1),
)
PIXELS = 150
LENGTH_M = 5.0

Vec3 = tuple[float, float, float]


def point_on(strip: int, position_m: float) -> Vec3:
    start, end, _ = STRIPS[strip]
    share = position_m / LENGTH_M
    x, y, z = (a + share * (b - a) for a, b in zip(start, end, strict=True))
    return (x, y, z)


def near_pixel(number: int) -> float:
    """Return the arc length of a place in the `number`-th pixel of a line, a little off its centre."""
    return (number + 0.4) * LENGTH_M / PIXELS


def expected_pixel(strip: int, position_m: float) -> int:
    pixel = int(position_m / LENGTH_M * PIXELS)
    return pixel if STRIPS[strip][2] == 1 else PIXELS - 1 - pixel


def line_pointing_at(target: Vec3) -> bytes:
    """Return the IMU's output while eyes, fingertip and `target` are in line: `w,x,y,z`."""
    east = target[0] - FEET_M[0]
    north = target[1] - FEET_M[1]
    up = target[2] - EYES_M
    distance = math.hypot(east, north, up)
    # of the line of sight, per metre
    ahead = math.hypot(east, north) / distance
    rise = up / distance
    # the fingertip: on the line of sight, as far from the shoulder as the arm is long
    drop = EYES_M - SHOULDER_M
    reach = -drop * rise + math.sqrt((drop * rise) ** 2 + ARM_M**2 - drop**2)
    elevation = math.atan2(drop + reach * rise, reach * ahead)
    azimuth = math.atan2(north, east) - math.radians(YAW_DEG)
    c = math.cos(azimuth / 2)
    s = math.sin(azimuth / 2)
    ce = math.cos(elevation / 2)
    se = math.sin(elevation / 2)
    return f"{c * ce:.6f},{s * se:.6f},{-c * se:.6f},{s * ce:.6f}\n".encode()


HOME_M = near_pixel(75)
"""Position on strip 0 of the first target."""


class Board:
    """An LED expander: reads bytes, shows frames, and rejects what the table does not allow."""

    def __init__(self) -> None:
        self.shown: dict[int, list[Vec3]] = {}
        self.shown_at_s = 0.0
        self.frames = 0
        self.faults: list[str] = []
        self._pending: dict[int, list[Vec3]] = {}
        self._stream = bytearray()
        self._lock = threading.Lock()

    def take(self, data: bytes) -> None:
        with self._lock:
            self._stream += data
            while self._step():
                pass

    def restart(self) -> None:
        with self._lock:
            self._stream.clear()
            self._pending.clear()
            self.shown = {}

    def lit(self, channel: int) -> list[int]:
        return [k for k, color in enumerate(self.shown.get(channel, [])) if color != (0, 0, 0)]

    def _step(self) -> bool:
        stream = self._stream
        if len(stream) < 6:
            return False
        if not stream.startswith(b"UPXL"):
            self.faults.append(f"no magic: {bytes(stream[:4])!r}")
            del stream[0]
            return True
        channel = stream[4]
        kind = stream[5]
        body = 0
        if kind == 1:
            if len(stream) < 10:
                return False
            body = 4 + stream[6] * (stream[8] + 256 * stream[9])
        if len(stream) < 6 + body + 4:
            return False
        checked = bytes(stream[: 6 + body])
        crc = bytes(stream[6 + body : 10 + body])
        del stream[: 10 + body]
        if zlib.crc32(checked) != int.from_bytes(crc, "little"):
            self.faults.append("crc")
        self._obey(channel, kind, checked[6:])
        return True

    def _obey(self, channel: int, kind: int, body: bytes) -> None:
        if kind == 1:
            colors = body[0]
            order = body[1]
            if colors != 3 or order != 0b100001:  # green first: red 1, green 0, blue 2, no white
                self.faults.append(f"{colors} colours in order {order:#x}")
            self._pending[channel] = [(body[k], body[k + 1], body[k + 2]) for k in range(4, len(body) - 2, 3)]
        elif kind == 2 and channel == 255:
            self.shown = dict(self._pending)
            self.shown_at_s = time.monotonic()
            self.frames += 1
        else:
            self.faults.append(f"type {kind} on channel {channel}")


class Bench:
    def __init__(self, imu: PtyDevice, bus: Bus) -> None:
        self.line = line_pointing_at(point_on(0, HOME_M))
        self.talker = Talker(imu, lambda: self.line)
        self.board = Board()
        self.imu = imu
        self.reports: dict[str, Health] = {}
        bus.subscribe(HEALTH, lambda report, name: self.reports.__setitem__(name, report))

    def point(self, strip: int, position_m: float) -> None:
        self.line = line_pointing_at(point_on(strip, position_m))

    def shows(self, strip: int, position_m: float) -> bool:
        """Return True if the cursor, three pixels wide, has the expected pixel in its middle."""
        wanted = expected_pixel(strip, position_m)
        return self.board.lit(strip) == [wanted - 1, wanted, wanted + 1] and not self.board.lit(1 - strip)

    async def until_shown(self, strip: int, position_m: float) -> None:
        try:
            await until(lambda: self.shows(strip, position_m))
        except AssertionError as error:
            lit = {channel: self.board.lit(channel) for channel in self.board.shown}
            wanted = expected_pixel(strip, position_m)
            raise AssertionError(f"wanted {wanted} on strip {strip}, lit {lit}, {self.reports}") from error

    def unread(self) -> int:
        """Return the number of unreadable lines of the IMU, as it reports."""
        count, _, what = self.warnings("imu-bridge.anna").partition(" ")
        return int(count) if "could not be read" in what else 0

    def warnings(self, instance: str) -> str:
        return " ".join(self.reports[instance].warnings) if instance in self.reports else ""


@asynccontextmanager
async def whole_chain(folder: Path) -> AsyncGenerator[Bench]:
    with pty_device(folder / "imu") as imu, pty_device(folder / "leds") as leds:
        launches = [
            Launch(
                service=ImuBridge,
                config=ImuBridgeConfig.model_validate(
                    {"source": "serial", "serial": SerialConfig(port=str(imu.path))}
                ),
                user="anna",
            ),
            Launch(service=Pointing, config=PointingConfig(), user="anna"),
            Launch(
                service=Localizer,
                config=LocalizerConfig(method="fixed", position_m=(*FEET_M, 0.0), yaw_deg=YAW_DEG),
                user="anna",
            ),
            Launch(service=Pui, config=PuiConfig(map="lab")),
            Launch(service=LedDriver, config=LedDriverConfig(outputs=(ExpanderConfig(port=str(leds.path)),))),
        ]
        bus = await ZenohBus.open(Link())
        try:
            bench = Bench(imu, bus)
            with bench.talker, Listener(leds, bench.board.take):
                running = asyncio.create_task(run_services(launches, bus, WallClock()))
                try:
                    await until(lambda: running.done() or bench.board.frames > 0)
                    if running.done():
                        running.result()
                    yield bench
                finally:
                    running.cancel()
                    await asyncio.gather(running, return_exceptions=True)
                # the last frame of a controller is dark
                await until(lambda: not bench.board.lit(0) and not bench.board.lit(1))
        finally:
            await bus.close()


PLACES = [(0, 12), (0, 52), (0, 99), (0, 137), (1, 18), (1, 60), (1, 117), (1, 141)]
"""Strip, and pixel counted along its line."""


async def test_the_cursor_is_at_the_right_pixel_of_both_strips(tmp_path: Path) -> None:
    async with whole_chain(tmp_path) as bench:
        for strip, number in PLACES:
            position_m = near_pixel(number)
            bench.point(strip, position_m)
            began_s = time.monotonic()
            await bench.until_shown(strip, position_m)
            assert within(bench.board.shown_at_s - began_s, 2.0)
            shown = bench.board.shown[strip]
            assert {shown[k] for k in bench.board.lit(strip)} == {(255, 255, 255)}
            assert [len(bench.board.shown[channel]) for channel in (0, 1)] == [PIXELS, PIXELS]
        assert bench.board.faults == []


async def test_garbage_in_between_is_counted_and_does_no_harm(tmp_path: Path) -> None:
    async with whole_chain(tmp_path) as bench:
        await bench.until_shown(0, HOME_M)
        garbage = [b"\xff\x00\x80garbage\n", b"nan,nan,nan,nan\n", b"1,1,1,1\n", b"\x55" * 1000, b"\n0.1,0\n"]
        for piece in garbage:
            with bench.talker.lock:
                bench.imu.send(piece)
            await asyncio.sleep(0.02)
        bench.point(1, near_pixel(90))
        await bench.until_shown(1, near_pixel(90))
        await until(lambda: bench.unread() >= 5, what="each piece to be counted")
        assert bench.unread() <= 10  # and the lines it ran into
        assert bench.board.faults == []


async def test_cursor_disappears_and_returns_with_the_imu(tmp_path: Path) -> None:
    async with whole_chain(tmp_path) as bench:
        await bench.until_shown(0, HOME_M)
        with bench.talker.lock:
            bench.imu.unplug()
        await until(lambda: not bench.board.lit(0), what="no cursor without an IMU")
        await until(lambda: "plug the device in" in bench.warnings("imu-bridge.anna"))
        bench.point(1, near_pixel(36))
        with bench.talker.lock:
            bench.imu.plug()
        await bench.until_shown(1, near_pixel(36))
        await until(lambda: not bench.warnings("imu-bridge.anna"))
        assert bench.board.faults == []


def test_the_decoder_of_this_test_reads_the_published_frames() -> None:
    board = Board()
    board.take(bytes.fromhex("55 50 58 4c 00 01 03 21 02 00 11 22 33 aa bb cc fb 69 48 ce"))
    board.take(bytes.fromhex("55 50 58 4c ff 02 9b 38 81 df"))
    assert (board.shown, board.faults) == ({0: [(0x11, 0x22, 0x33), (0xAA, 0xBB, 0xCC)]}, [])
