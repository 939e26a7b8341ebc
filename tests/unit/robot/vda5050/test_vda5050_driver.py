"""The driver of AGVs at a broker that is a queue: what it sends when it ends."""

import asyncio
import contextlib
from collections.abc import AsyncGenerator, AsyncIterator
from typing import Any

import aiomqtt
import pytest

from pointit.runtime.service.plugin_guard import Surroundings
from pointit.services.robot.drivers import vda5050
from pointit.services.robot.drivers.agv import Agv, Vda5050Config
from pointit.services.robot.drivers.vda5050 import Vda5050Driver
from pointit.services.robot.robot_driver import FollowPath, ReportItem, RobotReport
from pointit.testing.trial import TrialHealth
from pointit_lab.devices.agv_broker import VirtualAgv
from tests.support.bench import ManualClock, until
from tests.unit.robot.vda5050.agv_bench import SPEC

pytestmark = pytest.mark.wall_time

STATE = "uagv/v2/acme/7/state"


class Broker:
    """A connected client, and the AGV behind it, which stands."""

    def __init__(self) -> None:
        self.agv = VirtualAgv()
        self.incoming: asyncio.Queue[aiomqtt.Message] = asyncio.Queue()

    @property
    async def messages(self) -> AsyncIterator[aiomqtt.Message]:
        while True:
            yield await self.incoming.get()

    async def subscribe(self, *_arguments: Any) -> None: ...

    async def publish(self, topic: str, payload: str, **_options: Any) -> None:
        self.agv.receive(topic, payload)
        self.say()

    def say(self) -> None:
        self.incoming.put_nowait(aiomqtt.Message(STATE, self.agv.state(), 0, False, 1, None))


async def test_agv_is_stopped_before_an_error_ends_the_driver(monkeypatch: pytest.MonkeyPatch) -> None:
    broker = Broker()

    @contextlib.asynccontextmanager
    async def connected(_options: object) -> AsyncGenerator[Broker]:
        yield broker

    def fail(*_arguments: object) -> None:
        raise ArithmeticError

    monkeypatch.setattr(vda5050, "connected", connected)
    config = Vda5050Config(broker="hub", manufacturer="acme", serial_number="7")
    around = Surroundings(clock=ManualClock(), health=TrialHealth(), folder=Surroundings.detached().folder)
    driver = Vda5050Driver(config, SPEC, around)
    items: list[ReportItem] = []
    running = asyncio.ensure_future(driver.run(items.append))
    await until(lambda: any(isinstance(each, RobotReport) for each in items))
    driver.command(FollowPath(1, ((9.0, 0.0, 0.0),)))
    await until(lambda: bool(broker.agv.base))
    monkeypatch.setattr(Agv, "on_message", fail)
    broker.say()
    with pytest.raises(ExceptionGroup):
        await running
    assert broker.agv.base == []
