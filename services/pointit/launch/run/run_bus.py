"""The bus and the clock of a run, and its adaptation to services that are already on the site."""

import asyncio
import dataclasses
import logging

from pointit.launch.plan.plan import Plan
from pointit.launch.run.running_scenario import PRESENCE_PATIENCE_S
from pointit.launch.run.surroundings import check_names
from pointit.runtime.bus.contract import list_present
from pointit.runtime.bus.site_clock import SiteClock
from pointit.runtime.clock import Clock, SimulatedClock, WallClock
from pointit.runtime.errors import ListenError
from pointit.runtime.link.link import Link
from pointit.runtime.service.instance_takeover import claim_names
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas.topics import SERVICE_ALIVE, USER_ALIVE

log = logging.getLogger(__name__)

PORTS_TO_TRY = 10
"""Consecutive ports from the default one that `run` tries."""

CLOCK_PATIENCE_S = 0.5
"""Timeout for the clock of a joined site; a site without `run` has none."""


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
            link = Link(site=link.site, listen=(f"{address}:{int(port) + 1}",))
        else:
            if number:
                log.warning(
                    "%s is in use; listening at %s: give other commands --connect %s",
                    plan.link.listen[0],
                    link.listen[0],
                    link.listen[0],
                )
            return bus
    raise AssertionError("unreachable: the last try raises")


async def clock_of(plan: Plan, bus: ZenohBus) -> Clock:
    """Return the clock of this run: its own, or that of the site it joins."""
    if plan.speed != 1.0:
        return SimulatedClock(plan.speed)
    if bus.link.connect:
        clock = SiteClock(bus)
        await clock.wait_for_tick(CLOCK_PATIENCE_S)
        return clock
    return WallClock()


async def adapt_to_site(plan: Plan, bus: ZenohBus) -> Plan:
    """Return the plan adapted to the services on the site: without what one is enough of, if there is one.

    Raises:
        ConfigError: If another process runs services under the same people's names, or a shard has one.
    """
    if not bus.link.connect:
        return plan
    there, _, _ = await asyncio.gather(
        list_present(bus, SERVICE_ALIVE, PRESENCE_PATIENCE_S),
        claim_names(bus, USER_ALIVE, plan.users),
        check_names(bus, plan.users),
    )
    doubled = [each for each in plan.beside if each.ONE_IS_ENOUGH and each.instance in there]
    for each in doubled:
        log.warning("site %s has a %s already; this run opens none of its own", bus.site, each.WHAT)
    return dataclasses.replace(plan, beside=[each for each in plan.beside if each not in doubled])
