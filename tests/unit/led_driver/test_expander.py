"""The output: ports of their own, keep-alives, darkness at the end, late and stuck controllers, current."""

import contextlib
import functools
import os
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from pointit.runtime.host.serial_port import PortSettings
from pointit.runtime.service.plugin_guard import Surroundings
from pointit.schemas import Environment, Strip
from pointit.schemas.topics import CURSOR, HEALTH, MAP
from pointit.services.led_driver.config import LedDriverConfig
from pointit.services.led_driver.output.expander import ExpanderConfig, ExpanderOutput, draw_time_s
from pointit.services.led_driver.output.serial_output import KEEP_ALIVE_S, SerialFrame, wire_time_s
from pointit.services.led_driver.outputs import FRAME_RATE
from tests.support import there
from tests.support.bench import ManualClock, memory_bench, until
from tests.support.pty_device import PtyDevice, pty_device
from tests.support.running_source import Health
from tests.unit.led_driver.driving import FAST, cursor, next_frame, started

pytestmark = pytest.mark.wall_time


def expander(path: Path) -> LedDriverConfig:
    return FAST.model_copy(update={"outputs": (ExpanderConfig(port=str(path)),)})


async def test_expander_reports_its_current_and_warns_above_the_limit(tmp_path: Path) -> None:
    clock = ManualClock()
    output = ExpanderConfig(port=str(tmp_path / "led"), max_current_a=0.05)
    async with memory_bench(clock) as bench:
        reports = bench.collect(HEALTH)
        frames = await started(bench, FAST.model_copy(update={"outputs": (output,)}))
        bench.put(CURSOR, cursor(clock, 0.5), "anna")
        await next_frame(frames)
        await until(lambda: any("dimmed to 0.05 A" in text for text in reports[-1].warnings))
        figure = next(figure for figure in reports[-1].figures if figure.name.startswith("current"))
        assert figure.unit == "A"
        assert 0.04 < figure.value <= 0.05
        bench.put(CURSOR, cursor(clock, 9.0), "anna")
        await next_frame(frames)
        await until(lambda: any(figure.value == 0.0 for figure in reports[-1].figures))


async def test_stuck_controller_is_said_and_holds_nobody_up(tmp_path: Path) -> None:
    clock = ManualClock()
    with pty_device(tmp_path / "led") as device:  # nobody reads it
        async with memory_bench(clock) as bench:
            reports = bench.collect(HEALTH)
            frames = await started(bench, expander(device.path))
            step = 0

            def said() -> bool:
                nonlocal step
                step += 1
                bench.put(CURSOR, cursor(clock, step % 20 / 10 + 0.05), "anna")
                return bool(reports) and any("no more data" in text for text in reports[-1].warnings)

            await until(said, 20)
            await next_frame(frames)


LONG = Environment(
    stamp_ns=1,
    name="long",
    strips=tuple(Strip(id=name, line_m=((0, 0, 0), (2, 0, 0)), pixels=800) for name in "abcd"),
)
WIDE = LONG.model_copy(
    update={"strips": tuple(LONG.strips[0].model_copy(update={"id": f"{k:02}"}) for k in range(48))}
)


class SlowReader:
    """Reads so many bytes from a device in so many seconds, in a thread: a link slower than its baud rate."""

    def __init__(self, device: PtyDevice, size_bytes: int, period_s: float) -> None:
        self._device = device
        self._size_bytes = size_bytes
        self._period_s = period_s
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="slow reader", daemon=True)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(30.0)

    def _run(self) -> None:
        while not self._stop.wait(self._period_s):
            with contextlib.suppress(BlockingIOError):
                os.read(self._device.master, self._size_bytes)


class SentAtOnce:
    """A port of a healthy link: takes everything, in the time that a given clock says."""

    out_waiting = 0
    write_timeout = 1.0

    def write(self, data: bytes) -> int:
        return len(data)


@pytest.mark.parametrize("pause_s", [0.0, KEEP_ALIVE_S])
@pytest.mark.parametrize("baud", [100_000, 4_000_000])
def test_frame_rate_follows_the_link_even_for_static_pictures(
    pause_s: float, baud: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = 0.0

    def sleep(time_s: float) -> None:
        nonlocal now_s
        now_s += time_s

    clock = SimpleNamespace(sleep=sleep, monotonic=lambda: now_s)
    monkeypatch.setattr("pointit.services.led_driver.output.serial_output.time", clock)
    health = Health()
    output = ExpanderOutput(
        ExpanderConfig(port="leds", baud=baud), replace(Surroundings.detached(), health=health)
    )

    def post(call: Callable[..., None], *arguments: object) -> None:
        call(*arguments)

    monkeypatch.setattr(output._thread, "post", post)
    data = bytes(267)  # a channel of 81 pixels
    picture = SerialFrame(data=data, opening=data, dark=data, draw_s=draw_time_s(81))
    frame_s = max(wire_time_s(len(data), baud), picture.draw_s)
    for _ in range(4):
        output._transmit(cast("Any", SentAtOnce()), picture)
        sleep(pause_s)
    assert health.metrics == {f"{FRAME_RATE} leds": pytest.approx(1.0 / frame_s)}
    assert not health.warnings


async def test_throttled_link_is_called_slow_and_no_cable_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # the reader is a thread of a machine that may be busy
    patient = functools.partial(PortSettings, write_timeout_s=20.0)
    monkeypatch.setattr("pointit.services.led_driver.output.serial_output.PortSettings", patient)
    clock = ManualClock()
    output = ExpanderConfig(port=str(tmp_path / "led"), baud=4_000_000)
    with pty_device(tmp_path / "led") as device, SlowReader(device, 2048, 0.01):  # half of what is expected
        async with memory_bench(clock) as bench:
            reports = bench.collect(HEALTH)
            frames = await started(bench, FAST.model_copy(update={"outputs": (output,)}))
            bench.put(MAP, WIDE)  # 116 kB a frame, 0.6 s
            step = 0

            def is_slow() -> bool:
                nonlocal step
                step += 1
                bench.put(CURSOR, cursor(clock, step % 20 / 10 + 0.05, "00"), "anna")
                return bool(reports) and any(
                    "something slows the link" in text for text in reports[-1].warnings
                )

            await until(is_slow, 30)
            assert not any("no more data" in text for report in reports for text in report.warnings)
            assert frames[-1].light_s > 0.2
            assert there(reports[-1].latency).p50_s > 0.2
            rate = next(figure for figure in reports[-1].figures if figure.name.startswith(FRAME_RATE))
            assert rate.unit == "Hz"
