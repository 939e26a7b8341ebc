"""Services of the backend on rclpy, against a stand-in for it: who asks gets an answer, and nobody waits."""

import asyncio
from collections.abc import Callable

import pytest

from pointit.runtime.errors import BusClosedError
from tests.support.bench import until
from tests.unit.ros2 import fake_rclpy
from tests.unit.ros2.fake_rclpy import SetBool, Value, Wire
from tests.unit.ros2.rclpy_bench import BOOL, QOS, SET, TRUE, node_of_ours, on_a_wire, profile

pytestmark = pytest.mark.wall_time


@pytest.fixture
def wire(monkeypatch: pytest.MonkeyPatch) -> Wire:
    return on_a_wire(monkeypatch)


def into(answered: list[bytes]) -> Callable[[Value], None]:
    def take(response: Value) -> None:
        answered.append(response.cdr)

    return take


def more(request: Value, _response: Value) -> Value:
    return SetBool.Response(request.cdr + b"\2")


async def test_requests_are_answered_in_the_loop_while_the_executor_goes_on(wire: Wire) -> None:
    async with node_of_ours() as ours:
        gate = asyncio.Event()

        async def slow(request: bytes) -> bytes:
            await gate.wait()
            return request

        desk = ours.backend.serve("/stop", SET, slow)
        (service,) = wire.ends["service"]
        assert isinstance(service, fake_rclpy.Service)
        answered: list[bytes] = []
        service.ask(b"\0\1\0\0\7", into(answered))
        heard: list[bytes] = []
        ours.backend.subscribe("/in", BOOL, QOS, heard.append)
        wire.node("robot").create_publisher(fake_rclpy.Bool, "/in", profile()).publish(TRUE)
        await until(lambda: bool(heard))
        assert not answered
        gate.set()
        await until(lambda: bool(answered))
        assert answered == [b"\0\1\0\0\7"]
        desk.close()
        assert not wire.ends["service"]


@pytest.mark.parametrize("response", [b"", b"\0\1\0\0bad", None], ids=["empty", "other", "raises"])
async def test_who_asks_is_always_answered(wire: Wire, response: bytes | None) -> None:
    async with node_of_ours() as ours:

        async def wrong(_request: bytes) -> bytes:
            await asyncio.sleep(0)
            if response is None:
                raise ZeroDivisionError
            return response

        ours.backend.serve("/stop", SET, wrong)
        (service,) = wire.ends["service"]
        assert isinstance(service, fake_rclpy.Service)
        answered: list[bytes] = []
        service.ask(b"\0\1\0\0bad", into(answered))  # ends `spin`
        service.ask(b"\0\1\0\0\7", into(answered))
        await until(lambda: bool(answered))
        assert answered == [SetBool.Response().cdr]
        assert ours.now["rclpy"] == "something from ROS was dropped by rclpy: cannot be read"


async def test_too_many_open_requests_are_answered_with_nothing_in_them(wire: Wire) -> None:
    async with node_of_ours() as ours:
        gate = asyncio.Event()

        async def slow(request: bytes) -> bytes:
            await gate.wait()
            return request

        ours.backend.serve("/stop", SET, slow)
        (service,) = wire.ends["service"]
        assert isinstance(service, fake_rclpy.Service)
        answered: list[bytes] = []
        for _ in range(66):
            service.ask(b"\0\1\0\0\7", into(answered))
        await until(lambda: len(answered) == 2)
        assert answered == [SetBool.Response().cdr] * 2
        assert "too many requests are open" in ours.now["requests to /stop"]
        gate.set()
        await until(lambda: len(answered) == 66)
        assert answered[2:] == [b"\0\1\0\0\7"] * 64


async def test_calls_get_their_answers_or_say_what_is_lacking(wire: Wire) -> None:
    async with node_of_ours() as ours:
        with pytest.raises(TimeoutError, match=r"/stop: no node serves it within 0\.01 s"):
            await ours.backend.call("/stop", SET, TRUE, timeout_s=0.01)
        call = asyncio.create_task(ours.backend.call("/stop", SET, TRUE, timeout_s=5))
        server = wire.node("robot").create_service(SetBool, "/stop", more)
        assert await call == TRUE + b"\2"
        assert len(wire.ends["client"]) == 1
        server.is_mute = True
        with pytest.raises(TimeoutError, match=r"its server did not answer within 0\.05 s"):
            await ours.backend.call("/stop", SET, TRUE, timeout_s=0.05)
        assert len(wire.removed) == 2
        with pytest.raises(ValueError, match="CDR begins"):
            await ours.backend.call("/stop", SET, b"", timeout_s=1)
        waiting = asyncio.create_task(ours.backend.call("/stop", SET, TRUE, timeout_s=60))
        await until(lambda: len(asyncio.all_tasks()) >= 3)
    with pytest.raises(BusClosedError):
        await waiting
