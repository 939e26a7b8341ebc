"""`pointit things try`: fires a thing without pointing at it."""

from typing import Unpack

import click

from pointit.api.reactions import check_things
from pointit.cli.common.output import say
from pointit.cli.common.site_link import PATIENCE_S, AtSite, LatestMessage, join_site, quiet, site_options
from pointit.runtime.errors import NoMessageError
from pointit.runtime.service.shutdown import run_until_shutdown
from pointit.schemas import SetThing
from pointit.schemas.topics import MAP, SET_THING


@click.command("try", params=site_options())
@click.argument("thing")
@click.option("--user", default="operator", show_default=True, help="name of who does it, in events")
@click.option("--on/--off", default=None, help="state of a switch  [default: the other one]")
def command(*, thing: str, user: str, on: bool | None, **at: Unpack[AtSite]) -> int:
    """Fire THING, as if somebody had pointed at it: its light, and all that reacts to it.

    A switch goes on or off. On a secured site only operators may do this.

    Example: pointit things try screws
    """
    quiet()
    return run_until_shutdown(_try(thing, user, on=on, **at))


async def _try(thing: str, user: str, *, on: bool | None, **at: Unpack[AtSite]) -> int:
    async with join_site(**at) as bus:
        room = await LatestMessage(bus, MAP).wait(PATIENCE_S)
        if room is None:
            raise NoMessageError("no map has come, which `pui` publishes; see `pointit doctor`")
        check_things([thing], room)
        reply = await bus.call(SET_THING, SetThing(thing=thing, on=on), user)
    say(reply.message)
    return 0
