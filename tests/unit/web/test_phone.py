"""Phones over TLS: pairing, the socket, the posts, and everything a phone may not."""

import asyncio
import json
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
import pytest_asyncio
import websockets
from httpx import AsyncClient
from websockets.asyncio.client import ClientConnection

from pointit.bridges.web.wrists import phone as phone_connection
from pointit.bridges.web.wrists.wrist_control import STILL_S
from pointit.schemas import Feedback, Interaction, Localization
from tests.support.bench import until
from tests.unit.web.phone_bench import PhoneBench, phone_bench

pytestmark = pytest.mark.wall_time

TURN = {"kind": "turn", "q": [0.0, 0.0, 0.0, 1.0], "t_ms": 12.5, "session": 3, "battery": 0.5}


@pytest_asyncio.fixture
async def bench(tmp_path: Path) -> AsyncIterator[PhoneBench]:
    async with phone_bench(tmp_path) as bench:
        yield bench


@pytest_asyncio.fixture
async def phone(bench: PhoneBench) -> AsyncIterator[AsyncClient]:
    async with bench.client() as client:
        await bench.pair(client)
        yield client


async def heard(socket: ClientConnection) -> dict[str, Any]:
    async with asyncio.timeout(60.0):
        found: dict[str, Any] = json.loads(await socket.recv())
        return found


async def greeted(socket: ClientConnection) -> None:
    hello = await heard(socket)
    state = await heard(socket)
    assert (hello["kind"], state["kind"]) == ("hello", "cue")


async def posted(phone: AsyncClient, *items: Any) -> list[dict[str, Any]]:
    response = await phone.post("/wrist", json=list(items))
    assert response.status_code == 200, response.text
    found: list[dict[str, Any]] = response.json()
    return found


async def test_phones_get_the_lamps_of_each_map(bench: PhoneBench, phone: AsyncClient) -> None:
    bench.phones.set_lamps(("led_0",))
    async with bench.connect(phone) as socket:
        assert (await heard(socket))["lamps"] == ["led_0"]
        assert (await heard(socket))["kind"] == "cue"
        bench.phones.set_lamps(("led_0",))
        bench.phones.set_lamps(("led_0", "door"))
        hello = await heard(socket)
        assert (hello["kind"], hello["user"], hello["lamps"]) == ("hello", "anna", ["led_0", "door"])


async def test_link_pairs_and_redirects_without_its_token(bench: PhoneBench) -> None:
    async with bench.client() as client:
        assert (await client.get("/phone")).status_code == 403
        token, _ = bench.pairing.pair("anna", 1e12)
        response = await client.get(f"/phone?token={token}")
        assert (response.status_code, response.headers["location"]) == (303, "/phone")
        cookie = response.headers["set-cookie"]
        assert all(word in cookie for word in ("HttpOnly", "Secure", "SameSite=lax"))
        assert token not in cookie
        page = await client.get("/phone")
        assert (page.status_code, page.headers["content-type"]) == (200, "text/html; charset=utf-8")
        assert "content-security-policy" in page.headers
        assert (await client.get("/phone?token=wrong")).status_code == 403


async def test_phone_cookie_opens_only_its_wrist(bench: PhoneBench, phone: AsyncClient) -> None:
    assert (await phone.get("/")).status_code == 403
    assert (await phone.get("/recording.mcap")).status_code == 403
    with pytest.raises(websockets.InvalidStatus) as refused:
        await bench.connect(phone, path="/ws")
    assert refused.value.response.status_code == 403


async def test_socket_needs_the_cookie_and_the_own_origin(bench: PhoneBench, phone: AsyncClient) -> None:
    with pytest.raises(websockets.InvalidStatus) as refused:
        await bench.connect(phone, origin="https://evil.example")
    assert refused.value.response.status_code == 403
    async with bench.client() as stranger:
        with pytest.raises(websockets.InvalidStatus):
            await bench.connect(stranger)
        assert (await stranger.post("/wrist", json=[TURN])).status_code == 403
    foreign = await phone.post("/wrist", json=[TURN], headers={"Origin": "https://evil.example"})
    assert foreign.status_code == 403
    assert bench.sent == []


async def test_requests_of_a_phone_are_for_its_own_person(bench: PhoneBench, phone: AsyncClient) -> None:
    async with bench.connect(phone) as socket:
        await greeted(socket)
        await socket.send(json.dumps({"kind": "ask", "id": 7, "deed": "press", "name": "ben"}))
        assert await heard(socket) == {
            "kind": "answer",
            "id": 7,
            "reply": {"message": "done"},
            "error": "",
            "is_stale": False,
        }
    bench.error = "the localizer is busy"

    localize = "localizer/{user}/start"
    (answer,) = await posted(phone, {"kind": "ask", "id": 8, "key": localize, "name": "ben"})
    assert (answer["id"], answer["error"]) == (8, "the localizer is busy")

    asked = [(ask.name, ask.deed or ask.key) for _, ask in bench.asked]
    assert asked == [("anna", "press"), ("anna", localize)]


async def test_phone_is_notified_when_its_direction_is_set(bench: PhoneBench, phone: AsyncClient) -> None:
    await posted(phone)
    bench.phones.centred("anna")
    (cue,) = await posted(phone, TURN)
    assert "ahead" in cue["text"]


async def test_posts_do_the_same_as_the_socket(bench: PhoneBench, phone: AsyncClient) -> None:
    bench.phones.interaction("anna", Interaction(stamp_ns=0, state="idle", next_step="press to begin"))
    hello, state = await posted(phone)
    assert (hello["role"], hello["user"], hello["site"]) == ("wrist", "anna", "lab")
    assert (state["kind"], state["state"], state["next_step"]) == ("cue", "idle", "press to begin")
    assert "press" in hello["deeds"]
    assert "localizer/{user}/start" in hello["requests"]

    feedback = Feedback(stamp_ns=0, cue="started", text="go", chime="up", haptic_ms=(30,))
    bench.phones.feedback("ben", feedback)
    bench.phones.feedback("anna", feedback)
    bench.phones.localization("anna", Localization(stamp_ns=0, phase="sampling", target_id="led_0"))

    turns = [{**TURN, "t_ms": 10.0 + k} for k in range(3)]
    cue, target, answer = await posted(phone, *turns, {"kind": "ask", "id": 4, "deed": "press"})
    assert (cue["text"], cue["chime"], cue["haptic_ms"]) == ("go", "up", [30])
    assert target["text"] == "point at led_0"
    assert (answer["id"], answer["error"]) == (4, "")
    assert [sample.device_time_ns for _, sample in bench.sent] == [12_000_000]
    assert await posted(phone, TURN) == []


AIM_OF_BEN = '{"kind": "aim", "user": "ben", "at_m": [0, 0, 0]}'


async def test_malformed_items_are_counted_and_reported(bench: PhoneBench, phone: AsyncClient) -> None:
    items: tuple[str | bytes, ...] = ("no json", '{"kind": "turn"}', AIM_OF_BEN, "[" * 5000, b"\xff\x00")
    async with bench.connect(phone) as socket:
        await greeted(socket)
        for count, item in enumerate(items, 1):
            bench.health.warnings.clear()
            await socket.send(item)
            await until(lambda: "phone anna" in bench.health.warnings)
            assert "load its page again" in bench.health.warnings["phone anna"]
            await socket.send(json.dumps(TURN))  # it goes on
            await until(lambda count=count: len(bench.sent) == count)


async def test_posts_that_are_no_lists_are_refused(bench: PhoneBench, phone: AsyncClient) -> None:
    for body in ("", "{}", "[1]", "nothing", json.dumps([TURN] * 65), "[" * 9000):
        response = await phone.post("/wrist", content=body)
        assert response.status_code == 400, body
        assert "phone anna" in bench.health.warnings
        assert bench.sent == []
        await posted(phone)
        assert bench.health.warnings == {}


async def test_arm_moves_with_any_clock_of_a_phone(bench: PhoneBench, phone: AsyncClient) -> None:
    for t_ms in (9e12, 9.3e12, 1e15, 1e300):
        await posted(phone, TURN)
        await posted(phone, {**TURN, "t_ms": t_ms})
        bench.clock.advance(STILL_S)
        assert len(bench.wrists.step(bench.clock.now_ns())) == 1, t_ms


async def test_health_shortens_malformed_words(bench: PhoneBench, phone: AsyncClient) -> None:
    for item in ({**TURN, "x" * 50_000: 1}, {"kind": "x" * 50_000}):
        bench.health.warnings.clear()
        await posted(phone, item)
        assert len(bench.health.warnings["phone anna"]) < 500


async def test_newer_socket_of_a_phone_replaces_the_older(bench: PhoneBench, phone: AsyncClient) -> None:
    async with bench.connect(phone) as first:
        await greeted(first)
        async with bench.connect(phone) as second:
            await greeted(second)
            with pytest.raises(websockets.ConnectionClosed) as closed:
                await heard(first)
            assert closed.value.rcvd is not None
            assert closed.value.rcvd.code == 4409
            await second.send(json.dumps(TURN))
            await until(lambda: len(bench.sent) == 1)
            assert bench.wrists.holder("anna")[1] == "phone"
    await until(lambda: bench.wrists.holder("anna")[1] == "own", what="a socket that is gone lets go")


async def test_unpaired_phone_loses_the_arm_and_is_refused(bench: PhoneBench, phone: AsyncClient) -> None:
    await posted(phone, TURN)
    await bench.phones.cut(bench.pairing.unpair("anna"))
    assert bench.wrists.holder("anna") == ("", "own")
    assert (await phone.post("/wrist", json=[TURN])).status_code == 403
    assert (await phone.get("/phone")).status_code == 403


async def test_flood_of_turns_is_dropped(bench: PhoneBench, phone: AsyncClient) -> None:
    async with bench.connect(phone) as socket:
        await greeted(socket)
        for _ in range(1500):
            await socket.send(json.dumps(TURN))
        await socket.send(json.dumps({"kind": "ask", "id": 1, "deed": "press"}))
        line = next(iter(bench.phones._connections.values()))
        await until(lambda: line.dropped > 0)
        assert "were dropped" in bench.health.warnings["phone anna"]
        assert len(bench.sent) < 1500


async def test_requests_are_refused_when_too_many_are_open(phone: AsyncClient) -> None:
    answers = await posted(phone, *({"kind": "ask", "id": k, "deed": "press"} for k in range(20)))
    refused = [answer["id"] for answer in answers if "too much" in answer["error"]]
    assert refused == list(range(8, 20))
    assert len(answers) == 20


async def test_queue_of_a_phone_that_reads_nothing_is_bounded(bench: PhoneBench, phone: AsyncClient) -> None:
    for k in range(1000):
        bench.phones.feedback("anna", Feedback(stamp_ns=0, cue="selected", text=f"{k}"))
    assert await posted(phone, TURN) == []  # it had not begun when they were said
    for k in range(1000):
        bench.phones.feedback("anna", Feedback(stamp_ns=0, cue="selected", text=f"{k}"))
    cues = await posted(phone, TURN)
    assert [cue["text"] for cue in cues] == [str(k) for k in range(936, 1000)]


async def test_old_cues_are_not_sent(
    bench: PhoneBench, phone: AsyncClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    await posted(phone)
    bench.phones.feedback("anna", Feedback(stamp_ns=0, cue="selected", text="late"))
    monkeypatch.setattr(phone_connection, "MAX_CUE_AGE_S", -1.0)
    assert await posted(phone, TURN) == []
    monkeypatch.undo()
    assert await posted(phone, TURN) == []


async def test_phones_of_two_people_are_independent(bench: PhoneBench, phone: AsyncClient) -> None:
    async with bench.client() as other:
        await bench.pair(other, "ben")
        await posted(phone, TURN)
        await posted(other, TURN)
        assert [user for user, _ in bench.sent] == ["anna", "ben"]
        bench.phones.lost("ben")
        assert await posted(phone, TURN) == []
        (cue,) = await posted(other, TURN)
        assert cue["has_lost_arm"]
        assert "another device" in cue["text"]
        _, state = await posted(other)
        assert not state["has_lost_arm"]
