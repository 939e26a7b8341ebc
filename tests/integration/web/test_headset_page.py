"""The wearer of a headset as a person: a page's messages to what the site is told, and who may send them."""

from typing import Any
from urllib.parse import urlsplit

import pytest

import pointit.schemas as models
from pointit.schemas import topics
from pointit.schemas.problems import VOICE
from tests.integration.web.pages import VIEWER, Page, serving
from tests.support.bench import START_NS, Bench, ManualClock, memory_bench, until

ROOM = {"yaw_rad": 0.5, "origin_m": [1.0, 2.0, 0.0]}
POSE = topics.POSE.key


async def people(bench: Bench, page: Page, *users: str) -> None:
    for user in users:
        bench.bus.announce(topics.USER_ALIVE, user)
        bench.bus.announce(topics.SERVICE_ALIVE, f"imu-bridge.{user}")
        bench.put(topics.INTERACTION, models.Interaction(stamp_ns=START_NS, state="pointing"), user)
    await until(lambda: all(page.person(user) for user in users))


async def take(page: Page, user: str = "anna") -> str:
    answer = await page.ask(deed="take", name=user, query={"by": "headset"})
    return str(answer["error"])


async def no_pose(bench: Bench, user: str) -> None:
    """Wait until who begins to read the pose of `user` finds none."""
    while True:
        late = bench.collect(topics.POSE, user)
        await bench.settle()
        if not late:
            return


async def wear(page: Page, user: str = "anna", x_m: float = 0.0, **changed: Any) -> None:
    part = {"alignment": ROOM, "eyes_m": [x_m, 0.0, 1.6], "tip_m": [x_m + 0.4, 0.0, 1.5]}
    await page.say(kind="headset", user=user, **(part | changed))


async def test_headset_moves_its_person_until_the_arm_is_released(bench: Bench, page: Page) -> None:
    samples = bench.collect(topics.WRIST, "anna")
    poses = bench.collect(topics.POSE, "anna")
    pressed = bench.collect(topics.BUTTON, "anna")
    stepped = bench.collect(topics.STEP, "anna")
    await people(bench, page, "anna")
    assert await take(page) == ""

    await wear(page)
    await until(lambda: (POSE, "anna") in page.states, what="the pose")
    await until(lambda: bool(samples and poses), what="the wrist")
    assert page.states[POSE, "anna"]["position_m"][:2] == pytest.approx([1.0, 2.0])
    assert {sample.source for sample in samples} == {"headset"}

    await page.ask(deed="press", name="anna")
    await page.ask(deed="step", name="anna", query={"by": 1})
    assert [pressed[-1].source, stepped[-1].source] == ["headset", "headset"]
    await until(lambda: page.person("anna")["moved_by"] == "headset" and page.person("anna")["is_mine"])

    await page.ask(deed="give", name="anna")
    await until(lambda: page.person("anna")["moved_by"] == "own")
    await no_pose(bench, "anna")
    await wear(page)
    await page.ask(deed="press", name="anna")
    assert (pressed[-1].source, page.person("anna")["moved_by"]) == ("page", "own")


async def test_headsets_of_two_people_are_independent_until_a_page_closes() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench, serving(bench) as server, server.page() as one:
        await people(bench, one, "anna", "ben")
        async with server.page() as two:
            assert (await take(one, "anna"), await take(two, "ben")) == ("", "")
            await wear(one, "anna")
            await wear(two, "ben", 1.0)
            await until(lambda: {(POSE, "anna"), (POSE, "ben")} <= set(one.states))

            clock.advance(0.2)  # poses are 0.1 s apart at least
            await wear(two, "anna", 3.0)  # whom this page does not move
            pressed = bench.collect(topics.BUTTON, "ben")
            await two.ask(deed="press", name="ben", query={"held_s": 0.2})
            await until(lambda: bool(pressed))
            assert pressed[-1].stamp_ns == clock.now_ns() - models.NS_PER_S // 5  # as it went down
            assert "held_s" in (await two.ask(deed="press", name="ben", query={"held_s": 9.0}))["error"]
            await until(lambda: one.person("ben")["moved_by"] == "headset")
        await until(lambda: one.person("ben")["moved_by"] == "own")

        await no_pose(bench, "ben")
        assert one.states[POSE, "anna"]["position_m"][:2] == pytest.approx([1.0, 2.0])


async def test_headset_that_is_not_aligned_is_reported(bench: Bench, page: Page) -> None:
    poses = bench.collect(topics.POSE, "anna")
    reports = bench.collect(topics.HEALTH, "web")
    await people(bench, page, "anna")
    await take(page)
    await wear(page, alignment=None)

    def warnings() -> list[str]:
        return [warning for report in reports for warning in report.warnings]

    await until(lambda: any("touch three lamps or things first" in each for each in warnings()))
    await wear(page, eyes_m=["x", 0.0, 1.6])
    await until(lambda: any("eyes_m" in each for each in warnings()))
    assert poses == []


async def test_viewer_page_moves_only_the_person_of_its_phone_link() -> None:
    lan = {"lan_port": 0, "lan_address": "127.0.0.1"}
    async with memory_bench() as bench, serving(bench, **lan) as server, server.page() as operator:
        await people(bench, operator, "anna", "ben")
        async with server.page(VIEWER) as viewer:
            assert "only looks on" in await take(viewer)
            await wear(viewer)
            assert "only looks on" in (await viewer.ask(deed="press", name="anna"))["error"]
        await operator.ask(deed="open_lan")
        link = urlsplit(str((await operator.ask(deed="pair", name="anna"))["reply"]["url"]))
        async with server.client() as client:
            cookie = (await client.get(f"{link.path}?{link.query}")).headers["set-cookie"].partition(";")[0]
        async with server.page(VIEWER, cookies=f"; {cookie}") as wearer:
            assert wearer.hello is not None
            assert (wearer.hello["role"], wearer.hello["user"]) == ("viewer", "anna")
            assert "only looks on" in await take(wearer, "ben")
            assert "only looks on" in (await wearer.ask(deed="open_lan"))["error"]
            assert "as a headset only" in (await wearer.ask(deed="take", name="anna"))["error"]
            assert "does not move" in (await wearer.ask(deed="centre", name="anna"))["error"]
            assert await take(wearer) == ""
            assert "align it again" in (await wearer.ask(deed="centre", name="anna"))["error"]

            await wear(wearer)
            await until(lambda: (POSE, "anna") in operator.states)
            await until(lambda: operator.person("anna")["moved_by"] == "headset")

            await operator.ask(deed="pair", name="anna", query={"off": True})  # revokes the link
            await wear(wearer)
            await until(lambda: operator.person("anna")["moved_by"] == "own")
            assert "only looks on" in await take(wearer)


async def test_spoken_names_are_counted_and_silence_is_reported() -> None:
    async with memory_bench(ManualClock()) as bench, serving(bench) as server, server.page() as page:
        health = bench.collect(topics.HEALTH, "web")
        await people(bench, page, "anna")

        async def report(spoken: int, problem: str, page: Page = page) -> str:
            query = {"spoken": spoken, "problem": problem}
            answer = await page.ask(deed="report_voice", name="anna", query=query)
            return str(answer["reply"]["message"])

        def told() -> list[str]:
            return [each.sentence for each in health[-1].problems if each.code == VOICE]

        sentence = "anna hears no names: the browser has no voices; open the page in another browser"
        assert sentence in await report(0, "none")
        await until(lambda: bool(health) and sentence in str(told()), what="the warning")
        async with server.page() as other:
            assert await report(2, "", other) == ""
            await until(lambda: ("names spoken", 2.0) in [(f.name, f.value) for f in health[-1].figures])
            assert told() == [], "another page of the person is heard"
        await until(lambda: bool(told()), what="the warning, as that page has gone")
        assert await report(1, "") == ""
        await until(lambda: not told(), what="that it is heard")
