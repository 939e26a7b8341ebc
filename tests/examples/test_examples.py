"""The examples that use the API, beside a simulated site, a genuine broker, and in a browser."""

import ast
import asyncio
import contextlib
import inspect
import json
from collections.abc import AsyncGenerator, Iterator
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import aiomqtt
import matplotlib as mpl
import pytest

import pointit
from examples import mqtt_relay, my_lamp, my_tracker
from pointit.bridges.foxglove.config import FoxgloveConfig
from pointit.bridges.foxglove.service import SERVICE
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.clock import WallClock
from pointit.schemas import Hover, Selection, SelectionEvent, StripsFrame
from pointit.schemas.base import Rgb
from pointit.schemas.environment import StripFrame
from pointit.schemas.selection import SelectedObject
from pointit.schemas.topics import CONVEYOR_STATE, HOVER, SELECTION, STRIPS_FRAME
from tests.architecture.sources import ROOT
from tests.examples.running import running
from tests.support.bench import Bench, until
from tests.support.browser import NAMES, chromium, installed
from tests.support.buses import free_port, is_listening
from tests.support.mqtt import broker

NOTEBOOK = json.loads((ROOT / "examples" / "pointing.ipynb").read_text(encoding="utf-8"))
PATIENCE_S = 120.0
"""Time limit by the site's clock, s."""


def test_lamp_turns_green_when_something_is_selected() -> None:
    colors: list[Rgb] = []

    async def main() -> None:
        async with pointit.run("scenario_3", virtual=True) as site, running(my_lamp.react(site)):
            async for shown in site.lamp("led_2").colors().during(PATIENCE_S):
                colors.append(shown.color)
                if len(colors) > 1:
                    break

    pointit.run_virtually(main())
    assert colors == [(0, 0, 0), (0, 0xC0, 0x40)]


def test_train_is_selected_by_a_person_watching_the_strip() -> None:
    events: list[SelectionEvent] = []

    async def main() -> None:
        no_conveyor: dict[str, object] = {"conveyor-sim.feeder.sequence": []}
        async with (
            pointit.run("scenario_3", virtual=True, settings=no_conveyor) as site,
            running(my_tracker.track(site)),
        ):
            async for event in site.selections().during(PATIENCE_S):
                events.append(event)
                break

    pointit.run_virtually(main())
    (event,) = events
    assert (event.event, event.kind, event.user) == ("selected", "red", "user1")
    assert event.object_id.endswith("train")


@pytest.mark.slow
async def test_notebook_runs_and_is_stored_without_its_results() -> None:
    """Cells run as in Jupyter: one after the other, inside a running event loop."""
    mpl.use("Agg")
    cells = [cell for cell in NOTEBOOK["cells"] if cell["cell_type"] == "code"]
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in cells)
    names: dict[str, Any] = {"__name__": "__main__"}
    for cell in cells:
        code = compile("".join(cell["source"]), cell["id"], "exec", ast.PyCF_ALLOW_TOP_LEVEL_AWAIT)
        result = eval(code, names)  # noqa: S307 - our own notebook
        if inspect.isawaitable(result):
            await result
    names["plt"].close("all")
    assert names["found"].position_sigma_m < 0.5
    assert names["slope_s"] > 0.1  # s/bit: harder targets take longer


DASHBOARD = ROOT / "examples" / "dashboard"
PATIENCE_MS = 60_000


@pytest.mark.slow
async def test_dashboard_shows_light_people_and_selection() -> None:
    path = installed()
    if path is None:
        pytest.skip(f"no browser: none of {', '.join(NAMES)} is in PATH")
    bus = MemoryBus(LocalBroker())
    bench = Bench(bus, WallClock())

    port = free_port()
    bench.start(SERVICE, FoxgloveConfig(port=port))
    await until(lambda: is_listening(port), what="the bridge listens")

    bench.put(STRIPS_FRAME, StripsFrame(stamp_ns=1, strips=(StripFrame(id="s", rgb=b"\xff\x00\x00" * 10),)))
    bench.put(HOVER, Hover(stamp_ns=1, object_id="7", progress=0.5, action="select"), "anna")
    selected = SelectedObject(id="3", user="ben", since_ns=1, kind="red")
    bench.put(SELECTION, Selection(stamp_ns=1, objects=(selected,)))
    try:
        async with chromium(path) as browser:
            page = await browser.new_page()
            page.set_default_timeout(PATIENCE_MS)
            await page.goto(f"{(DASHBOARD / 'index.html').as_uri()}?at=ws://127.0.0.1:{port}")
            await page.get_by_text("ben: red 3").wait_for()
            await page.get_by_text("▰▰▰▰▰▱▱▱▱▱ select 7").wait_for()
            await page.locator("canvas").wait_for()
            color = "document.querySelector('canvas').getContext('2d').getImageData(9, 0, 1, 1).data.join()"
            assert await page.evaluate(color) == "255,0,0,255"
            assert await page.get_by_text("anna").get_attribute("title") == Hover.__doc__
    finally:
        await bench.stop()
        await bus.close()


RELAY_S = 60.0


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
            received.setdefault(str(message.topic), []).append(json.loads(message.payload))

    async with aiomqtt.Client("127.0.0.1", port) as client:
        await client.subscribe([("pointit/selection", 1), ("pointit/events", 1)])
        async with running(listen()):
            yield client, received


async def test_relay_ends_also_when_a_confirmation_arrives_with_the_cancellation() -> None:
    confirmation: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    async def publish(*_: object, **__: object) -> None:
        await asyncio.wait_for(confirmation, RELAY_S)  # noqa: TID251 - as aiomqtt does

    publishing = asyncio.create_task(mqtt_relay.publish(Mock(publish=publish), "topic", "payload"))
    await asyncio.sleep(0.01)
    confirmation.set_result(None)
    publishing.cancel()
    await asyncio.wait({publishing})
    assert publishing.cancelled()


@pytest.mark.slow
async def test_relay_sends_selections_takes_speed(broker_port: int, caplog: pytest.LogCaptureFixture) -> None:
    await until(lambda: is_listening(broker_port), what="the broker")
    async with (
        pointit.run("scenario_3", settings={"conveyor-sim.feeder.count": 0}) as site,  # never out of objects
        listening(broker_port) as (client, received),
        aiomqtt.Client("127.0.0.1", broker_port) as relays,
        running(mqtt_relay.relay(site, relays)),
    ):
        await client.publish(mqtt_relay.SPEED, "0.125", retain=True)  # the relay may not have come yet
        async for state in site.messages(CONVEYOR_STATE):
            if state.speed_mps == 0.125:
                break
        await client.publish(mqtt_relay.SPEED, "fast")
        await until(lambda: "could not convert string to float" in caplog.text, RELAY_S, "a warning")
        await until(lambda: any(received.get("pointit/selection", ())), RELAY_S, "a selection")
        await until(lambda: "selected" in [each["event"] for each in received.get("pointit/events", ())])
    selected = next(each for each in received["pointit/selection"] if each)[0]
    event = next(each for each in received["pointit/events"] if each["event"] == "selected")

    assert (selected["id"], selected["kind"], selected["user"]) == (event["object_id"], "red", "user1")
