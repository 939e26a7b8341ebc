"""MQTT relay: what people select goes to a broker, for Home Assistant or Node-RED; a speed comes back.

- `pointit/selection`: all that is selected, retained, `[{"id": "7", "kind": "red", "user": "anna"}]`
- `pointit/events`: each event as it happens, `{"event": "selected", "object_id": "7", "user": "anna", ...}`
- `pointit/conveyor/speed`: publish a number, m/s, and the conveyor moves at it
"""

import argparse
import asyncio
import json
import logging
import ssl

import aiomqtt

import pointit
from pointit.schemas.topics import SELECTION

log = logging.getLogger("relay")

SPEED = "pointit/conveyor/speed"


async def publish(broker: aiomqtt.Client, topic: str, payload: str, *, retain: bool = False) -> None:
    """Publish at least once (quality of service 1).

    Raises:
        CancelledError: If the task was cancelled meanwhile. aiomqtt alone may lose that before Python 3.12:
            then the relay would not end.
    """
    await broker.publish(topic, payload, qos=1, retain=retain)
    task = asyncio.current_task()
    if task is not None and task.cancelling():
        raise asyncio.CancelledError


async def publish_events(site: pointit.Site, broker: aiomqtt.Client) -> None:
    """Publish every event."""
    async for event in site.selections():
        await publish(broker, "pointit/events", event.model_dump_json())


async def publish_selection(site: pointit.Site, broker: aiomqtt.Client) -> None:
    """Publish what is selected after each change; the broker keeps it for those who come later."""
    async for selection in site.messages(SELECTION):
        selected: list[dict[str, str]] = []
        for item in selection.settled:
            selected.append({"id": item.id, "kind": item.kind, "user": item.user})
        await publish(broker, "pointit/selection", json.dumps(selected), retain=True)


async def follow_speed(site: pointit.Site, broker: aiomqtt.Client) -> None:
    """Set the conveyor's speed to each number that comes; log what was refused, and go on."""
    await broker.subscribe(SPEED)
    async for message in broker.messages:
        try:
            await site.conveyor.set_speed(float(message.payload))
        except (TypeError, ValueError, pointit.PointItError) as error:
            log.warning("%s: %s", SPEED, error)


async def relay(site: pointit.Site, broker: aiomqtt.Client) -> None:
    """Do all three at the same time; if one fails, the others end too."""
    async with asyncio.TaskGroup() as tasks:
        for part in (publish_events, publish_selection, follow_speed):
            tasks.create_task(part(site, broker))


async def main() -> None:
    """Join the site on this machine and a broker."""
    parser = argparse.ArgumentParser(description="Relay selections to an MQTT broker.")
    parser.add_argument("--broker", default="127.0.0.1", help="address of the broker")
    parser.add_argument("--port", type=int, default=1883)
    parser.add_argument("--ca-file", help="authority of a broker that encrypts, usually at port 8883")
    given = parser.parse_args()
    tls = ssl.create_default_context(cafile=given.ca_file) if given.ca_file else None
    broker = aiomqtt.Client(given.broker, given.port, tls_context=tls)
    async with pointit.connect() as site, broker:
        await relay(site, broker)


if __name__ == "__main__":
    asyncio.run(main())
