"""Lights on a broker on which others announce far too much. In virtual time."""

import asyncio
import json
from collections.abc import AsyncIterator, Sequence
from typing import Any, cast

import aiomqtt

from pointit.bridges.home_assistant.mqtt.announced_lights import (
    MAX_LIGHTS,
    MAX_LIGHTS_OF_DEVICE,
    MAX_REFUSED_TOPICS,
    AnnouncedLights,
)
from pointit.bridges.home_assistant.mqtt.broker_connection import MAX_START_S, BrokerConnection
from pointit.runtime.mqtt.broker_client import BrokerClient
from tests.support.bench import background, memory_bench

ACK_S = 0.01
"""Time for the broker to acknowledge, s."""


class BusyBroker:
    """A client whose broker delivers what the test announces, and notes topics and commands."""

    def __init__(self) -> None:
        self._queue = asyncio.Queue[aiomqtt.Message]()
        self.subscribed = set[str]()
        self.max_subscribed = 0
        self.published: list[str] = []
        """Topics of commands."""
        self.ack_s = ACK_S
        """Time for an acknowledgement of a command, s."""

    def deliver(self, topic: str, payload: bytes) -> None:
        self._queue.put_nowait(aiomqtt.Message(topic, payload, 0, retain=True, mid=0, properties=None))

    @property
    def messages(self) -> AsyncIterator[aiomqtt.Message]:
        return self._messages()

    async def _messages(self) -> AsyncIterator[aiomqtt.Message]:
        while True:
            yield await self._queue.get()

    async def subscribe(self, topics: Sequence[tuple[str, int]], optional: Sequence[str] = ()) -> str:
        del optional
        await asyncio.sleep(ACK_S)
        self.subscribed |= {topic for topic, _qos in topics}
        self.max_subscribed = max(self.max_subscribed, len(self.subscribed))
        return ""

    async def unsubscribe(self, topics: Sequence[str]) -> None:
        await asyncio.sleep(ACK_S)
        self.subscribed -= set(topics)

    async def publish(self, topic: str, _payload: str, **_options: Any) -> None:
        self.published.append(topic)
        await asyncio.sleep(self.ack_s)


def connection_to(broker: BusyBroker) -> BrokerConnection:
    return BrokerConnection(cast("BrokerClient", broker), "broker.home", "homeassistant")


def topic_of(name: str) -> str:
    return f"homeassistant/light/{name}/config"


def light(name: str, /, **fields: Any) -> bytes:
    announcement = {"name": name, "unique_id": name, "command_topic": f"{name}/set", "state_topic": name}
    return json.dumps(announcement | fields).encode()


def device(name: str) -> dict[str, Any]:
    return {"identifiers": [name], "name": name}


async def started(connection: BrokerConnection) -> float:
    """Return the time until all lights are known, s."""
    begin_s = asyncio.get_running_loop().time()
    async with asyncio.timeout(60):
        while True:
            if not await connection.is_starting():
                return asyncio.get_running_loop().time() - begin_s
            await asyncio.sleep(0.5)


async def test_start_ends_while_lights_are_announced_without_end() -> None:
    async with memory_bench():
        broker = BusyBroker()
        connection = connection_to(broker)

        async def announce() -> None:
            for number in range(10_000):
                name = f"light_{number % 400}"
                broker.deliver(topic_of(name), light(name, state_topic=f"{name}/{number}"))
                await asyncio.sleep(0.1)

        async with background(connection.read()), background(announce()):
            await connection.subscribe("state_changed", lambda _data: None)
            assert MAX_START_S - 1 < await started(connection) < MAX_START_S + 1
            assert "light.light_0" in await connection.states()

            zigbee = {"schema": "json", "origin": {"name": "Zigbee2MQTT"}}
            broker.deliver(topic_of("late"), light("late", **zigbee))
            await asyncio.sleep(1.0)
            assert not await connection.is_starting()
            assert "light.late" in await connection.states()
            assert broker.published == ["late/get"], "a later light is asked, too"


async def test_start_waits_for_no_answer_of_silent_lights() -> None:
    async with memory_bench():
        broker = BusyBroker()
        broker.ack_s = 5.0
        connection = connection_to(broker)
        async with background(connection.read()):
            await connection.subscribe("state_changed", lambda _data: None)
            for number in range(20):
                zigbee = {"schema": "json", "origin": {"name": "Zigbee2MQTT"}}
                broker.deliver(topic_of(f"lamp_{number}"), light(f"lamp_{number}", **zigbee))
            assert await started(connection) < 2.0
            await asyncio.sleep(120.0)
            assert len(broker.published) == 20, "each is asked"


async def test_light_that_changes_thousands_of_times_hides_no_other() -> None:
    async with memory_bench():
        broker = BusyBroker()
        connection = connection_to(broker)
        async with background(connection.read()):
            await connection.subscribe("state_changed", lambda _data: None)
            for number in range(6_000):
                broker.deliver(topic_of("busy"), light("busy", state_topic=f"busy/{number}"))
                if number % 10 == 0:
                    await asyncio.sleep(ACK_S)
            broker.deliver(topic_of("desk"), light("desk"))
            await asyncio.sleep(1.0)

            broker.deliver("desk", b"ON")
            await asyncio.sleep(1.0)
            assert (await connection.states())["light.desk"]["state"] == "on"
            assert {
                topic
                for topic in broker.subscribed
                if "homeassistant" not in topic and "tasmota" not in topic
            } == {
                "busy/5999",
                "desk",
            }
            assert broker.max_subscribed < 10
        assert connection.refusals == []


async def test_topics_of_a_light_that_is_gone_are_unsubscribed_from() -> None:
    async with memory_bench():
        broker = BusyBroker()
        connection = connection_to(broker)
        async with background(connection.read()):
            broker.deliver(topic_of("desk"), light("desk"))
            await asyncio.sleep(1.0)
            assert broker.subscribed == {"desk"}
            broker.deliver(topic_of("desk"), b"")
            await asyncio.sleep(1.0)
        assert broker.subscribed == set()


def test_device_with_too_many_lights_keeps_no_other_out() -> None:
    lights = AnnouncedLights("broker.home", "homeassistant")
    for number in range(MAX_LIGHTS):
        name = f"noisy_{number}"
        lights.on_announcement(topic_of(name), light(name, device=device("noisy")))
    lights.on_announcement(topic_of("desk"), light("desk", device=device("desk")))

    assert "light.desk" in lights.entries
    assert len(lights.entries) == MAX_LIGHTS_OF_DEVICE + 1
    assert len(lights.refusals) == MAX_LIGHTS - MAX_LIGHTS_OF_DEVICE
    assert "noisy_499 is left out: its device has more than 64 lamps" in lights.refusals


def test_announcement_of_many_devices_counts_as_one() -> None:
    components: dict[str, Any] = {}
    for number in range(300):
        components[f"c{number}"] = {
            "platform": "light",
            "unique_id": f"light_{number}",
            "command_topic": "c",
            "device": device(f"device_{number}"),
        }
    lights = AnnouncedLights("broker.home", "homeassistant")
    lights.on_announcement("homeassistant/device/noisy/config", json.dumps({"cmps": components}).encode())
    assert len(lights.entries) == MAX_LIGHTS_OF_DEVICE


def test_lights_above_the_limit_are_named() -> None:
    lights = AnnouncedLights("broker.home", "homeassistant")
    for number in range(MAX_LIGHTS + MAX_REFUSED_TOPICS + 1):
        lights.on_announcement(topic_of(f"light_{number}"), light(f"light_{number}"))

    assert len(lights.entries) == MAX_LIGHTS
    assert len(lights.refusals) == MAX_REFUSED_TOPICS + 1
    assert lights.refusals[0].startswith("light_500 is left out: broker.home has more than 500 lamps;")
    assert lights.refusals[-1] == "broker.home has further lamps that cannot be used"


def test_second_light_with_the_same_id_replaces_none() -> None:
    lights = AnnouncedLights("broker.home", "homeassistant")
    lights.on_announcement(topic_of("desk"), light("desk"))
    lights.on_announcement(topic_of("other"), light("desk", name="Other", command_topic="other/set"))
    assert lights.entries["light.desk"].topic == topic_of("desk")
    (sentence,) = lights.refusals
    assert sentence.startswith("Other is left out: it has the `unique_id` of desk, which homeassistant/")

    lights.on_announcement(topic_of("desk"), light("desk", name="Desk"))
    assert lights.entries["light.desk"].light.name == "Desk", "a change of its own"


def test_each_refused_light_of_an_announcement_is_named() -> None:
    components = {name: {"platform": "light", "name": name} for name in ("Left", "Right")}
    lights = AnnouncedLights("broker.home", "homeassistant")
    topic = "homeassistant/device/lamp/config"
    lights.on_announcement(topic, json.dumps({"components": components}).encode())
    assert [sentence.partition(" ")[0] for sentence in lights.refusals] == ["Left", "Right"]

    lights.on_announcement(topic, b"")
    assert lights.refusals == []


async def test_messages_that_cannot_be_read_are_named() -> None:
    async with memory_bench():
        broker = BusyBroker()
        connection = connection_to(broker)
        async with background(connection.read()):
            broker.deliver(topic_of("text"), b"a lamp")
            broker.deliver(topic_of("long"), b" " * 200_000)
            broker.deliver(topic_of("desk"), light("desk"))
            await asyncio.sleep(1.0)
            broker.deliver("desk", b" " * 200_000)
            await asyncio.sleep(1.0)
            report, long, text = connection.refusals
            assert report == "a report of desk on desk cannot be used: 200000 bytes, limit 100000"
            assert long.endswith("light/long/config cannot be used: 200000 bytes, limit 100000")
            assert text.endswith("light/text/config cannot be used: it is no object in JSON")
            broker.deliver("desk", b"ON")
            await asyncio.sleep(1.0)
            assert connection.refusals == [long, text]
