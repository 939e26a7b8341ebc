"""`pointit person press USER`: a person's button, for devices without one."""

from typing import Unpack, cast

import click

from pointit.api.inputs import Gesture, press
from pointit.cli.common.output import json_option, print_json, say
from pointit.cli.common.site_link import AtSite, join_site, quiet, site_options
from pointit.runtime.bus.site_clock import SiteClock
from pointit.runtime.errors import AccessDeniedError
from pointit.runtime.service.process import run_until_shutdown
from pointit.schemas.topics import BUTTON, check_name


@click.command("press", params=site_options())
@click.argument("user")
@click.option(
    "--gesture",
    type=click.Choice(["press", "double", "hold"]),
    default="press",
    help="press: start or stop; double: point at one lamp to correct the pose; hold: localize again",
)
@json_option
def command(user: str, *, gesture: str, as_json: bool, **at: Unpack[AtSite]) -> int:
    """Press the button of the person USER, and print the resulting state and the next step.

    The exit code is 1 if that person has no supervisor.

    Example: pointit person press anna --gesture double
    """
    check_name(user, "user")
    quiet()
    return run_until_shutdown(_press(user, cast("Gesture", gesture), as_json=as_json, **at))


async def _press(user: str, gesture: Gesture, *, as_json: bool, **at: Unpack[AtSite]) -> int:
    async with join_site(**at) as bus:
        if denied := await bus.denial_reason("writes", BUTTON, user):
            raise AccessDeniedError(denied)
        answer = await press(bus, SiteClock(bus), user, gesture)
    if as_json:
        print_json({"user": user, **answer.model_dump(include={"state", "reason", "next_step"})})
    else:
        say(f"{user}: {answer.state}. {answer.reason} {answer.next_step}".replace("  ", " "))
    return 0
