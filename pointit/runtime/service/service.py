"""Services, and the common start and end of one or many of them."""

import asyncio
import contextlib
import logging
from abc import ABC
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, Literal, TypeVar
from urllib.parse import quote

from pointit.runtime.bus.contract import Bus, Publisher
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.clock import MAX_SLEW_S, Clock, SteadyClock
from pointit.runtime.config.config import Config, published_parameters
from pointit.runtime.errors import BusClosedError, ConfigError, PointItError, describe, first_cause
from pointit.runtime.host.extras import pointit_version
from pointit.runtime.host.state_file import plugin_folder
from pointit.runtime.service.instance_takeover import TakeoverMonitor
from pointit.runtime.service.people_share import check_people
from pointit.runtime.service.plugin_guard import (
    NullHealth,
    PluginGuard,
    PluginHealth,
    Surroundings,
    watch_for_stalls,
)
from pointit.schemas import Configuration, Environment, Health
from pointit.schemas.problems import TWICE
from pointit.schemas.system import check_user, instance_of
from pointit.schemas.topics import CONFIGURATION, HEALTH, SERVICE_ALIVE, USER_ALIVE

log = logging.getLogger(__name__)


C = TypeVar("C", bound=Config)
Scope = Literal["site", "user"]

HEALTH_PERIOD_S = 1.0
START_S = 30.0
"""Time in which a plug-in that is alone in its process ends it if it is refused, s."""


@dataclass(frozen=True, kw_only=True)
class Context:
    """The environment of a service."""

    bus: ServiceBus
    clock: Clock
    user: str = ""
    """User that owns the service, or `""` for a shared service."""
    name: str = ""
    """Its name among several of its kind on the site, or `""`."""


class Service(ABC, Generic[C]):
    """A process of PointIt: it subscribes, calls its pure core, and publishes what that returns.

    A service is a shell. It knows the bus, the clock and timers, and decides nothing; decisions are in cores
    beside it, which get messages and the time and return messages. So a decision is tested without a network,
    and a replay repeats it.

        class Greeter(Service[GreeterConfig]):
            NAME, SCOPE, CONFIG = "greeter", "site", GreeterConfig

            def __init__(self, config: GreeterConfig, context: Context) -> None:
                super().__init__(config, context)
                self._core = Greetings(config)
                self.bus.subscribe(topics.SELECTION_EVENTS, self._on_event)

    The constructor declares everything on the bus and publishes the first states. `run` holds the periodic
    work. Both run in the event loop, so neither may block. `run_service` starts it, reports its presence and
    health, and starts a failed plug-in again.
    """

    NAME: ClassVar[str]
    """Name in the registry, such as `led-driver`."""
    SCOPE: ClassVar[Scope]
    """One instance for all users (`site`) or one per user (`user`)."""
    CONFIG: ClassVar[type[Config]]
    SEVERAL: ClassVar[bool] = False
    """True if a site may have several instances of a shared service, each with a name: `robot.quad`."""
    SHARDS: ClassVar[bool] = False
    """True if each named instance serves the users in its parameter `people` (`PeopleShare`), and the
    instance without a name all others."""
    MAKES_USER_PRESENT: ClassVar[bool] = True
    """True if a running instance means that its user is present. False for services that may outlive
    pointing, and for those of other packages."""
    TIME_MAY_STEP: ClassVar[bool] = False
    """If False, the clock never goes back during a run (`SteadyClock`), and the service restarts if the
    site's time goes back too far. True for bridges and for services whose state a restart would lose: they
    handle steps of the clock."""

    def __init__(self, config: C, context: Context) -> None:
        """Store both. Subclasses declare their publishers first and their subscriptions last."""
        self.config = config
        self.bus = context.bus
        self.clock = context.clock
        self.user = context.user
        self.name = context.name

    @classmethod
    def validate_config(cls, config: C) -> None:
        """Check for errors that do not depend on the site. Called before a bus is opened, and may read files.

        Raises:
            ConfigError: Names the parameter or file and the remedy.
        """

    @classmethod
    def validate_link(cls, config: C, addresses: Sequence[str]) -> None:
        """Check `config` against `addresses`, where the process connects or listens, before a bus is opened.

        Raises:
            ConfigError: Names the parameter and the address and the remedy.
        """

    @classmethod
    def validate_map(cls, config: C, room: Environment) -> None:
        """Check that the map of a run has what `config` needs. Called before a bus is opened.

        Raises:
            ConfigError: Names the missing part and the remedy.
        """

    @classmethod
    def discard_saved_state(cls, site: str, now_ns: int) -> None:
        """Delete the state that an earlier run of `site` stored for resumption. Called before a new run.

        The state of a service that is running stays.
        """

    def surroundings(self, kind: str, name: str, user: str = "", which: str = "") -> Surroundings:
        """Return the surroundings of the plug-in `name` of a `kind`, such as `imu_sources`, for `user`.

        `which` distinguishes several of one name in this service, such as by their addresses.
        """
        label = " ".join(filter(None, (name, which, user)))
        health = PluginHealth(self.bus, label)
        user = user or self.user
        folder_name = name
        if which:
            folder_name = f"{name}@{quote(which, safe='')}"
        folder = plugin_folder(self.bus.site, user, kind, folder_name)
        return Surroundings(clock=self.clock, health=health, folder=folder, user=user)

    async def run(self) -> None:
        """Run until cancelled. Services that only react need not override it."""
        await asyncio.Event().wait()


AnyService = Service[Any]


@dataclass(frozen=True, kw_only=True)
class Launch:
    """A service to start, with its configuration and its person."""

    service: type[AnyService]
    config: Config
    user: str = ""
    name: str = ""
    """Its name among several of its kind on the site, or `""`."""
    plugin: str = ""
    """Name in messages of a service from another package, whose faults end no other service, or `""`."""
    is_alone: bool = False
    """True if it is the only service of its process, which ends if that of another package cannot start."""

    @property
    def instance(self) -> str:
        """Return the name under which it is present: `selector`, `pointing.anna`, `robot.quad`."""
        return instance_of(self.service.NAME, self.user or self.name)

    @property
    def is_single(self) -> bool:
        """Return True if only one process may have its instance name. The one that started last keeps it."""
        if self.user or self.name:
            return True
        return self.service.SEVERAL and not self.service.SHARDS


def check_launches(launches: Sequence[Launch], addresses: Sequence[str] = ()) -> None:
    """Check the configuration of every service, before anything is opened or started.

    Raises:
        ConfigError: If one cannot work. Names the instance.
    """
    for launch in launches:
        try:
            launch.service.validate_config(launch.config)
            launch.service.validate_link(launch.config, addresses)
            if launch.service.SHARDS:
                check_people(launch.service.NAME, getattr(launch.config, "people", ()), launch.name)
        except ConfigError as error:
            raise ConfigError(f"{launch.instance}: {error}") from error
        except Exception as error:
            if not launch.plugin:
                raise
            problem = f"{launch.plugin} cannot check its configuration ({describe(error)})"
            raise ConfigError(f"{launch.instance}: {problem}; update or uninstall it") from error


async def run_service(launch: Launch, bus: Bus, clock: Clock) -> None:
    """Run one service until it ends, is cancelled or `bus` is closed, or a person's name is taken over.

    Whatever it raises ends it and is raised here, in a group. A service is present from when it is ready
    until all its tasks have ended. It is restarted if `clock` was set back too far to be slewed. A service of
    another package is also restarted, with back-off, whenever it ends or raises. If it is alone in its
    process, a `PointItError` in its first `START_S` ends it: its user is still looking.
    """
    if launch.user:
        check_user(launch.user)
    guard = PluginGuard(launch.plugin, NullHealth()) if launch.plugin else None
    started_s = asyncio.get_running_loop().time() + START_S if launch.is_alone else 0.0
    while True:
        # A clock of its own for each start: the one before may be ahead of a clock that was set back
        steady = SteadyClock(clock, may_step=launch.service.TIME_MAY_STEP)
        error: BaseException | None = None
        try:
            end = await _run_once(launch, bus, steady, guard)
        except Exception as raised:
            end = "ended"
            error = first_cause(raised)
            # A closed bus ends a plug-in, too: its publishers raise BusClosedError
            if guard is None or bus.is_closed:
                raise
            is_first_start = asyncio.get_running_loop().time() < started_s
            if is_first_start and isinstance(error, PointItError):
                raise
        if end == "set back":
            log.warning(
                "%s restarts: the clock was set back by more than %.0f s", launch.instance, MAX_SLEW_S
            )
        elif guard is None or end == "over":
            return
        else:
            await _wait_for_restart(launch, bus, steady, guard, guard.failed(error))


async def _run_once(
    launch: Launch, bus: Bus, clock: SteadyClock, guard: PluginGuard | None
) -> Literal["ended", "set back", "over"]:
    """Run one service. Return the reason of its end: itself, its clock, or a lost bus or name."""
    kind = launch.service
    own_bus = ServiceBus(bus, clock, kind.NAME, launch.instance, launch.user)
    takeover = TakeoverMonitor(bus, launch.instance)
    if launch.plugin:
        watch_for_stalls(kind.__module__, launch.plugin, own_bus, is_service=True)
    try:
        service = kind(launch.config, Context(bus=own_bus, clock=clock, user=launch.user, name=launch.name))
        health = own_bus.account(HEALTH)
        own_bus.account(CONFIGURATION).put(_configuration(launch, clock.now_ns()))
        own_bus.announce(SERVICE_ALIVE, launch.instance)
        if launch.user and kind.MAKES_USER_PRESENT and not launch.plugin:
            own_bus.announce(USER_ALIVE, launch.user)
        if not launch.plugin and kind.__module__.startswith("pointit."):
            # not before: nobody waits for a service that is not present yet, and its modules are loaded
            watch_for_stalls(kind.__module__, launch.instance, own_bus, is_service=True)
        log.debug("%s started", launch.instance)
        async with asyncio.TaskGroup() as group:
            running = service.run() if guard is None else guard.run(service.run)
            work = group.create_task(running, name=launch.instance)
            reporting = _report(own_bus, health, takeover, clock, guard)
            report = group.create_task(reporting, name=f"{launch.instance} health")
            tasks = {work, report}
            if launch.is_single:  # duplicates of other shared services both continue, with a warning
                holding = _until_lost(takeover, launch)
                tasks.add(group.create_task(holding, name=f"{launch.instance} name"))
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in tasks:
                task.cancel()
        if not report.cancelled() and report.result():
            return "set back"
        return "ended" if done == {work} else "over"
    finally:
        takeover.close()
        await own_bus.close()
        log.debug("%s ended", launch.instance)


def _configuration(launch: Launch, now_ns: int) -> Configuration:
    return Configuration(
        stamp_ns=now_ns,
        service=launch.service.NAME,
        instance=launch.instance,
        user=launch.user,
        parameters=published_parameters(launch.config),
        release=pointit_version(),
    )


async def _wait_for_restart(
    launch: Launch, bus: Bus, clock: SteadyClock, guard: PluginGuard, wait_s: float
) -> None:
    """Report the health of a failed service of another package until its restart is due."""
    own_bus = ServiceBus(bus, clock, launch.service.NAME, launch.instance, launch.user)
    try:
        health = own_bus.account(HEALTH)
        own_bus.announce(SERVICE_ALIVE, launch.instance)
        own_bus.warn("plug-in", guard.problem, guard.label)
        with contextlib.suppress(BusClosedError):
            for _ in range(round(wait_s / HEALTH_PERIOD_S)):
                health.put(own_bus.report())
                await asyncio.sleep(HEALTH_PERIOD_S)
    finally:
        await own_bus.close()


async def _until_lost(takeover: TakeoverMonitor, launch: Launch) -> None:
    await takeover.superseded.wait()
    ends = launch.instance
    by = takeover.successor
    log.error("%s ends: %s, which started later, has taken over its name", ends, by)


async def _report(
    own_bus: ServiceBus,
    health: Publisher[Health],
    takeover: TakeoverMonitor,
    clock: SteadyClock,
    guard: PluginGuard | None,
) -> bool:
    """Publish health until the bus is closed, or until a restart is due: then return True."""
    with contextlib.suppress(BusClosedError):  # closed by its owner: no error
        while not clock.needs_restart():
            own_bus.warn(TWICE, takeover.duplicate_instance_warning())
            own_bus.warn("plug-in", "" if guard is None else guard.problem)
            health.put(own_bus.report())
            await asyncio.sleep(HEALTH_PERIOD_S)
        return True
    return False


async def run_services(launches: Sequence[Launch], bus: Bus, clock: Clock) -> None:
    """Run services concurrently until cancelled. If one fails, all end and its error is raised."""
    async with asyncio.TaskGroup() as group:
        for launch in launches:
            group.create_task(run_service(launch, bus, clock), name=f"service {launch.instance}")
