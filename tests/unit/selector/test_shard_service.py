"""A shard of the selector on a bus, beside the selector of the site."""

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

from pointit.schemas import Claim, ClearSelection, Selection, SetMethod, topics
from pointit.services.selector.claim_budget import MAX_CLAIMS
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.selection_engine import NO_ARBITER
from pointit.services.selector.service import Selector
from tests.support.bench import Bench, ManualClock, memory_bench, until
from tests.unit.selector.served import Served, objects, served


async def start_shard(bench: Bench, user: str = "anna") -> None:
    """Start a shard of a person, and wait until it serves them."""
    present: set[str] = set()
    bench.bus.watch(topics.SHARD_ALIVE, lambda name, **_: present.add(name))
    bench.start(Selector, SelectorConfig(people=(user,)), name=user)
    await until(lambda: f"selector.{user}" in present, what="the shard")
    await bench.settle()


@asynccontextmanager
async def shard_alone() -> AsyncGenerator[Served]:
    """Run anna's shard without a selector of the site."""
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        site = Served(bench, clock)
        await start_shard(bench)
        yield site


async def test_sites_selector_decides_on_claims_of_a_shard() -> None:
    async with served() as site:
        claims = site.bench.collect(topics.CLAIM, "anna")
        site.bus.announce(topics.USER_ALIVE, "ben")
        await site.bench.settle()
        await start_shard(site.bench)
        await site.stay("anna", 1.0, "a")

        await site.stay("ben", 1.0, "a")
        assert site.told == [("selected", "a", "anna"), ("refused", "a", "ben")]
        assert {event.cause for event in site.events} == {"dwell"}
        assert [claim.stamp_ns for claim in claims if claim.wish == "toggle"] == [site.events[0].stamp_ns]
        assert len(site.hovers["anna"]) == 25, "one writer"
        assert [cue.cue for cue in site.cues["anna"]] == ["selected"]

        done = await site.bus.call(topics.CLEAR_SELECTION, ClearSelection(), "anna")
        assert done.message == "1 of anna's objects deselected"
        await site.bench.settle()
        await site.stay("anna", 1.0, "a")
        assert len(site.events) == 3, "they have not left it"
        assert site.owners == []


async def test_shard_follows_the_method_of_the_site() -> None:
    async with served() as site:
        await site.bus.call(topics.SET_METHOD, SetMethod(method="hold", dwell_s=2.0))
        await start_shard(site.bench)
        await until(lambda: site.selections[-1].method == "hold", what="the method")
        assert site.selections[-1].dwell_s == 2.0
        await site.bench.settle()
        await site.stay("anna", 1.0, "a")
        assert site.events == []
        await site.stay("anna", 1.0, "a")
        await site.stay("anna", 1.0, "a")
        assert site.told == [("selected", "a", "anna")]


async def test_dwell_time_of_the_method_in_use_is_a_figure() -> None:
    async with served(gauge={"full_s": 0.6, "sparse_full_s": 0.4}, window_s=0.9) as site:

        def default_s() -> list[float]:
            figures = site.health[-1].figures if site.health else ()
            return [each.value for each in figures if each.name == "default dwell"]

        for query, wanted_s in (({"dwell_s": 2.0}, 0.6), ({"method": "hold", "dwell_s": 1.5}, 0.9)):
            await site.bus.call(topics.SET_METHOD, SetMethod.model_validate(query))
            await site.stay("anna", 1.0)
            await until(lambda wanted_s=wanted_s: default_s() == [wanted_s])


async def test_missing_method_is_a_warning_of_the_shard() -> None:
    async with shard_alone() as site:
        stare = Selection(stamp_ns=site.clock.now_ns(), method="stare", dwell_s=1.0)
        site.bench.put(topics.SELECTION, stare)
        await until(lambda: site.warns("method stare"), what="the warning")


async def test_shard_without_a_selector_warns_and_hovers() -> None:
    async with shard_alone() as site:
        claims = site.bench.collect(topics.CLAIM)
        await until(lambda: site.warns(NO_ARBITER), what="the warning")
        await site.stay("anna", 1.0, "a")
        assert site.hovers["anna"][-1].object_id == "a"
        assert [(cue.cue, cue.text) for cue in site.cues["anna"]] == [("refused", NO_ARBITER)]
        assert claims == []
        token = site.bus.announce(topics.SERVICE_ALIVE, "selector")
        await until(lambda: not site.warns(NO_ARBITER), what="the end of the warning")
        token.close()


async def test_flood_of_claims_is_shown_in_health() -> None:
    async with served() as site:
        site.bench.put(topics.OBJECTS, objects(site.clock, "a", "b"), "conveyor")
        await site.bench.settle()
        for index in range(2 * MAX_CLAIMS):
            claim = Claim(stamp_ns=site.clock.now_ns() + index, object_id="z", wish="toggle")
            site.bench.put(topics.CLAIM, claim, "anna")
        await site.bench.settle()
        site.clock.advance(1.0)
        await until(lambda: site.warns("of anna are ignored"), what="the warning")
        assert len(site.events) == MAX_CLAIMS
