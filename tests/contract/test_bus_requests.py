"""Contract of every bus for requests: in memory, between peers and through a router."""

import asyncio
import time

import pytest

from pointit.runtime.bus.contract import MAX_IN_FLIGHT
from pointit.runtime.errors import NoAnswerError, RefusedError
from pointit.schemas import AddPackage, AddPackageReply, Done, SetBrightness, SetPose
from pointit.schemas.topics import ADD_PACKAGE, SET_BRIGHTNESS, SET_POSE
from tests.contract.readers import SlowServer
from tests.support.bench import until
from tests.support.buses import Site


class TestRequests:
    async def test_the_reply_comes_back_typed(self, site: Site) -> None:
        async def add(query: AddPackage, name: str) -> AddPackageReply:
            assert name == ""
            return AddPackageReply(object_id=f"{query.kind}-1", message="added")

        site.a.serve(ADD_PACKAGE, add)
        for bus in site.buses:
            reply = await bus.call(ADD_PACKAGE, AddPackage(kind="red"))
            assert reply == AddPackageReply(object_id="red-1", message="added")

    async def test_the_name_tells_whom_it_is_about(self, site: Site) -> None:
        async def pose(_query: SetPose, name: str) -> Done:
            return Done(message=name)

        async def own(_query: SetPose, name: str) -> Done:
            return Done(message=f"only {name}")

        served = (site.a.serve(SET_POSE, pose, "anna"), site.b.serve(SET_POSE, own, "ben"))
        query = SetPose(position_m=(0, 0, 0))
        for bus in site.buses:
            for name, said in (("anna", "anna"), ("ben", "only ben")):
                assert (await bus.call(SET_POSE, query, name)).message == said
        with pytest.raises(NoAnswerError):
            await site.c.call(SET_POSE, query, "carl")
        for one in served:
            one.close()
        await site.settle()
        site.a.serve(SET_POSE, pose)  # of every name
        for bus in site.buses:
            assert (await bus.call(SET_POSE, query, "dora")).message == "dora"

    @pytest.mark.parametrize(
        ("error", "sentence"),
        [
            (RefusedError("the strips are off; switch them on"), "the strips are off; switch them on"),
            (NoAnswerError("conveyor-sim does not answer"), "conveyor-sim does not answer"),
            (ZeroDivisionError("oops"), "led-driver failed on leds/brightness: ZeroDivisionError: oops"),
        ],
        ids=["refuses", "asks another in vain", "fails"],
    )
    async def test_a_server_without_a_reply_says_why_in_a_sentence(
        self, site: Site, error: Exception, sentence: str, caplog: pytest.LogCaptureFixture
    ) -> None:
        async def fail(_query: SetBrightness, _name: str) -> Done:
            raise error

        site.a.serve(SET_BRIGHTNESS, fail)
        for bus in site.buses:
            caplog.clear()
            with pytest.raises(RefusedError) as caught:
                await bus.call(SET_BRIGHTNESS, SetBrightness(brightness=1))
            assert str(caught.value) == sentence
            has_traceback = any(record.exc_info for record in caplog.records)
            assert has_traceback == isinstance(error, ZeroDivisionError), "the server's, of its own faults"

    async def test_a_wrong_reply_is_an_error_that_names_both(self, site: Site) -> None:
        async def wrong(_query: AddPackage, _name: str) -> AddPackageReply:
            return Done()  # pyrefly: ignore[bad-return]  # the defect under test

        site.a.serve(ADD_PACKAGE, wrong)
        for bus in site.buses:
            with pytest.raises(RefusedError, match="Done, not a AddPackageReply"):
                await bus.call(ADD_PACKAGE, AddPackage(kind="red"))

    async def test_a_missing_server_is_known_before_the_time_out(self, site: Site) -> None:
        for bus in site.buses:
            began_s = time.monotonic()
            with pytest.raises(NoAnswerError, match="led-driver does not answer leds/brightness"):
                await bus.call(SET_BRIGHTNESS, SetBrightness(brightness=1), timeout_s=60)
            assert time.monotonic() - began_s < 30

    async def test_too_slow_is_no_answer_and_the_server_goes_on(self, site: Site) -> None:
        slow = SlowServer()
        site.a.serve(SET_BRIGHTNESS, slow)
        await site.settle()
        told = r"led-driver does not answer leds/brightness within 0\.1 s"
        for bus in site.buses:
            with pytest.raises(NoAnswerError, match=told):
                await bus.call(SET_BRIGHTNESS, SetBrightness(brightness=1), timeout_s=0.1)
        slow.go_on.set()
        async with asyncio.timeout(60):
            await slow.done.wait()

    async def test_a_caller_may_give_up(self, site: Site) -> None:
        slow = SlowServer()
        site.a.serve(SET_BRIGHTNESS, slow)
        for bus in site.buses:
            for event in (slow.asked, slow.go_on, slow.done):
                event.clear()
            question = bus.call(SET_BRIGHTNESS, SetBrightness(brightness=1), timeout_s=60)
            call = asyncio.create_task(question)
            async with asyncio.timeout(60):
                await slow.asked.wait()
            began_s = time.monotonic()
            call.cancel()
            with pytest.raises(asyncio.CancelledError):
                await call
            assert time.monotonic() - began_s < 30
            slow.go_on.set()
            async with asyncio.timeout(60):
                await slow.done.wait()

    async def test_a_hundred_calls_at_once_each_get_their_own_reply(self, site: Site) -> None:
        together = asyncio.Barrier(100)

        async def pose(query: SetPose, name: str) -> Done:
            await together.wait()  # none is answered before all have asked
            return Done(message=f"{name} {query.yaw_rad:g}")

        site.a.serve(SET_POSE, pose)
        await site.settle()
        queries = [SetPose(position_m=(0, 0, 0), yaw_rad=index) for index in range(100)]
        for bus in site.buses:
            replies = await asyncio.gather(
                *(bus.call(SET_POSE, query, f"u{query.yaw_rad:g}", timeout_s=10) for query in queries)
            )
            assert [reply.message for reply in replies] == [f"u{index} {index}" for index in range(100)]

    async def test_too_many_at_once_are_refused_and_not_queued(self, site: Site) -> None:
        slow = SlowServer()
        site.a.serve(SET_BRIGHTNESS, slow)
        await site.settle()
        query = SetBrightness(brightness=1)
        questions = (site.b.call(SET_BRIGHTNESS, query, timeout_s=10) for _ in range(MAX_IN_FLIGHT + 20))
        calls = [asyncio.create_task(question) for question in questions]
        await until(lambda: sum(call.done() for call in calls) == 20)
        slow.go_on.set()
        results = await asyncio.gather(*calls, return_exceptions=True)
        refused = [str(result) for result in results if isinstance(result, RefusedError)]
        assert len(refused) == 20
        assert all("led-driver is busy with 256 other requests" in sentence for sentence in refused)

    async def test_a_closing_server_refuses_waiting_callers(self, site: Site) -> None:
        asked: list[str] = []
        stopped: list[str] = []

        async def slow(_query: SetPose, name: str) -> Done:
            asked.append(name)
            try:
                await asyncio.Event().wait()
            finally:
                stopped.append(name)
            return Done()

        served = site.a.serve(SET_POSE, slow)
        await site.settle()
        calls = [
            asyncio.create_task(bus.call(SET_POSE, SetPose(position_m=(0, 0, 0)), "anna"))
            for bus in site.buses
        ]

        await until(lambda: len(asked) == len(calls), what="all to be asked")
        served.close()
        served.close()
        for call in calls:
            with pytest.raises(RefusedError, match="localizer is shutting down"):
                await call
        assert stopped == ["anna"] * 3
        with pytest.raises(NoAnswerError):
            await site.b.call(SET_POSE, SetPose(position_m=(0, 0, 0)), "anna")
