"""Metrics, pages that play the last minutes, and the search for wrists: real requests to a real port."""

import asyncio
import contextlib
import time
from typing import Any

import httpx
import pytest

from pointit.bridges.web.pages.page_session import MAX_PAST_PAGES
from pointit.bridges.web.playback import past_page
from pointit.bridges.web.playback.past_page import CANNOT_BE_CHANGED
from pointit.bridges.web.server import access, metrics_server
from pointit.bridges.web.server.app import PAST
from pointit.bridges.web.server.metrics_server import PATH, MetricsServer
from pointit.bridges.web.site_metrics import SiteMetrics
from pointit.runtime.errors import ConfigError
from pointit.schemas import Cursor, Environment, SelectionEvent
from pointit.schemas.topics import CURSOR, MAP, SELECTION_EVENTS, SERVICE_ALIVE
from tests.integration.web.pages import OPERATOR, VIEWER, Server, serving
from tests.support.bench import START_NS, Bench, ManualClock, memory_bench, until


def bearer(token: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {token}"}


async def test_metrics_need_a_token_or_the_cookie_of_a_page(
    bench: Bench, server: Server, client: httpx.AsyncClient
) -> None:
    bench.bus.announce(SERVICE_ALIVE, "pui")
    answer = await client.get(PATH, headers=bearer(VIEWER))
    while 'pointit_service_present{name="",service="pui"} 1.0' not in answer.text:  # the test's time limit
        answer = await client.get(PATH, headers=bearer(VIEWER))
    assert answer.headers["content-type"].startswith("text/plain")
    for headers in (bearer(OPERATOR), {"Cookie": await server.cookie(VIEWER)}):
        answer = await client.get(PATH, headers=headers)
        assert answer.status_code == 200
        assert 'pointit_site_info{site="' in answer.text


async def test_metrics_are_computed_once_a_second_for_all_readers(
    server: Server, client: httpx.AsyncClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    computed: list[str] = []

    def exposition(_metrics: object, accept: str) -> tuple[bytes, str]:
        computed.append(accept)
        return b"", "text/plain"

    monkeypatch.setattr(metrics_server, "exposition", exposition)
    cookie = await server.cookie(VIEWER)
    begin_s = time.monotonic()
    for _ in range(20):
        await client.get(PATH, headers={"Cookie": cookie})
    assert len(computed) <= 1 + (time.monotonic() - begin_s)


async def test_metrics_are_refused_without_a_token(client: httpx.AsyncClient) -> None:
    for headers in ({}, bearer("wrong"), {"Authorization": f"Basic {VIEWER}"}):
        answer = await client.get(PATH, headers=headers)
        assert answer.status_code == 401
        assert answer.headers["www-authenticate"] == "Bearer"
        assert "pointit_" not in answer.text


async def test_wrong_tokens_of_a_scrape_count_as_guesses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pointit.bridges.web.server.metrics_server.REFUSAL_S", 0.0)
    async with memory_bench() as bench, serving(bench) as server, server.client() as client:
        for guess in range(access.MAX_GUESSES):
            await client.get(PATH, headers=bearer(f"guess {guess}"))
        assert (await client.get("/", params={"token": "one more"})).status_code == 429
        assert (await client.get(PATH, headers=bearer(VIEWER))).status_code == 200


async def test_metrics_server_answers_this_machine_without_a_token() -> None:
    server = MetricsServer(SiteMetrics("hall", "1"), "127.0.0.1", 0)
    serving_it = asyncio.create_task(server.run())
    try:
        async with httpx.AsyncClient(base_url=f"http://127.0.0.1:{server.port}") as client:
            answer = await client.get(PATH)
            assert answer.status_code == 200
            assert 'pointit_site_info{site="hall",version="1"} 1.0' in answer.text
            assert (await client.get(PATH, headers={"Host": "evil.example"})).status_code == 403
    finally:
        serving_it.cancel()
        await asyncio.gather(serving_it, return_exceptions=True)


async def test_metrics_server_is_closed_to_other_machines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(access.CONTAINER, "oci")  # many containers share the network of their host
    with pytest.raises(ConfigError, match=r"listen at 127\.0\.0\.1"):
        MetricsServer(SiteMetrics("lab", "1"), "0.0.0.0", 0)  # noqa: S104 - refused


def now(bench: Bench) -> dict[str, Any]:
    return {"stamp_ns": bench.clock.now_ns()}


async def test_page_shows_the_past_while_another_stays_live() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench, serving(bench) as server, server.page() as live:

        async def move(miss_m: float) -> None:
            bench.put(CURSOR, Cursor(**now(bench), miss_m=miss_m), "anna")
            await until(lambda: live.states.get((CURSOR.key, "anna"), {}).get("miss_m") == miss_m)

        bench.put(MAP, Environment(**now(bench), name="lab"))
        await move(1.0)
        clock.advance(30.0)

        bench.put(
            SELECTION_EVENTS, SelectionEvent(**now(bench), event="selected", object_id="r-7", user="anna")
        )
        await until(lambda: bool(live.events))

        await move(2.0)
        clock.advance(30.0)
        async with server.page(VIEWER, path=PAST) as page:
            await until(lambda: bool(page.timeline and page.batches))
            assert page.hello is not None
            assert (page.hello["requests"], page.hello["deeds"]) == ([], [])

            selected = next(lane for lane in page.timeline["lanes"] if lane["kind"] == "selections")
            assert (selected["user"], selected["items"][0][2]) == ("anna", "selected 7")
            start_s = selected["items"][0][0]
            assert page.timeline["length_s"] == pytest.approx(start_s + 30.0, abs=1e-3)
            assert page.playing["at_s"] == pytest.approx(page.timeline["length_s"] - 15.0, abs=0.5)
            assert page.states[CURSOR.key, "anna"]["miss_m"] == 2.0
            await until(lambda: live.status.get("viewers") == 2, what="that both pages are counted")

            await page.say(kind="play", at_s=start_s - 1.0, is_playing=False)
            await until(lambda: page.states[CURSOR.key, "anna"]["miss_m"] == 1.0, what="the cursor of then")
            assert not page.playing["is_playing"]
            assert page.states[MAP.key, ""]["name"] == "lab"
            assert live.states[CURSOR.key, "anna"]["miss_m"] == 2.0
            assert page.events == []
            await page.say(kind="play", step=1)
            await until(lambda: len(page.events) == 1, what="the event that a step leads to")
        assert clock.now_ns() > START_NS


async def test_past_cannot_be_changed_and_present_not_played(server: Server) -> None:
    async with server.page(path=PAST) as page:
        for wish in ({"deed": "press", "name": "anna"}, {"key": "conveyor/reset"}):
            answer = await page.ask(**wish)
            assert (answer["reply"], answer["error"]) == (None, CANNOT_BE_CHANGED)
        await page.say(kind="aim", user="anna", at_m=[0.0, 0.0, 0.0])
        assert (await page.ask(deed="press", name="anna"))["error"] == CANNOT_BE_CHANGED
    async with server.page() as live:
        await live.say(kind="play", is_playing=False)
        await until(
            lambda: any("shows the present" in each["sentence"] for each in live.status["findings"]),
            what="that health tells of it",
        )


async def test_number_of_pages_of_the_past_is_limited(server: Server) -> None:
    async with contextlib.AsyncExitStack() as stack:
        for _ in range(MAX_PAST_PAGES):
            await stack.enter_async_context(server.page(path=PAST))
        with pytest.raises(Exception, match="503"):
            await stack.enter_async_context(server.page(path=PAST))
        await stack.enter_async_context(server.page())


async def test_seeks_are_limited_and_the_newest_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(past_page, "SEEK_S", 60.0)
    async with memory_bench() as bench, serving(bench) as server, server.page(path=PAST) as page:
        await until(lambda: bool(page.playing))
        count = len(page.playing)
        for _ in range(20):
            await page.say(kind="play", at_s=0.0)
        await page.say(kind="ask", id=1, key="no/such")
        await until(lambda: 1 in page.answers)
        assert len(page.playing) == count


async def test_pages_of_the_past_count_as_pages() -> None:
    async with memory_bench() as bench, serving(bench, most_viewers=2) as server:
        async with server.page(), server.page(path=PAST):
            with pytest.raises(Exception, match="503"):
                async with server.page(path=PAST):
                    pass
            with pytest.raises(Exception, match="503"):
                async with server.page():
                    pass
        async with server.page(path=PAST) as page:
            await until(lambda: bool(page.playing))
