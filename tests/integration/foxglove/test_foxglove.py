"""The bridge on a memory bus, seen by a viewer of our own over a real socket; subprotocols of viewers."""

import asyncio
import logging
import ssl
import time
from collections.abc import AsyncIterator

import pytest
import pytest_asyncio
import websockets
from websockets.typing import Subprotocol

import pointit.schemas as models
from pointit.bridges.foxglove import service as bridge
from pointit.bridges.foxglove.config import FoxgloveConfig
from pointit.bridges.foxglove.server import names_of, rename
from pointit.bridges.foxglove.service import FAST, SERVICE
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.clock import WallClock
from pointit.runtime.service import service
from pointit.schemas import topics
from pointit.schemas.environment import StripFrame
from tests.integration.foxglove.viewer import SDK, viewer
from tests.support.bench import Bench, until
from tests.support.buses import free_port, is_listening
from tests.support.pace import within

MAP_MESSAGE = models.Environment(
    stamp_ns=1,
    name="lab",
    belts=(models.Belt(id="b", line_m=((0, 0, 1), (4, 0, 1))),),
    strips=(models.Strip(id="s", line_m=((0, 0, 0), (1, 0, 0)), pixels=10),),
)
SCENE = ("/scene/room", "/scene/pixels", "/scene/objects", "/scene/people", "/tf", "/log")


class Site:
    def __init__(self) -> None:
        self.exchange = LocalBroker()
        self.bus = MemoryBus(self.exchange)
        self.bench = Bench(self.bus, WallClock())
        self.port = free_port()
        self.address = f"ws://127.0.0.1:{self.port}"

    async def start(self, host: str = "127.0.0.1", **changes: float) -> None:
        config = FoxgloveConfig.model_validate({"host": host, "port": self.port, **changes})
        self.bench.start(SERVICE, config)
        await until(lambda: is_listening(self.port, host), what="the bridge listens")


@pytest_asyncio.fixture
async def site() -> AsyncIterator[Site]:
    made = Site()
    try:
        yield made
    finally:
        await made.bench.stop()
        await made.bus.close()


def cursor(seq: int) -> models.Cursor:
    return models.Cursor(
        stamp_ns=time.time_ns(), seq=seq, origin_m=(0, 0, 1.6), direction=(1, 0, 0), point_m=(2, 0, 1.6),
        range_m=2.0, miss_rad=0.01 * seq,
    )  # fmt: skip


async def test_a_viewer_sees_the_scene_and_every_topic(site: Site) -> None:
    await site.start()
    async with viewer(site.address, everything=True) as one:
        await until(lambda: "/scene/people" in one.channels)
        site.bench.put(topics.MAP, MAP_MESSAGE)
        site.bench.put(topics.POSE, models.UserPose(stamp_ns=1, position_m=(1, 2, 0), yaw_rad=0), "anna")
        site.bench.put(
            topics.STRIPS_FRAME,
            models.StripsFrame(stamp_ns=1, strips=(StripFrame(id="s", rgb=b"\xff" * 30),)),
        )
        package = models.TrackedObject(
            id="7", kind="red", position_m=(1, 0, 1), surface="belt", surface_id="b"
        )
        site.bench.put(topics.OBJECTS, models.TrackedObjects(stamp_ns=1, objects=(package,)), "plant")
        site.bench.put(topics.CURSOR, cursor(3), "anna")

        await until(lambda: "belt b" in one.entities("room"))
        await until(lambda: {"person anna", "ray anna", "cursor anna"} <= set(one.entities("people")))
        await until(lambda: "plant 7" in one.entities("objects"))
        await until(
            lambda: any(b"\xff\xff\xff\xff" in each["data"] for each in one.all("/scene/pixels")[-1:])
        )
        await until(lambda: any(each["transforms"] for each in one.all("/tf")[-1:]))
        await until(lambda: bool(one.all("/users/anna/cursor")))
        assert one.all("/users/anna/cursor")[0]["miss_rad"] == pytest.approx(0.03)
        assert one.channels["/users/anna/cursor"]["schemaName"] == models.Cursor.schema_name()
        assert one.channels["/users/anna/cursor"]["schemaEncoding"] == "jsonschema"
        await until(lambda: bool(one.all("/health/foxglove")), what="its own health, for plots")

        log_ns, _ = one.frames["/users/anna/cursor"][0]
        assert abs(log_ns - time.time_ns()) < 60e9


async def test_late_viewer_gets_retained_values(site: Site) -> None:
    site.bench.put(topics.MAP, MAP_MESSAGE)
    site.bench.put(topics.SELECTION, models.Selection(stamp_ns=1))
    await site.start()
    async with viewer(site.address, "/scene/room") as early:
        await until(lambda: "belt b" in early.entities("room"))
        async with viewer(site.address, "/scene/room", "/selection", "/map") as late:
            await until(lambda: "belt b" in late.entities("room"))
            await until(lambda: bool(late.all("/selection") and late.all("/map")))
            assert late.all("/map")[0]["strips"][0]["line_m"] == [[0, 0, 0], [1, 0, 0]]
        await early.subscribe("/selection")
        await until(lambda: bool(early.all("/selection")), what="a channel that is looked at later")


async def test_all_events_arrive_and_the_log_begins_with_its_history(site: Site) -> None:
    await site.start()
    site.bench.put(topics.FEEDBACK, models.Feedback(stamp_ns=1, cue="started", text="before"), "anna")
    await site.bench.settle()
    async with viewer(site.address, "/log", "/users/anna/feedback") as one:
        await until(lambda: any("before" in line["message"] for line in one.all("/log")))
        await asyncio.sleep(0)
        for number in range(20):
            site.bench.put(
                topics.FEEDBACK, models.Feedback(stamp_ns=1, cue="selected", text=f"no {number}"), "anna"
            )
        await until(lambda: len(one.all("/users/anna/feedback")) == 20)
        await until(lambda: sum("no " in line["message"] for line in one.all("/log")) == 20)

        lines_ns = [time_ns for time_ns, line in one.frames["/log"] if "no " in line["message"]]
        assert lines_ns == [time_ns for time_ns, _ in one.frames["/users/anna/feedback"]], (
            "one time a message"
        )


async def test_flood_is_limited_to_the_rate_and_the_newest_arrives(site: Site) -> None:
    await site.start(rate_hz=20.0)
    async with viewer(site.address, "/users/anna/cursor", "/scene/people") as one:
        site.bench.put(topics.CURSOR, cursor(0), "anna")
        await until(lambda: bool(one.all("/users/anna/cursor")))
        shown = ("/users/anna/cursor", "/scene/people")
        before = {topic: len(one.all(topic)) for topic in shown}
        began_s = time.monotonic()
        for number in range(1, 200):
            site.bench.put(topics.CURSOR, cursor(number), "anna")
            await asyncio.sleep(0.002)
        await until(lambda: one.all("/users/anna/cursor")[-1]["seq"] == 199)
        most = (time.monotonic() - began_s) * 20.0 + 2
        for topic in shown:
            assert len(one.all(topic)) - before[topic] <= most


async def test_fast_topics_are_read_while_a_viewer_is_connected(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bridge, "LOOK_S", 0.1)

    def read() -> int:
        return sum(len(site.exchange.readers_of(topic)) for topic in FAST)

    await site.start()
    await until(lambda: read() == 0, what="the bridge rests")
    async with viewer(site.address, *SCENE) as one:
        await until(lambda: read() == len(FAST), what="it wakes for a viewer")
        site.bench.put(topics.CURSOR, cursor(1), "anna")
        await until(lambda: "cursor anna" in one.entities("people"))
        await asyncio.sleep(0.3)
        assert read() == len(FAST), "it rests while somebody looks on"
    await until(lambda: read() == 0, what="it rests again")
    presence = site.bus.announce(topics.USER_ALIVE, "bert")
    await until(lambda: read() == len(FAST), what="it learns the keys of who comes")
    presence.close()


async def test_rays_vanish_when_messages_stop(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service, "HEALTH_PERIOD_S", 60.0)  # not even a service about itself
    await site.start()
    async with viewer(site.address, "/scene/people") as one:
        site.bench.put(topics.CURSOR, cursor(1), "anna")
        await until(lambda: "ray anna" in one.ever("people"))
        await until(lambda: not one.entities("people"))


async def test_channels_of_a_person_end_when_they_leave(site: Site) -> None:
    await site.start()
    presence = site.bus.announce(topics.USER_ALIVE, "anna")
    async with viewer(site.address, "/scene/people", "/users/anna/cursor") as one:
        site.bench.put(topics.POSE, models.UserPose(stamp_ns=1, position_m=(1, 2, 0), yaw_rad=0), "anna")
        site.bench.put(topics.CURSOR, cursor(1), "anna")
        await until(lambda: "person anna" in one.entities("people") and bool(one.all("/users/anna/cursor")))
        presence.close()
        await until(lambda: not one.entities("people"))
        await until(lambda: {"/users/anna/cursor", "/users/anna/pose"} <= one.gone)
        site.bench.put(topics.CURSOR, cursor(2), "anna")  # late: it brings nobody back
        site.bus.announce(topics.USER_ALIVE, "anna")

        def is_seen() -> bool:
            site.bench.put(topics.CURSOR, cursor(3), "anna")
            return len(one.all("/users/anna/cursor")) > 1

        await until(is_seen, what="who comes back is seen again")


async def test_undrawable_map_is_a_warning(site: Site) -> None:
    seen: list[models.Health] = site.bench.collect(topics.HEALTH)
    await site.start()
    dot = models.Belt(id="dot", line_m=((1, 1, 1), (1, 1, 1)))
    site.bench.put(topics.MAP, MAP_MESSAGE.model_copy(update={"belts": (dot,)}))
    await until(lambda: any("'dot' cannot be drawn" in w for each in seen for w in each.warnings))
    site.bench.put(topics.MAP, MAP_MESSAGE)
    await until(lambda: not seen[-1].warnings)


async def test_viewers_cannot_do_anything(site: Site) -> None:
    await site.start()
    async with viewer(site.address, "/scene/room") as one:
        await until(lambda: bool(one.info))
        assert one.info["capabilities"] == []
        assert "supportedEncodings" not in one.info
        channel = {"id": 1, "topic": "/button", "encoding": "json", "schemaName": "", "schema": ""}
        await one.send({"op": "advertise", "channels": [channel]})
        await one.send({"op": "nonsense"})
        site.bench.put(topics.MAP, MAP_MESSAGE)
        await until(lambda: "belt b" in one.entities("room"), what="it goes on")


async def test_service_ends_at_once_and_frees_the_port() -> None:
    site = Site()
    site.bench.put(topics.MAP, MAP_MESSAGE)
    await site.start()
    async with viewer(site.address, *SCENE) as one:
        await until(lambda: "belt b" in one.entities("room"))
        began_s = time.monotonic()
        await site.bench.stop()
        await until(lambda: not is_listening(site.port), what="the port to be free")
        assert within(time.monotonic() - began_s, 4.0)
    await site.bus.close()


WEBSOCKET = "foxglove.websocket.v1"


@pytest_asyncio.fixture
async def address(site: Site, request: pytest.FixtureRequest) -> str:
    """Start the bridge, which has a map."""
    host: str = getattr(request, "param", "127.0.0.1")
    site.bench.put(topics.MAP, MAP_MESSAGE)
    await site.start(host=host)
    return f"[{host}]:{site.port}" if ":" in host else f"{host}:{site.port}"


@pytest.mark.parametrize(
    ("address", "offered", "chosen"),
    [
        ("::1", (SDK,), SDK),
        ("127.0.0.1", (WEBSOCKET, SDK), SDK),
        ("127.0.0.1", ("foxglove.sdk.v9", WEBSOCKET), WEBSOCKET),
    ],
    indirect=["address"],
)
async def test_viewer_sees_the_scene_by_the_name_that_it_knows(
    address: str, offered: tuple[str, ...], chosen: str
) -> None:
    async with viewer(f"ws://{address}", "/scene/room", subprotocols=offered) as one:
        assert one.subprotocol == chosen
        await until(lambda: "belt b" in one.entities("room"), what="the room")
        assert one.info["op"] == "serverInfo"


@pytest.mark.parametrize(
    ("offered", "shown"),
    [((), "no subprotocol"), (("rosbridge_v2", "foxglove.websocket.v2"), "rosbridge_v2, foxglove.websocket")],
)
async def test_viewer_with_other_subprotocols_is_refused_with_the_reason(
    address: str, caplog: pytest.LogCaptureFixture, offered: tuple[str, ...], shown: str
) -> None:
    names = [Subprotocol(name) for name in offered] or None
    for _ in range(3):  # one line in the log
        with pytest.raises(websockets.InvalidStatus, match="400"):
            await websockets.connect(f"ws://{address}", subprotocols=names)
    (line,) = [each.getMessage() for each in caplog.records if "was refused" in each.getMessage()]
    assert f"it offers {shown}" in line
    assert "choose *Foxglove WebSocket*" in line


async def test_encrypted_connection_is_refused_at_once(
    address: str, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    with pytest.raises((ssl.SSLError, OSError, EOFError, websockets.InvalidMessage)):
        await websockets.connect(f"wss://{address}", ssl=ssl.create_default_context())
    await until(lambda: "open ws:// in it, not wss://" in caplog.text)


async def test_message_of_many_packets_arrives_whole(address: str) -> None:
    """As the server reads it: what it does not know is answered by a status."""
    async with viewer(f"ws://{address}", "/scene/room", subprotocols=(WEBSOCKET,)) as one:
        await one.send({"op": "subscribe", "subscriptions": [], "padding": "x" * 500_000})
        await until(lambda: "belt b" in one.entities("room"), what="the room")


def test_subprotocols_are_exchanged_in_any_spelling_of_the_header() -> None:
    head = (
        b"GET / HTTP/1.1\r\nHost: x\r\nSEC-WebSocket-protocol:foxglove.websocket.v1 ,other\r\n"
        b"Sec-WebSocket-Protocol: foxglove.sdk.v1\r\nX: foxglove.websocket.v1\r\n\r\n"
    )
    assert names_of(head) == [WEBSOCKET, "other", SDK]
    renamed = rename(head, WEBSOCKET, SDK)
    assert names_of(renamed) == [SDK, "other", SDK]
    assert renamed.startswith(b"GET / HTTP/1.1\r\nHost: x\r\n")
    assert renamed.endswith(b"\r\nX: foxglove.websocket.v1\r\n\r\n")
