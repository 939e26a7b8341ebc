"""`pointit person calibrate user USER`: pointing offset from lamps pointed at without a cursor."""

import asyncio
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Unpack

import click

from pointit.cli.common import site_link
from pointit.cli.common.latest_message import LatestMessage
from pointit.cli.common.lazy import UnknownNameError
from pointit.cli.common.output import (
    INTERRUPTED,
    OutputSection,
    console,
    json_option,
    print_json,
    print_table,
    say,
)
from pointit.cli.common.panels import PanelCommand
from pointit.cli.people import offset_report
from pointit.cli.people.anchor import timeout_option
from pointit.cli.people.anchoring import LISTEN_S, AnchorNotStartedError, AnchorRequester
from pointit.cli.people.changing_line import ChangingLine, changing_line
from pointit.cli.people.pose import found
from pointit.cli.people.stored_calibration import erase_local, query_site, read_local
from pointit.diagnosis.writers import silence_reason
from pointit.runtime.bus.contract import AnyTopic, Bus, list_present
from pointit.runtime.bus.site_clock import SiteClock
from pointit.runtime.config.nearest_name import nearest
from pointit.runtime.errors import NoAnswerError, PointItError, RefusedError
from pointit.runtime.host.state_file import StateFile
from pointit.runtime.service.shutdown import run_until_shutdown
from pointit.schemas import Anchor, PointingOffset, SetOffset, UserProfile
from pointit.schemas.topics import LOCALIZATION, MAP, POSE, PROFILE, SERVICE_ALIVE, SET_OFFSET, check_name
from pointit.services.supervisor.user_messages import OFFSET_PURPOSE


@dataclass(frozen=True, kw_only=True)
class CalibrationOptions:
    """Options of a calibration."""

    lamps: Sequence[str]
    """Lamps in this order. Empty: all of the map."""
    count: int | None
    """Number of pointings. None: one per lamp."""
    timeout_s: float
    keeps: bool


@click.command(
    "user",
    params=[timeout_option(), *site_link.site_options()],
    cls=PanelCommand,
    usual=("lamps", "count", "dry_run", "show", "erase", "connect"),
)
@click.argument("user")
@click.option(
    "--lamps",
    multiple=True,
    metavar="LAMP[,LAMP...]",
    help="lamps to point at, in this order  [default: all of the map]",
)
@click.option(
    "--anchors",
    "count",
    type=click.IntRange(1, 200),
    help="number of pointings, round after round; from 8 the offset may vary with the direction  "
    "[default: one per lamp]",
)
@click.option("--dry-run", is_flag=True, help="only show the result, change nothing")
@click.option("--show", is_flag=True, help="only show the offset in use, or stored on this machine")
@click.option("--erase", is_flag=True, help="delete the offset: no correction any more")
@json_option
def command(
    user: str,
    *,
    lamps: tuple[str, ...],
    count: int | None,
    timeout_s: float,
    dry_run: bool,
    show: bool,
    erase: bool,
    as_json: bool,
    **at: Unpack[site_link.AtSite],
) -> int:
    """Measure and store the pointing offset of the person USER.

    Lamp after lamp lights up, and USER points at each with a straight arm, as if there were no cursor, until
    it goes dark. USER must have a known pose (`pointit person pose USER`). The elevation error of most
    pointings is corrected from then on, with enough of them also its change with the direction. A common
    azimuth error is the heading of the pose, which the pointings correct as well. The supervisor stores the
    offset for the next start. Nothing is stored if the pose looks wrong because the pointings do not fit each
    other.

    Example: pointit person calibrate user anna --lamps led_0,led_2 --anchors 8
    """
    check_name(user, "user")
    if show and erase:
        raise UnknownNameError("--show and --erase exclude each other")
    site_link.quiet()
    if show or erase:
        return run_until_shutdown(_keep(user, erase=erase, as_json=as_json, **at))
    names = [name.strip() for text in lamps for name in text.split(",") if name.strip()]
    options = CalibrationOptions(lamps=names, count=count, timeout_s=timeout_s, keeps=not dry_run)
    return run_until_shutdown(_measure(user, options, as_json=as_json, **at))


async def _measure(
    user: str, options: CalibrationOptions, *, as_json: bool, **at: Unpack[site_link.AtSite]
) -> int:
    async with site_link.join_site(**at) as bus:
        clock = SiteClock(bus)
        anchoring = AnchorRequester(bus, user)
        lamps = await _lamps(bus, user, options.lamps)
        count = options.count or len(lamps)
        lights = "a lamp will light up" if count == 1 else f"{count} times a lamp will light up"
        click.echo(
            f"{user}: {lights}; point at it with a straight arm, as if there were no cursor, until it "
            "goes dark",
            err=True,
        )
        try:
            order = list(itertools.islice(itertools.cycle(lamps), count))
            anchors, missed = await _point(anchoring, user, order, options.timeout_s)
        except asyncio.CancelledError:
            return INTERRUPTED
        fitted, rows = offset_report.assess(anchors, clock.now_ns())
        problem = offset_report.rejection_reason(rows)
        if problem:
            problem = (
                f"the pose looks wrong, {problem}: localize first, or `pointit person pose {user} X Y`, then "
                "calibrate again"
            )
        if not options.keeps and not as_json:
            _show(user, rows)
        if problem and options.keeps:
            raise PointItError(f"{user}: nothing is stored: {problem}")
        if fitted.offset is None:
            why = "; ".join(dict.fromkeys([*missed, *(row.why_not for row in rows)]))
            raise PointItError(f"{user}: no pointing was usable, nothing was changed: {why}")
        note = ". ".join(filter(None, (problem, "nothing is changed (--dry-run)")))
        if options.keeps:
            reply = await bus.call(SET_OFFSET, SetOffset(offset=fitted.offset), user)
            note = reply.message + site_link.default_address_note(**at)
    if as_json:
        offset = fitted.offset.model_dump(mode="json")
        table_rows = [offset_report.table_row(row) for row in rows]
        print_json(
            {"user": user, "offset": offset, "doubt": problem, "anchors": table_rows, "missed": missed}
        )
    else:
        if options.keeps:
            _show(user, rows)
        click.echo(f"{user}: {offset_report.describe(fitted.offset)}")
        say(f"{user}: {note}")
    return 0


async def _lamps(bus: Bus, user: str, options: Sequence[str]) -> list[str]:
    """Return the lamps to point at, after checking that the person's pose is known."""
    room, pose = LatestMessage(bus, MAP), LatestMessage(bus, POSE, user)
    latest = LatestMessage(bus, LOCALIZATION, user)
    with site_link.notify_if_slow("waiting for the map …"):
        environment = await room.wait(site_link.TIMEOUT_S)
    if environment is None:
        raise NoAnswerError(f"there is no map: {await _why(bus, MAP, '')}")
    await found(bus, user, pose, latest)
    known = [lamp.id for lamp in environment.lamps]
    if not known:
        raise PointItError(f"map {environment.name!r} has no lamps to point at; add `lamps` to it")
    for name in options:
        if name not in known:
            raise UnknownNameError(
                f"--lamps: no lamp {name!r} on map {environment.name!r}; {nearest(name, known)}"
            )
    return list(options) or known


async def _why(bus: Bus, topic: AnyTopic, user: str) -> str:
    return silence_reason(topic, user, await list_present(bus, SERVICE_ALIVE, LISTEN_S))


async def _point(
    anchoring: AnchorRequester, user: str, lamps: Sequence[str], timeout_s: float
) -> tuple[list[Anchor], list[str]]:
    """Return the anchors, and why others failed; raises if the localizer refuses, also after waiting."""
    anchors: list[Anchor] = []
    missed: list[str] = []
    with changing_line() as line:
        for number, lamp in enumerate(lamps, start=1):
            which = f"{user}: {number} of {len(lamps)}"
            try:
                anchor = await _begun(anchoring, lamp, timeout_s, which, line)
            except AnchorNotStartedError as error:
                raise AnchorNotStartedError(f"{user}: nothing was changed: {error}") from error
            except RefusedError as error:
                missed.append(f"{lamp}: {error}")
                line.say(f"{which}: {lamp}: {error}")
            else:
                anchors.append(anchor)
                line.say(f"{which}: pointed at {lamp}")
    return anchors, missed


async def _begun(
    anchoring: AnchorRequester, lamp: str, timeout_s: float, which: str, line: ChangingLine
) -> Anchor:
    """Return the anchor from pointing at `lamp`; wait once while another person uses the lamps."""

    def tell(text: str) -> None:
        line(f"{which}: {text}")

    try:
        return await anchoring.point(lamp, timeout_s, tell)
    except AnchorNotStartedError as error:
        if not error.is_busy:
            raise
        line.say(f"{which}: {error}; waiting for up to {timeout_s:g} s")
    await anchoring.wait_until_idle(timeout_s)
    return await anchoring.point(lamp, timeout_s, tell)


def _show(user: str, rows: Sequence[offset_report.AnchorResidual]) -> None:
    about = (
        f"how far {user} pointed too far right and too low, before and after correction, without a common "
        "turn, which belongs to the pose"
    )
    section = OutputSection(name="pointings", about=about, rows=tuple(map(offset_report.shown_row, rows)))
    print_table(console(), section)


async def _keep(user: str, *, erase: bool, as_json: bool, **at: Unpack[site_link.AtSite]) -> int:
    """Show or delete the offset: by the supervisor if it runs, else in the file on this machine."""
    file = StateFile(PointingOffset, user, OFFSET_PURPOSE)
    if erase:
        reply = await query_site(
            lambda bus: bus.call(SET_OFFSET, SetOffset(), user), site_link.join_site(**at)
        )
        if reply is None:
            return erase_local(user, file, "offset", as_json=as_json)
        if as_json:
            print_json({"user": user, "from": "supervisor", "message": reply.message})
        else:
            say(f"{user}: {reply.message}{site_link.default_address_note(**at)}")
        return 0
    profile = await query_site(lambda bus: _profile(bus, user), site_link.join_site(**at))
    if profile is not None:
        offset = profile.offset
        if as_json:
            shown: Any = None if offset is None else offset.model_dump(mode="json")
            print_json({"user": user, "from": "supervisor", "offset": shown})
        else:
            click.echo(
                f"{user}: {'no offset is in use' if offset is None else offset_report.describe(offset)}"
            )
        return 0
    offset = read_local(user, file, "offset", as_json=as_json)
    if offset is not None:
        click.echo(f"{user}: {offset_report.describe(offset)}")
    return 0


async def _profile(bus: Bus, user: str) -> UserProfile:
    with site_link.notify_if_slow(f"waiting for the profile of {user} …"):
        profile = await LatestMessage(bus, PROFILE, user).wait(site_link.TIMEOUT_S)
    if profile is None:
        raise NoAnswerError(f"the profile of {user} did not arrive")
    return profile
