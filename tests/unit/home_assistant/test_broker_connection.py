"""Lights on a broker, whatever clients publish there and maps want of them."""

import contextlib
from collections.abc import AsyncIterator, Sequence
from typing import Any, cast

import aiomqtt
import pytest

from pointit.bridges.home_assistant.home_action import ServiceCall
from pointit.bridges.home_assistant.home_connection import ActionRefusedError, NoHomeAssistantError
from pointit.bridges.home_assistant.mqtt.broker_connection import BrokerConnection
from pointit.runtime.mqtt.broker_client import BrokerClient

OTHER = b'{"unique_id": "other", "command_topic": "o", "state_topic": "homeassistant/light/desk/config"}'
DESK = b'{"unique_id": "desk", "command_topic": "desk/set"}'
TEMPLATE = (
    b'{"unique_id": "desk", "command_topic": "desk/set", "brightness_command_topic": "desk/level", '
    b'"brightness_command_template": "{{ value * 2 }}"}'
)
DIMMER = b'{"unique_id": "desk", "command_topic": "desk/set", "brightness_command_topic": "desk/level"}'


class ScriptedClient:
    """A client whose broker delivers retained announcements, and then closes the connection."""

    def __init__(self, announcements: Sequence[tuple[str, bytes]]) -> None:
        self._announcements = announcements
        self.published: list[tuple[str, str]] = []

    @property
    def messages(self) -> AsyncIterator[aiomqtt.Message]:
        return self._deliver()

    async def _deliver(self) -> AsyncIterator[aiomqtt.Message]:
        for number, (name, payload) in enumerate(self._announcements):
            topic = f"homeassistant/light/{name}/config"
            yield aiomqtt.Message(topic, payload, 0, retain=True, mid=number, properties=None)

    async def subscribe(self, _topics: object, optional: object = ()) -> str:
        del optional
        return ""

    async def publish(self, topic: str, payload: str, **_options: Any) -> None:
        self.published.append((topic, payload))


async def read(client: ScriptedClient) -> BrokerConnection:
    """Return a connection that has read what the broker delivers."""
    connection = BrokerConnection(cast("BrokerClient", client), "broker.home", "homeassistant")
    with contextlib.suppress(NoHomeAssistantError):
        await connection.read()
    return connection


async def test_light_that_reports_on_announcements_hides_no_other() -> None:
    connection = await read(ScriptedClient([("other", OTHER), ("desk", DESK)]))
    assert (await connection.states()).keys() == {"light.other", "light.desk"}


@pytest.mark.parametrize(
    ("announcement", "brightness"),
    [
        (DESK, 100),
        (TEMPLATE, 100),
        (DIMMER, "100"),
        (DIMMER, 300),
        (DIMMER, 0),
        (DIMMER, 0.5),
        (DIMMER, True),
    ],
)
async def test_brightness_that_cannot_be_set_is_refused(announcement: bytes, brightness: object) -> None:
    client = ScriptedClient([("desk", announcement)])
    connection = await read(client)
    with pytest.raises(ActionRefusedError, match=r"brightness.* in the map"):
        await connection.call(ServiceCall("light.desk", "light", "turn_on", {"brightness": brightness}))
    assert client.published == []


async def test_brightness_of_a_map_is_sent_to_a_dimmer() -> None:
    client = ScriptedClient([("desk", DIMMER)])
    connection = await read(client)
    await connection.call(ServiceCall("light.desk", "light", "turn_on", {"brightness": 100}))
    assert client.published == [("desk/level", "100"), ("desk/set", "ON")]
