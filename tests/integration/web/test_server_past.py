"""Pages of a running site that play its last minutes."""

from typing import Any

import pytest

from pointit.bridges.web.playback.past_page import CANNOT_BE_CHANGED
from pointit.bridges.web.server.app import PAST
from pointit.schemas import Cursor, Environment, SelectionEvent
from pointit.schemas.topics import CURSOR, MAP, SELECTION_EVENTS
from tests.integration.web.pages import VIEWER, Server, serving
from tests.support.bench import START_NS, Bench, ManualClock, memory_bench, until


def now(bench: Bench) -> dict[str, Any]:
    return {"stamp_ns": bench.clock.now_ns()}


async def test_a_page_goes_back_in_time_while_another_one_stays_live() -> None:
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


async def test_the_past_cannot_be_changed_and_the_present_not_played(server: Server) -> None:
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
