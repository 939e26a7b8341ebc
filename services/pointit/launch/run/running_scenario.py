"""The running scenario: its services, its monitor, and switching to another scenario."""

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable, Sequence
from typing import cast

from pointit.launch.page.page import Page
from pointit.launch.plan.plan import Plan
from pointit.launch.robots.robot_score import RobotsScore, spots_of
from pointit.launch.run.deployment_publisher import DeploymentPublisher, Line
from pointit.launch.run.monitor import Monitor
from pointit.launch.run.score import Score
from pointit.launch.run.service_group import ServiceGroup
from pointit.runtime.bus.contract import UNDECLARE_S, Bus
from pointit.runtime.clock import Clock
from pointit.runtime.errors import ConfigError
from pointit.runtime.link.link import Link
from pointit.runtime.service.instance_takeover import claim_names
from pointit.runtime.service.service import Launch
from pointit.schemas.topics import SERVICE_ALIVE, USER_ALIVE

log = logging.getLogger(__name__)

PRESENCE_PATIENCE_S = 0.3
"""Time to listen for services that are already present."""

RECORDER_PATIENCE_S = 10.0
"""Time that a run waits for its recorder, so that the recording has its beginning."""

GONE_S = UNDECLARE_S + 0.05
"""Time after which late subscribers receive no retained state of ended services any more."""

Tell = Callable[[str], object]
"""Shows a message to the operator: in the log, or above the view."""


class RunningScenario:
    """The running services, here or as processes. The page stays when the scenario changes."""

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
        on_page: Callable[[Page], None],
    ) -> None:
        """Create it; starts nothing yet.

        Args:
            plan: the first plan to run.
            bus: bus of the run.
            link: of `bus`, for services in processes of their own.
            clock: clock of all services.
            tell: shows messages to the operator.
            news: receives event lines, if there is no view.
            on_end: called when services end unexpectedly.
            on_page: called when the page is present.
        """
        self.plan = plan
        self.bus = bus
        self._link = link
        self.clock = clock
        self.monitor = Monitor(Score(plan.target_kinds), clock)
        self.began_s = time.monotonic()
        self.saw_cursor = False
        """A scenario before this one had a cursor."""
        self._tell = tell
        self._news = news
        self._on_end = on_end
        self._on_page = on_page
        self._notice = DeploymentPublisher(bus)
        self._cast: ServiceGroup | None = None
        self._page: ServiceGroup | None = None
        self._page_is_lost = False
        self._recorder: ServiceGroup | None = None
        self._opening: asyncio.Task[None] | None = None

    @property
    def end_s(self) -> float | None:
        """Return the monotonic time at which its duration ends, or None if it never does."""
        if self.plan.duration_s is None:
            return None
        return self.began_s + self.plan.duration_s / self.clock.speed

    @property
    def has_ended(self) -> bool:
        """Return True if the scenario's services have ended by themselves."""
        return self._cast is not None and self._cast.has_ended

    @property
    def has_page(self) -> bool:
        """Return True if a page runs beside the scenario."""
        return (
            self._page is not None
            and self._opening is not None
            and self._opening.done()
            and not self._page_is_lost
        )

    async def begin(self) -> None:
        """Start the plan's services. The page, which loads slowly, starts in the background.

        Raises:
            Exception: The error that ended a service at startup.
        """
        if self.plan.recorder is not None:
            self._recorder = self._cast_of([self.plan.recorder], on_end=self._check_recorder)
            await self._recorder.begin()
            await _until_present(self.bus, self.plan.recorder.instance)
        await self._set(self.plan)
        if self.plan.page is not None:
            self._opening = asyncio.create_task(self._open(self.plan.page), name="opening the page")

    async def switch_to(self, plan: Plan) -> None:
        """Run `plan` in place of the current plan. If it cannot start, restart the current plan.

        Raises:
            ConfigError: If it cannot start, with the reason.
        """
        before = self.plan
        await claim_names(self.bus, USER_ALIVE, set(plan.users) - set(before.users))
        await self._strike()
        try:
            await self._set(plan)
        except Exception as error:
            await self._strike()
            await self._set(before)
            raise ConfigError(
                f"{plan.name} could not start ({_sentence(error)}); {before.name} was restarted"
            ) from error
        for note in plan.notes:
            self._tell(note)

    async def end(self) -> None:
        """Stop everything.

        Raises:
            Exception: The error that ended a service before.
        """
        if self._opening is not None:
            self._opening.cancel()
            await asyncio.wait({self._opening})
        self.monitor.detach()  # what was last said of people who now leave is for the summary
        if not self.has_ended:  # else it failed and stays in the deployment as missing
            self._notice.retract()
        casts = [cast for cast in (self._cast, self._page) if cast is not None]
        await asyncio.gather(*(cast.end() for cast in casts))
        if self._recorder is not None:
            await self._recorder.end()
        if self._cast is not None:
            self._cast.check()

    async def _set(self, plan: Plan) -> None:
        self.plan = plan
        self.monitor = Monitor(
            Score(plan.target_kinds),
            self.clock,
            person=plan.person,
            tell=self._news,
            robots=RobotsScore(spots_of(plan.launches)),
        )
        self.monitor.attach(self.bus)
        for launch in plan.launches:
            if launch.service.SHARDS and launch.name:
                continue  # the site's is another's
            launch.service.discard_saved_state(self.bus.site, self.clock.now_ns())
        self._cast = self._cast_of(plan.launches, on_end=self._on_end)
        where = (self._link.listen or self._link.connect)[0]
        names = ", ".join(launch.instance for launch in plan.launches)
        log.info("%s of site %s at %s: %s", plan.name, self.bus.site, where, names)
        self._post()
        self.began_s = time.monotonic()
        await self._cast.begin()

    async def _strike(self) -> None:
        """Stop the scenario. Return when none of its state is retained any more."""
        self._notice.retract()
        if self._cast is not None:
            await self._cast.end()
            self._cast = None
        self.saw_cursor |= self.monitor.first_cursor_unix_s is not None
        self.monitor.detach()
        await asyncio.sleep(GONE_S)

    def _cast_of(self, launches: Sequence[Launch], on_end: Callable[[], None]) -> ServiceGroup:
        link = self._link if self.plan.processes else None
        return ServiceGroup(launches, self.bus, self.clock, processes=link, on_end=on_end)

    async def _open(self, page: Page) -> None:
        try:
            launch = await asyncio.to_thread(page.launch)
            self._page = self._cast_of([launch], on_end=self._check_page)
            await self._page.begin()
        except Exception as error:  # noqa: BLE001 - whatever it was, the scenario goes on
            self._give_up_page(error)
            return
        if self._cast is not None:  # else another scenario is about to start, and publishes both
            self._post()
        self._on_page(page)

    def _check_page(self) -> None:
        try:
            if self._page is not None:
                self._page.check()
        except Exception as error:  # noqa: BLE001 - as above
            self._give_up_page(error)

    def _check_recorder(self) -> None:
        try:
            if self._recorder is not None:
                self._recorder.check()
        except Exception as error:  # noqa: BLE001 - as above
            log.error("the recorder has ended (%s); the run continues without it", _sentence(error))  # noqa: TRY400

    def _give_up_page(self, error: Exception) -> None:
        if not self._page_is_lost:
            log.error("the page has ended (%s); the run continues without it", _sentence(error))
        self._page_is_lost = True

    def _post(self) -> None:
        """Publish the deployment."""
        self._notice.post(self.plan, [*_lines(self._cast), *_lines(self._page), *_lines(self._recorder)])


async def _until_present(bus: Bus, instance: str) -> None:
    """Wait for a service, also as a process, but no longer than `RECORDER_PATIENCE_S`."""
    there = asyncio.Event()

    def look(name: str, present: bool) -> None:  # noqa: FBT001 - the bus's signature
        if present and name == instance:
            there.set()

    watching = bus.watch(SERVICE_ALIVE, look)
    try:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(RECORDER_PATIENCE_S):
                await there.wait()
    finally:
        watching.close()


def _lines(cast: ServiceGroup | None) -> list[Line]:
    return [] if cast is None else list(zip(cast.launches, cast.commands(), strict=True))


def _sentence(error: BaseException) -> str:
    """Return the message of an error, or of the first one in a group."""
    while isinstance(error, BaseExceptionGroup):
        error = cast("BaseExceptionGroup[BaseException]", error).exceptions[0]
    return str(error) or type(error).__name__
