"""`pointit person memory USER`: what localizations found of a person's pointing."""

import math
from collections.abc import Iterable, Iterator
from typing import Unpack

import click

from pointit.cli.common.output import json_option, print_json, say
from pointit.cli.common.site_link import AtSite, default_address_note, join_site, quiet, site_options
from pointit.cli.people.stored_calibration import erase_local, query_site, read_local
from pointit.runtime.service.shutdown import run_until_shutdown
from pointit.schemas import EraseMemory, LearntPointing, ReadMemory
from pointit.schemas.topics import ERASE_MEMORY, READ_MEMORY, check_name
from pointit.services.localizer.memory.memory_file import memory_file
from pointit.services.supervisor.user_messages import minute


@click.command("memory", params=site_options())
@click.argument("user")
@click.option("--erase", is_flag=True, help="forget it all: the next localization knows nothing of USER")
@json_option
def command(user: str, *, erase: bool, as_json: bool, **at: Unpack[AtSite]) -> int:
    """Show or erase what localizations found of the pointing of the person USER.

    Each localization by pointing starts from what the last ones found with the same kind of device and
    mounting: how much USER points too high or too low. It is stored by USER's localizer on its machine, and
    forgotten over months. `localizer.remember=false` switches it off.

    Example: pointit person memory anna
    """
    check_name(user, "user")
    quiet()
    return run_until_shutdown(_memory(user, erase=erase, as_json=as_json, **at))


async def _memory(user: str, *, erase: bool, as_json: bool, **at: Unpack[AtSite]) -> int:
    file = memory_file(user)
    if erase:
        done = await query_site(lambda bus: bus.call(ERASE_MEMORY, EraseMemory(), user), join_site(**at))
        if done is None:
            return erase_local(user, file, "memory", as_json=as_json)
        if as_json:
            print_json({"user": user, "from": "localizer", **done.model_dump(mode="json")})
        else:
            say(f"{user}: {done.message}{default_address_note(**at)}")
        return 0
    reply = await query_site(lambda bus: bus.call(READ_MEMORY, ReadMemory(), user), join_site(**at))
    if reply is None:
        stored = read_local(user, file, "memory", as_json=as_json)
        if stored is not None:
            _tell(user, stored.learnt)
    elif as_json:
        print_json({"user": user, "from": "localizer", **reply.model_dump(mode="json")})
    else:
        _tell(user, reply.learnt)
    return 0


def _tell(user: str, learnt: Iterable[LearntPointing]) -> None:
    lines = [f"{each.mounting}: {', '.join(describe(each))}" for each in learnt]
    for line in lines or ["nothing is remembered"]:
        say(f"{user}: {line}")


def describe(learnt: LearntPointing) -> Iterator[str]:
    """Yield what is remembered with one device and mounting, as clauses."""
    bias = learnt.elevation_bias_rad
    if bias is not None:
        mean_deg, sigma_deg = math.degrees(bias.mean), math.degrees(bias.sigma)
        way = "high" if mean_deg >= 0 else "low"
        yield f"points {abs(mean_deg):.1f}° too {way} (1 sigma {sigma_deg:.1f}°)"
    count = learnt.localizations
    yield f"from {count} localization{'s' if count != 1 else ''}, the last one at {minute(learnt.learnt_ns)}"
