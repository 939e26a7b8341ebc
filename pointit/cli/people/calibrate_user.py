"""`pointit person calibrate user USER`: pointing offset from lamps pointed at without a cursor."""

import asyncio
import itertools
import math
import statistics
from collections.abc import Awaitable, Callable, Sequence
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from itertools import combinations
from typing import Any, TypeVar

import click
from pydantic import BaseModel
from rich.text import Text

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
from pointit.cli.common.site_link import SiteAddress, site_command
from pointit.cli.people.anchor import (
    LISTEN_S,
    AnchorNotStartedError,
    AnchorRequester,
    point_once,
    timeout_option,
)
from pointit.cli.people.pose import found
from pointit.diagnosis.observation import silence_reason
from pointit.geometry import vector
from pointit.runtime.bus.contract import AnyTopic, Bus, list_present
from pointit.runtime.bus.site_clock import SiteClock
from pointit.runtime.config.nearest_name import nearest
from pointit.runtime.errors import ConnectError, NoAnswerError, PointItError, RefusedError
from pointit.runtime.host.state_file import StateFile
from pointit.schemas import NS_PER_S, Anchor, PointingOffset, SetOffset, UserProfile
from pointit.schemas.topics import LOCALIZATION, MAP, POSE, PROFILE, SERVICE_ALIVE, SET_OFFSET, check_name
from pointit.services.pointing.offset import OffsetFit, OffsetSighting, fit, sighting
from pointit.services.pointing.pointer import apply
from pointit.services.supervisor.transitions import OFFSET_PURPOSE

R = TypeVar("R")
K = TypeVar("K", bound=BaseModel)

STEADY_RAD = math.radians(3.0)
"""Spread of the rays about their mean above which a pointing does not count."""
DRIFT_FROM = 4
"""Number of pointings needed to estimate a drift of the IMU."""
DRIFT_OVER_S = 8.0
"""Minimum time between the first and the last of them."""
MAX_DROPPED = 1.0 / 3.0
"""Share of dropped pointings above which the pose is wrong, not the person's pointing."""
SCATTER_RAD = math.radians(20.0)
"""Rms of all azimuths about their mean above which the pose must be wrong."""


async def query_site(
    ask: Callable[[Bus], Awaitable[R]], connection: AbstractAsyncContextManager[Bus]
) -> R | None:
    """Return the result of `ask` on a site that is joined, or None if there is none or no service replies."""
    try:
        async with connection as bus:
            return await ask(bus)
    except (ConnectError, NoAnswerError):
        return None


def erase_local(user: str, file: StateFile[K], quantity: str, *, as_json: bool) -> int:
    """Delete the calibration stored on this machine, and print that; return the exit code."""
    was_stored = file.erase()
    if as_json:
        print_json({"user": user, "from": str(file.path), "erased": was_stored})
    elif was_stored:
        click.echo(
            f"{user}: no service runs; the {quantity} stored on this machine ({file.path}) was deleted"
        )
    else:
        click.echo(f"{user}: no service runs, and no {quantity} is stored on this machine ({file.path})")
    return 0


def read_local(user: str, file: StateFile[K], quantity: str, *, as_json: bool) -> K | None:
    """Return the calibration stored on this machine for output as text, after printing its file's name."""
    state = file.read()
    if as_json:
        shown = None if state is None else state.model_dump(mode="json")
        print_json({"user": user, "from": str(file.path), quantity: shown})
        return None
    if state is None:
        click.echo(f"{user}: no service runs, and no {quantity} is stored on this machine ({file.path})")
        return None
    click.echo(f"{user}: no service runs; stored on this machine ({file.path}):")
    return state


@dataclass(frozen=True, kw_only=True)
class AnchorResidual:
    """One pointing at a lamp, with the person's errors before and after correction, rad.

    Target minus ray; azimuths without the mean of all pointings, which is the heading of the pose. None if
    not measured.
    """

    lamp: str
    azimuth_before_rad: float | None = None
    azimuth_after_rad: float | None = None
    elevation_before_rad: float | None = None
    elevation_after_rad: float | None = None
    is_used: bool
    why_not: str = ""
    not_accepted: str = ""
    """Reason why the localizer did not correct the pose by it, or `""`. It may count nevertheless."""


def in_one_pose(anchors: Sequence[Anchor]) -> list[Anchor]:
    """Return `anchors` relative to the pose before the first, without the corrections by each.

    The IMU's drift meanwhile, a constant rate, is removed if it can be estimated: the median of the slopes
    between all pairs (Theil and Sen).
    """
    if not anchors:
        return []
    # One pose for all: each anchor has the pose that the ones before it have corrected
    first = anchors[0]
    pose = {"position_m": first.position_m, "yaw_rad": first.yaw_rad}
    same = [anchor.model_copy(update=pose) for anchor in anchors]
    times_s = [(anchor.stamp_ns - first.stamp_ns) / NS_PER_S for anchor in same]
    duration_s = max(times_s) - min(times_s)
    if len(same) < DRIFT_FROM or duration_s < DRIFT_OVER_S:
        return same

    # Theil and Sen: pairs that are close in time have slopes of noise
    errors_rad = [_azimuth_error_rad(anchor) for anchor in same]
    slopes_radps: list[float] = []
    for a, b in combinations(range(len(same)), 2):
        elapsed_s = times_s[b] - times_s[a]
        if elapsed_s > 1.0:
            change_rad = vector.wrap(errors_rad[b] - errors_rad[a])
            slopes_radps.append(change_rad / elapsed_s)
    rate_radps = statistics.median(slopes_radps) if slopes_radps else 0.0

    steady: list[Anchor] = []
    for anchor, time_s in zip(same, times_s, strict=True):
        yaw_rad = anchor.yaw_rad + rate_radps * time_s
        steady.append(anchor.model_copy(update={"yaw_rad": yaw_rad}))
    return steady


def _azimuth_error_rad(anchor: Anchor) -> float:
    seen = sighting(anchor)
    return 0.0 if seen is None else _turn(seen)


def _turn(seen: OffsetSighting) -> float:
    return vector.wrap(seen.target_azimuth_rad - seen.azimuth_rad)


def assess(anchors: Sequence[Anchor], now_ns: int) -> tuple[OffsetFit, list[AnchorResidual]]:
    """Return the offset fitted to `anchors`, and the residual of each."""
    steady = list(filter(_is_steady, anchors))
    sightings: list[OffsetSighting] = []
    for anchor in in_one_pose(steady):
        seen = sighting(anchor)
        if seen is not None:
            sightings.append(seen)
    offset_fit = fit(sightings, now_ns)

    # A row for each anchor, in their order. Sightings are of the steady ones only
    rows: list[AnchorResidual] = []
    index = 0
    for anchor in anchors:
        if anchor not in steady:
            rows.append(AnchorResidual(lamp=anchor.target_id, is_used=False, why_not=anchor.reason))
            continue
        is_used = index not in offset_fit.dropped
        rows.append(_row(anchor, sightings[index], offset_fit, is_used=is_used))
        index += 1
    return offset_fit, rows


def _is_steady(anchor: Anchor) -> bool:
    return bool(anchor.target_m) and anchor.spread_rad <= STEADY_RAD


def _row(anchor: Anchor, seen: OffsetSighting, offset_fit: OffsetFit, *, is_used: bool) -> AnchorResidual:
    azimuth_rad = vector.wrap(_turn(seen) - offset_fit.heading_rad)
    elevation_rad = seen.target_elevation_rad - seen.elevation_rad
    by_azimuth = 0.0
    by_elevation = 0.0
    if offset_fit.offset is not None:
        world_azimuth_rad = seen.azimuth_rad + offset_fit.heading_rad
        by_azimuth, by_elevation = apply(offset_fit.offset, world_azimuth_rad, seen.elevation_rad)
    not_accepted = ""
    if not anchor.accepted:
        not_accepted = anchor.reason or "no reason given"
    return AnchorResidual(
        lamp=anchor.target_id,
        azimuth_before_rad=azimuth_rad,
        azimuth_after_rad=vector.wrap(azimuth_rad - by_azimuth),
        elevation_before_rad=elevation_rad,
        elevation_after_rad=elevation_rad - by_elevation,
        is_used=is_used,
        why_not="" if is_used else "far from the others",
        not_accepted=not_accepted,
    )


def rejection_reason(rows: Sequence[AnchorResidual]) -> str:
    """Return the evidence in `rows` that the pose is wrong, so that no offset is stored, or `""`."""
    azimuths_rad: list[float] = []
    dropped = 0
    for row in rows:
        if row.azimuth_before_rad is not None:
            azimuths_rad.append(row.azimuth_before_rad)
            dropped += not row.is_used
    count = len(azimuths_rad)
    if dropped > MAX_DROPPED * count:
        return f"{dropped} of {count} pointings exceed the error of a person"
    if not azimuths_rad:
        return ""

    # Circular mean: azimuths may lie on both sides of 180°
    sine = sum(map(math.sin, azimuths_rad))
    cosine = sum(map(math.cos, azimuths_rad))
    mean_rad = math.atan2(sine, cosine)
    squares = [vector.wrap(azimuth_rad - mean_rad) ** 2 for azimuth_rad in azimuths_rad]
    rms_rad = math.sqrt(statistics.fmean(squares))
    if rms_rad <= SCATTER_RAD:
        return ""
    return f"the directions scatter by {math.degrees(rms_rad):.0f}° about their mean"


def table_row(row: AnchorResidual) -> dict[str, Any]:
    """Return `row` for a program, in degrees, or None if not measured."""
    return {
        "lamp": row.lamp,
        "azimuth_before_deg": _degrees(row.azimuth_before_rad),
        "azimuth_after_deg": _degrees(row.azimuth_after_rad),
        "elevation_before_deg": _degrees(row.elevation_before_rad),
        "elevation_after_deg": _degrees(row.elevation_after_rad),
        "used": "yes" if row.is_used else f"no: {row.why_not}",
        "not_accepted": row.not_accepted,
    }


def shown_row(row: AnchorResidual) -> dict[str, Any]:
    """Return `row` for people: degrees too far right and too low."""
    counts = "yes" if row.is_used else f"no: {row.why_not}"
    if row.is_used and row.not_accepted:
        counts = f"yes, but the localizer did not correct the pose by it: {row.not_accepted}"
    return {
        "lamp": row.lamp,
        "too_far_right": _tenths(row.azimuth_before_rad),
        "corrected": _tenths(row.azimuth_after_rad),
        "too_low": _tenths(row.elevation_before_rad),
        "corrected_": _tenths(row.elevation_after_rad),
        "counts": counts,
    }


def _degrees(angle_rad: float | None) -> float | None:
    return None if angle_rad is None else round(math.degrees(angle_rad), 2)


def _tenths(angle_rad: float | None) -> Text | None:
    if angle_rad is None:
        return None
    angle_deg = round(math.degrees(angle_rad), 1) + 0.0  # no minus before 0
    return Text(f"{angle_deg:.1f}°", justify="right")


def describe(offset: PointingOffset) -> str:
    """Return the effect of an offset as a clause."""
    up_deg = math.degrees(offset.elevation[0])
    direction = "up" if up_deg >= 0 else "down"
    text = f"the rays are turned {direction} by {abs(up_deg):.1f}°"
    if offset.rung == "polynomial":
        text += " in the middle, and differently elsewhere (a polynomial in azimuth and elevation)"
    pointings = "1 pointing" if offset.anchors == 1 else f"{offset.anchors} pointings"
    remaining_deg = math.degrees(offset.sigma_rad)
    return f"{text}; fitted from {pointings}, {remaining_deg:.1f}° (1 sigma) is left"


@dataclass(frozen=True, kw_only=True)
class CalibrationOptions:
    """Options of a calibration."""

    lamps: Sequence[str]
    """Lamps in this order. Empty: all of the map."""
    count: int | None
    """Number of pointings. None: one per lamp."""
    timeout_s: float
    keeps: bool


@site_command(
    "user",
    params=[timeout_option()],
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
@click.option("--erase", is_flag=True, help="delete the offset, so that nothing is corrected any more")
@json_option
async def command(
    site: SiteAddress,
    user: str,
    *,
    lamps: tuple[str, ...],
    count: int | None,
    timeout_s: float,
    dry_run: bool,
    show: bool,
    erase: bool,
    as_json: bool,
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
    if show or erase:
        return await _show_or_erase(site, user, erase=erase, as_json=as_json)

    # Lamps may be separated by commas, or given one an option
    names: list[str] = []
    for text in lamps:
        names += filter(None, map(str.strip, text.split(",")))
    options = CalibrationOptions(lamps=names, count=count, timeout_s=timeout_s, keeps=not dry_run)
    return await _measure(site, user, options, as_json=as_json)


async def _measure(site: SiteAddress, user: str, options: CalibrationOptions, *, as_json: bool) -> int:
    async with site.join() as bus:
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

        # Round after round of all lamps
        try:
            order = list(itertools.islice(itertools.cycle(lamps), count))
            anchors, missed = await _point(anchoring, user, order, options.timeout_s)
        except asyncio.CancelledError:
            return INTERRUPTED

        # Nothing is stored from a pose that is wrong, or without a result
        fitted, rows = assess(anchors, clock.now_ns())
        problem = rejection_reason(rows)
        if problem:
            problem = (
                f"the pose looks wrong, {problem}: localize first, or `pointit person pose {user} X Y`, then "
                "calibrate again"
            )
        if not options.keeps and not as_json:
            _print_residuals(user, rows)
        if problem and options.keeps:
            raise PointItError(f"{user}: nothing is stored: {problem}")
        if fitted.offset is None:
            reasons = [*missed, *(row.why_not for row in rows)]
            reason = "; ".join(dict.fromkeys(reasons))
            raise PointItError(f"{user}: no pointing was usable, nothing was changed: {reason}")
        note = ". ".join(filter(None, (problem, "nothing is changed (--dry-run)")))
        if options.keeps:
            reply = await bus.call(SET_OFFSET, SetOffset(offset=fitted.offset), user)
            note = reply.message + site.note
    if as_json:
        offset = fitted.offset.model_dump(mode="json")
        result = {"user": user, "offset": offset, "doubt": problem}
        print_json({**result, "anchors": [table_row(row) for row in rows], "missed": missed})
    else:
        if options.keeps:
            _print_residuals(user, rows)
        click.echo(f"{user}: {describe(fitted.offset)}")
        say(f"{user}: {note}")
    return 0


async def _lamps(bus: Bus, user: str, options: Sequence[str]) -> list[str]:
    """Return the lamps to point at, after checking that the person's pose is known."""
    room = LatestMessage(bus, MAP)
    pose = LatestMessage(bus, POSE, user)
    latest = LatestMessage(bus, LOCALIZATION, user)
    with site_link.notify_if_slow("waiting for the map …"):
        environment = await room.wait(site_link.TIMEOUT_S)
    if environment is None:
        reason = await _silence_reason(bus, MAP, "")
        raise NoAnswerError(f"there is no map: {reason}")
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


async def _silence_reason(bus: Bus, topic: AnyTopic, user: str) -> str:
    present = await list_present(bus, SERVICE_ALIVE, LISTEN_S)
    return silence_reason(topic, user, present)


async def _point(
    anchoring: AnchorRequester, user: str, lamps: Sequence[str], timeout_s: float
) -> tuple[list[Anchor], list[str]]:
    """Return the anchors, and why others failed; raises if the localizer refuses, also after waiting."""
    anchors: list[Anchor] = []
    missed: list[str] = []
    for number, lamp in enumerate(lamps, start=1):
        which = f"{user}: {number} of {len(lamps)}"
        try:
            anchor = await _begun(anchoring, lamp, timeout_s, which)
        except AnchorNotStartedError as error:
            raise AnchorNotStartedError(f"{user}: nothing was changed: {error}") from error
        except RefusedError as error:
            missed.append(f"{lamp}: {error}")
            say(f"{which}: {lamp}: {error}", err=True)
        else:
            anchors.append(anchor)
            say(f"{which}: pointed at {lamp}", err=True)
    return anchors, missed


async def _begun(anchoring: AnchorRequester, lamp: str, timeout_s: float, which: str) -> Anchor:
    """Return the anchor from pointing at `lamp`; wait once while another person uses the lamps."""
    try:
        return await point_once(anchoring, lamp, timeout_s, which)
    except AnchorNotStartedError as error:
        if not error.is_busy:
            raise
        say(f"{which}: {error}; waiting for up to {timeout_s:g} s", err=True)
    await anchoring.wait_until_idle(timeout_s)
    return await point_once(anchoring, lamp, timeout_s, which)


def _print_residuals(user: str, rows: Sequence[AnchorResidual]) -> None:
    about = (
        f"how far {user} pointed too far right and too low, before and after correction, without a common "
        "turn, which belongs to the pose"
    )
    section = OutputSection(name="pointings", about=about, rows=tuple(map(shown_row, rows)))
    print_table(console(), section)


async def _show_or_erase(site: SiteAddress, user: str, *, erase: bool, as_json: bool) -> int:
    """Show or delete the offset: by the supervisor if it runs, else in the file on this machine."""
    file = StateFile(PointingOffset, user, OFFSET_PURPOSE)
    if erase:
        reply = await query_site(lambda bus: bus.call(SET_OFFSET, SetOffset(), user), site.join())
        if reply is None:
            return erase_local(user, file, "offset", as_json=as_json)
        if as_json:
            print_json({"user": user, "from": "supervisor", "message": reply.message})
        else:
            say(f"{user}: {reply.message}{site.note}")
        return 0

    # The supervisor's profile has the offset in use. Without one, the file has that of the next start
    profile = await query_site(lambda bus: _profile(bus, user), site.join())
    if profile is not None:
        offset = profile.offset
        if as_json:
            shown: Any = None if offset is None else offset.model_dump(mode="json")
            print_json({"user": user, "from": "supervisor", "offset": shown})
        else:
            effect = "no offset is in use" if offset is None else describe(offset)
            click.echo(f"{user}: {effect}")
        return 0
    offset = read_local(user, file, "offset", as_json=as_json)
    if offset is not None:
        click.echo(f"{user}: {describe(offset)}")
    return 0


async def _profile(bus: Bus, user: str) -> UserProfile:
    with site_link.notify_if_slow(f"waiting for the profile of {user} …"):
        profile = await LatestMessage(bus, PROFILE, user).wait(site_link.TIMEOUT_S)
    if profile is None:
        raise NoAnswerError(f"the profile of {user} did not arrive")
    return profile
