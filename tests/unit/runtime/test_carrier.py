"""A carrier carries out the events that name it, within limits, and tells each result once."""

import asyncio
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from typing import Literal

import pytest

from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.carrier import MAX_AT_ONCE, Act, ActFailedError, Carrier, check_carrier
from pointit.runtime.virtual_time import VirtualClock
from pointit.schemas import NS_PER_S, ActResult, SelectionEvent, ThingState, ThingStates
from pointit.schemas.selection import REPEATED_REASON
from pointit.schemas.topics import ACT_RESULTS, CARRIER_ALIVE, SELECTION_EVENTS, THING_STATES
from tests.support.bench import START_NS, Bench, in_virtual_time, memory_bench, stand_still, until


class Lamp:
    def __init__(self, takes_s: float = 0.0, error: Exception | None = None, limit_s: float = 5.0) -> None:
        self.state = ThingState(id="", state="off", limit_s=limit_s)
        self.takes_s = takes_s
        self.error = error
        self.acts: list[Act] = []

    async def carry_out(self, act: Act) -> None:
        self.acts.append(act)
        if self.takes_s > 2.0:
            act.tell_started()
        await asyncio.sleep(self.takes_s)
        if self.error is not None:
            raise self.error
        self.state = self.state.model_copy(update={"state": "on" if act.on else "off"})


class Unreachable:
    """A target that is tried once a second until `tries` have failed."""

    def __init__(self, tries: int) -> None:
        self.state = ThingState(id="", limit_s=30.0)
        self.tries = tries
        self.acts: list[Act] = []

    async def carry_out(self, act: Act) -> None:
        for _ in range(self.tries):
            act.check_in_time()
            self.acts.append(act)
            await asyncio.sleep(1.0)


class Site:
    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.states: list[ThingStates] = bench.collect(THING_STATES)
        self.results: list[ActResult] = bench.collect(ACT_RESULTS)
        self.present: list[bool] = []
        bench.bus.watch(CARRIER_ALIVE, lambda _name, *, present: self.present.append(present))
        self.carrier = Carrier(bench.bus, bench.clock, "home")

    async def act(
        self,
        name: str = "lamp",
        *,
        number: int = 1,
        carriers: tuple[str, ...] = ("home",),
        on: bool = True,
        reason: str = "",
    ) -> None:
        kind: Literal["selected", "deselected"] = "selected" if on else "deselected"
        event = SelectionEvent(
            stamp_ns=START_NS + number,
            event=kind,
            object_id=name,
            user="anna",
            carriers=carriers,
            reason=reason,
        )
        self.bench.put(SELECTION_EVENTS, event)
        await self.bench.settle(3)

    @property
    def told(self) -> list[tuple[str, str, str]]:
        return [(each.result, each.code, each.text) for each in self.results]


@asynccontextmanager
async def site() -> AsyncGenerator[Site]:
    async with memory_bench() as bench:
        made = Site(bench)
        try:
            yield made
        finally:
            await made.carrier.close()


@in_virtual_time
async def test_carrier_performs_its_own_events_and_reports_the_new_state() -> None:
    async with site() as home:
        lamp = Lamp()
        home.carrier.use({"lamp": [lamp]})
        await home.act(carriers=("other",))
        await home.act(number=7)
        await until(lambda: bool(home.results))
        (result,) = home.results
        assert (result.object_id, result.event_ns, result.result, result.state) == (
            "lamp",
            START_NS + 7,
            "done",
            "on",
        )
        assert len(lamp.acts) == 1


@in_virtual_time
async def test_repeated_event_of_a_restarted_selector_is_not_carried_out() -> None:
    async with site() as home:
        lamp = Lamp()
        home.carrier.use({"lamp": [lamp]})
        again = {"stamp_ns": START_NS, "event": "selected", "object_id": "lamp", "carriers": ("home",)}
        event = SelectionEvent.model_validate(again | {"reason": REPEATED_REASON})
        home.bench.put(SELECTION_EVENTS, event)
        await home.act(number=2)
        await until(lambda: bool(home.results))
        assert [(each.event.stamp_ns, each.on) for each in lamp.acts] == [(START_NS + 2, True)]
        await until(lambda: len(home.states) == 2)
        assert home.states[-1].things[0].state == "on", (
            "a selector that starts later does not know the result"
        )


@in_virtual_time
async def test_failure_has_its_sentence_and_an_unexpected_error_its_type() -> None:
    async with site() as home:
        errors = [ActFailedError("refused", "not allowed"), ValueError("what?")]
        for number, error in enumerate(errors):
            home.carrier.use({"lamp": [Lamp(), Lamp(error=error)]})
            await home.act(number=number)
            await until(lambda: len(home.results) > number)  # noqa: B023 - awaited here
        await home.act("gone", number=9)
        await until(lambda: len(home.results) == 3)
        assert home.told == [
            ("failed", "refused", "not allowed"),
            ("failed", "error", "stopped by an unexpected error (ValueError: what?)"),
            ("failed", "unavailable", "it has no target any more: point again"),
        ]
        assert (home.carrier.done, home.carrier.failed) == (0, 3)


@in_virtual_time
async def test_the_limit_is_that_of_the_thing() -> None:
    async with site() as home:
        home.carrier.use({"lamp": [Lamp(takes_s=6.0)], "cover": [Lamp(takes_s=30.0, limit_s=60.0)]})
        await home.act("lamp")
        await home.act("cover", number=2)
        await until(lambda: len(home.results) == 4, 60.0)
        assert [(each.object_id, each.result, each.text) for each in home.results] == [
            ("lamp", "started", ""),
            ("cover", "started", ""),
            ("lamp", "failed", "not done within 5 s"),
            ("cover", "done", ""),
        ]


@in_virtual_time
async def test_act_beyond_the_limit_is_refused_and_running_acts_continue() -> None:
    async with site() as home:
        home.carrier.use({"lamp": [Lamp(takes_s=1.0)], "other": [Lamp()]})
        for number in range(MAX_AT_ONCE + 1):
            await home.act(number=number)
        await home.act("other", number=99)
        await until(lambda: len(home.results) == MAX_AT_ONCE + 2)
        assert [each.code for each in home.results].count("busy") == 1
        assert [each.result for each in home.results].count("done") == MAX_AT_ONCE + 1


@in_virtual_time
async def test_newest_act_on_a_switch_cancels_and_awaits_earlier_ones() -> None:
    async with site() as home:
        lamp = Lamp(takes_s=1.0)
        home.carrier.use({"lamp": [lamp]})
        for number in range(3):
            await home.act(number=number, on=number != 1)
        await until(lambda: len(home.results) == 3)
        assert [(each.event_ns - START_NS, each.result, each.code) for each in home.results] == [
            (0, "failed", "replaced"), (1, "failed", "replaced"), (2, "done", ""),
        ]  # fmt: skip
        assert lamp.state.state == "on"
        assert lamp.acts[-1].event.stamp_ns == START_NS + 2


@in_virtual_time
async def test_undo_reaches_all_targets_but_those_that_failed() -> None:
    async with site() as home:
        done = Lamp()
        failing = Lamp(error=ActFailedError("refused", "no"))
        slow = Lamp(takes_s=6.0)
        home.carrier.use({"lamp": [done, failing], "slow": [slow], "refused": [failing]})
        for name in ("lamp", "slow", "refused"):
            await home.act(name)

        await until(lambda: [each.result for each in home.results].count("failed") == 3, 10.0)
        slow.state = slow.state.model_copy(update={"state": "on"})
        for name in ("lamp", "slow", "refused"):
            await home.act(name, number=2, on=False, reason="not done: no")
        await until(lambda: slow.state.state == "off", 10.0)
        assert [each.on for each in done.acts] == [True, False]
        assert [each.on for each in failing.acts] == [True, True], "there is nothing to take back"

        await home.act("refused", number=3)
        assert [each.on for each in failing.acts] == [True, True, True]


@in_virtual_time
async def test_late_act_is_neither_carried_out_nor_taken_back() -> None:
    async with site() as home:
        lamp = Lamp()
        home.carrier.use({"lamp": [lamp]})
        late_ns = -20 * NS_PER_S
        await home.act(number=late_ns)
        await home.act(number=late_ns + 1, on=False, reason="not done: home has ended before it was done")
        await until(lambda: bool(home.results))
        assert (home.results[0].code, lamp.acts) == ("no_answer", [])
        assert "20 s late" in home.results[0].text
        await home.act(number=-4 * NS_PER_S)
        await until(lambda: home.results[-1].result == "done")
        await home.act(number=late_ns + 2, on=False, reason="not done: another carrier has failed")
        await until(lambda: lamp.state.state == "off")
        assert [each.on for each in lamp.acts] == [True, False], "what was done goes back, however late"


@in_virtual_time
async def test_states_are_published_on_change_and_unavailable_takes_precedence() -> None:
    async with site() as home:
        lamp = Lamp()
        plug = Lamp()
        plug.state = ThingState(id="", state="unavailable", reason="no power")
        home.carrier.use({"lamp": [lamp, plug], "none": []})
        home.carrier.tell()
        await until(lambda: len(home.states) == 1)
        plug.state = ThingState(id="")
        home.carrier.tell()
        await until(lambda: len(home.states) == 2)
        assert [[(one.id, one.state, one.reason) for one in each.things] for each in home.states] == [
            [("lamp", "unavailable", "no power")],
            [("lamp", "off", "")],
        ]


@in_virtual_time
async def test_closed_carrier_reports_failure_of_its_acts_and_leaves() -> None:
    async with site() as home:
        home.carrier.use({"lamp": [Lamp(takes_s=4.0)]})
        await home.act()
        await home.carrier.close()
        await until(lambda: home.present == [True, False])
        assert home.told[-1] == ("failed", "error", "home ended before it was done")
        assert home.states[-1].things == ()


@in_virtual_time
async def test_a_name_is_that_of_one_carrier() -> None:
    bus = MemoryBus()
    carrier = Carrier(bus, VirtualClock(), "home")
    await check_carrier(bus, "other")
    with pytest.raises(ConfigError, match="home carries out acts on these things already: end the other"):
        await check_carrier(bus, "home")
    await carrier.close()
    await check_carrier(bus, "home")
    await bus.close()


@in_virtual_time
async def test_act_is_not_tried_again_when_its_process_stood_still() -> None:
    async with site() as home:
        target = Unreachable(tries=3)
        home.carrier.use({"lamp": [target]})
        await home.act()
        stand_still(8.0)
        await until(lambda: bool(home.results))
        assert len(target.acts) == 1
        assert home.told == [("failed", "no_answer", "home stood still before it was done: point again")]
        await home.act(number=2)
        await until(lambda: len(home.results) == 2)
        assert (len(target.acts), home.told[-1][0]) == (4, "done"), "later acts are not hurt"


@in_virtual_time
async def test_act_is_tried_again_after_a_pause_that_nobody_notices() -> None:
    async with site() as home:
        target = Unreachable(tries=3)
        home.carrier.use({"lamp": [target]})
        await home.act()
        stand_still(1.5)
        await until(lambda: bool(home.results))
        assert (len(target.acts), home.told[0][0]) == (3, "done")


@in_virtual_time
async def test_act_that_waited_beyond_its_limit_does_not_begin() -> None:
    class SlowToEnd(Lamp):
        async def carry_out(self, act: Act) -> None:
            try:
                await super().carry_out(act)
            finally:
                if act.on:
                    await asyncio.sleep(6.0)

    async with site() as home:
        lamp = SlowToEnd(takes_s=1.0)
        home.carrier.use({"lamp": [lamp]})
        await home.act()
        await home.act(number=2, on=False)
        await until(lambda: len(home.results) == 2)
        assert [each.on for each in lamp.acts] == [True]
        assert home.told == [
            ("failed", "replaced", "it was switched again before it was done"),
            ("failed", "no_answer", "not done within 5 s"),
        ]


@in_virtual_time
async def test_act_that_waited_within_its_limit_ends_at_that_limit() -> None:
    class SlowToEnd(Lamp):
        async def carry_out(self, act: Act) -> None:
            self.acts.append(act)
            try:
                await asyncio.sleep(60.0)
            finally:
                if act.on:
                    await asyncio.sleep(3.0)

    async with site() as home:
        lamp = SlowToEnd()
        home.carrier.use({"lamp": [lamp]})
        began_s = asyncio.get_running_loop().time()
        await home.act()
        await home.act(number=2, on=False)
        await until(lambda: len(home.results) == 2)
        assert [each.on for each in lamp.acts] == [True, False]
        assert asyncio.get_running_loop().time() - began_s == pytest.approx(5.0, abs=0.1)


@in_virtual_time
async def test_act_is_taken_back_although_the_process_stood_still() -> None:
    async with site() as home:
        target = Unreachable(tries=3)
        home.carrier.use({"lamp": [target]})
        await home.act(on=False, reason="not done: another carrier has failed")
        stand_still(8.0)
        await until(lambda: bool(home.results))
        assert (len(target.acts), home.told[0][0]) == (3, "done")
