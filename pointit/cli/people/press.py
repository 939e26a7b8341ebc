"""`pointit person press USER`: a person's button, for devices without one."""

from typing import cast

import click

from pointit.api.inputs import Gesture, press
from pointit.cli.common.output import json_option, print_json, say
from pointit.cli.common.site_link import SiteAddress, site_command
from pointit.runtime.bus.site_clock import SiteClock
from pointit.runtime.errors import AccessDeniedError
from pointit.schemas.topics import BUTTON, check_name


@site_command("press")
@click.argument("user")
@click.option(
    "--gesture",
    type=click.Choice(["press", "double", "hold"]),
    default="press",
    help="press: start or stop; double: point at one lamp to correct the pose; hold: localize again",
)
@json_option
async def command(site: SiteAddress, user: str, *, gesture: str, as_json: bool) -> int:
    """Press the button of the person USER, and print the resulting state and the next step.

    The exit code is 1 if that person has no supervisor.

    Example: pointit person press anna --gesture double
    """
    check_name(user, "user")
    async with site.join() as bus:
        denied = await bus.denial_reason("writes", BUTTON, user)
        if denied:
            raise AccessDeniedError(denied)
        answer = await press(bus, SiteClock(bus), user, cast("Gesture", gesture))
    if as_json:
        print_json({"user": user, **answer.model_dump(include={"state", "reason", "next_step"})})
    else:
        sentence = f"{answer.state}. {answer.reason} {answer.next_step}"
        say(f"{user}: {sentence}".replace("  ", " "))
    return 0
