"""Datagrams of frames: newest wins, resent, limited in rate, dark at the end; errors named."""

import asyncio
import functools
import socket
import threading
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from dataclasses import replace
from typing import Any

import pytest

from pointit.runtime.service.plugin_guard import Surroundings
from pointit.schemas import Strip, StripFrame, StripsFrame
from pointit.services.led_driver.output import udp_output
from pointit.services.led_driver.output.udp_output import Datagram, UdpOutput, UdpOutputConfig
from pointit.testing import UdpDevice
from tests.support.bench import until
from tests.support.running_source import Health
from tests.unit.led_driver.driving import receiver

pytestmark = pytest.mark.wall_time
STRIP = Strip(id="a", line_m=((0, 0, 0), (1, 0, 0)), pixels=2)


class PlainOutput(UdpOutput):
    def encode(self, pixels: bytes, number: int) -> list[Datagram]:
        return [Datagram(bytes((number % 256,)) + pixels)]


def plain_output(told: Health, port: int, **parameters: Any) -> PlainOutput:
    config = UdpOutputConfig.model_validate({"gamma": 1.0, "port": port, **parameters})
    return PlainOutput(config, replace(Surroundings.detached(), health=told))


def frame(value: int) -> StripsFrame:
    return StripsFrame(stamp_ns=1, strips=(StripFrame(id="a", rgb=bytes([value] * 6)),))


@asynccontextmanager
async def running(
    port: int, told: Health, host: str = "127.0.0.1", rate_hz: float = 1000.0
) -> AsyncGenerator[UdpOutput]:
    output = plain_output(told, port, host=host, max_rate_hz=rate_hz)
    output.set_strips([STRIP])
    work = asyncio.create_task(output.run())
    yield output
    work.cancel()
    await asyncio.wait({work})


async def test_frame_arrives_is_resent_and_ends_dark(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(udp_output, "KEEP_ALIVE_S", 0.01)
    told = Health()
    async with receiver() as device:
        async with running(device.port, told) as output:
            output.show(frame(7), 0.01)
            await until(lambda: [each[1:] for each in device.datagrams[-3:]] == [bytes([7] * 6)] * 3)
            assert output.light_s > 0.0
            assert told.metrics[f"frame rate 127.0.0.1:{device.port}"] == pytest.approx(1000.0, rel=0.5)
            assert (told.metrics[f"network rate 127.0.0.1:{device.port}"] or 0.0) > 0.0
        await until(lambda: device.datagrams[-1][1:] == bytes(6))
        counts = [each[0] for each in device.datagrams]
        assert counts == [(counts[0] + k) % 256 for k in range(len(counts))]
    assert not told.warnings


async def test_changed_frame_is_resent_soon_since_datagrams_get_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(udp_output, "REPEAT_S", 0.01)
    monkeypatch.setattr(udp_output, "KEEP_ALIVE_S", 1000.0)
    async with receiver() as device, running(device.port, Health()) as output:
        for value in (7, 8):
            output.show(frame(value))
            await until(lambda value=value: [each[1] for each in device.datagrams].count(value) == 3)
        await asyncio.sleep(0.1)  # none follows
        assert [each[1] for each in device.datagrams][-3:] == [8, 8, 8]


async def test_newest_frame_replaces_those_that_the_rate_does_not_allow() -> None:
    async with receiver() as device, running(device.port, Health(), rate_hz=20.0) as output:
        output.show(frame(255))
        await until(lambda: bool(device.datagrams))
        for value in range(1, 255):
            output.show(frame(value))
            await asyncio.sleep(0)
        await until(lambda: device.datagrams[-1][1:] == bytes([254] * 6))
        assert len(device.datagrams) < 20


async def test_refused_frames_are_reported_and_arrive_when_the_light_returns() -> None:
    told = Health()
    device = UdpDevice()
    async with running(device.port, told) as output:
        device.close()  # nobody listens
        output.show(frame(1))
        await until(lambda: "does not listen" in told.warnings.get(f"network 127.0.0.1:{device.port}", ""))
        await device.plug()
        output.show(frame(2))
        await until(lambda: any(each[1:] == bytes([2] * 6) for each in device.datagrams))
        await until(lambda: not told.warnings)
        await device.unplug()


async def test_pixels_that_a_new_map_lacks_become_dark() -> None:
    async with receiver() as device, running(device.port, Health()) as output:
        output.show(frame(7))
        await until(lambda: last_is(device, 7))
        output.set_strips([STRIP.model_copy(update={"pixels": 1})])
        output.show(StripsFrame(stamp_ns=1, strips=(StripFrame(id="a", rgb=bytes((1, 2, 3))),)))
        await until(lambda: device.datagrams[-1][1:] == bytes((1, 2, 3, 0, 0, 0)))
        output.set_strips([])
        await until(lambda: device.datagrams[-1][1:] == bytes(6))


async def test_same_map_again_does_not_blink(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(udp_output, "KEEP_ALIVE_S", 0.01)
    async with receiver() as device, running(device.port, Health()) as output:
        output.show(frame(7))
        await until(lambda: last_is(device, 7))
        lit = len(device.datagrams)
        count = len(device.datagrams) + 3
        output.set_strips([STRIP.model_copy()])
        await until(lambda: len(device.datagrams) >= count)
        assert {each[1:] for each in device.datagrams[lit:]} == {bytes([7] * 6)}


async def test_light_that_is_back_while_a_retry_waits_ends_dark(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(udp_output, "RETRY_S", 1000.0)
    told = Health()
    device = UdpDevice()
    async with running(device.port, told) as output:
        output.show(frame(1))
        device.close()  # nobody listens
        output.show(frame(2))
        await until(lambda: "does not listen" in told.warnings.get(f"network 127.0.0.1:{device.port}", ""))
        await device.plug()
    await until(lambda: [each[1:] for each in device.datagrams] == [bytes(6)])
    await device.unplug()


async def test_light_goes_off_at_the_end_despite_an_earlier_refusal(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(udp_output, "REPEAT_S", 1000.0)
    told = Health()
    device = UdpDevice()
    device.close()  # nobody listens
    async with running(device.port, told):
        await until(lambda: f"network rate 127.0.0.1:{device.port}" in told.metrics)
        await device.plug()
    await until(lambda: [each[1:] for each in device.datagrams] == [bytes(6)])
    await device.unplug()


def last_is(device: UdpDevice, value: int) -> bool:
    return bool(device.datagrams) and device.datagrams[-1][1] == value


async def test_light_that_cannot_be_found_delays_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = asyncio.Event()
    loop = asyncio.get_running_loop()
    answer = threading.Event()

    def resolve(*_: object) -> object:
        loop.call_soon_threadsafe(asked.set)
        answer.wait(60.0)
        raise socket.gaierror(socket.EAI_NONAME, "no such name")

    monkeypatch.setattr(socket, "getaddrinfo", resolve)
    told = Health()
    async with (
        receiver() as device,
        running(device.port, Health()) as other,
        running(4048, told, host="kitchen.local") as lost,
    ):
        await asked.wait()
        for value in range(1, 100):
            lost.show(frame(value))
            other.show(frame(value))
            await until(functools.partial(last_is, device, value))
        answer.set()
        await until(lambda: "name cannot be resolved" in told.warnings.get("network kitchen.local:4048", ""))


async def test_segments_that_do_not_fit_the_map_are_named() -> None:
    told = Health()
    output = plain_output(told, 1, host="127.0.0.1", segments=[{"strip": "b"}])
    output.set_strips([STRIP])
    assert told.warnings == {
        "segments 127.0.0.1:1": "127.0.0.1:1: the map has no strip b: correct `segments`"
    }
    output.set_strips([STRIP.model_copy(update={"id": "b"})])
    assert not told.warnings
