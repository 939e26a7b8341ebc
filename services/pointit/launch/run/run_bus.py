"""How a run comes onto the network: its bus, the time it goes by, who is there already."""

import asyncio
import dataclasses
import logging

from pointit.launch.plan.plan import Plan
from pointit.launch.run.running_scenario import PRESENCE_PATIENCE_S, refuse_names_in_use
from pointit.runtime.bus.contract import list_present
from pointit.runtime.clock import Clock, SimulatedClock, SiteClock, WallClock
from pointit.runtime.errors import ListenError
from pointit.runtime.link.link import Link
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas.topics import SERVICE_ALIVE

log = logging.getLogger(__name__)

PORTS_TO_TRY = 10
"""Ports from the default on that `run` tries before it gives up."""

CLOCK_PATIENCE_S = 0.5
"""How long to wait for the time of a site that is joined; a site of bare services has none."""


async def open_bus(plan: Plan) -> ZenohBus:
    """Open the bus; when the default address is taken, take the next port and say so."""
    link = plan.link
    for number in range(PORTS_TO_TRY):
        try:
            bus = await ZenohBus.open(link, patience_s=plan.duration_s)
        except ListenError:
            if not plan.may_move or number == PORTS_TO_TRY - 1:
                raise
            address, _, port = link.listen[0].rpartition(":")
            link = Link(site=link.site, listen=(f"{address}:{int(port) + 1}",))
        else:
            if number:
                log.warning(
                    "%s is taken; listening at %s: tell other commands with --connect %s",
                    plan.link.listen[0],
                    link.listen[0],
                    link.listen[0],
                )
            return bus
    raise AssertionError("unreachable: the last try raises")


async def clock_of(plan: Plan, bus: ZenohBus) -> Clock:
    """Return the time of this run: its own, or that of the site it joins."""
    if plan.speed != 1.0:
        return SimulatedClock(plan.speed)
    if bus.link.connect:
        clock = SiteClock(bus)
        await clock.wait_for_tick(CLOCK_PATIENCE_S)
        return clock
    return WallClock()


async def adapt_to_site(plan: Plan, bus: ZenohBus) -> Plan:
    """Return the plan as it is run beside who is on the site already: without a page where there is one.

    Raises:
        ConfigError: somebody runs services under the same people's names.
    """
    if not bus.link.connect:
        return plan
    there, _ = await asyncio.gather(
        list_present(bus, SERVICE_ALIVE, PRESENCE_PATIENCE_S), refuse_names_in_use(bus, set(plan.users))
    )
    if plan.page is None or plan.page.instance not in there:
        return plan
    log.warning("site %s has a page already; this run opens none of its own", bus.site)
    return dataclasses.replace(plan, page=None)
