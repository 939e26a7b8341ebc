"""Things of scripts, and sites without `await`."""

import asyncio
import contextlib
import logging
import threading
from collections.abc import AsyncGenerator, Generator, Iterator

import pytest

import pointit
from pointit.api.feed import MAX_AT_ONCE, FunctionTarget, is_reaction
from pointit.api.loop_thread import LoopThread
from pointit.api.site import Site
from pointit.api.sync_site import SyncSite
from pointit.errors import (
    BusClosedError,
    ConfigError,
    ConnectError,
    KeyNameError,
    NoMessageError,
    SchemaError,
)
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.virtual_time import VirtualClock
from pointit.schemas import ActResult, Environment, Selection, SelectionEvent, TrackedObject
from pointit.schemas.environment import Thing, ThingMode
from pointit.schemas.selection import RESTORED
from pointit.schemas.topics import ACT_RESULTS, CARRIER_ALIVE, MAP, SELECTION, SELECTION_EVENTS
from tests.contract.public_api import in_memory
from tests.docs.blocks import ROOT, blocks
from tests.support.acts import act_on
from tests.support.bench import PATIENCE_S, START_NS, Bench, in_virtual_time, until


def thing(name: str, mode: ThingMode = "button") -> Thing:
    return Thing(id=name, center_m=(1.0, 2.0, 1.0), size_m=(0.2, 0.2, 0.2), mode=mode)


ROOM = Environment(
    stamp_ns=1, name="shop", things=(thing("screws"), thing("radio", "switch"), thing("door", "claim"))
)
SHELF = ROOT / "docs" / "tutorial" / "shelf.md"
MISSPELT = r"the map has no thing 'scews'; did you mean screws\?"


@contextlib.asynccontextmanager
async def shop(*, has_map: bool = True) -> AsyncGenerator[tuple[Site, Bench]]:
    """Yield a site without services, and what publishes on it."""
    bus = MemoryBus()
    bench = Bench(bus, VirtualClock())
    try:
        async with Site.on(bus, VirtualClock()) as site:
            if has_map:
                bench.put(MAP, ROOM)
                await site.latest.map.wait()
            yield site, bench
    finally:
        await bus.close()


def point(bench: Bench, name: str, event: str = "selected", cause: str = "dwell", stamp_ns: int = 1) -> None:
    fields = {"stamp_ns": stamp_ns, "event": event, "object_id": name, "user": "anna", "cause": cause}
    bench.put(SELECTION_EVENTS, SelectionEvent.model_validate(fields))


async def settled() -> None:
    """Return when all that is under way has arrived."""
    await asyncio.sleep(0.01)


@in_virtual_time
async def test_only_switches_are_switched_off() -> None:
    async with shop() as (site, bench):
        events = site.pointed()
        for name in ("door", "screws", "radio", "box_7"):
            for event in ("selected", "deselected"):
                point(bench, name, event)
        await settled()
        assert [(each.thing, each.is_on) async for each in events.during(0)] == [
            *(("door", True), ("screws", True), ("radio", True), ("radio", False))
        ]


@pytest.mark.parametrize(
    ("event", "names", "counts"),
    [("selected", ("screws",), True), ("selected", (), False), ("deselected", ("screws",), False)],
)
def test_only_named_things_fire_before_the_map_has_come(
    event: str, names: tuple[str, ...], *, counts: bool
) -> None:
    told = {"stamp_ns": 1, "event": event, "object_id": "screws", "user": "anna", "cause": "dwell"}
    assert is_reaction(SelectionEvent.model_validate(told), names, None) == counts


def test_reactions_ignore_a_switch_restored_after_a_restart() -> None:
    fields = {"stamp_ns": 1, "event": "selected", "object_id": "radio", "user": "anna"}
    for more in ("", "; told again after a restart of the selector"):
        event = SelectionEvent.model_validate({**fields, "reason": RESTORED + more})
        assert not any(is_reaction(event, ("radio",), room) for room in (ROOM, None))


@in_virtual_time
async def test_misspelt_thing_is_refused_at_once() -> None:
    async with shop() as (site, _bench):
        with pytest.raises(ConfigError, match=MISSPELT):
            site.pointed("radio", "scews")
        with pytest.raises(ConfigError, match=MISSPELT):
            site.on_pointed("scews")(print)


@in_virtual_time
async def test_misspelt_thing_is_refused_when_the_map_has_come() -> None:
    async with shop(has_map=False) as (site, bench):
        events = site.pointed("scews")
        site.on_pointed("scews")(print)
        bench.put(MAP, ROOM)
        with pytest.raises(ConfigError, match=MISSPELT):
            await anext(events)
        with pytest.raises(ConfigError, match=MISSPELT):
            await site.sleep(60)


@in_virtual_time
async def test_slow_function_delays_no_other_and_skips_calls_beyond_eight(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async with shop() as (site, bench):
        begun: list[int] = []
        others: list[int] = []

        @site.on_pointed("screws")
        async def prints(event: SelectionEvent) -> None:
            begun.append(event.stamp_ns)
            await asyncio.sleep(3600)

        @site.on_pointed("screws")
        async def counts(event: SelectionEvent) -> None:
            others.append(event.stamp_ns)

        assert callable(prints)
        assert callable(counts)
        for stamp_ns in range(100):
            point(bench, "screws", stamp_ns=stamp_ns)
        await settled()
        assert begun == list(range(MAX_AT_ONCE))
        assert others == list(range(100))
        warnings = [each.getMessage() for each in caplog.records if each.levelno == logging.WARNING]
        assert len(warnings) == 100 - MAX_AT_ONCE
        assert warnings[0].endswith("prints still runs 8 times: left out screws")
        await asyncio.sleep(3600)
        point(bench, "screws", stamp_ns=200)
        await settled()
        assert begun[-1] == 200


@in_virtual_time
async def test_reactions_end_with_the_site() -> None:
    before = asyncio.all_tasks()
    cancelled: list[bool] = []
    bus = MemoryBus()
    bench = Bench(bus, VirtualClock())
    bench.put(MAP, ROOM)
    async with Site.on(bus, VirtualClock()) as site:

        @site.on_pointed("screws")
        async def waits(_event: SelectionEvent) -> None:
            try:
                await asyncio.sleep(3600)
            finally:
                cancelled.append(True)

        assert callable(waits)
        point(bench, "screws")
        await settled()
        assert not cancelled
    assert cancelled == [True]
    assert asyncio.all_tasks() == before
    await bus.close()


class Shop:
    """A site of a script without services, and what publishes on it."""

    def __init__(self) -> None:
        self.thread = LoopThread()
        self._bench: Bench
        self.site = SyncSite(self._joined(), self.thread)

    @contextlib.asynccontextmanager
    async def _joined(self) -> AsyncGenerator[Site]:
        async with shop() as (site, self._bench):
            self._bench.put(SELECTION, Selection(stamp_ns=1))
            yield site

    def point(self, name: str) -> None:
        self.thread.call(lambda: point(self._bench, name))


@pytest.fixture
def script() -> Iterator[Shop]:
    script = Shop()
    with script.site:
        yield script


def test_script_iterates_over_events(script: Shop) -> None:
    events = script.site.pointed("radio")
    script.point("screws")
    script.point("radio")
    assert next(events).thing == "radio"


def test_script_waits_for_the_map_and_reports_its_absence() -> None:
    with SyncSite(in_memory(), LoopThread(virtual=True)) as site:
        for act in (lambda: next(site.pointed("screws")), site.on_pointed):
            with pytest.raises(NoMessageError, match="nothing came on map within 2 s"):
                act()


def test_tutorial_ends_with_a_sentence_when_the_map_lacks_things(
    script: Shop, monkeypatch: pytest.MonkeyPatch
) -> None:
    @contextlib.contextmanager
    def opened(**_: object) -> Generator[SyncSite]:
        yield script.site

    monkeypatch.setattr(pointit, "open", opened)
    (program,) = (each.code for each in blocks(SHELF, SHELF.read_text()) if each.title == "my_order.py")
    with pytest.raises(SystemExit, match=r"^my_order\.py: the map has no thing 'nuts'.*$") as ended:
        exec(compile(program, "my_order.py", "exec"), {})  # noqa: S102 - the tutorial's own
    assert "\n" not in str(ended.value)


def test_function_that_exits_is_named(script: Shop, caplog: pytest.LogCaptureFixture) -> None:
    @script.site.on_pointed("screws")
    def leaves(_event: SelectionEvent) -> None:
        raise SystemExit

    assert callable(leaves)
    script.point("screws")
    script.thread.run(until(lambda: "leaves failed for screws" in caplog.text))


def test_function_may_use_the_site_and_close_it(script: Shop) -> None:
    events = script.site.pointed("door")
    problems: list[str] = []

    @script.site.on_pointed("screws")
    def closes(_event: SelectionEvent) -> None:
        problems.append(script.site.problem)
        script.site.close()

    assert callable(closes)
    script.point("screws")
    with contextlib.suppress(BusClosedError):  # the loop ends where it waits: with its items or this error
        assert list(events) == []
    script.thread._thread.join(PATIENCE_S)
    assert not script.thread._thread.is_alive()
    assert problems == [""]


@in_virtual_time
async def test_return_of_a_carrying_function_is_the_acts_result() -> None:
    async with shop() as (site, bench):
        results: list[ActResult] = bench.collect(ACT_RESULTS)
        carriers: list[str] = []
        bench.bus.watch(CARRIER_ALIVE, lambda name, *, present: carriers.append(name if present else "ended"))

        @site.carries("screws", limit_s=2.0)
        async def order(event: SelectionEvent) -> None:
            if event.user == "bert":
                raise ValueError("none left")
            await asyncio.sleep(1.0 if event.user == "anna" else 3.0)

        @site.carries("radio")
        async def switch(event: SelectionEvent) -> None:
            assert event.is_on

        await until(lambda: len(carriers) == 2)
        for number, (name, user) in enumerate(
            (("screws", "anna"), ("screws", "bert"), ("screws", "carl"), ("radio", "anna"))
        ):
            fields = {"stamp_ns": START_NS + number, "event": "selected", "object_id": name, "user": user}
            own = next(
                each for each in carriers if each.startswith("order" if name == "screws" else "switch")
            )
            bench.put(SELECTION_EVENTS, SelectionEvent.model_validate(fields | {"carriers": (own,)}))
        await until(lambda: len(results) == 4, PATIENCE_S)
        assert {each.event_ns - START_NS: (each.result, each.text) for each in results} == {
            0: ("done", ""),
            1: ("failed", "order failed (ValueError: none left)"),
            2: ("failed", "not done within 2 s"),
            3: ("done", ""),
        }
    assert carriers[2:] == ["ended", "ended"]


@in_virtual_time
async def test_functions_are_called_when_the_map_comes_later_than_the_program() -> None:
    async with shop(has_map=False) as (site, bench):
        called: list[tuple[str, str]] = []

        @site.carries("radio")
        async def switch(event: SelectionEvent) -> None:
            called.append(("carried", event.object_id))

        @site.on_pointed("screws")
        async def react(event: SelectionEvent) -> None:
            called.append(("pointed", event.object_id))

        await site.sleep(60.0)
        bench.put(MAP, ROOM)
        carriers: list[str] = []
        bench.bus.watch(CARRIER_ALIVE, lambda name, *, present: carriers.append(name if present else "ended"))
        await until(lambda: len(carriers) == 1)

        fields = {"stamp_ns": bench.clock.now_ns(), "event": "selected", "object_id": "radio", "user": "anna"}
        bench.put(SELECTION_EVENTS, SelectionEvent.model_validate(fields | {"carriers": tuple(carriers)}))
        point(bench, "screws")
        await until(lambda: len(called) == 2)
        assert sorted(called) == [("carried", "radio"), ("pointed", "screws")]
        await site.sleep(1.0)


@pytest.mark.parametrize("limit_s", [0.0, 3601.0, float("nan")])
@in_virtual_time
async def test_a_limit_that_cannot_be_is_refused_at_once(limit_s: float) -> None:
    async with shop() as (site, _bench):
        with pytest.raises(ValueError, match=f"limit_s is {limit_s:g} s; give more than 0 s"):
            site.carries("screws", limit_s=limit_s)


def test_call_in_a_thread_ends_before_the_opposite_call_starts() -> None:
    begun: list[bool] = []
    end = threading.Event()

    def switch(event: SelectionEvent) -> None:
        begun.append(event.is_on)
        assert end.wait(PATIENCE_S)

    async def main() -> None:
        target = FunctionTarget(switch, 5.0)
        first = asyncio.create_task(target.carry_out(act_on("radio")))
        await until(lambda: begun == [True])
        first.cancel()
        second = asyncio.create_task(target.carry_out(act_on("radio", event="deselected")))
        await settled()
        assert begun == [True]
        end.set()
        await second

    with contextlib.closing(LoopThread()) as loop:  # virtual time would not wait for the thread
        loop.run(main())
    assert begun == [True, False]


CUP = TrackedObject(id="cup", kind="red", position_m=(1.0, 2.0, 0.8))


@pytest.fixture
def site() -> Iterator[SyncSite]:
    with SyncSite(in_memory(), LoopThread()) as site:
        yield site


def test_objects_may_come_from_a_generator_that_uses_the_site(site: SyncSite) -> None:
    things = site.objects("camera")
    site.tracker("camera").update(CUP for _ in [site.now_ns()])
    assert next(things).objects == (CUP,)


def test_the_thread_of_the_site_does_not_wait_for_itself(site: SyncSite) -> None:
    with pytest.raises(RuntimeError, match="the loop of the site cannot wait for itself"):
        site._thread.call(site.now_ns)


@pytest.mark.parametrize(("objects", "stamp_ns"), [([CUP], -1), ([7], 1)])
def test_wrong_objects_are_named(site: SyncSite, objects: list[TrackedObject], stamp_ns: int) -> None:
    with pytest.raises(SchemaError, match="objects/camera: "):
        site.tracker("camera").update(objects, stamp_ns=stamp_ns)


def test_an_empty_name_is_not_everybodys(site: SyncSite) -> None:
    with pytest.raises(KeyNameError, match="user ''"):
        site.cursors("")
    with pytest.raises(KeyNameError, match="user ''"):
        site.selections("")
    with pytest.raises(KeyNameError, match="lamp ''"):
        site.lamp("")


def test_traceback_of_a_wrong_name_hides_the_sites_thread(site: SyncSite) -> None:
    with pytest.raises(KeyNameError, match="user ''") as told:
        site.cursors("")
    assert [frame.name for frame in told.traceback[1:]] == ["iterating", "call", "run"]


def test_site_error_hides_the_library_error_behind_it() -> None:
    async def fail() -> None:
        raise ConnectError("nobody answers") from OSError(111, "refused")

    thread = LoopThread()
    with pytest.raises(ConnectError) as caught:
        thread.run(fail())
    thread.close()
    assert caught.value.__cause__ is None
    assert caught.value.__suppress_context__
