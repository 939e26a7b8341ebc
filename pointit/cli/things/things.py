"""`pointit things`: the things of a running site's map."""

import asyncio
import contextlib
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import chain

import click

from pointit.api.feed import is_reaction
from pointit.bridges.mqtt_things.mqtt_things import USER, MqttThings
from pointit.cli.common.latest_message import LatestMessage
from pointit.cli.common.output import OutputSection, Row, json_option, say, show
from pointit.cli.common.panels import PanelCommand
from pointit.cli.common.site_link import TIMEOUT_S, SiteAddress, site_command
from pointit.cli.things.run_things import broker_of, mqtt_options, summary_lines
from pointit.launch.plan.plan import Watcher
from pointit.runtime.bus.contract import Bus
from pointit.runtime.bus.site_clock import SiteClock
from pointit.runtime.errors import NoMessageError, RequestError
from pointit.runtime.service.carrier import Carrier, check_carrier, check_things
from pointit.runtime.service.process import EXIT_FAILED
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Environment, ReadHistory, SelectionEvent, SetThing, ThingStates
from pointit.schemas.environment import Thing
from pointit.schemas.topics import MAP, READ_HISTORY, SET_THING, THING_STATES
from pointit.services.reactions.service import targets_of
from pointit.services.reactions.targets import Reaction, reactions_in

STATES_S = 0.3
"""Time in which the states of carriers arrive, s."""


@site_command("list")
@json_option
async def list_things(site: SiteAddress, *, as_json: bool) -> int:
    """List the things of a site's map: mode, light, state of the target, and how often each fired.

    Counts begin when the site loaded this map, among the last 200 events in the selector's journal since
    then; - means that no selector replies. The exit code is 1 if the map has no things.

    Example: pointit things list --json
    """
    async with site.join() as bus:
        room = await _map(bus)
        events: Sequence[SelectionEvent] | None
        try:
            history = await bus.call(READ_HISTORY, ReadHistory(since_ns=room.stamp_ns))
            events = history.events
        except RequestError as error:
            say(f"the counts of the things are unknown: {error}", err=True)
            events = None
        states = await _states(bus)
    if not room.things and not as_json:
        say(f"the map {room.name} has no things; add a section `things`", err=True)
    else:
        thing_rows = rows(room, events, states)
        section = OutputSection(name="things", about=f"of map {room.name}", rows=thing_rows)
        show([section], as_json=as_json)
    return 0 if room.things else EXIT_FAILED


async def _map(bus: Bus) -> Environment:
    room = await LatestMessage(bus, MAP).wait(TIMEOUT_S)
    if room is None:
        raise NoMessageError("no map arrived from `pui`; see `pointit doctor`")
    return room


async def _states(bus: Bus) -> dict[str, str]:
    """Return the states that the carriers of things report within `STATES_S`."""
    by_carrier: dict[str, ThingStates] = {}

    def on_states(states: ThingStates, carrier: str) -> None:
        by_carrier[carrier] = states

    with contextlib.closing(bus.subscribe(THING_STATES, on_states)):
        await asyncio.sleep(STATES_S)

    # An act needs all carriers of its thing: what one of them lacks comes last, and stays
    reports = list(chain.from_iterable(states.things for states in by_carrier.values()))
    reports.sort(key=lambda report: report.state == "unavailable")
    states: dict[str, str] = {}
    for report in reports:
        states[report.id] = report.state
        if report.reason:
            states[report.id] += f": {report.reason}"
    return states


def rows(
    room: Environment, events: Sequence[SelectionEvent] | None, states: Mapping[str, str]
) -> tuple[Row, ...]:
    """Return a row for each thing.

    The events of a thing since the map's stamp are counted. Earlier ones belong to another map or run, which
    may have things with the same names. `events`: all selection events, or None if unknown. `states`: state
    of each thing that a carrier tells, with the reason if it is unavailable.
    """
    # Events that the mode of their thing makes a reaction
    fired: Counter[str] = Counter()
    for event in events or ():
        if event.stamp_ns < room.stamp_ns or not event.is_on:
            continue
        if is_reaction(event, (), room):
            fired[event.thing] += 1

    thing_rows: list[Row] = []
    for thing in room.things:
        row = {
            "thing": thing.id,
            "label": thing.label or thing.id,
            "mode": thing.mode,
            "light": _light(thing),
            "state": states.get(thing.id, ""),
            "fired": None if events is None else fired[thing.id],
        }
        thing_rows.append(row)
    return tuple(thing_rows)


def _light(thing: Thing) -> str:
    if not thing.strip:
        return thing.lamp
    start_m, end_m = thing.part_m
    return f"{thing.strip} {start_m:g}-{end_m:g} m"


@site_command("try")
@click.argument("thing")
@click.option("--user", default="operator", help="user name in events")
@click.option("--on/--off", default=None, help="state of a switch  [default: the other one]")
async def try_thing(site: SiteAddress, *, thing: str, user: str, on: bool | None) -> int:
    """Fire THING as if a person had pointed at it: its light, and all its reactions.

    A switch goes on or off. On a secured site only operators may do this.

    Example: pointit things try screws
    """
    async with site.join() as bus:
        room = await _map(bus)
        check_things([thing], room)
        reply = await bus.call(SET_THING, SetThing(thing=thing, on=on), user)
    say(reply.message)
    return 0


@site_command("react", cls=PanelCommand, usual=("mqtt", "connect", "credentials"))
@click.argument("on", nargs=-1, metavar="[FILE.yaml|THING=PROGRAM|THING=URL]...")
@mqtt_options
async def react_to_things(
    site: SiteAddress, *, on: tuple[str, ...], mqtt: str, mqtt_ca_file: str, mqtt_discovery_prefix: str
) -> int:
    """Start programs and send web requests when people point at things of a running site, until Ctrl-C.

    The arguments are values of `--on` of `pointit run`; FILE.yaml has several, `THING: PROGRAM or URL`. A
    thing that the map does not have is refused.

    On a secured site only operators may do this.

    Example: pointit things react my_site.yaml
    """
    reactions = list(chain.from_iterable(map(reactions_in, on)))
    watchers: list[Watcher] = []
    if mqtt or mqtt_ca_file:
        watchers.append(MqttThings(broker_of(mqtt, mqtt_ca_file), mqtt_discovery_prefix, is_new_run=False))
    if not watchers and not reactions:
        raise click.UsageError(
            "nothing to do: name a FILE.yaml, THING=PROGRAM or THING=URL, or --mqtt BROKER"
        )
    async with site.join() as bus:
        return await _react(bus, watchers, reactions)


async def _carrier(bus: ZenohBus, reactions: Sequence[Reaction]) -> Carrier:
    """Return a carrier of the reactions, whose name is the same after a restart."""
    targets = targets_of(reactions)
    things = " ".join(sorted(targets))
    name = f"react-{zlib.crc32(things.encode()):08x}"
    await check_carrier(bus, name)
    carrier = Carrier(bus, SiteClock(bus), name)
    carrier.use(targets)
    return carrier


async def _react(bus: ZenohBus, watchers: Sequence[Watcher], reactions: Sequence[Reaction]) -> int:
    # All is checked before anything is announced: the map, and other carriers of the same name
    room = await _map(bus)
    for reaction in reactions:
        reaction.check(room)
    if watchers:
        await check_carrier(bus, USER)
    carrier = await _carrier(bus, reactions) if reactions else None

    def on_map(environment: Environment, _name: str) -> None:
        for watcher in watchers:
            watcher.on_map(environment)

    try:
        with contextlib.ExitStack() as ending:
            for watcher in watchers:
                for subscription in watcher.attach(bus, lambda _line, _user: None):
                    ending.callback(subscription.close)
            bus.subscribe(MAP, on_map)
            say(f"reacting to things of map {room.name}; Ctrl-C ends it")
            await asyncio.Event().wait()
    finally:
        if carrier is not None:
            await carrier.close()
            say(f"Acts: {carrier.done} done, {carrier.failed} failed.")
        for watcher in watchers:
            for line in summary_lines(watcher.summary()):
                say(line)
    return 0
