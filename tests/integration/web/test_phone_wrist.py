"""A phone is paired by an operator's page and moves an arm: real sockets, real services, a bus in memory."""

import asyncio
import contextlib
import json
import math
import time
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from typing import Any

import httpx
import pytest
import websockets
from websockets.asyncio.client import ClientConnection

import pointit.schemas as models
from pointit.bridges.web.server.paced_websocket import PacedWebSocket
from pointit.bridges.web.wrists import phone as phone_module
from pointit.bridges.web.wrists import wrist_control
from pointit.geometry import rotation, vector
from pointit.geometry.rotation import Quaternion
from pointit.runtime.clock import WallClock
from pointit.schemas.topics import (
    ANNOUNCED,
    BUTTON,
    FEEDBACK,
    HEALTH,
    IMU,
    MAP,
    POSE,
    PROFILE,
    SERVICE_ALIVE,
    USER_ALIVE,
    WRIST,
)
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.imu_bridge.service import ImuBridge
from tests.integration.web.pages import Page, serving
from tests.support.bench import Bench, memory_bench, until
from tests.unit.web.phone_bench import trust

ANNA = "anna"
BELT = models.Belt(id="b", line_m=((4.0, 1.0, 1.0), (4.0, 3.0, 1.0)))
YAW_RAD = 0.4
"""{H} in {W}."""


@pytest.fixture(autouse=True)
def _phones_may_be_held_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a phone keep the arm for longer after its last word, so that the page is told of it in time."""
    monkeypatch.setattr(wrist_control, "SILENT_S", 3.0)


class Room:
    def __init__(self, bench: Bench, page: Page) -> None:
        self.bench = bench
        self.page = page
        self.wrists = bench.collect(WRIST, ANNA)
        self.imu = bench.collect(IMU, ANNA)
        self.presses = bench.collect(BUTTON, ANNA)

    async def ask(self, deed: str, **query: Any) -> dict[str, Any]:
        return await self.page.ask(deed=deed, name="" if deed == "open_lan" else ANNA, query=query)

    @property
    def person(self) -> dict[str, Any]:
        return self.page.person(ANNA)


@asynccontextmanager
async def room() -> AsyncGenerator[Room]:
    clock = WallClock()
    async with memory_bench(clock) as bench:
        bench.bus.announce(USER_ALIVE, ANNA)
        bench.start(ImuBridge, ImuBridgeConfig(source="page"), ANNA)
        bench.put(MAP, models.Environment(stamp_ns=clock.now_ns(), name="hall", belts=(BELT,)))
        bench.put(PROFILE, models.UserProfile(stamp_ns=clock.now_ns()), ANNA)
        pose = models.UserPose(stamp_ns=clock.now_ns(), position_m=(0.0, 2.0, 0.0), yaw_rad=YAW_RAD)
        bench.put(POSE, pose, ANNA)
        lan = {"lan_port": 0, "lan_address": "127.0.0.1"}
        async with serving(bench, **lan) as server, server.page() as page:
            site = Room(bench, page)
            await until(lambda: bool(site.person), what="the person is shown")
            yield site


@asynccontextmanager
async def phone(site: Room) -> AsyncGenerator[ClientConnection]:
    assert (await site.ask("open_lan"))["error"] == ""
    offer = (await site.ask("pair"))["reply"]
    url = httpx.URL(offer["url"])
    origin = f"https://{url.host}:{url.port}"
    async with httpx.AsyncClient(verify=trust(site.bench.bus.site)) as browser:
        assert (await browser.get(offer["url"])).status_code == 303
        cookies = "; ".join(f"{name}={value}" for name, value in browser.cookies.items())
    async with websockets.connect(
        f"wss://{url.host}:{url.port}/ws/wrist",
        ssl=trust(site.bench.bus.site),
        origin=websockets.Origin(origin),
        additional_headers={"Cookie": cookies},
        proxy=None,
    ) as socket:
        yield socket


def turn(q: Quaternion, t_ms: float = 1.0) -> str:
    return json.dumps({"kind": "turn", "q": q, "t_ms": t_ms, "session": 5, "battery": 0.75})


def held(azimuth_rad: float, elevation_rad: float = 0.0) -> Quaternion:
    """Return the orientation of a phone whose top points there, in a frame of its own."""
    arm = rotation.from_azimuth_elevation(azimuth_rad, elevation_rad)
    return rotation.multiply(arm, rotation.from_yaw(-math.pi / 2))


def azimuth(sample: models.ImuSample) -> float:
    return vector.azimuth(rotation.rotate(sample.orientation_xyzw, (1.0, 0.0, 0.0)))


async def heard(socket: ClientConnection, kind: str) -> dict[str, Any]:
    async with asyncio.timeout(60.0):
        while True:
            part: dict[str, Any] = json.loads(await socket.recv())
            if part["kind"] == kind:
                return part


async def test_paired_phone_moves_the_arm() -> None:
    async with room() as site, phone(site) as socket:
        hello = await heard(socket, "hello")
        assert (hello["role"], hello["user"]) == ("wrist", ANNA)
        await socket.send(turn(held(0.3)))
        await until(lambda: bool(site.imu))
        assert site.wrists[0].device == "phone"
        await until(lambda: site.person["moved_by"] == "phone" and not site.person["is_mine"])
        assert site.person["phone"] == "moves the arm"
        assert site.person["battery"] == 0.75

        await socket.send(json.dumps({"kind": "ask", "id": 1, "deed": "press"}))
        await until(lambda: bool(site.presses))
        assert (await heard(socket, "answer"))["error"] == ""

        feedback = models.Feedback(stamp_ns=1, cue="selected", chime="tick", haptic_ms=(30,))
        site.bench.put(FEEDBACK, feedback, ANNA)
        cue = await heard(socket, "cue")
        while not cue["chime"]:
            cue = await heard(socket, "cue")
        assert (cue["chime"], cue["haptic_ms"]) == ("tick", [30])


async def test_phone_has_names_until_their_selector_ends() -> None:
    async def names_are(spoken: bool) -> None:
        while (await heard(socket, "cue"))["has_names"] != spoken:
            pass

    async with room() as site, phone(site) as socket:
        selector = site.bench.bus.announce(SERVICE_ALIVE, "selector")
        site.bench.put(ANNOUNCED, models.Announced(stamp_ns=time.time_ns()), ANNA)
        await names_are(True)
        selector.close()
        await names_are(False)


async def test_centred_phone_points_at_the_middle_of_the_room() -> None:
    async with room() as site, phone(site) as socket:
        await socket.send(turn(held(2.2)))
        await until(lambda: bool(site.imu))
        await socket.send(json.dumps({"kind": "ask", "id": 1, "deed": "centre"}))
        while "ahead" not in (await heard(socket, "cue"))["text"]:
            pass
        assert (await heard(socket, "answer"))["error"] == ""
        await socket.send(turn(held(2.2), 2.0))
        to_belt_rad = math.atan2(2.0 - 2.0, 4.0) - YAW_RAD
        await until(lambda: azimuth(site.imu[-1]) == pytest.approx(to_belt_rad, abs=1e-6))
        await socket.send(turn(held(2.3), 3.0))
        await until(lambda: azimuth(site.imu[-1]) == pytest.approx(to_belt_rad + 0.1, abs=1e-6))


async def lost_arm(socket: ClientConnection) -> str:
    """Wait until the phone has lost the arm, and return the text that says so."""
    cue = await heard(socket, "cue")
    while not cue["has_lost_arm"]:
        cue = await heard(socket, "cue")
    return str(cue["text"])


async def test_phone_is_notified_when_a_mouse_takes_and_releases_control() -> None:
    async with room() as site, phone(site) as socket:
        await socket.send(turn(held(0.0)))
        await until(lambda: site.person["moved_by"] == "phone")
        assert (await site.ask("take"))["error"] == ""
        assert "another device" in await lost_arm(socket)
        await until(lambda: site.person["moved_by"] == "mouse")

        await socket.send(turn(held(0.0), 2.0))
        await socket.send(json.dumps({"kind": "ask", "id": 1, "deed": "take"}))
        assert (await heard(socket, "answer"))["error"] == ""
        await until(lambda: site.person["moved_by"] == "phone")
        assert (await site.ask("give"))["error"] == ""

        text = await lost_arm(socket)
        assert "your own again" in text
        assert "another device" not in text
        await until(lambda: site.person["moved_by"] == "own")


async def test_flood_of_a_phone_is_not_parsed_beyond_its_rate(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(phone_module, "BURST", 10.0)
    monkeypatch.setattr(phone_module, "DROPPED_PAUSE_S", 3600.0)
    parsed = 0
    parse = PacedWebSocket.send_receive_event_to_app

    def count_and_parse(protocol: PacedWebSocket) -> None:
        nonlocal parsed
        parsed += 1
        parse(protocol)

    async def send_many(socket: ClientConnection) -> None:
        with contextlib.suppress(websockets.ConnectionClosed):
            for number in range(5000):
                await socket.send(turn(held(0.3), float(number)))

    async with room() as site, phone(site) as socket:
        monkeypatch.setattr(PacedWebSocket, "send_receive_event_to_app", count_and_parse)
        reports = site.bench.collect(HEALTH, "web")
        await send_many(socket)  # the system takes what the server does not read
        await until(lambda: bool(reports) and "messages a second" in " ".join(reports[-1].warnings))
        for _ in range(20):
            assert (await site.ask("centre"))["id"], "the page is served meanwhile"
        assert parsed < 500
        socket.transport.abort()  # the server reads no closing handshake


async def test_phone_is_disconnected_when_unpaired() -> None:
    async with room() as site, phone(site) as socket:
        await socket.send(turn(held(0.0)))
        await until(lambda: site.person["moved_by"] == "phone")
        assert (await site.ask("pair", off=True))["error"] == ""
        async with asyncio.timeout(60.0):
            await socket.wait_closed()
        assert socket.close_code == 4403, "as the client knows it"
        await until(lambda: site.person["phone"] == "" and site.person["moved_by"] == "own")
        assert "no phone is paired" in (await site.ask("pair", off=True))["error"]
