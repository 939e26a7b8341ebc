"""`pointit things react`: reactions beside a running site, such as one in containers."""

import asyncio
import contextlib
from collections.abc import Sequence
from typing import Unpack

import click

from pointit.cli.common.output import say
from pointit.cli.common.site_link import AtSite, join_site, quiet, site_options
from pointit.cli.things.mqtt_events import MqttThings, broker_of
from pointit.cli.things.reactions import Reaction, Reactions, reactions_in
from pointit.cli.things.run_things import mqtt_option, summary_lines
from pointit.cli.things.things import read_map
from pointit.launch.plan.watcher import Watcher
from pointit.runtime.service.shutdown import run_until_shutdown
from pointit.schemas import Environment
from pointit.schemas.topics import MAP


@click.command("react", params=site_options())
@click.argument("on", nargs=-1, metavar="[FILE.yaml|THING=PROGRAM|THING=URL]...")
@mqtt_option
def react_to_things(*, on: tuple[str, ...], mqtt: str, **at: Unpack[AtSite]) -> int:
    """Start programs and tell web servers when people point at things of a running site, until Ctrl-C.

    The arguments are values of `--on` of `pointit run`; FILE.yaml has several, `THING: PROGRAM or URL`. A
    thing that the map does not have is refused.

    On a secured site any identity may do this, a dashboard's too. Only an operator's may switch switches, as
    Home Assistant does with --mqtt.

    Example: pointit things react my_site.yaml
    """
    quiet()
    reactions = [each for text in on for each in reactions_in(text)]
    watchers: list[Watcher] = [Reactions(reactions)] if reactions else []
    if mqtt:
        watchers.append(MqttThings(broker_of(mqtt)))
    if not watchers:
        raise click.UsageError(
            "nothing to do: name a FILE.yaml, THING=PROGRAM or THING=URL, or --mqtt BROKER"
        )
    return run_until_shutdown(_react(watchers, reactions, **at))


async def _react(watchers: Sequence[Watcher], reactions: Sequence[Reaction], **at: Unpack[AtSite]) -> int:
    async with join_site(**at) as bus:
        room = await read_map(bus)
        for reaction in reactions:
            reaction.check(room)

        def on_map(environment: Environment, _name: str) -> None:
            for watcher in watchers:
                watcher.on_map(environment)

        with contextlib.ExitStack() as ending:
            for watcher in watchers:
                for each in watcher.attach(bus, lambda _line, _user: None):
                    ending.callback(each.close)
            bus.subscribe(MAP, on_map)
            say(f"reacting to things of map {room.name}; Ctrl-C ends it")
            try:
                await asyncio.Event().wait()
            finally:
                for watcher in watchers:
                    for line in summary_lines(watcher.summary()):
                        say(line)
    return 0
