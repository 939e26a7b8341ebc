"""Site of a run: bus, clock, present services, colours of joining users, observers, requests."""

import asyncio
import dataclasses
import logging
import math
from collections import deque
from collections.abc import Callable, Collection

from pointit.launch.plan.launches import CURSOR_COLORS, PAGE
from pointit.launch.plan.plan import USUAL, Beside, Plan, scenario_names
from pointit.launch.run.running_scenario import PRESENCE_TIMEOUT_S, RunningScenario
from pointit.runtime.bus.contract import Bus, list_present
from pointit.runtime.bus.site_clock import SiteClock
from pointit.runtime.clock import Clock, SimulatedClock, WallClock
from pointit.runtime.errors import ConfigError, ListenError, PointItError, RefusedError
from pointit.runtime.link.link import DEFAULT_SITE, Link
from pointit.runtime.link.link import SILENT_S as VIEWER_SILENT_S
from pointit.runtime.service.instance_takeover import SILENT_S, claim_names
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Deployment, Done, Health, RunScenario, UserProfile
from pointit.schemas.base import Rgb
from pointit.schemas.system import SHARDED, instance_of
from pointit.schemas.topics import DEPLOYMENT, PROFILE, SERVICE_ALIVE, SHARD_ALIVE, USER_ALIVE

log = logging.getLogger(__name__)

Found = tuple[str, int]
"""A scenario, and a place of it, from 1 on."""

PORTS_TO_TRY = 10
"""Consecutive ports from the default one that `run` tries."""
CLOCK_TIMEOUT_S = 0.5
"""Timeout for the clock of a joined site; a site without `run` has none."""
LISTEN_S = 0.3
"""Time to listen; retained state arrives at once."""
VIEWERS = "viewers"
"""Metric in a page's Health: number of open pages."""


async def open_bus(plan: Plan) -> ZenohBus:
    """Open the bus. If the default address is in use, use the next port and log it."""
    link = plan.link
    for number in range(PORTS_TO_TRY):
        try:
            bus = await ZenohBus.open(link, patience_s=plan.duration_s)
        except ListenError:
            if not plan.may_move or number == PORTS_TO_TRY - 1:
                raise
            address, _, port = link.listen[0].rpartition(":")
            next_address = f"{address}:{int(port) + 1}"
            link = Link(site=link.site, listen=(next_address,))
        else:
            if number:
                log.warning("%s", moved_notice(plan.link, link.listen[0]))
            return bus
    raise AssertionError("unreachable: the last try raises")


def moved_notice(link: Link, new_address: str) -> str:
    """Return the message that a run listens at `new_address`, as the address of `link` is in use.

    It gives the options that other commands need to reach this run, and advises another site only where
    both runs may have the default one.
    """
    options = f"--connect {new_address}"
    advice = ", and start one of two runs on the same machine with --site NAME"
    if link.site != DEFAULT_SITE:
        options = f"--site {link.site} {options}"
        advice = ""
    return (
        f"{link.listen[0]} is in use, probably by another run, so this run listens at {new_address}. Give "
        f"other commands {options}{advice}"
    )


async def clock_of(plan: Plan, bus: ZenohBus) -> Clock:
    """Return the clock of this run: its own, or that of the site it joins."""
    if plan.speed != 1.0:
        return SimulatedClock(plan.speed)
    if bus.link.connect:
        clock = SiteClock(bus)
        await clock.wait_for_tick(CLOCK_TIMEOUT_S)
        return clock
    return WallClock()


async def adapt_to_site(plan: Plan, bus: ZenohBus) -> Plan:
    """Return the plan adapted to the services on the site: without what one is enough of, if there is one.

    Raises:
        ConfigError: If another process runs services under the same people's names, or a shard has one.
    """
    if not bus.link.connect:
        return plan
    present_names, _, _ = await asyncio.gather(
        list_present(bus, SERVICE_ALIVE, PRESENCE_TIMEOUT_S),
        claim_names(bus, USER_ALIVE, plan.users),
        check_names(bus, plan.users),
    )
    needed: list[Beside] = []
    for beside in plan.beside:
        if beside.ONE_IS_ENOUGH and beside.instance in present_names:
            log.warning("site %s already has a %s, so this run does not open one", bus.site, beside.WHAT)
        else:
            needed.append(beside)
    return dataclasses.replace(plan, beside=needed)


async def surroundings(bus: Bus) -> Found:
    """Return the scenario of a joined site, and a free place."""
    running: dict[str, str] = {}
    colors: dict[str, Rgb] = {}

    def on_deployment(deployment: Deployment, name: str) -> None:
        running[name] = deployment.believed(name).scenario

    def on_profile(profile: UserProfile, user: str) -> None:
        colors[user] = profile.cursor_color

    listening = (bus.subscribe(DEPLOYMENT, on_deployment), bus.subscribe(PROFILE, on_profile))
    try:
        await asyncio.sleep(LISTEN_S)
    finally:
        for subscription in listening:
            subscription.close()
    shipped = sorted(set(running.values()) & set(scenario_names()))
    scenario = shipped[0] if len(shipped) == 1 else USUAL
    return scenario, free_place(colors.values())


async def check_names(bus: Bus, people: Collection[str]) -> None:
    """Check that no other shard has the name of one of `people`.

    It takes `LISTEN_S`, and `SILENT_S` more if one has: it may be dead, or about to serve the user.

    Raises:
        ConfigError: If there is such a shard.
    """
    rivals = {instance_of(service, person): person for service in sorted(SHARDED) for person in people}
    for wait_s in (LISTEN_S, SILENT_S):
        present_names, serving = await asyncio.gather(
            list_present(bus, SERVICE_ALIVE, wait_s), list_present(bus, SHARD_ALIVE, wait_s)
        )
        idle = present_names - serving
        rivals = {shard: person for shard, person in rivals.items() if shard in idle}
        if not rivals:
            return
    for shard, person in rivals.items():
        raise ConfigError(
            f"{person}: {shard} on site {bus.site} is a shard that serves nobody of this name; choose another"
        )


def free_place(colors: Collection[Rgb]) -> int:
    """Return the number, from 1, of the first cursor colour that is not in `colors`, or `len(colors) + 1`."""
    free = (place for place, color in enumerate(CURSOR_COLORS, 1) if color not in colors)
    return next(free, len(colors) + 1)


class ScenarioRequests:
    """Pending requests. Use in the event loop only."""

    def __init__(self, on_request: Callable[[], None]) -> None:
        """Create an empty queue; `on_request` is called when a request arrives."""
        self._on_request = on_request
        self._waiting: deque[tuple[RunScenario, asyncio.Future[Done]]] = deque()

    def __bool__(self) -> bool:
        """Return True if a request is pending."""
        return bool(self._waiting)

    async def serve(self, query: RunScenario, _name: str) -> Done:
        """Reply when the request is fulfilled or has failed."""
        answer: asyncio.Future[Done] = asyncio.get_running_loop().create_future()
        self._waiting.append((query, answer))
        self._on_request()
        return await answer

    async def apply_next(self, scenario: RunningScenario) -> None:
        """Switch `scenario` to the scenario of the oldest request."""
        query, answer = self._waiting.popleft()
        try:
            await scenario.switch_to(await _plan(query, scenario.plan))
        except PointItError as error:
            if not answer.done():
                answer.set_exception(RefusedError(str(error)))
        else:
            if not answer.done():
                answer.set_result(Done())


async def _plan(query: RunScenario, plan: Plan) -> Plan:
    if plan.another is None:
        raise ConfigError(
            f"{plan.name} runs without people of its own (--site-only): it cannot change the scenario"
        )
    return await asyncio.to_thread(plan.another, query, plan)


class ViewerPresence:
    """Tracks until when viewers count as present: a page that is reloaded is not gone at once."""

    def __init__(self) -> None:
        self.until_s = -math.inf
        """Viewers count as present until then, on the clock of `on_health`."""

    def on_health(self, health: Health, now_s: float) -> bool:
        """Update from a service's Health. Return True if it changes whether viewers are present."""
        counts = [figure.value for figure in health.figures if figure.name == VIEWERS]
        is_open = any(count > 0 for count in counts)
        if is_open and health.service == PAGE:
            self.until_s = max(self.until_s, now_s + VIEWER_SILENT_S)
            return True
        return False
