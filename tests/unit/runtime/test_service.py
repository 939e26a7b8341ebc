"""A service's life: constructed, present, reporting, ended; alone and with others."""

import asyncio
import json
from collections.abc import AsyncIterator
from typing import Any, ClassVar

import pytest
import pytest_asyncio

from pointit.runtime.bus.instrumented import ServedPublisher
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.clock import MAX_SLEW_S
from pointit.runtime.config.config import Config, published_parameters
from pointit.runtime.errors import BusClosedError, RefusedError
from pointit.runtime.service import service as service_module
from pointit.runtime.service.service import Context, Launch, Scope, Service, run_service, run_services
from pointit.schemas import (
    Configuration,
    Done,
    Health,
    ServedRequest,
    SetBrightness,
    UserProfile,
    encode,
    topics,
)
from pointit.services.registry import PROCESSES, Process
from tests.support.bench import ManualClock, until


class Worker(Service[Config]):
    """Writes a state, answers a request, works until cancelled."""

    NAME: ClassVar[str] = "worker"
    SCOPE: ClassVar[Scope] = "user"
    CONFIG = Config

    running: "ClassVar[list[Worker]]"

    def __init__(self, config: Config, context: Context) -> None:
        super().__init__(config, context)
        self.go_on = asyncio.Event()
        self.failure: Exception | None = None
        self.cleaned_up = False
        self.profiles = self.bus.publisher(topics.PROFILE, self.user)
        self.profiles.put(UserProfile(stamp_ns=1, seq=1))
        self.bus.serve(topics.SET_BRIGHTNESS, self._on_brightness)
        self.running.append(self)

    async def _on_brightness(self, _query: SetBrightness, _name: str) -> Done:
        return Done()

    async def run(self) -> None:
        try:
            await self.go_on.wait()
            if self.failure is not None:
                raise self.failure
        finally:
            self.profiles.put(UserProfile(stamp_ns=2, seq=2))  # the bus is still there
            self.cleaned_up = True


class SteppingWorker(Worker):
    TIME_MAY_STEP: ClassVar[bool] = True


class OneOfSeveral(Service[Config]):
    """One of several of a site, whose name it notes."""

    NAME: ClassVar[str] = "worker"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = Config
    SEVERAL: ClassVar[bool] = True

    names: "ClassVar[list[str]]"

    def __init__(self, config: Config, context: Context) -> None:
        super().__init__(config, context)
        self.names.append(self.name)


class Bench:
    def __init__(self) -> None:
        self.exchange = LocalBroker()
        self.bus = MemoryBus(self.exchange)
        self.other = MemoryBus(self.exchange)
        self.health: list[Health] = []
        self.alive: dict[str, bool] = {}
        self.other.subscribe(topics.HEALTH, lambda message, _name: self.health.append(message))
        self.other.watch(topics.SERVICE_ALIVE, self._on_presence)
        self.other.watch(topics.USER_ALIVE, self._on_presence)

    def _on_presence(self, name: str, *, present: bool) -> None:
        self.alive[name] = present

    def launch(self, user: str = "anna") -> Launch:
        return Launch(service=Worker, config=Config(), user=user)


@pytest_asyncio.fixture
async def bench(monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Bench]:
    monkeypatch.setattr(service_module, "HEALTH_PERIOD_S", 0.02)
    Worker.running = []
    OneOfSeveral.names = []
    bench = Bench()
    yield bench
    await bench.bus.close()
    await bench.other.close()


async def test_service_is_present_and_reports_while_it_runs(bench: Bench) -> None:
    task = asyncio.create_task(run_service(bench.launch(), bench.bus, ManualClock()))
    await until(lambda: bench.alive == {"worker.anna": True, "anna": True})
    await until(lambda: len(bench.health) >= 3)
    assert [report.seq for report in bench.health[:3]] == [1, 2, 3]
    assert bench.health[0].instance == "worker.anna"
    assert bench.exchange.states[topics.PROFILE.key]
    assert bench.exchange.handler_for(topics.SET_BRIGHTNESS, "") is not None

    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert Worker.running[0].cleaned_up
    await until(lambda: bench.alive == {"worker.anna": False, "anna": False})
    assert not bench.exchange.states[topics.PROFILE.key]
    assert bench.exchange.handler_for(topics.SET_BRIGHTNESS, "") is None
    assert not bench.bus.declarations


async def test_service_is_present_from_its_readiness_to_its_last_task(bench: Bench) -> None:
    states: list[tuple[bool, bool]] = []

    def told(_name: str, *, present: bool) -> None:
        served = bench.exchange.handler_for(topics.SET_BRIGHTNESS, "") is not None
        states.append((present, served))

    bench.other.watch(topics.SERVICE_ALIVE, told)
    task = asyncio.create_task(run_service(bench.launch(), bench.bus, ManualClock()))
    await until(lambda: states == [(True, True)])
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    await until(lambda: states == [(True, True), (False, False)])


async def test_later_of_two_processes_keeps_the_name(bench: Bench) -> None:
    launch = Launch(service=OneOfSeveral, config=Config(), name="quad")
    assert (launch.instance, launch.is_single) == ("worker.quad", True)
    task = asyncio.create_task(run_service(launch, bench.bus, ManualClock()))
    await until(lambda: bool(bench.health) and bench.alive == {"worker.quad": True})
    assert OneOfSeveral.names == ["quad"]
    rival = bench.health[0].model_copy(update={"pid": 1, "host": "elsewhere", "stamp_ns": 2**62})
    publisher = bench.other.publisher(topics.HEALTH, "worker.quad")
    async with asyncio.timeout(20):
        while not task.done():
            publisher.put(rival)  # again, as a process does: of two reports at once the newer one wins
            await asyncio.wait({task}, timeout=0.05)
    await task
    await until(lambda: bench.alive == {"worker.quad": False})


async def test_a_run_that_returns_ends_the_service(bench: Bench) -> None:
    task = asyncio.create_task(run_service(bench.launch(), bench.bus, ManualClock()))
    await until(lambda: bool(Worker.running))
    Worker.running[0].go_on.set()
    async with asyncio.timeout(20):
        await task
    await until(lambda: bench.alive["worker.anna"] is False)


async def test_a_service_that_raises_ends_all_with_its_error(bench: Bench) -> None:
    launches = [bench.launch(user) for user in ("anna", "ben", "carl")]
    task = asyncio.create_task(run_services(launches, bench.bus, ManualClock()))
    await until(lambda: len(Worker.running) == 3 and all(bench.alive.values()))
    broken = Worker.running[1]
    broken.failure = ZeroDivisionError("broken")
    broken.go_on.set()
    with pytest.raises(ExceptionGroup) as caught:
        await task
    assert caught.group_contains(ZeroDivisionError, match="broken")
    assert all(worker.cleaned_up for worker in Worker.running)
    await until(lambda: not any(bench.alive.values()))
    assert not bench.bus.declarations


async def test_a_constructor_that_raises_leaves_nothing_behind(bench: Bench) -> None:
    class Broken(Worker):
        def __init__(self, config: Config, context: Context) -> None:
            super().__init__(config, context)
            raise LookupError("no map")

    launch = Launch(service=Broken, config=Config(), user="anna")
    with pytest.raises(LookupError):
        await run_service(launch, bench.bus, ManualClock())
    assert not bench.bus.declarations
    assert bench.alive == {}


@pytest.mark.parametrize(
    ("kind", "back_s", "count"),
    [(Worker, MAX_SLEW_S - 1.0, 1), (Worker, MAX_SLEW_S + 1.0, 2), (SteppingWorker, 3600.0, 1)],
)
async def test_service_restarts_when_its_clock_is_set_back_too_far(
    bench: Bench, kind: type[Worker], back_s: float, count: int
) -> None:
    clock = ManualClock()
    launch = Launch(service=kind, config=Config(), user="anna")
    task = asyncio.create_task(run_service(launch, bench.bus, clock))
    await until(lambda: bool(bench.health))

    (first,) = Worker.running
    before_ns = first.clock.now_ns()
    clock.advance(-back_s)
    assert (first.clock.now_ns() >= before_ns) is (kind is Worker)

    reports = len(bench.health)
    await until(lambda: len(bench.health) > reports + 3)
    assert len(Worker.running) == count
    assert first.cleaned_up is (count > 1)
    if count > 1:
        assert Worker.running[-1].clock.now_ns() == clock.now_ns()
        assert bench.alive == {"worker.anna": True, "anna": True}

    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    assert not bench.bus.declarations


async def test_a_bus_closed_beneath_a_service_ends_it_without_complaint(bench: Bench) -> None:
    class Quiet(Worker):
        async def run(self) -> None:
            await asyncio.Event().wait()

    launch = Launch(service=Quiet, config=Config(), user="anna")
    task = asyncio.create_task(run_service(launch, bench.bus, ManualClock()))
    await until(lambda: bool(bench.health))
    await bench.bus.close()
    async with asyncio.timeout(20):
        await task


async def test_services_use_of_a_closed_bus_is_its_own_error(bench: Bench) -> None:
    task = asyncio.create_task(run_service(bench.launch(), bench.bus, ManualClock()))
    await until(lambda: bool(bench.health))
    await bench.bus.close()
    with pytest.raises(ExceptionGroup) as caught:
        async with asyncio.timeout(20):
            await task
    assert caught.group_contains(BusClosedError)


class DimmerConfig(Config):
    SECRETS = frozenset({"token"})

    gain: float = 0.5
    token: str = "hush"  # noqa: S105 - no real one


class Dimmer(Service[DimmerConfig]):
    NAME: ClassVar[str] = "dimmer"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = DimmerConfig

    def __init__(self, config: DimmerConfig, context: Context) -> None:
        super().__init__(config, context)
        self.bus.serve(topics.SET_BRIGHTNESS, self._on_brightness)

    async def _on_brightness(self, query: SetBrightness, _name: str) -> Done:
        if query.brightness != 0.5:
            raise RefusedError("half or nothing")
        return Done(message="dimmed")


@pytest_asyncio.fixture
async def bus() -> AsyncIterator[MemoryBus]:
    """Yield another participant of a site on which a dimmer runs."""
    exchange = LocalBroker()
    own = MemoryBus(exchange)
    other = MemoryBus(exchange)
    launch = Launch(service=Dimmer, config=DimmerConfig(gain=0.75))
    task = asyncio.create_task(run_service(launch, own, ManualClock()))
    await until(lambda: exchange.handler_for(topics.SET_BRIGHTNESS, "") is not None)
    yield other
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    await own.close()
    await other.close()


async def test_parameters_of_a_running_service_are_published_without_secrets(bus: MemoryBus) -> None:
    told: dict[str, Configuration] = {}
    bus.subscribe(topics.CONFIGURATION, lambda message, name: told.__setitem__(name, message))
    await until(lambda: "dimmer" in told)
    assert json.loads(told["dimmer"].parameters) == {"gain": 0.75}
    assert (told["dimmer"].service, told["dimmer"].user) == ("dimmer", "")
    assert told["dimmer"].release


async def test_answered_requests_are_published_with_their_reply_or_refusal(bus: MemoryBus) -> None:
    told: list[tuple[str, ServedRequest]] = []
    bus.subscribe(topics.SERVED, lambda message, name: told.append((name, message)))
    await bus.call(topics.SET_BRIGHTNESS, SetBrightness(brightness=0.5))
    with pytest.raises(RefusedError, match="half or nothing"):
        await bus.call(topics.SET_BRIGHTNESS, SetBrightness(brightness=0.25))
    await until(lambda: len(told) == 2)
    (name, done), (_, refused) = told
    assert (name, done.request, done.seq, refused.seq) == ("dimmer", "leds/brightness", 1, 2)
    assert SetBrightness.model_validate_json(done.query) == SetBrightness(brightness=0.5)
    assert (Done.model_validate_json(done.reply), done.refusal) == (Done(message="dimmed"), "")
    assert (refused.reply, refused.refusal) == ("", "half or nothing")


async def answered(publisher: Any, reply: Done) -> Done:
    async def serve(_query: SetBrightness, _name: str) -> Done:
        return reply

    served = ServedPublisher(publisher, ManualClock(), service="dimmer", instance="dimmer")
    return await served.reporting(topics.SET_BRIGHTNESS, serve)(SetBrightness(brightness=0.5), "")


async def test_large_reply_is_given_but_omitted_from_the_published_request(bus: MemoryBus) -> None:
    told: list[ServedRequest] = []
    bus.subscribe(topics.SERVED, lambda message, _name: told.append(message))
    large = Done(message="x" * ServedRequest.max_bytes)
    assert await answered(bus.publisher(topics.SERVED, "dimmer.2"), large) is large
    await until(lambda: bool(told))
    assert (told[0].reply, told[0].refusal) == ("", "")
    assert len(encode(told[0])) < ServedRequest.max_bytes


@pytest.mark.parametrize("row", [pytest.param(row, id=row.name) for row in PROCESSES])
def test_parameters_of_every_process_survive_the_way_through_json(row: Process) -> None:
    config = row.config()()
    assert row.config().model_validate_json(published_parameters(config)) == config
