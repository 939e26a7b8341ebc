"""The running scenario: its services, which start and stop together, its monitor, and switching to another.

Publishes the deployment of a run: scenario, services and the commands that restart them.

A run that ends on purpose publishes an empty deployment. The deployment of a run that dies is retained, and
`doctor` reports the missing services.
"""

import asyncio
import logging
import re
import sys
import time
from collections.abc import Callable, Sequence

from pointit.launch.plan.plan import WATCHERS, Beside, Plan
from pointit.launch.run.monitor import Monitor, RunScore
from pointit.launch.run.processes import Processes
from pointit.runtime.bus.contract import UNDECLARE_S, Bus, Closable, Publisher
from pointit.runtime.clock import Clock, wait_up_to
from pointit.runtime.errors import ConfigError, first_cause
from pointit.runtime.host.extras import present
from pointit.runtime.link.link import Link
from pointit.runtime.machine import this_machine
from pointit.runtime.service.instance_takeover import claim_names
from pointit.runtime.service.service import Launch, run_services
from pointit.schemas import Deployment, ExpectedService
from pointit.schemas.system import RUN
from pointit.schemas.topics import DEPLOYMENT, SERVICE_ALIVE, USER_ALIVE

log = logging.getLogger(__name__)

Line = tuple[Launch, tuple[str, ...]]
"""A service, and the command that restarts it."""
Tell = Callable[[str], object]
"""Shows a message to the operator: in the log, or above the view."""

SECRET = re.compile(r"(token[^=]*=).*", re.DOTALL)
"""An assignment with a secret value."""
PRESENCE_TIMEOUT_S = 0.3
"""Time to listen for services that are already present."""
GONE_S = UNDECLARE_S + 0.05
"""Time after which late subscribers receive no retained state of ended services any more."""


class ServiceGroup:
    """Launches on a bus; `on_end` is called when they end unexpectedly."""

    def __init__(
        self,
        launches: Sequence[Launch],
        bus: Bus,
        clock: Clock,
        *,
        link: Link | None,
        on_end: Callable[[], None],
        is_supervised: bool = False,
    ) -> None:
        """Start nothing yet.

        `link`: the link that services in processes of their own join. None: they run in this process,
        and `on_end` is called when they end unexpectedly. `is_supervised`: see `Processes`.
        """
        self.launches = launches
        self._bus = bus
        self._clock = clock
        self._on_end = on_end
        self._work: asyncio.Task[None] | None = None
        self._children: Processes | None = None
        if link is not None:
            self._children = Processes(
                launches, site=link.site, connect=link.addresses[0], is_supervised=is_supervised
            )

    @property
    def has_ended(self) -> bool:
        """Return True if all have ended."""
        return self._work is not None and self._work.done()

    def commands(self) -> list[tuple[str, ...]]:
        """Return the command that restarts each launch, without secrets because it is published."""
        if self._children is None:
            command = ("pointit", *redact_secrets(sys.argv[1:]))
            return [command] * len(self.launches)
        return [self._children.command(launch) for launch in self.launches]

    async def begin(self) -> None:
        """Start the services. Return when all are present, or when all processes are started.

        Raises:
            Exception: The error that ended one of them at startup; the others have ended too.
        """
        if self._children is not None:
            await self._children.__aenter__()
            return
        missing = {launch.instance for launch in self.launches}
        settled = asyncio.Event()

        def on_presence(name: str, *, present: bool) -> None:
            if present:
                missing.discard(name)
            if not missing:
                settled.set()

        def on_end(_work: asyncio.Task[None]) -> None:
            settled.set()
            self._on_end()

        # watched from before the start, and until all are present or one has ended
        watching = self._bus.watch(SERVICE_ALIVE, on_presence)
        try:
            running = run_services(self.launches, self._bus, self._clock)
            self._work = asyncio.create_task(running, name="services")
            self._work.add_done_callback(on_end)
            if missing:
                await settled.wait()
        finally:
            watching.close()
        self.check()

    def check(self) -> None:
        """Raise the error that ended them, if they have ended.

        Raises:
            Exception: That error.
        """
        work = self._work
        if work is None or not work.done():
            return
        if not work.cancelled():
            work.result()

    async def end(self) -> None:
        """Stop and clean up all started services, also those that have ended by themselves."""
        if self._children is not None:
            await self._children.__aexit__(None, None, None)
        if self._work is not None:
            self._work.cancel()
            await asyncio.wait({self._work})


def redact_secrets(arguments: Sequence[str]) -> list[str]:
    """Return the command line `arguments` with secret values removed."""
    return [SECRET.sub(r"\1…", argument) for argument in arguments]


class DeploymentPublisher:
    """Publishes the deployment of the current run; there is one at a time."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._name = ""
        self._publisher: Publisher[Deployment] | None = None
        self._subscription: Closable | None = None
        self._stamp_ns = 0
        """Stamp of the last published deployment."""
        self._is_anothers = False
        """Another process has published under the same name since then."""

    def post(self, plan: Plan, lines: Sequence[Line]) -> None:
        """Publish the services of `plan`, which replaces the last deployment."""
        name = plan.name if plan.person else f"{RUN}{plan.name}"
        # Another person, or none, has another key. The last writer takes its deployment along.
        if self._publisher is None or self._name != name:
            self.retract()
            self._publisher = self._bus.publisher(DEPLOYMENT, name)
            self._name = name
            self._subscription = self._bus.subscribe(DEPLOYMENT, self._on_deployment, name, retained=False)
        self._stamp_ns = this_machine().now_ns()
        self._is_anothers = False
        services: list[ExpectedService] = []
        for launch, command in lines:
            kind = launch.service.NAME
            service = ExpectedService(service=kind, user=launch.user, name=launch.name, command=command)
            services.append(service)
        deployment = Deployment(
            stamp_ns=self._stamp_ns,
            name=plan.name,
            services=tuple(services),
            scenario=plan.scenario,
            title=plan.title,
            scenarios=tuple(offer.name for offer in plan.offers),
            offers=tuple(plan.offers),
            localizes=plan.localizes,
            target_kinds=tuple(plan.target_kinds),
            goal=plan.goal,
        )
        self._publisher.put(deployment)

    def retract(self) -> None:
        """Publish that nothing should run any more, unless another process has taken over the name."""
        publisher = self._publisher
        self._publisher = None
        if publisher is not None:
            if not self._is_anothers:
                publisher.put(Deployment(stamp_ns=this_machine().now_ns(), name=self._name))
            publisher.close_nowait()
        if self._subscription is not None:
            self._subscription.close()
            self._subscription = None

    def _on_deployment(self, deployment: Deployment, _name: str) -> None:
        self._is_anothers |= deployment.stamp_ns > self._stamp_ns


class _Companion:
    """A service beside the scenario. When it ends, the run continues without it."""

    def __init__(self, beside: Beside) -> None:
        self.beside = beside
        self.group: ServiceGroup | None = None
        self.has_begun = False
        self.is_lost = False

    async def begin(self, group: ServiceGroup) -> None:
        self.group = group
        await group.begin()

    def check(self) -> None:
        try:
            if self.group is not None:
                self.group.check()
        except Exception as error:  # noqa: BLE001 - whatever it was, the scenario goes on
            self.give_up(error)

    def give_up(self, error: Exception) -> None:
        if not self.is_lost:
            kind = self.beside.WHAT
            log.error("the %s has ended (%s); the run continues without it", kind, _sentence(error))
        self.is_lost = True


class RunningScenario:
    """Running services, in this process or others. Background services outlive a change of scenario."""

    def __init__(
        self,
        plan: Plan,
        bus: Bus,
        link: Link,
        clock: Clock,
        *,
        tell: Tell,
        news: Tell | None,
        on_end: Callable[[], None],
        on_beside: Callable[[Beside], None],
    ) -> None:
        """Create it without starting a service.

        `link`: connection of services in separate processes. `tell` shows messages to the operator. `news`
        gets event lines if there is no view. `on_end` is called when services end unexpectedly, `on_beside`
        when background services have started.
        """
        self.plan = plan
        self.bus = bus
        self._link = link
        self.clock = clock
        self.monitor = Monitor(RunScore(plan.target_kinds), clock)
        self.began_s = time.monotonic()
        self.saw_cursor = False
        """A scenario before this one had a cursor."""
        self._show_message = tell
        self._on_event_line = news
        self._on_end = on_end
        self._on_beside = on_beside
        self._deployment_publisher = DeploymentPublisher(bus)
        self._service_group: ServiceGroup | None = None
        self._companions = [_Companion(beside) for beside in plan.beside]
        self._companion_starts: list[asyncio.Task[None]] = []

    @property
    def end_s(self) -> float | None:
        """Return the monotonic time at which its duration ends, or None if it never does."""
        if self.plan.duration_s is None:
            return None
        return self.began_s + self.plan.duration_s / self.clock.speed

    @property
    def has_ended(self) -> bool:
        """Return True if the scenario's services have ended by themselves."""
        return self._service_group is not None and self._service_group.has_ended

    @property
    def address(self) -> str:
        """Return the URL of a service beside the scenario, such as the page, or `""`."""
        for companion in self._companions:
            is_running = companion.has_begun and not companion.is_lost
            if is_running and companion.beside.address:
                return companion.beside.address
        return ""

    async def begin(self) -> None:
        """Start the plan's services, and beside them what it waits for, or else starts in the background.

        Raises:
            Exception: The error that ended a service at startup.
        """
        in_background: list[_Companion] = []
        for companion in self._companions:
            if not companion.beside.WAIT_S:
                in_background.append(companion)
                continue
            group = self._new_companion_group(companion, companion.beside.launch())
            await companion.begin(group)
            await _until_present(self.bus, companion.beside, companion.beside.WAIT_S)

        # The others start after the scenario, which they must not delay
        await self._start(self.plan)
        for companion in in_background:
            starting = self._start_companion(companion)
            task = asyncio.create_task(starting, name=f"starting the {companion.beside.WHAT}")
            self._companion_starts.append(task)

    async def switch_to(self, plan: Plan) -> None:
        """Run `plan` in place of the current plan. If it cannot start, restart the current plan.

        Raises:
            ConfigError: If it cannot start, with the reason.
        """
        previous = self.plan
        # Names are claimed before the current plan stops: without them, it goes on
        new_users = set(plan.users) - set(previous.users)
        await claim_names(self.bus, USER_ALIVE, new_users)
        await self._stop()
        try:
            await self._start(plan)
        except Exception as error:
            await self._stop()
            await self._start(previous)
            reason = _sentence(error)
            raise ConfigError(
                f"{plan.name} could not start ({reason}); {previous.name} was restarted"
            ) from error
        for note in plan.notes:
            self._show_message(note)

    async def end(self) -> None:
        """Stop everything.

        Raises:
            Exception: The error that ended a service before.
        """
        for task in self._companion_starts:
            task.cancel()
        if self._companion_starts:
            await asyncio.wait(self._companion_starts)

        self.monitor.detach()  # the summary needs the last state of people who leave now
        if not self.has_ended:  # else it failed and stays in the deployment as missing
            self._deployment_publisher.retract()

        # The companions end after it, since a page shows the end, and last those that it waited for.
        if self._service_group is not None:
            await self._service_group.end()
        for companion in sorted(self._companions, key=lambda companion: companion.beside.WAIT_S):
            if companion.group is not None:
                await companion.group.end()
        if self._service_group is not None:
            self._service_group.check()

    async def _start(self, plan: Plan) -> None:
        """Start the services of `plan` with a new monitor, and publish the deployment."""
        self.plan = plan
        kinds = (*present(WATCHERS), *plan.watchers)
        watchers = [kind(plan.launches) for kind in kinds]
        self.monitor = Monitor(
            RunScore(plan.target_kinds),
            self.clock,
            person=plan.person,
            tell=self._on_event_line,
            watchers=watchers,
        )
        self.monitor.attach(self.bus)
        for launch in plan.launches:
            if launch.service.SHARDS and launch.name:
                continue  # the site's is another's
            launch.service.discard_saved_state(self.bus.site, self.clock.now_ns())
        self._service_group = self._new_group(plan.launches, on_end=self._on_end)

        addresses = self._link.listen or self._link.connect
        instances = ", ".join(launch.instance for launch in plan.launches)
        log.info("%s starts on site %s at %s: %s", plan.name, self.bus.site, addresses[0], instances)
        self._publish_deployment()
        self.began_s = time.monotonic()
        await self._service_group.begin()

    async def _stop(self) -> None:
        """Stop the scenario. Return when no retained state of it is left."""
        # Retracted first: what ends on purpose is not missing
        self._deployment_publisher.retract()
        if self._service_group is not None:
            await self._service_group.end()
            self._service_group = None
        self.saw_cursor |= self.monitor.first_cursor_unix_s is not None
        self.monitor.detach()
        await asyncio.sleep(GONE_S)

    def _new_group(self, launches: Sequence[Launch], on_end: Callable[[], None]) -> ServiceGroup:
        link = self._link if self.plan.processes else None
        return ServiceGroup(launches, self.bus, self.clock, link=link, on_end=on_end)

    def _new_companion_group(self, companion: _Companion, launch: Launch) -> ServiceGroup:
        """Return the group of a companion, in a supervised process of its own if it needs one."""
        if not companion.beside.needs_own_process(self._link):
            return self._new_group([launch], on_end=companion.check)
        return ServiceGroup(
            [launch], self.bus, self.clock, link=self._link, on_end=companion.check, is_supervised=True
        )

    async def _start_companion(self, companion: _Companion) -> None:
        try:
            launch = await asyncio.to_thread(companion.beside.launch)
            await companion.begin(self._new_companion_group(companion, launch))
        except Exception as error:  # noqa: BLE001 - whatever it was, the scenario goes on
            companion.give_up(error)
            return
        if self._service_group is not None:  # else another scenario is about to start, and publishes both
            self._publish_deployment()
        # a service of this process is present by now, but a process has only been started
        await _until_present(self.bus, companion.beside, None)
        companion.has_begun = True
        self._on_beside(companion.beside)

    def _publish_deployment(self) -> None:
        lines: list[Line] = []
        for group in (self._service_group, *(companion.group for companion in self._companions)):
            if group is not None:
                lines += zip(group.launches, group.commands(), strict=True)
        self._deployment_publisher.post(self.plan, lines)


async def _until_present(bus: Bus, beside: Beside, timeout_s: float | None) -> None:
    """Wait for a service, also as a process, but no longer than `timeout_s`. None: without limit."""
    is_present = asyncio.Event()

    def on_presence(name: str, *, present: bool) -> None:
        if present and name == beside.instance:
            is_present.set()

    subscription = bus.watch(SERVICE_ALIVE, on_presence)
    try:
        await wait_up_to(is_present, timeout_s)
    finally:
        subscription.close()


def _sentence(error: BaseException) -> str:
    cause = first_cause(error)
    return str(cause) or type(cause).__name__
