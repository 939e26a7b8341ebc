"""Reports of the runtime on each service for recordings: its parameters, and the requests it answered."""

import asyncio
import json
from collections.abc import AsyncIterator
from typing import Any, ClassVar

import pytest
import pytest_asyncio

from pointit.runtime.bus.instrumented import ServedPublisher
from pointit.runtime.bus.local_broker import LocalBroker
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.config.config import Config, published_parameters
from pointit.runtime.errors import RefusedError
from pointit.runtime.service.service import Context, Launch, Scope, Service, run_service
from pointit.schemas import Configuration, Done, ServedRequest, SetBrightness, encode
from pointit.schemas.topics import CONFIGURATION, SERVED, SET_BRIGHTNESS
from pointit.services.registry import PROCESSES, Process
from tests.support.bench import ManualClock, until


class DimmerConfig(Config):
    SECRETS = frozenset({"token"})

    gain: float = 0.5
    token: str = "hush"  # noqa: S105 - no real one


class Dimmer(Service[DimmerConfig]):
    NAME: ClassVar[str] = "dimmer"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = DimmerConfig

    def __init__(self, config: DimmerConfig, context: Context) -> None:
        super().__init__(config, context)
        self.bus.serve(SET_BRIGHTNESS, self._on_brightness)

    async def _on_brightness(self, query: SetBrightness, _name: str) -> Done:
        if query.brightness != 0.5:
            raise RefusedError("half or nothing")
        return Done(message="dimmed")


@pytest_asyncio.fixture
async def bus() -> AsyncIterator[MemoryBus]:
    """Yield another participant of a site on which a dimmer runs."""
    exchange = LocalBroker()
    own, other = MemoryBus(exchange), MemoryBus(exchange)
    launch = Launch(service=Dimmer, config=DimmerConfig(gain=0.75))
    task = asyncio.create_task(run_service(launch, own, ManualClock()))
    await until(lambda: exchange.handler_for(SET_BRIGHTNESS, "") is not None)
    yield other
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    await own.close()
    await other.close()


async def test_parameters_of_a_running_service_are_published_without_secrets(bus: MemoryBus) -> None:
    told: dict[str, Configuration] = {}
    bus.subscribe(CONFIGURATION, lambda message, name: told.__setitem__(name, message))
    await until(lambda: "dimmer" in told)
    assert json.loads(told["dimmer"].parameters) == {"gain": 0.75}
    assert (told["dimmer"].service, told["dimmer"].user) == ("dimmer", "")
    assert told["dimmer"].release


async def test_answered_requests_are_published_with_their_reply_or_refusal(bus: MemoryBus) -> None:
    told: list[tuple[str, ServedRequest]] = []
    bus.subscribe(SERVED, lambda message, name: told.append((name, message)))
    await bus.call(SET_BRIGHTNESS, SetBrightness(brightness=0.5))
    with pytest.raises(RefusedError, match="half or nothing"):
        await bus.call(SET_BRIGHTNESS, SetBrightness(brightness=0.25))
    await until(lambda: len(told) == 2)
    (name, done), (_, refused) = told
    assert (name, done.request, done.seq, refused.seq) == ("dimmer", "leds/brightness", 1, 2)
    assert SetBrightness.model_validate_json(done.query) == SetBrightness(brightness=0.5)
    assert (Done.model_validate_json(done.reply), done.refusal) == (Done(message="dimmed"), "")
    assert (refused.reply, refused.refusal) == ("", "half or nothing")


async def answered(publisher: Any, reply: Done) -> Done:
    async def serve(_query: SetBrightness, _name: str) -> Done:
        return reply

    served = ServedPublisher(publisher, ManualClock(), service="dimmer", instance="dimmer")
    return await served.reporting(SET_BRIGHTNESS, serve)(SetBrightness(brightness=0.5), "")


async def test_reply_that_cannot_be_published_is_still_given(caplog: pytest.LogCaptureFixture) -> None:
    class Broken:
        def put(self, _message: ServedRequest) -> None:
            raise RuntimeError("no room")

    assert (await answered(Broken(), Done(message="dimmed"))).message == "dimmed"
    assert "answered, but not published for recordings" in caplog.text


async def test_large_reply_is_given_and_left_out_of_what_is_published(bus: MemoryBus) -> None:
    told: list[ServedRequest] = []
    bus.subscribe(SERVED, lambda message, _name: told.append(message))
    large = Done(message="x" * ServedRequest.max_bytes)
    assert await answered(bus.publisher(SERVED, "dimmer.2"), large) is large
    await until(lambda: bool(told))
    assert (told[0].reply, told[0].refusal) == ("", "")
    assert len(encode(told[0])) < ServedRequest.max_bytes


@pytest.mark.parametrize("row", [pytest.param(row, id=row.name) for row in PROCESSES])
def test_parameters_of_every_process_survive_the_way_through_json(row: Process) -> None:
    config = row.config()()
    assert row.config().model_validate_json(published_parameters(config)) == config


def test_secrets_are_not_published_at_any_depth() -> None:
    class Account(Config):
        name: str
        password: str

    class CloudConfig(Config):
        address: str
        api_token: str
        accounts: dict[str, Account]
        keys: tuple[str, ...] = ("w", "a")

    config = CloudConfig(
        address="mqtt://me:hush@broker:1883/lamps",
        api_token="hush",  # noqa: S106 - no real one
        accounts={"first": Account(name="me", password="hush")},  # noqa: S106
    )
    assert json.loads(published_parameters(config)) == {
        "address": "mqtt://***@broker:1883/lamps",
        "accounts": {"first": {"name": "me"}},
        "keys": ["w", "a"],
    }
