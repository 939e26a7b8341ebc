"""The site's side of a scan: who may, what is refused, what becomes of views; the solver is not needed."""

import asyncio
import time
from collections.abc import AsyncIterator, Sequence
from pathlib import Path
from typing import Any

import httpx
import pytest
import pytest_asyncio
from starlette.requests import HTTPConnection, Request
from starlette.responses import Response
from starlette.websockets import WebSocket

from pointit.bridges.web.scan.scan_server import ScanServer
from pointit.bridges.web.scan.session import ScanSession, ScanSolution
from pointit.bridges.web.scan.simulated_room import SimulatedRoom
from pointit.bridges.web.scan.wire import ScanStrip
from pointit.bridges.web.server.access import Access
from pointit.bridges.web.server.app import application
from pointit.bridges.web.server.bundle import Bundle
from pointit.bridges.web.wire import Role
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.scan.views import Survey
from pointit.schemas import LitPixels
from tests.support.bench import until

HERE = "http://127.0.0.1:8090"
TOKEN = "of-the-qr-code"  # noqa: S105 - of tests only
LINE = ((0.0, 0.0, 1.0), (1.0, 0.0, 1.0))
VIEW: dict[str, Any] = {
    "kind": "view",
    "width": 640,
    "height": 360,
    "seen": [[0, 10.5, 20.5], [1, 30.0, 40.0]],
}


NO_CORNERS: dict[str, Any] = {"corners": []}


class Bench:
    def __init__(self, folder: Path) -> None:
        (folder / "scan.html").write_text("<!doctype html><title>scan</title>")
        self.shown: list[tuple[Sequence[LitPixels], float]] = []
        self.solved: list[Survey] = []
        self.fault: Exception | None = None
        self.may_solve = asyncio.Event()
        self.may_solve.set()
        self.file = folder / "room.yaml"
        self.session = ScanSession(show=self._show, solve=self._solve, file=self.file)
        self.doors = Access("operator-token", "viewer-token")
        self.is_wrist = False

        def wrist(_connection: HTTPConnection) -> bool:
            return self.is_wrist

        self.bundle = Bundle(folder)
        self.door = ScanServer(
            self.session, self.doors, self.bundle, is_wrist=wrist, token=TOKEN, room=SimulatedRoom()
        )
        self.app = application(self.doors, self.bundle, self.no_page, self.no_file, self.door.routes)

    def client(self) -> httpx.AsyncClient:
        transport = httpx.ASGITransport(self.app)
        return httpx.AsyncClient(transport=transport, base_url=HERE, headers={"Origin": HERE})

    async def _show(self, lit: Sequence[LitPixels], for_s: float) -> None:
        if self.fault is not None:
            raise self.fault
        self.shown.append((lit, for_s))

    async def _solve(self, survey: Survey) -> ScanSolution:
        await self.may_solve.wait()
        self.solved.append(survey)
        if self.fault is not None:
            raise self.fault
        strips = (ScanStrip(name="shelf", pixels=20, line_m=LINE, sigma_m=0.004),)
        return ScanSolution(
            thing=lambda said: ScanStrip(name=said.name, pixels=0, line_m=LINE, seen=2),
            strips=strips,
            is_complete=True,
            advice="enough",
            map_text=lambda origin, things: f"# {origin}\n" * (1 + len(things)),
        )

    async def no_page(self, _socket: WebSocket, _role: Role) -> None:
        raise AssertionError

    async def no_file(self, _request: Request) -> Response:
        raise AssertionError


@pytest_asyncio.fixture
async def bench(tmp_path: Path) -> AsyncIterator[Bench]:
    bench = Bench(tmp_path)
    bench.session.set_strips({"shelf": 20, "desk": 30})
    yield bench
    await bench.session.close()


@pytest_asyncio.fixture
async def phone(bench: Bench) -> AsyncIterator[httpx.AsyncClient]:
    async with bench.client() as client:
        assert (await client.get(f"/scan?token={TOKEN}")).status_code == 303
        yield client


async def said(client: httpx.AsyncClient, status: int = 200, **what: Any) -> Any:
    response = await client.post("/scan", json=what)
    assert response.status_code == status, response.text
    return response.json() if status == 200 else response.text


async def solved(bench: Bench, client: httpx.AsyncClient, views: int = 0) -> Any:
    """Send `views`, and return the state once all is solved."""
    for _ in range(views):
        await said(client, **VIEW)
    await until(lambda: not bench.session.state().is_solving)
    return await said(client, kind="look")


async def test_scan_needs_the_code_or_the_operators_cookie(bench: Bench) -> None:
    async with bench.client() as client:
        for path in ("/scan", "/scan?token=another", "/scan/map.yaml", "/scan/room", "/scan/lights"):
            assert (await client.get(path)).status_code == 403, path
        assert "Map this room" in await said(client, 403, kind="look")
        foreign = await client.post("/scan", json={"kind": "look"}, headers={"Origin": "http://x"})
        assert foreign.status_code == 403


async def test_scan_code_redirects_without_its_token(bench: Bench) -> None:
    async with bench.client() as client:
        response = await client.get(f"/scan?token={TOKEN}")
        assert response.headers["location"] == "/scan"
        assert all(word in response.headers["set-cookie"] for word in ("HttpOnly", "SameSite=lax"))
        assert (await client.get("/scan")).status_code == 200
        assert bench.door.pair() != TOKEN
        assert (await client.get("/scan")).status_code == 403, "another phone has it now"


OPERATOR = {"Authorization": "Bearer operator-token"}


@pytest.mark.parametrize("end", ["left", "later"])
async def test_wrist_may_scan_until_the_page_closes_or_30_minutes(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, end: str
) -> None:
    door = ScanServer(bench.session, bench.doors, bench.bundle, is_wrist=lambda _: bench.is_wrist)
    bench.is_wrist = True
    bench.app = application(bench.doors, bench.bundle, bench.no_page, bench.no_file, door.routes)
    async with bench.client() as wrist, bench.client() as operator:
        operator.headers.update(OPERATOR)
        assert (await operator.get("/scan")).status_code == 200
        assert (await wrist.get("/scan")).status_code == 403, "a link that the operator followed opens none"

        await said(operator, kind="look")
        await said(wrist, kind="look")
        if end == "left":
            await said(operator, 204, kind="light", colors=None)
        else:
            now = time.monotonic
            monkeypatch.setattr(time, "monotonic", lambda: now() + 1801.0)
        await said(wrist, 403, kind="begin")


@pytest.mark.parametrize("kind", ["wrist", "camera"])
async def test_scan_in_use_goes_on_but_wrists_begin_no_other(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    door = ScanServer(bench.session, bench.doors, bench.bundle, is_wrist=lambda _: kind == "wrist")
    bench.app = application(bench.doors, bench.bundle, bench.no_page, bench.no_file, door.routes)
    now_s = 1000.0
    monkeypatch.setattr(time, "monotonic", lambda: now_s)
    async with bench.client() as phone, bench.client() as operator:
        if kind == "wrist":
            await operator.post("/scan", json={"kind": "look"}, headers=OPERATOR)
        else:
            await phone.get(f"/scan?token={door.pair()}")
        await said(phone, kind="begin")
        for _ in range(4):
            now_s += 1000.0
            await said(phone, **VIEW)

        assert (await said(phone, kind="look"))["views"] == 4
        text = await said(phone, 403 if kind == "wrist" else 200, kind="begin")
        assert kind == "camera" or "Map this room" in text

        now_s += 1801.0
        await said(phone, 403, **VIEW)


async def test_paired_phone_may_begin_no_scan_after_30_minutes(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with bench.client() as client:
        await client.get(f"/scan?token={bench.door.pair()}")
        await said(client, kind="look")
        now = time.monotonic
        monkeypatch.setattr(time, "monotonic", lambda: now() + 1801.0)
        await said(client, 403, kind="begin")


async def test_light_message_lights_the_marked_pixels_for_a_while(
    bench: Bench, phone: httpx.AsyncClient
) -> None:
    state = await said(phone, kind="begin")
    assert state["lights"][:2] == [["shelf", 0], ["shelf", 2]]
    assert state["lights"][-1] == ["desk", 29]
    assert len(state["lights"]) == 20, "ten of each strip"

    reds = [0] * len(state["lights"])
    await said(phone, 204, kind="light", colors=[1, 2, *reds[2:]], brightness=0.5)
    lit, for_s = bench.shown[-1]
    assert [(each.id, each.color) for each in lit] == [
        *(("shelf", color) for color in ((0, 128, 0), (0, 0, 128), (128, 0, 0))),
        ("desk", (128, 0, 0)),
    ]
    assert (lit[0].pixels, lit[1].pixels) == ((0,), (2,))
    assert for_s == 6.0

    await said(phone, 204, kind="light", colors=[])
    assert bench.shown[-1] == ((), 6.0)
    await said(phone, 204, kind="light", colors=None)
    assert bench.shown[-1] == ((), 0.0)
    assert "load the page again" in await said(phone, 409, kind="light", colors=[0])

    bench.fault = RefusedError("led-driver does not answer")
    assert await said(phone, 409, kind="light", colors=reds) == "led-driver does not answer"


async def test_views_are_solved_with_known_lengths_and_densities(
    bench: Bench, phone: httpx.AsyncClient
) -> None:
    begun: dict[str, Any] = {"leds_per_m": {"shelf": 50.0}, "known_strip": "desk", "known_m": 0.9}
    assert "first view" in (await said(phone, kind="begin", **begun))["advice"]
    await said(phone, **VIEW, gravity=[0.0, 1.0, 0.0])
    assert "second view" in (await solved(bench, phone))["advice"]
    assert bench.solved == []

    state = await solved(bench, phone, 1)
    (survey,) = bench.solved
    assert [(each.name, each.count, each.pitch_m) for each in survey.strips] == [
        ("shelf", 20, 0.02),
        ("desk", 30, None),
    ]
    assert survey.known_length is not None
    assert (survey.known_length.end.pixel, survey.known_length.metres) == (29, 0.9)
    assert survey.views[0].gravity == (0.0, 1.0, 0.0)
    assert [(seen.name, seen.pixel, seen.u) for seen in survey.views[1].sightings] == [
        ("shelf", 0, 10.5),
        ("shelf", 2, 30.0),
    ]

    known, unknown = state["strips"]
    assert (known["seen"], known["sigma_m"], unknown["line_m"]) == (2, 0.004, [])
    assert (state["is_complete"], state["advice"]) == (True, "enough")


async def test_views_received_while_solving_are_solved_together(
    bench: Bench, phone: httpx.AsyncClient
) -> None:
    await said(phone, kind="begin")
    bench.may_solve.clear()
    for _ in range(4):
        await said(phone, **VIEW)
    assert (await said(phone, kind="look"))["is_solving"]
    bench.may_solve.set()
    await solved(bench, phone)
    assert [len(survey.views) for survey in bench.solved][-1] == 4
    await said(phone, kind="undo")
    assert (await solved(bench, phone))["views"] == 3


async def test_solution_is_dropped_when_one_view_remains(bench: Bench, phone: httpx.AsyncClient) -> None:
    await said(phone, kind="begin")
    assert (await solved(bench, phone, 2))["is_complete"]
    await said(phone, kind="undo")
    state = await solved(bench, phone)
    assert (state["views"], state["is_complete"], state["strips"][0]["line_m"]) == (1, False, [])


async def test_lamps_blink_unless_they_are_left_out(bench: Bench, phone: httpx.AsyncClient) -> None:
    bench.session.set_strips({"shelf": 20, "door": 1})
    assert (await said(phone, kind="begin"))["lights"][-1] == ["door", 0]
    await solved(bench, phone, 2)
    assert [lamp.name for lamp in bench.solved[0].lamps] == ["door"]
    assert [strip.name for strip in bench.solved[0].strips] == ["shelf"]
    state = await said(phone, kind="begin", has_lamps=False)
    assert {name for name, _ in state["lights"]} == {strip["name"] for strip in state["strips"]} == {"shelf"}
    bench.session.set_strips({"door": 1})
    assert "has no strips" in await said(phone, 409, kind="begin")


async def test_tapped_things_are_stored_and_removed(bench: Bench, phone: httpx.AsyncClient) -> None:
    await said(phone, kind="begin")
    thing: dict[str, Any] = {"kind": "thing", "name": "crate", "corners": [[[0, 1, 1], [2, 1, 1]]] * 4}
    assert "nothing is known yet" in await said(phone, 409, **thing)
    await solved(bench, phone, 3)
    assert (await said(phone, **thing))["strips"][-1]["name"] == "crate"
    assert (await phone.get("/scan/map.yaml?origin=desk")).text == "# desk\n# desk\n"
    assert "leading" in await said(phone, 409, **(thing | {"name": "-"}))
    assert "crate" not in str((await said(phone, **(thing | NO_CORNERS)))["strips"])
    await said(phone, **thing)
    await said(phone, kind="undo")
    assert "crate" not in str((await solved(bench, phone))["strips"]), "one of its views is gone"


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [(ConfigError("no two views agree"), "no two views agree"), (ValueError("x"), "a fault of PointIt")],
)
async def test_solution_stays_when_further_views_determine_nothing(
    bench: Bench, phone: httpx.AsyncClient, fault: Exception, sentence: str
) -> None:
    await said(phone, kind="begin")
    await solved(bench, phone, 2)
    bench.fault = fault
    state = await solved(bench, phone, 1)
    assert sentence in state["problem"]
    assert state["strips"][0]["line_m"]


async def test_scanned_map_is_a_new_file_or_a_download(bench: Bench, phone: httpx.AsyncClient) -> None:
    await said(phone, kind="begin")
    assert "nothing is known yet" in await said(phone, 409, kind="save", name="room")
    assert (await phone.get("/scan/map.yaml")).status_code == 409
    await solved(bench, phone, 2)
    state = await said(phone, kind="save", name="room", origin="shelf")
    assert state["saved"] == f"…/{bench.file.parent.name}/room.yaml"
    assert bench.file.read_text() == "# shelf\n"
    twice = await said(phone, 409, kind="save", name="room.yaml", origin="desk")
    assert "exists already" in twice
    assert str(bench.file.parent) not in twice
    assert bench.file.read_text() == "# shelf\n"
    for name in ("../other", "a/b.yaml", "", ".hidden", "x" * 60, "con\n"):
        assert "no name for a map" in await said(phone, 409, kind="save", name=name)
    assert (await phone.get("/scan/map.yaml?origin=desk")).text == "# desk\n"


async def test_message_is_refused_when_malformed_or_of_another_scan(
    bench: Bench, phone: httpx.AsyncClient
) -> None:
    await said(phone, kind="begin")
    for wrong in (
        {"kind": "view"},
        {"kind": "else"},
        {"kind": "begin", "known_m": -1.0},
        VIEW | {"width": 1},
    ):
        assert "malformed" in await said(phone, 400, **wrong)
    assert "there is no strip 'door'" in await said(phone, 409, kind="begin", leds_per_m={"door": 60})
    assert "load the page again" in await said(phone, 409, **VIEW | {"seen": [[20, 1.0, 1.0]]})
    assert "no unit vector" in await said(phone, 409, **VIEW, gravity=[0.0, 2.0, 0.0])
    bench.session.set_strips({})
    assert "pointit map scan -o FILE --strip" in await said(phone, 409, kind="begin")


async def test_scan_restarts_when_the_map_changes(bench: Bench, phone: httpx.AsyncClient) -> None:
    await said(phone, kind="begin")
    await said(phone, **VIEW)
    bench.session.set_strips({"shelf": 20, "desk": 30})
    assert (await said(phone, kind="look"))["views"] == 1
    bench.session.set_strips({"shelf": 21, "desk": 30})
    assert (await said(phone, kind="look"))["views"] == 0


async def test_simulated_camera_sees_the_colours_of_the_led_driver(
    bench: Bench, phone: httpx.AsyncClient
) -> None:
    room = (await phone.get("/scan/room")).json()
    assert [len(each["places_m"]) for each in room["strips"]] == [1, 1, 90, 90, 102, 68, 63]
    bench.door.lights({"shelf": b"\1\2\3"})
    first = (await phone.get("/scan/lights")).json()
    assert first == {"seq": 1, "strips": {"shelf": "010203"}}
    waiting = asyncio.create_task(phone.get("/scan/lights?after=1"))
    await asyncio.sleep(0)
    bench.door.lights({"corner": b"\4\5\6"})
    assert (await waiting).json() == {"seq": 2, "strips": {"shelf": "010203", "corner": "040506"}}
