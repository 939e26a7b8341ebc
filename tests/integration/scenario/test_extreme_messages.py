"""Whatever one person may send, twice: no service fails, and those of others go on."""

import asyncio
from collections.abc import AsyncGenerator, Iterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from pointit import run_virtually
from pointit.access.rights import rights_of
from pointit.launch.plan.launches import Choices, site_launches, user_launches
from pointit.launch.plan.plan import read_scenario
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.errors import RefusedError
from pointit.runtime.service.service import Launch, run_service
from pointit.runtime.virtual_time import VirtualClock
from pointit.schemas import Environment, Health, Query
from pointit.schemas.topics import ACCOUNTS, ANY, HEALTH, MAP, REQUESTS, Request, topic_of
from pointit.services.registry import process
from tests.support import there
from tests.support.extreme_messages import extreme_messages

SENDER = "anna"
"""The person who sends it. Ben is somebody else."""
ROBOT = "quad"
OTHER_SERVICES = (
    "keeper", "recorder", "reactions", "speaker", "robot", "selector", "conveyor-sim",
    "web", "foxglove", "ros2",
)  # fmt: skip
"""Services that run in addition to those of the scenario, as far as it does not have them."""
OF_PEOPLE = ("goal", "listener", "localizer", "imu-bridge")
STARTED_S = 3.0
"""Time until all services run, and one person points, s of virtual time."""
MESSAGES_A_TICK = 20
TICK_S = 0.02
"""Time between `MESSAGES_A_TICK` messages, s: frames are drawn and timers end meanwhile."""
AFTER_S = 5.0
"""Time in which services would fail because of what they have stored, s."""


class RunningServices:
    """All services of one process, and the messages about their failures."""

    def __init__(self, exchange: LocalBroker, clock: VirtualClock) -> None:
        self.bus = MemoryBus(exchange)
        self.clock = clock
        self.health: dict[str, Health] = {}
        self.room: Environment | None = None
        self.tasks: dict[str, asyncio.Task[None]] = {}
        self._exchange = exchange
        self.bus.subscribe(HEALTH, self._on_health)
        self.bus.subscribe(MAP, self._on_map)

    def start(self, launches: Sequence[Launch]) -> None:
        """Run the services of `launches`, each as a participant of its own."""
        for launch in launches:
            running = run_service(launch, MemoryBus(self._exchange), self.clock)
            self.tasks[launch.instance] = asyncio.create_task(running, name=launch.instance)

    def failures(self) -> dict[str, str]:
        """Return by instance the failure of each service that has ended, or whose handler or timer raised."""
        ended = {name: f"has ended: {task}" for name, task in self.tasks.items() if task.done()}
        failing = {
            name: "; ".join(health.warnings) or f"{health.errors} errors"
            for name, health in self.health.items()
            if health.errors
        }
        return failing | ended

    async def stop(self) -> None:
        """End all services."""
        for task in self.tasks.values():
            task.cancel()
        await asyncio.gather(*self.tasks.values(), return_exceptions=True)

    def known_names(self) -> tuple[str, ...]:
        """Return names that exist on the site."""
        room = there(self.room)
        things = (*room.lamps, *room.strips, *room.belts, *room.things, *room.planes)
        return (SENDER, "ben", ROBOT, *(thing.id for thing in things[:4]))

    def _on_health(self, health: Health, name: str) -> None:
        if name in self.tasks and health.pid:  # a forged report has none
            self.health[name] = health

    def _on_map(self, room: Environment, _name: str) -> None:
        self.room = room


@asynccontextmanager
async def site(scenario: str, users: Sequence[str]) -> AsyncGenerator[RunningServices]:
    """Yield the services of `scenario` and others, with those of `users`, once all run."""
    plan = read_scenario(scenario)
    choices = Choices(seed=1)
    launches = list(site_launches(plan, choices))
    for index, user in enumerate(users):
        launches += user_launches(plan, choices, user, index)
    present = {launch.instance for launch in launches}
    for name in OTHER_SERVICES:
        kind = process(name).load()
        is_named = kind.SEVERAL and not kind.SHARDS
        launch = Launch(service=kind, config=kind.CONFIG(), name=ROBOT if is_named else "")
        if launch.instance not in present:
            launches.append(launch)
    for name in OF_PEOPLE:
        kind = process(name).load()
        of_person = [Launch(service=kind, config=kind.CONFIG(), user=user) for user in users]
        launches += [launch for launch in of_person if launch.instance not in present]
    running = RunningServices(LocalBroker(), VirtualClock())
    running.start(launches)
    try:
        await asyncio.sleep(STARTED_S)
        assert not running.failures()
        yield running
    finally:
        await running.stop()


def written_keys(*, of_accounts: bool) -> list[str]:
    """Return the keys that `SENDER` may write: of the accounts of the own services, or all others."""
    accounts = tuple(topic.key.partition("/")[0] for topic in ACCOUNTS)
    return [key for key in rights_of("user", SENDER).writes if key.startswith(accounts) == of_accounts]


async def send_messages(services: RunningServices, keys: Sequence[str]) -> int:
    """Put all extremes of the messages of `keys`. Return their number."""
    count = 0
    for key in keys:
        topic = there(topic_of(key))
        publisher = services.bus.publisher(topic, topic.name_in(key))
        plain = {"stamp_ns": services.clock.now_ns()}  # else it is late
        for message in extreme_messages(topic.message, plain, services.known_names()):
            publisher.put(message)
            count += 1
            await asyncio.sleep(0 if count % MESSAGES_A_TICK else TICK_S)
        await asyncio.sleep(TICK_S)
        publisher.close()
    return count


async def send_requests(services: RunningServices) -> list[str]:
    """Send all extremes of what `SENDER` may ask. Return the failures, which are refusals with a cause."""
    failures: list[str] = []
    for request, name in permitted_requests():
        queries: Iterator[Query] = extreme_messages(request.query, {}, services.known_names())
        for query in queries:
            try:
                await services.bus.call(request, query, name, timeout_s=AFTER_S)
            except RefusedError as refusal:
                if " failed on " in str(refusal):
                    failures.append(f"{query!r}: {refusal}")
    return failures


def permitted_requests() -> Iterator[tuple[Request[Any, Any], str]]:
    """Yield the requests that `SENDER` may send, with the name in the key, but for the scenario's own."""
    asks = rights_of("user", SENDER).asks
    for request in REQUESTS:
        name = {"": "", "user": SENDER}.get(request.placeholder, ROBOT)
        if request.at(name) in asks or (request.placeholder and request.at(ANY) in asks):
            yield request, name


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("POINTIT_STATE", str(tmp_path / "state"))
    monkeypatch.chdir(tmp_path)  # the recording


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["scenario_3", "scenario_2", "shelf"])
def test_no_service_fails_on_extreme_messages_of_one_person(scenario: str) -> None:
    async def main() -> None:
        async with site(scenario, ("anna", "ben")) as services:
            failures: list[str] = []
            for _ in range(2):  # the second time, they meet what the first has left
                assert await send_messages(services, written_keys(of_accounts=False)) > 1000
                failures += await send_requests(services)
                await asyncio.sleep(AFTER_S)
                assert not services.failures()
            assert not failures

    run_virtually(main())


@pytest.mark.slow
def test_no_service_fails_on_forged_accounts_of_one_person() -> None:
    async def main() -> None:
        async with site("scenario_3", ("ben",)) as services:  # those of the sender would end
            for _ in range(2):
                assert await send_messages(services, written_keys(of_accounts=True)) > 1000
                await asyncio.sleep(AFTER_S)
                assert not services.failures()

    run_virtually(main())
