"""One scenario gives way to another: nothing of the first is left, and what cannot begin changes nothing."""

import asyncio
import functools
import itertools
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import pytest

from pointit.cli.page import RunPage
from pointit.cli.run.run import _Run
from pointit.launch.page import page_of
from pointit.launch.plan.launches import Choices, Settings
from pointit.launch.plan.plan import Plan, read_scenario
from pointit.launch.plan.scenario_catalog import ScenarioCatalog, scenario_launches
from pointit.launch.run.running_scenario import RunningScenario
from pointit.runtime.bus.contract import Bus
from pointit.runtime.clock import WallClock
from pointit.runtime.errors import RefusedError
from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Deployment, Environment, Health, Message, RunScenario
from pointit.schemas.topics import (
    CONVEYOR_STATE,
    DEPLOYMENT,
    HEALTH,
    LAMP_COLOR,
    MAP,
    POSE,
    PROFILE,
    RUN_SCENARIO,
    SELECTION,
    SERVICE_ALIVE,
    USER_ALIVE,
    Topic,
)
from tests.support.bench import until
from tests.support.buses import free_port
from tests.support.commands import change
from tests.unit.cli_run.stand_in import Broken, StandIn

PATIENCE_S = 20.0
STATES: tuple[Topic[Any], ...] = (CONVEYOR_STATE, LAMP_COLOR, POSE, PROFILE, SELECTION)
TWICE = "led-driver.outputs=[{kind: expander, port: /nowhere}, {kind: expander, port: /nowhere}]"
"""Found wrong when the service begins, not before."""


def plan_of(
    name: str = "scenario_4",
    people: int = 1,
    settings: tuple[str, ...] = (),
    service: type[StandIn] = StandIn,
    **said: Any,
) -> Plan:
    scenario = read_scenario(name)
    choices = Choices(settings=settings)
    program = ScenarioCatalog.beginning_with(name, name, scenario, choices)
    plan = Plan(
        name=name, scenario=name, launches=scenario_launches(scenario, Choices(), people),
        link=Link(listen=(f"tcp/127.0.0.1:{free_port()}",)), target_kinds=scenario.target_kinds,
        offers=program.offered, another=program.plan,
        beside=[RunPage(replace(page_of(Settings(), asked={"port": 0}), load=lambda: service))],
    )  # fmt: skip
    return replace(plan, **said)


@dataclass
class Seen:
    """State of the bus as seen by an early or a late subscriber."""

    bus: Bus
    services: set[str] = field(default_factory=set[str])
    people: set[str] = field(default_factory=set[str])
    deployments: dict[str, Deployment] = field(default_factory=dict[str, Deployment])
    states: dict[str, set[str]] = field(default_factory=lambda: {topic.key: set() for topic in STATES})
    """By key pattern, the names that have a state."""
    rooms: list[str] = field(default_factory=list[str])

    def look(self) -> None:
        self.bus.watch(SERVICE_ALIVE, lambda name, *, present: change(self.services, name, here=present))
        self.bus.watch(USER_ALIVE, lambda name, *, present: change(self.people, name, here=present))
        self.bus.subscribe(DEPLOYMENT, self._on_deployment)
        self.bus.subscribe(MAP, self._on_map)
        for topic in STATES:
            self.bus.subscribe(topic, functools.partial(self._on_state, topic.key))

    def _on_state(self, key: str, _message: Message, name: str) -> None:
        self.states[key].add(name)

    def _on_deployment(self, deployment: Deployment, name: str) -> None:
        self.deployments[name] = deployment
        if not deployment.services:
            del self.deployments[name]

    def _on_map(self, room: Environment, _name: str) -> None:
        self.rooms.append(room.name)

    def has(self, services: set[str], people: set[str]) -> bool:
        return (self.services, self.people) == (services, people)

    def runs(self, scenario: str) -> bool:
        return any(deployment.scenario == scenario for deployment in self.deployments.values())


@asynccontextmanager
async def late_joiner(bus: ZenohBus) -> AsyncGenerator[Seen]:
    """Yield somebody in another session, who has just come."""
    joined = await ZenohBus.open(Link(connect=bus.link.listen), patience_s=30)
    seen = Seen(joined)
    seen.look()
    try:
        yield seen
    finally:
        await joined.close()


@dataclass
class Going:
    run: _Run
    bus: ZenohBus
    task: asyncio.Task[None]

    @property
    def stage(self) -> RunningScenario:
        assert self.run.stage is not None
        return self.run.stage

    async def asks(self, scenario: str, **asked: Any) -> None:
        """Ask for another scenario. Zenoh may take 10 s to end a declaration; wishes wait in turn."""
        await self.bus.call(RUN_SCENARIO, RunScenario(scenario=scenario, **asked), timeout_s=3 * PATIENCE_S)


@asynccontextmanager
async def going(plan: Plan) -> AsyncGenerator[Going]:
    bus = await ZenohBus.open(plan.link)
    run = _Run(plan, bus, None)
    task = asyncio.create_task(run.live(WallClock()))
    try:
        await until(
            lambda: task.done() or bool(bus.exchange.request_servers.get(RUN_SCENARIO.key)), PATIENCE_S, "run"
        )
        yield Going(run, bus, task)
    finally:
        task.cancel()
        await asyncio.wait({task})
        await bus.close()


async def test_nothing_of_the_scenario_before_is_left(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    async with going(plan_of(people=2)) as run, late_joiner(run.bus) as onlooker:
        await until(lambda: run.stage.monitor.first_cursor_unix_s is not None, PATIENCE_S, "a cursor")
        await until(lambda: onlooker.people == {"user1", "user2"}, PATIENCE_S, "two people")
        await until(lambda: onlooker.runs("scenario_4"), PATIENCE_S, "the deployment")

        first = run.stage.monitor
        await run.asks("scenario_2", users=1)
        assert run.stage.plan.name == "scenario_2"
        assert run.stage.monitor is not first
        assert run.stage.monitor.score.target_kinds == ()

        async with late_joiner(run.bus) as late:
            await until(lambda: bool(late.deployments and late.rooms), PATIENCE_S, "the other scenario")
            wanted = {"pui", "led-driver", "keeper", "web"}
            wanted |= {f"{name}.user1" for name in ("pointing", "localizer", "supervisor", "user-sim")}
            for seen in (onlooker, late):
                await until(functools.partial(seen.has, wanted, {"user1"}), PATIENCE_S, f"{seen} to change")
            await until(lambda: bool(late.states[POSE.key] and late.states[PROFILE.key]), PATIENCE_S, "state")
            assert late.rooms == ["lab"]
            assert late.states[POSE.key] == late.states[PROFILE.key] == {"user1"}
            assert late.states[CONVEYOR_STATE.key] == late.states[SELECTION.key] == set()
            assert set(late.deployments) == {"run.scenario_2"}

            told = late.deployments["run.scenario_2"]
            assert (told.scenario, told.localizes) == ("scenario_2", False)
            assert set(told.scenarios) >= {"scenario_1", "scenario_4"}
            assert {each.service for each in told.services} == {name.partition(".")[0] for name in wanted}
        await until(lambda: run.stage.monitor.cursor_count > 0, PATIENCE_S, "a cursor in the other scenario")
    assert not [record for record in caplog.records if record.levelname in {"ERROR", "CRITICAL"}]


async def test_the_page_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(StandIn, "viewers", 0)
    async with going(plan_of("scenario_2")) as run:
        uptimes: list[float] = []
        run.bus.subscribe(HEALTH, lambda health, _name: uptimes.append(health.uptime_s), "web")
        await until(lambda: bool(uptimes), PATIENCE_S, "the page")
        await run.asks("scenario_1")
        await until(lambda: uptimes[-1] > 1.0, PATIENCE_S, "the same page")
        assert uptimes == sorted(uptimes)


async def test_wishes_are_granted_one_after_the_other() -> None:
    async with going(plan_of("scenario_2")) as run:
        names: list[str] = []
        run.bus.subscribe(DEPLOYMENT, lambda told, _name: names.extend([told.scenario] * bool(told.services)))
        wishes = [asyncio.create_task(run.asks(name)) for name in ("scenario_1", "scenario_3", "scenario_2")]
        await asyncio.gather(*wishes)
        assert run.stage.plan.name == "scenario_2"
        order = ["scenario_2", "scenario_1", "scenario_3", "scenario_2"]
        await until(lambda: [name for name, _ in itertools.groupby(names)] == order, what=f"not {names}")


async def _report(bus: Bus, user: str) -> None:
    reports = bus.publisher(HEALTH, f"pointing.{user}")
    health = Health(stamp_ns=1, service="pointing", instance=f"pointing.{user}", user=user, pid=1, host="far")
    while True:
        reports.put(health)
        await asyncio.sleep(0.1)


async def test_a_wish_that_cannot_be_changes_nothing() -> None:
    async with going(plan_of("scenario_2")) as run, late_joiner(run.bus) as beside:
        await until(lambda: beside.runs("scenario_2"), PATIENCE_S, "a run")
        there: set[str] = set()
        run.bus.watch(USER_ALIVE, lambda name, *, present: change(there, name, here=present))
        beside.bus.announce(USER_ALIVE, "user2")  # somebody has joined under that name
        reporting = asyncio.create_task(_report(beside.bus, "user2"))
        await until(lambda: "user2" in there, what="user2")

        before = run.stage.monitor
        with pytest.raises(RefusedError, match="user2: already on site lab; choose another name"):
            await run.asks("scenario_1", users=2)

        reporting.cancel()
        await asyncio.wait({reporting})
        assert run.stage.monitor is before

        count = before.cursor_count
        await until(lambda: before.cursor_count > count, PATIENCE_S, "more cursors")
        assert beside.deployments["run.scenario_2"].services


async def test_former_scenario_begins_again_when_the_next_cannot_begin() -> None:
    async with going(plan_of("scenario_2", settings=(TWICE,))) as run:
        await until(lambda: run.stage.monitor.cursor_count > 0, PATIENCE_S, "a cursor")
        with pytest.raises(
            RefusedError, match=r"scenario_1 could not start \(.*used by two.*\); scenario_2 was restarted"
        ):
            await run.asks("scenario_1")
        assert run.stage.plan.name == "scenario_2"
        await until(lambda: run.stage.monitor.cursor_count > 0, PATIENCE_S, "a cursor again")
        assert not run.task.done()


async def test_a_site_without_people_of_its_own_takes_no_wish() -> None:
    async with going(replace(plan_of("scenario_2", people=0), another=None, offers=())) as run:
        with pytest.raises(RefusedError, match="--site-only"):
            await run.asks("scenario_1")


async def test_a_run_goes_on_while_somebody_looks_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pointit.launch.run.run_site.VIEWER_SILENT_S", 3600.0)
    monkeypatch.setattr("pointit.runtime.service.service.HEALTH_PERIOD_S", 0.2)
    monkeypatch.setattr(StandIn, "viewers", 1)
    async with going(plan_of("scenario_2", duration_s=3600.0)) as run:
        await until(run.run._is_looked_on, PATIENCE_S, "somebody")
        run.stage.plan = replace(run.stage.plan, duration_s=0.0)  # over, as the page's next report shows
        reports: list[Health] = []
        run.bus.subscribe(HEALTH, lambda health, _name: reports.append(health), "web", retained=False)
        await until(lambda: run.task.done() or len(reports) > 2, PATIENCE_S, "reports")
        assert not run.task.done()

        monkeypatch.setattr("pointit.launch.run.run_site.VIEWER_SILENT_S", 0.0)
        run.run._viewers.until_s = 0.0  # the page is closed after its next report
        async with asyncio.timeout(60.0):
            await run.task
        assert run.run.lasted_s > 0.0


@pytest.mark.parametrize(("viewers", "is_limited"), [(1, True), (0, False)])
async def test_it_ends_in_time(monkeypatch: pytest.MonkeyPatch, viewers: int, *, is_limited: bool) -> None:
    monkeypatch.setattr(StandIn, "viewers", viewers)
    async with going(plan_of("scenario_2", duration_s=1.5, is_limited=is_limited)) as run:
        async with asyncio.timeout(60.0):
            await run.task
        assert run.run.lasted_s == pytest.approx(1.5)


async def test_a_page_that_cannot_be_is_told_and_costs_nothing(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")

    def told_of() -> list[str]:
        return [text for text in caplog.messages if "page" in text]

    async with going(plan_of("scenario_2", service=Broken)) as run:
        await until(lambda: bool(told_of()), PATIENCE_S, "the page's end")
        count = run.stage.monitor.frame_count
        await until(lambda: run.stage.monitor.frame_count > count, PATIENCE_S, "frames after it")
    assert told_of() == ["the page has ended (the port is taken); the run continues without it"]
