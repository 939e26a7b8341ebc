"""Messages to pages and their requests: the service on a bench, pages by real websockets."""

import asyncio
import io
import threading
import time
from typing import IO, Any

import pytest
from mcap.reader import make_reader

import pointit.schemas as models
from pointit.bridges.web.pages import action
from pointit.bridges.web.playback.recent import RecentPast
from pointit.bridges.web.server import app
from pointit.bridges.web.wrists import pairing
from pointit.runtime.errors import RefusedError
from pointit.schemas import topics
from pointit.schemas.catalogue.json_channel import channel_name
from pointit.services.selector.service import Selector
from tests.integration.web.pages import VIEWER, Page, Server, serving
from tests.support.bench import START_NS, Bench, ManualClock, memory_bench, until
from tests.support.pace import within
from tests.unit.selector.served import stay

NOW: dict[str, Any] = {"stamp_ns": START_NS}


async def known(page: Page, key: str, name: str = "") -> None:
    await until(lambda: (key, name) in page.states, what=f"{key} of {name}")


async def unknown(page: Page, key: str, name: str = "") -> None:
    await until(lambda: (key, name) not in page.states, what=f"that {key} of {name} is gone")


async def test_page_gets_states_and_events(bench: Bench, server: Server) -> None:
    bench.put(topics.MAP, models.Environment(**NOW, name="lab"))
    bench.put(topics.CURSOR, models.Cursor(**NOW, miss_m=1.0), "anna")
    async with server.page(VIEWER) as page:
        await known(page, topics.MAP.key)
        await known(page, topics.CURSOR.key, "anna")
        bench.put(topics.CURSOR, models.Cursor(**NOW, miss_m=2.0), "anna")
        bench.put(topics.FEEDBACK, models.Feedback(**NOW, cue="selected"), "anna")
        bench.put(topics.STRIPS_FRAME, models.StripsFrame(**NOW, strips=()))
        await until(lambda: page.states[topics.CURSOR.key, "anna"]["miss_m"] == 2.0)
        await until(lambda: [event[:2] for event in page.events] == [(topics.FEEDBACK.key, "anna")])
        await known(page, topics.STRIPS_FRAME.key)
        await known(page, topics.HEALTH.key, "web")
        assert page.batches == list(range(1, len(page.batches) + 1))


async def told_of_before(server: Server) -> list[tuple[str, str]]:
    async with server.page() as page:
        await until(lambda: bool(page.batches))
        told = [event for key, _, event in page.events if key == topics.SELECTION_EVENTS.key]
    return [(event["user"], event["object_id"]) for event in told]


async def test_late_server_has_earlier_events_from_the_journal() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        bench.start(Selector)
        await bench.settle()
        await stay(bench, clock, "anna", 1.0, "a", "b")
        async with serving(bench) as server:
            assert await told_of_before(server) == [("anna", "a")]
            await stay(bench, clock, "ben", 2.0, "a", "b")
            assert await told_of_before(server) == [("anna", "a"), ("ben", "b")]
    async with memory_bench(clock) as bench, serving(bench) as server:
        assert await told_of_before(server) == [], "the selector is not there yet"
        bench.start(Selector)
        async with asyncio.timeout(60.0):
            while len(told := await told_of_before(server)) < 2:
                pass
        assert told == [("anna", "a"), ("ben", "b")]


async def test_frame_of_light_is_sent_at_once() -> None:
    async with memory_bench() as bench, serving(bench, rate_hz=0.1) as server, server.page() as page:
        await known(page, topics.HEALTH.key, "web")
        loop = asyncio.get_running_loop()
        bench.put(topics.STRIPS_FRAME, models.StripsFrame(**NOW, strips=()))
        began_s = loop.time()
        await known(page, topics.STRIPS_FRAME.key)
        assert within(loop.time() - began_s, 3.0), "it waits for what was sent just before"


def lag(bench: Bench, page: Page, late_s: float) -> str:
    """Have a report of another machine come that late; return what the page server says of it."""
    stamp_ns = time.time_ns() - round(late_s * 1e9)
    late = models.Health(stamp_ns=stamp_ns, service="pui", instance="pui", pid=1, host="plant")
    bench.put(topics.HEALTH, late, "pui")
    warnings: list[str] = page.states.get((topics.HEALTH.key, "web"), {}).get("warnings", [])
    return "".join(warning for warning in warnings if "messages of plant reach" in warning)


async def test_lag_of_pages_is_reported(bench: Bench, page: Page) -> None:
    await until(lambda: "4.0 s late" in lag(bench, page, 4.0), 20.0, "the page to speak of it")
    await until(lambda: not lag(bench, page, 0.0), 20.0, "the page to speak of it no more")


async def test_person_who_leaves_disappears(bench: Bench, server: Server, page: Page) -> None:
    token = bench.bus.announce(topics.USER_ALIVE, "anna")
    bench.put(topics.CURSOR, models.Cursor(**NOW), "anna")
    await known(page, topics.CURSOR.key, "anna")
    await until(lambda: bool(page.person("anna")))
    token.close()
    await unknown(page, topics.CURSOR.key, "anna")
    await until(lambda: not page.person("anna"))
    async with server.page() as late:
        await until(lambda: bool(late.batches))
        assert (topics.CURSOR.key, "anna") not in late.states


async def test_replaced_scenario_leaves_only_its_map(bench: Bench, page: Page) -> None:
    tokens = [bench.bus.announce(topics.SERVICE_ALIVE, name) for name in ("pui", "conveyor-sim")]
    services = (models.ExpectedService(service="conveyor-sim"),)
    first = models.Deployment(**NOW, name="scenario_4", scenario="scenario_4", services=services)
    bench.put(topics.DEPLOYMENT, first, "run.scenario_4")
    bench.put(topics.MAP, models.Environment(**NOW, name="old"))
    bench.put(topics.CURSOR, models.Cursor(**NOW), "anna")
    bench.put(topics.OBJECTS, models.TrackedObjects(**NOW), "conveyor")
    await known(page, topics.CURSOR.key, "anna")
    await known(page, topics.OBJECTS.key, "conveyor")
    await known(page, topics.DEPLOYMENT.key, "run.scenario_4")
    for token in tokens:
        token.close()
    await unknown(page, topics.CURSOR.key, "anna")
    bench.put(
        topics.DEPLOYMENT,
        first.model_copy(update={"name": "scenario_3", "scenario": "scenario_3"}),
        "run.scenario_3",
    )
    await unknown(page, topics.DEPLOYMENT.key, "run.scenario_4")
    await known(page, topics.DEPLOYMENT.key, "run.scenario_3")

    await unknown(page, topics.OBJECTS.key, "conveyor")  # its tracker is silent
    assert (topics.MAP.key, "") in page.states


async def test_request_is_answered_by_its_server(bench: Bench, page: Page) -> None:
    asked: list[models.Query] = []

    async def set_speed(query: models.SetSpeed, _name: str) -> models.Done:
        asked.append(query)
        if query.speed_mps > 1.0:
            raise RefusedError("that is too fast")
        return models.Done(message="it runs")

    bench.bus.serve(topics.SET_SPEED, set_speed)
    done = await page.ask(key=topics.SET_SPEED.key, query={"speed_mps": 1, "belts": ["a"]})
    assert done["reply"] == {"message": "it runs", "status": None}
    assert done["error"] == ""
    assert asked == [models.SetSpeed(speed_mps=1.0, belts=("a",))]
    refused = await page.ask(key=topics.SET_SPEED.key, query={"speed_mps": 2})
    assert refused["reply"] is None
    assert refused["error"] == "that is too fast"
    wrong = await page.ask(key=topics.SET_SPEED.key, query={"speed_mps": 99})
    assert "speed_mps" in wrong["error"]
    assert len(asked) == 2
    nobody = await page.ask(key=topics.UNDO_SELECTION.key, name="anna")
    assert "selector does not answer" in nobody["error"]


async def test_viewer_request_is_refused_without_effect(bench: Bench, server: Server) -> None:
    bench.bus.announce(topics.USER_ALIVE, "anna")
    bench.bus.announce(topics.SERVICE_ALIVE, "imu-bridge.anna")
    presses = bench.collect(topics.BUTTON)
    samples = bench.collect(topics.WRIST)
    async with server.page(VIEWER) as page:
        for wish in ({"deed": "press"}, {"deed": "take"}, {"key": topics.UNDO_SELECTION.key}):
            answer = await page.ask(**wish, name="anna")
            assert "only looks on" in answer["error"]
        await page.say(kind="aim", user="anna", at_m=[1, 2, 3])
        await page.ask(key="no/such")
    assert presses == []
    assert samples == []


async def test_press_of_a_page_presses_the_button(bench: Bench, page: Page) -> None:
    presses = bench.collect(topics.BUTTON, "anna")
    assert "anna is not there" in (await page.ask(deed="press", name="anna"))["error"]
    bench.bus.announce(topics.USER_ALIVE, "anna")
    await until(lambda: bool(page.person("anna")))
    for gesture in ("press", "hold"):
        assert not (await page.ask(deed="press", name="anna", query={"gesture": gesture}))["error"]
    await until(lambda: len(presses) == 2)
    assert [(press.gesture, press.source) for press in presses] == [("press", "page"), ("hold", "page")]
    assert presses[0].seq != presses[1].seq


async def person(bench: Bench, page: Page, state: str = "pointing") -> None:
    bench.bus.announce(topics.USER_ALIVE, "anna")
    bench.bus.announce(topics.SERVICE_ALIVE, "imu-bridge.anna")
    bench.put(topics.INTERACTION, models.Interaction.model_validate({**NOW, "state": state}), "anna")
    await until(lambda: bool(page.person("anna")))


async def test_mouse_moves_the_arm_until_it_is_released() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench, serving(bench) as server, server.page() as page:
        await person(bench, page)
        samples = bench.collect(topics.WRIST, "anna")
        assert not (await page.ask(deed="take", name="anna"))["error"]
        await until(lambda: page.person("anna")["is_mine"])
        assert page.person("anna")["moved_by"] == "mouse"
        await until(lambda: len(samples) > 3)

        before = samples[-1].orientation_xyzw
        await page.say(kind="aim", user="anna", at_m=[0.0, 5.0, 1.0])
        while samples[-1].orientation_xyzw == before:  # the page's word may come after some of the time
            clock.advance(1.0)
            await asyncio.sleep(0.01)
        assert not (await page.ask(deed="give", name="anna"))["error"]
        await until(lambda: page.person("anna")["moved_by"] == "own")

        count = len(samples)
        await page.ask(deed="press", name="anna")
        await asyncio.sleep(0.1)
        assert len(samples) <= count + 1


@pytest.mark.parametrize(("state", "presses"), [("idle", 1), ("pointing", 0), ("localizing", 0)])
async def test_idle_person_begins_to_point_when_taken(
    bench: Bench, page: Page, state: str, presses: int
) -> None:
    pressed = bench.collect(topics.BUTTON, "anna")
    await person(bench, page, state)
    await page.ask(deed="take", name="anna")
    await page.ask(deed="give", name="anna")
    assert len(pressed) == presses


async def test_arm_is_not_taken_without_an_imu_bridge(bench: Bench, page: Page) -> None:
    bench.bus.announce(topics.USER_ALIVE, "anna")
    await until(lambda: bool(page.person("anna")))
    assert "imu-bridge --user anna" in (await page.ask(deed="take", name="anna"))["error"]


async def test_last_page_that_takes_has_the_arm_until_it_closes() -> None:
    async with memory_bench() as bench, serving(bench) as server, server.page() as one:
        await person(bench, one)
        async with server.page() as two:
            await take_in_turn(one, two)
        await until(lambda: one.person("anna")["moved_by"] == "own")


async def take_in_turn(one: Page, two: Page) -> None:
    await one.ask(deed="take", name="anna")
    await until(lambda: one.person("anna")["is_mine"] and two.person("anna")["moved_by"] == "mouse")
    assert not two.person("anna")["is_mine"]
    await two.ask(deed="take", name="anna")
    await until(lambda: two.person("anna")["is_mine"] and not one.person("anna")["is_mine"])
    assert "take it first" in (await one.ask(deed="tremor", name="anna", query={"rms_deg": 1}))["error"]
    assert not (await two.ask(deed="tremor", name="anna", query={"rms_deg": 1}))["error"]


async def test_phone_is_paired_only_over_the_local_network(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn_by: list[bool] = []

    def drawn(url: str, fingerprint: str) -> dict[str, Any]:
        drawn_by.append(threading.current_thread() is threading.main_thread())
        return pairing.offer(url, fingerprint)

    monkeypatch.setattr(action, "offer", drawn)
    async with (
        memory_bench() as bench,
        serving(bench, lan_address="127.0.0.1", lan_port=0) as server,
        server.page() as page,
    ):
        await person(bench, page)
        assert page.status["lan_url"] == ""
        assert "local network first" in (await page.ask(deed="pair", name="anna"))["error"]

        opened = await page.ask(deed="open_lan")
        assert opened["reply"]["url"].startswith("https://127.0.0.1:")
        await until(lambda: page.status["lan_url"] == opened["reply"]["url"])

        offer = (await page.ask(deed="pair", name="anna"))["reply"]
        assert offer["url"].startswith(opened["reply"]["url"] + "/phone?token=")
        assert offer["qr_svg"].startswith("<svg")
        assert offer["fingerprint"] == opened["reply"]["fingerprint"]
        assert drawn_by == [False]
        await until(lambda: "waiting" in page.person("anna")["phone"])


async def test_page_figures_are_in_health(bench: Bench, server: Server) -> None:
    reports = bench.collect(topics.HEALTH, "web")

    def figure(name: str) -> float | None:
        figures = reports[-1].figures if reports else ()
        return next((figure.value for figure in figures if figure.name == name), None)

    async with server.page(), server.page():
        await until(lambda: figure("viewers") == 2.0)
        await until(lambda: figure("capture to page p95") == 12.5)
        await until(lambda: (figure("batches") or 0.0) > 0.0)
        assert figure("events dropped") == 0.0
    await until(lambda: figure("viewers") == 0.0)


async def test_last_minute_is_a_file_for_operators(bench: Bench, server: Server) -> None:
    bench.put(topics.CURSOR, models.Cursor(**NOW), "anna")
    await bench.settle()
    async with server.client(Cookie=await server.cookie()) as client:
        answer = await client.get("/recording.mcap")
    assert answer.status_code == 200
    name = f"pointit-memory-{START_NS // models.NS_PER_S}.mcap"
    assert answer.headers["content-disposition"] == f'attachment; filename="{name}"'
    found = {channel.topic for _, channel, _ in make_reader(io.BytesIO(answer.content)).iter_messages()}
    assert channel_name(topics.CURSOR.at("anna")) in found
    async with server.client(Cookie=await server.cookie(VIEWER)) as client:
        assert (await client.get("/recording.mcap")).status_code == 403


async def test_request_while_writing_gets_the_same_recording(monkeypatch: pytest.MonkeyPatch) -> None:
    written: list[int] = []
    write = app.write_recording

    def counted(past: RecentPast, since_ns: int, output: IO[bytes]) -> int:
        written.append(1)
        time.sleep(0.2)  # longer than the others need to ask
        return write(past, since_ns, output)

    monkeypatch.setattr(app, "write_recording", counted)
    async with memory_bench() as bench, serving(bench) as server:
        for n in range(2000):
            bench.put(topics.CURSOR, models.Cursor(stamp_ns=START_NS, seq=n), "anna")
        await bench.settle()
        async with server.client(Cookie=await server.cookie()) as client:
            answers = await asyncio.gather(*(client.get("/recording.mcap") for _ in range(10)))
            assert {answer.status_code for answer in answers} == {200}
            assert len(written) < 10
            before = len(written)
            assert (await client.get("/recording.mcap")).status_code == 200
            assert len(written) == before + 1
