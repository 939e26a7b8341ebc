"""An observer at another host: prints each received message as a line of JSON.

Started as `network_spectator.py CREDENTIALS`. Runs until killed. The numbers show losses.
"""

import asyncio
import datetime as dt
import functools
import json
import sys
import time
from pathlib import Path
from typing import Any

from pointit.runtime.link.link import Link, read_credentials
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Message, SelectionEvent
from pointit.schemas.topics import CURSOR, OBJECTS, SELECTION, SELECTION_EVENTS, STRIPS_FRAME, Topic
from tests.faults.network_view import told

TOPICS: tuple[Topic[Any], ...] = (CURSOR, OBJECTS, SELECTION, SELECTION_EVENTS, STRIPS_FRAME)


def show(topic: str, message: Message, name: str) -> None:
    line = {"topic": topic, "name": name, "stamp": message.stamp_ns, "came": time.time_ns()}
    if isinstance(message, SelectionEvent):
        line["told"] = told(message)
    sys.stdout.write(json.dumps(line) + "\n")
    sys.stdout.flush()


async def main() -> None:
    credentials = read_credentials(Path(sys.argv[1]), dt.datetime.now(dt.UTC))
    link = Link(site=credentials.link.site, connect=credentials.link.endpoints, credentials=credentials)
    bus = await ZenohBus.open(link, patience_s=20.0)
    for topic in TOPICS:
        bus.subscribe(topic, functools.partial(show, topic.key))
    await asyncio.Event().wait()


if __name__ == "__main__":
    asyncio.run(main())
