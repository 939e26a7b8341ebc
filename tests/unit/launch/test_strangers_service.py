"""A service of another package, with a topic and a request of its own: found, started, permitted, guarded."""

import asyncio
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pointit.access.rights import rights_of
from pointit.cli.inspect.listings import plugins
from pointit.cli.inspect.topics import resolve
from pointit.diagnosis.observation import silence_reason, start_command
from pointit.launch.plan.launches import Choices, site_launches, user_launches
from pointit.launch.plan.plan import read_scenario
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.clock import WallClock
from pointit.runtime.config.config import Config
from pointit.runtime.errors import ConfigError, ListenError, first_cause
from pointit.runtime.service import plugin_guard
from pointit.runtime.service.service import Launch, Service, check_launches, run_service, run_services
from pointit.schemas import SelectionEvent, topics
from pointit.schemas.topics import Delivery, Topic
from pointit.services import registry
from pointit.services.service_plugin import ServicePlugin
from tests.support import strangers
from tests.support.bench import until

MODULE = """
import asyncio
from typing import ClassVar

from pydantic import Field

from pointit.plugins import Config, Delivery, Message, Query, Reply, Request, Service, ServicePlugin, Topic
from pointit.plugins import topics

class Count(Message):
    selected: int = 0

class Reset(Query): ...

class ResetReply(Reply): ...

class CounterConfig(Config):
    start: int = Field(default=0, ge=-1, description="first number; -1: it cannot check it")
    lives: int = Field(default=0, description="number of events after which it fails; 0: never")

def topic(key, *writers):
    return Topic(key=key, message=Count, delivery=Delivery.STATE, rate_hz=None, writers=writers, about="")

COUNTS = topic("counter/{user}", "counter")
RESET = Request(key="counter/reset", query=Reset, reply=ResetReply, server="counter", about="start again")

class Counter(Service[CounterConfig]):
    NAME: ClassVar = "counter"
    SCOPE: ClassVar = "site"
    CONFIG = CounterConfig

    def __init__(self, config, context):
        super().__init__(config, context)
        self.count = config.start
        self.bus.serve(RESET, self.reset)
        self.bus.subscribe(topics.SELECTION_EVENTS, self.on_event)
        self.failed = asyncio.Event()

    def on_event(self, event, name):
        self.count += 1
        self.bus.publisher(COUNTS, event.user).put(Count(stamp_ns=event.stamp_ns, selected=self.count))
        if self.count == self.config.lives:
            self.failed.set()

    @classmethod
    def validate_config(cls, config):
        if config.start < 0:
            raise LookupError("no such number")

    async def reset(self, query, name):
        self.count = 0
        return ResetReply()

    async def run(self):
        await self.failed.wait()
        if self.config.start:
            once = self.bus.publisher(COUNTS, "once")
            once.close()
            once.put(Count(stamp_ns=1))
        raise ValueError("it has lived long enough")

def other(**changes):
    return ServicePlugin(**{"summary": "", "config": CounterConfig, "make": Counter} | changes)

ROWS = dict(reads=(topics.SELECTION_EVENTS,), writes=(COUNTS,), serves=(RESET,), asks=(topics.SET_SPEED,))
COUNTER = other(summary="counts selections", **ROWS)

class Greedy(Counter):
    NAME: ClassVar = "greedy"

GREEDY = other(make=Greedy, writes=(topic("users/{user}/{user}", "greedy"),))
MISNAMED = other()
BROKEN = other(make=print)

class Personal(Counter):
    NAME: ClassVar = "personal"
    SCOPE: ClassVar = "user"

OWN = topic("personal/{user}/count", "personal")
PERSONAL = other(make=Personal, writes=(OWN, topics.POSE), asks=(topics.SET_POSE, topics.SET_SPEED))
"""

ENTRIES = """
counter = strangers_services:COUNTER
greedy = strangers_services:GREEDY
misnamed = strangers_services:MISNAMED
broken = strangers_services:BROKEN
personal = strangers_services:PERSONAL
lost = strangers_services:LOST [ble]
selector = strangers_services:COUNTER
"""


@pytest.fixture(autouse=True)
def _installed(tmp_path: Path) -> Iterator[None]:
    with strangers.installed(tmp_path, "strangers_services", MODULE, services=ENTRIES):
        yield


def counter() -> Launch:
    choices = Choices(services=["counter"], settings=["counter.lives=2"])
    (launch,) = (each for each in site_launches(read_scenario("scenario_3"), choices) if each.plugin)
    return launch


def test_service_is_found_without_importing_any_and_started_on_request() -> None:
    assert {"counter", "lost"} < set(registry.names())
    assert registry.names().count("selector") == 1  # ours stays ours
    assert all(row.plugin is None for row in registry.PROCESSES)
    launch = counter()
    assert (launch.instance, launch.plugin) == ("counter", "service 'counter' of strangers-parts")
    assert launch.config.model_dump() == {"start": 0, "lives": 2}
    assert registry.process("counter").command == ("-m", "pointit.services", "counter")
    assert user_launches(read_scenario("scenario_3"), Choices(services=["counter"]), "anna")
    assert [row.name for row in registry.PROCESSES if row.plugin is not None] == ["counter"]


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        (
            "absent",
            "--with absent: no service 'absent'; there are imu-bridge, .*, broken, counter, greedy, l",
        ),
        ("lost", r"'lost' of strangers-parts cannot be imported \(.*\); install strangers-parts\[ble\]"),
        ("misnamed", "cannot be used: NAME of Counter must be 'misnamed'"),
        ("greedy", "cannot be used: its key users/{user}/{user} must begin with greedy/"),
        ("broken", "'broken' of strangers-parts cannot be used: its make must be a subclass of Service"),
    ],
)
def test_service_that_cannot_be_used_is_refused_in_one_sentence(name: str, sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        site_launches(read_scenario("scenario_3"), Choices(services=[name]))
    registry.add_installed()
    assert [row.name for row in registry.PROCESSES if row.plugin is not None] == ["counter", "personal"]


def made(name: str, scope: str = "site", **rows: Any) -> ServicePlugin:
    kind = type("Made", (Service,), {"NAME": name, "SCOPE": scope, "CONFIG": Config})
    return ServicePlugin(summary="", config=Config, make=kind, **rows)


def own(key: str, writer: str = "evil") -> Topic[Any]:
    event = Delivery.EVENT
    return Topic(key=key, message=SelectionEvent, delivery=event, rate_hz=None, writers=(writer,), about="")


@pytest.mark.parametrize(
    ("key", "sentence"),
    [
        ("**", "must begin with evil/"),
        ("*/pose", "must begin with evil/"),
        ("{user}/pose", "must begin with evil/"),
        ("map/evil", "must begin with evil/"),
        ("evil/**", "must consist of names"),
        ("evil/*", "must consist of names"),
        ("evil/$*", "must consist of names"),
        ("evil/a{user}", "must consist of names"),
        ("evil/{user}{user}", "must consist of names"),
        ("evil/{user}/{led}", "must consist of names"),
        ("evil//a", "must consist of names"),
        ("evil/@adv", "must consist of names"),
    ],
)
def test_key_that_others_may_have_is_refused(key: str, sentence: str) -> None:
    made("evil", writes=(own("evil/{user}/a.b"),)).check("evil")
    made("my-lamp", writes=(own("my_lamp/a", "my-lamp"),)).check("my-lamp")
    with pytest.raises(ConfigError, match=sentence):
        made("evil", writes=(own(key),)).check("evil")


def test_key_of_a_row_of_the_tables_is_refused() -> None:
    row = own("leds/{user}", "leds")
    with pytest.raises(ConfigError, match=r"its key leds/\{user\} is that of another row .*, leds/leases"):
        made("leds", writes=(row,)).check("leds")
    with pytest.raises(ConfigError, match="is that of another row"):
        made("leds", reads=(row,)).check("leds")


@pytest.mark.parametrize(
    ("plugin", "sentence"),
    [
        (made("pointing.anna"), "its NAME 'pointing.anna' must be of letters"),
        (made("a b"), "its NAME 'a b' must be of letters"),
        (made("evil", "all"), "SCOPE of Made must be 'site' or 'user'"),
        (
            made("evil", "user", writes=(topics.MAP,)),
            "its SCOPE is 'user', so its key map must contain {user}",
        ),
        (made("evil", "user", writes=(topics.LAMP_COLOR,)), "its key leds/{led}/color must contain {user}"),
        (made("evil", "user", writes=(own("evil/a"),)), "its key evil/a must contain {user}"),
        (
            made("evil", writes=(topics.IMU,)),
            "cannot write users/{user}/imu of all people: its SCOPE must be",
        ),
        (made("evil", writes=(topics.HEALTH,)), "it cannot write health/{service}"),
        (made("evil", writes=(own("lamp/a", "lamp"),)), "it cannot write lamp/a, whose writers are lamp"),
        (
            made("evil", serves=(topics.SET_SPEED,)),
            "it cannot answer conveyor/set_speed, whose server is conveyor-sim",
        ),
    ],
)
def test_service_that_would_take_rights_of_others_is_refused(plugin: ServicePlugin, sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        plugin.check(plugin.make.NAME)


def test_personal_service_gets_rights_at_its_persons_name_only() -> None:
    rights = rights_of("user", "anna")
    assert {"personal/anna/count", "users/anna/pose", "health/personal.anna"} <= set(rights.writes)
    assert {"localizer/anna/set_pose", "conveyor/set_speed"} <= set(rights.asks)
    anyones = {topics.STOP_ROBOT.at(topics.ANY)}
    assert not any("*" in key for key in {*rights.writes, *rights.serves, *rights.asks} - anyones)
    assert "personal.anna can write it and runs" in silence_reason(topics.POSE, "anna", {"personal.anna"})


def test_plugin_rows_are_in_the_tables_and_give_rights() -> None:
    before = len(topics.TOPICS), len(topics.REQUESTS)
    rights = rights_of("services", "supervisor")
    assert (len(topics.TOPICS), len(topics.REQUESTS)) == (before[0] + 2, before[1] + 1)
    assert {"counter/*", topics.HEALTH.at("counter")} <= set(rights.writes)
    assert "counter/reset" in rights.serves
    assert "conveyor/set_speed" in rights.asks
    assert "counter/*" in rights_of("dashboard", "screen").reads
    assert "counter/*" not in rights_of("user", "anna").writes
    ((counts, name),) = resolve("counter/anna")
    assert name == "anna"
    assert start_command("counter") == "pointit service run counter"
    assert "counter can write it and runs" in silence_reason(counts, "anna", {"counter"})
    assert {"--with counter", "--with lost"} <= {row["use"] for row in plugins().rows}


def test_service_raising_in_its_check_is_refused_in_a_sentence() -> None:
    launch = replace(counter(), config=registry.process("counter").config()(start=-1))
    with pytest.raises(ConfigError, match=r"counter: service 'counter' .*\(LookupError: no such number\)"):
        check_launches([launch])


async def test_service_alone_in_its_process_ends_unless_it_has_started(
    monkeypatch: pytest.MonkeyPatch, bus: MemoryBus
) -> None:
    monkeypatch.setattr(plugin_guard, "FIRST_WAIT_S", 0.001)
    launch = replace(counter(), config=registry.process("counter").config()(), is_alone=True)
    lives: list[str] = []

    async def run(_self: object) -> None:
        lives.append("")
        await asyncio.sleep(0.0 if len(lives) != 2 else 40.0)
        raise ListenError("127.0.0.1:8765 is in use: choose another port")

    monkeypatch.setattr(launch.service, "run", run)
    with pytest.raises(ExceptionGroup) as raised:
        async with asyncio.timeout(60):
            await run_service(launch, bus, WallClock())
    assert (len(lives), str(first_cause(raised.value))) == (
        1,
        "127.0.0.1:8765 is in use: choose another port",
    )
    work = asyncio.create_task(run_service(launch, bus, WallClock()))
    await until(lambda: len(lives) > 2, 60, "a restart after 40 s")
    assert not work.done()
    work.cancel()
    await asyncio.wait({work})


@pytest.mark.parametrize(
    ("start", "failure"), [(0, "ValueError: it has lived long enough"), (1, "BusClosedError: ")]
)
async def test_failing_service_is_named_and_restarted_and_ends_nothing_else(
    start: int, failure: str, monkeypatch: pytest.MonkeyPatch, bus: MemoryBus
) -> None:
    monkeypatch.setattr(plugin_guard, "FIRST_WAIT_S", 0.001)
    launch = replace(counter(), config=registry.process("counter").config()(start=start, lives=2))
    ((counts, _),) = resolve("counter/*")
    seen: list[int] = []
    warnings: list[str] = []
    bus.subscribe(counts, lambda count, _name: seen.append(count.selected))
    bus.subscribe(topics.HEALTH, lambda health, _name: warnings.extend(health.warnings), "counter")
    events = bus.publisher(topics.SELECTION_EVENTS)
    work = asyncio.create_task(run_services([launch], bus, WallClock()))

    def select(_round: Any = None) -> bool:
        events.put(SelectionEvent(stamp_ns=1, event="selected", object_id="a", user="anna"))
        return seen.count(2) == 2

    await until(select, what="a second life")
    await until(lambda: bool(warnings), what="a warning")
    assert warnings[0].startswith(f"service 'counter' of strangers-parts failed ({failure}")
    assert not work.done()
    if start:
        await bus.close()
    else:
        work.cancel()
    await asyncio.wait({work})
    assert work.cancelled() is not bus.is_closed
