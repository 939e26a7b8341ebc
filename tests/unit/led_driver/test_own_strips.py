"""Outputs get the strips of their segments, when one of them has changed."""

import asyncio
from collections.abc import Callable, Sequence

import pytest

from pointit.runtime.service import plugin_guard
from pointit.runtime.service.plugin_guard import PluginGuard
from pointit.runtime.service.surroundings import NullHealth
from pointit.schemas import StripFrame, StripsFrame
from pointit.schemas.topics import CURSOR
from pointit.services.led_driver.guarded_output import GuardedOutput
from pointit.services.led_driver.output import datagram_sender
from pointit.services.led_driver.output.serial_port.expander_config import ExpanderConfig
from pointit.services.led_driver.outputs import OutputConfig
from pointit.testing import UdpDevice
from tests.support.bench import ManualClock, memory_bench, until
from tests.unit.led_driver.driving import FAST, MAP_MESSAGE, cursor, next_frame, started

A, B, LIT = StripFrame(id="a", rgb=bytes(60)), StripFrame(id="b", rgb=bytes(60)), bytes(57) + b"\1\2\3"


class Strips:
    """Records the strips of its frames. Its `show` raises if `is_stuck`."""

    def __init__(self) -> None:
        self.light_s = 0.0
        self.shown: list[tuple[StripFrame, ...]] = []
        self.is_stuck = False
        self.ended = asyncio.Event()

    def set_strips(self, strips: Sequence[object]) -> None:
        pass

    def show(self, frame: StripsFrame, age_s: float = 0.0) -> None:
        if self.is_stuck:
            raise ConnectionError("gone")
        assert age_s >= 0.0
        self.shown.append(frame.strips)

    async def run(self) -> None:
        await self.ended.wait()


def guarded(make: Callable[[], Strips], *strip_ids: str) -> GuardedOutput:
    output = GuardedOutput(make, PluginGuard("mine", NullHealth()), strip_ids)
    output.set_map(MAP_MESSAGE)
    return output


def frame(*strips: StripFrame) -> StripsFrame:
    return StripsFrame(stamp_ns=1, strips=strips)


def test_output_gets_its_strips_only_and_only_when_one_has_changed() -> None:
    mine, every = Strips(), Strips()
    outputs = guarded(lambda: mine, "b"), guarded(lambda: every)
    lit_a, lit_b = StripFrame(id="a", rgb=LIT), StripFrame(id="b", rgb=LIT)
    frames = frame(A, B), frame(lit_a, B), frame(lit_a, lit_b), frame(lit_a, lit_b.model_copy())
    sent = [tuple(output.show(each, 0.01) for output in outputs) for each in frames]
    assert sent == [(True, True), (False, True), (True, True), (False, False)]
    assert mine.shown == [(B,), (lit_b,)]
    assert every.shown == [(A, B), (lit_a, B), (lit_a, lit_b)]


def test_output_is_dark_when_frames_lack_its_strips() -> None:
    mine = Strips()
    output = guarded(lambda: mine, "b")
    output.show(frame(A, B))
    output.show(frame(A))
    output.show(frame())
    assert mine.shown == [(B,), ()]


def test_new_map_shows_unchanged_strips_again() -> None:
    mine = Strips()
    output = guarded(lambda: mine, "b")
    output.show(frame(A, B))
    output.set_map(MAP_MESSAGE)
    output.show(frame(A, B))
    assert mine.shown == [(B,), (B,)]


def test_frame_that_could_not_be_shown_is_shown_by_the_next_attempt() -> None:
    mine = Strips()
    mine.is_stuck = True
    output = guarded(lambda: mine, "b")
    assert not output.show(frame(A, B))
    mine.is_stuck = False
    assert output.show(frame(A, B))
    assert mine.shown == [(B,)]


async def test_output_that_is_made_again_shows_what_does_not_change(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plugin_guard, "FIRST_WAIT_S", 0.001)
    made: list[Strips] = []

    def make() -> Strips:
        made.append(Strips())
        return made[-1]

    output = guarded(make, "b")
    output.show(frame(A, B))
    work = asyncio.create_task(output.run())
    made[0].ended.set()
    await until(lambda: len(made) > 1 and made[1].shown == [(B,)])
    work.cancel()
    await asyncio.wait({work})


@pytest.mark.parametrize(
    ("config", "strip_ids"),
    [
        (OutputConfig(), set[str]()),
        (OutputConfig.model_validate({"segments": [{"strip": "a"}, {"strip": "a", "first": 3}]}), {"a"}),
        (ExpanderConfig(), set[str]()),
        (ExpanderConfig.model_validate({"channels": {"a": {"channel": 1}, "b": {"channel": 0}}}), {"a", "b"}),
        (ExpanderConfig.model_validate({"segments": [{"strip": "b", "universe": 0}]}), {"b"}),
    ],
)
def test_strips_of_an_output_are_those_of_its_parameters(config: OutputConfig, strip_ids: set[str]) -> None:
    assert config.strip_ids() == strip_ids


async def test_light_is_as_late_as_at_the_outputs_that_have_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    at_a, at_b = Strips(), Strips()
    made = [guarded(lambda: at_a, "a"), guarded(lambda: at_b, "b")]

    def make_outputs(*_arguments: object) -> list[GuardedOutput]:
        return made

    monkeypatch.setattr("pointit.services.led_driver.service.make_outputs", make_outputs)
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        frames = await started(bench)
        at_a.light_s, at_b.light_s = 0.01, 0.3
        bench.put(CURSOR, cursor(clock, 0.3, "b"), "ben")
        assert (await next_frame(frames)).light_s == 0.3, "the frame before was new to both"
        bench.put(CURSOR, cursor(clock, 0.3), "anna")
        assert (await next_frame(frames)).light_s == 0.3
        for place_m in (0.8, 1.3):
            bench.put(CURSOR, cursor(clock, place_m), "anna")
            light_s = (await next_frame(frames)).light_s
            assert light_s == 0.01, "b has not changed"


async def test_cursor_on_one_strip_sends_nothing_to_controllers_of_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for period in ("REPEAT_S", "KEEP_ALIVE_S"):
        monkeypatch.setattr(datagram_sender, period, 1000.0)
    clock, devices = ManualClock(), {"a": UdpDevice(), "b": UdpDevice()}
    for device in devices.values():
        await device.plug()
    hosts = {"a": "127.0.0.1", "b": "localhost"}
    outputs = [
        {"kind": "ddp", "host": hosts[name], "port": device.port, "segments": [{"strip": name}]}
        for name, device in devices.items()
    ]
    config = FAST.model_validate({**FAST.model_dump(), "outputs": outputs})
    async with memory_bench(clock) as bench:
        frames = await started(bench, config)
        bench.put(CURSOR, cursor(clock, 0.3, "b"), "ben")
        await until(lambda: any(any(datagram[10:]) for datagram in devices["b"].datagrams))
        count = len(devices["b"].datagrams)
        for place_m in (0.3, 0.8, 1.3):
            devices["a"].datagrams.clear()
            bench.put(CURSOR, cursor(clock, place_m, "a"), "anna")
            await next_frame(frames)
            await until(lambda: bool(devices["a"].datagrams))
        assert len(devices["b"].datagrams) == count
    for device in devices.values():
        await device.unplug()
        device.close()
