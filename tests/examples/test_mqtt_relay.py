"""The MQTT relay beside a simulated site and a genuine broker."""

import asyncio
import contextlib
import json
from collections.abc import AsyncGenerator, Iterator
from pathlib import Path
from typing import Any

import aiomqtt
import pytest

import pointit
from examples import mqtt_relay
from pointit.schemas.topics import CONVEYOR_STATE
from tests.examples.running import running
from tests.support.bench import until
from tests.support.buses import is_listening
from tests.support.mqtt import broker

PATIENCE_S = 60.0


@pytest.fixture
def broker_port(tmp_path: Path) -> Iterator[int]:
    with broker(tmp_path) as port:
        yield port


@contextlib.asynccontextmanager
async def listening(port: int) -> AsyncGenerator[tuple[aiomqtt.Client, dict[str, list[Any]]]]:
    """Yield a client, and all that it has received, by topic."""
    received: dict[str, list[Any]] = {}

    async def listen() -> None:
        async for message in client.messages:
            received.setdefault(str(message.topic), []).append(json.loads(bytes(message.payload)))

    async with aiomqtt.Client("127.0.0.1", port) as client:
        await client.subscribe([("pointit/selection", 1), ("pointit/events", 1)])
        async with running(listen()):
            yield client, received


@pytest.mark.slow
async def test_relay_publishes_selections_and_sets_the_speed(
    broker_port: int, caplog: pytest.LogCaptureFixture
) -> None:
    await until(lambda: is_listening(broker_port), what="the broker")
    async with (
        pointit.run("scenario_3") as site,
        listening(broker_port) as (client, received),
        aiomqtt.Client("127.0.0.1", broker_port) as relays,
        running(mqtt_relay.relay(site, relays)),
        asyncio.timeout(PATIENCE_S),
    ):
        await client.publish(mqtt_relay.SPEED, "0.125", retain=True)  # the relay may not have come yet
        async for state in site.messages(CONVEYOR_STATE):
            if state.speed_mps == 0.125:
                break
        await client.publish(mqtt_relay.SPEED, "fast")
        await until(lambda: "could not convert string to float" in caplog.text, PATIENCE_S, "a warning")
        await until(lambda: received.get("pointit/selection", [[]])[-1] != [], PATIENCE_S, "a selection")
    (selected,) = received["pointit/selection"][-1]
    (event,) = (each for each in received["pointit/events"] if each["event"] == "selected")
    assert (selected["id"], selected["kind"], selected["user"]) == (event["object_id"], "red", "user1")
