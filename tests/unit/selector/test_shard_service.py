"""A shard of the selector on a bus, beside the selector of the site."""

from pointit.schemas import Claim, ClearSelection, Health, Selection, SetMethod, topics
from pointit.services.selector.claim_budget import MAX_CLAIMS
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.service import Selector
from pointit.services.selector.shard_engine import NO_ARBITER
from tests.support.bench import Bench, ManualClock, memory_bench, until
from tests.unit.selector.test_selector_service import objects, stay


async def start_shard(bench: Bench, user: str = "anna") -> None:
    """Start a shard of a person, and wait until it serves them."""
    present: set[str] = set()
    bench.bus.watch(topics.SHARD_ALIVE, lambda name, _present: present.add(name))
    bench.start(Selector, SelectorConfig(people=(user,)), name=user)
    await until(lambda: f"selector.{user}" in present, what="the shard")
    await bench.settle()


def shows(reports: list[Health], warning: str) -> bool:
    """Return True if the newest report has a warning with this text."""
    return any(warning in text for report in reports[-1:] for text in report.warnings)


async def test_the_sites_selector_decides_on_what_a_shard_claims() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        events, selections = bench.collect(topics.SELECTION_EVENTS), bench.collect(topics.SELECTION)
        hovers, cues = bench.collect(topics.HOVER, "anna"), bench.collect(topics.FEEDBACK, "anna")
        claims = bench.collect(topics.CLAIM, "anna")
        bench.start(Selector)
        bench.bus.announce(topics.USER_ALIVE, "ben")
        await bench.settle()
        await start_shard(bench)
        await stay(bench, clock, "anna", 1.0, "a")
        await stay(bench, clock, "ben", 1.0, "a")
        assert [(event.event, event.user, event.cause) for event in events] == [
            ("selected", "anna", "dwell"),
            ("refused", "ben", "dwell"),
        ]
        assert [claim.stamp_ns for claim in claims if claim.wish == "toggle"] == [events[0].stamp_ns]
        assert len(hovers) == 25, "one writer"
        assert [cue.cue for cue in cues] == ["selected"]
        done = await bench.bus.call(topics.CLEAR_SELECTION, ClearSelection(), "anna")
        assert done.message == "1 of anna's objects deselected"
        await bench.settle()
        await stay(bench, clock, "anna", 1.0, "a")
        assert len(events) == 3, "they have not left it"
        assert selections[-1].objects == ()


async def test_a_shard_follows_the_method_of_the_site() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        selections, events = bench.collect(topics.SELECTION), bench.collect(topics.SELECTION_EVENTS)
        bench.start(Selector)
        await bench.settle()
        await bench.bus.call(topics.SET_METHOD, SetMethod(method="hold", dwell_s=2.0))
        await start_shard(bench)
        await until(lambda: selections[-1].method == "hold", what="the method")
        assert selections[-1].dwell_s == 2.0
        await bench.settle()
        await stay(bench, clock, "anna", 1.0, "a")
        assert events == []
        await stay(bench, clock, "anna", 1.0, "a")
        await stay(bench, clock, "anna", 1.0, "a")
        assert [event.user for event in events] == ["anna"]


async def test_a_method_that_is_not_installed_here_is_a_warning() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        reports = bench.collect(topics.HEALTH, "selector.anna")
        await start_shard(bench)
        bench.put(topics.SELECTION, Selection(stamp_ns=clock.now_ns(), method="stare", dwell_s=1.0))
        await until(lambda: shows(reports, "method stare"), what="the warning")


async def test_a_shard_without_a_selector_says_so_and_hovers() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        reports, hovers = bench.collect(topics.HEALTH, "selector.anna"), bench.collect(topics.HOVER, "anna")
        cues, claims = bench.collect(topics.FEEDBACK, "anna"), bench.collect(topics.CLAIM)
        await start_shard(bench)
        await until(lambda: shows(reports, NO_ARBITER), what="the warning")
        await stay(bench, clock, "anna", 1.0, "a")
        assert hovers[-1].object_id == "a"
        assert [(cue.cue, cue.text) for cue in cues] == [("refused", NO_ARBITER)]
        assert claims == []
        token = bench.bus.announce(topics.SERVICE_ALIVE, "selector")
        await until(lambda: not shows(reports, NO_ARBITER), what="the end of the warning")
        token.close()


async def test_a_flood_of_claims_is_shown_in_health() -> None:
    clock = ManualClock()
    async with memory_bench(clock) as bench:
        reports, events = bench.collect(topics.HEALTH, "selector"), bench.collect(topics.SELECTION_EVENTS)
        bench.start(Selector)
        await bench.settle()
        bench.put(topics.OBJECTS, objects(clock, "a", "b"), "conveyor")
        await bench.settle()
        for index in range(2 * MAX_CLAIMS):
            claim = Claim(stamp_ns=clock.now_ns() + index, object_id="z", wish="toggle")
            bench.put(topics.CLAIM, claim, "anna")
        await bench.settle()
        clock.advance(1.0)
        await until(lambda: shows(reports, "of anna are ignored"), what="the warning")
        assert len(events) == MAX_CLAIMS
