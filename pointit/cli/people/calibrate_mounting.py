"""`pointit person calibrate mounting USER`: the sensor's mounting on the arm from two poses."""

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import click

from pointit.cli.common import site_link
from pointit.cli.common.keyboard import wait_for_enter
from pointit.cli.common.latest_message import LatestMessage
from pointit.cli.common.lazy import UnknownNameError
from pointit.cli.common.output import INTERRUPTED, json_option, print_json, progress, say
from pointit.cli.common.panels import Finite, PanelCommand
from pointit.cli.common.site_link import SiteAddress, site_command
from pointit.cli.people.anchor import LISTEN_S
from pointit.cli.people.calibrate_user import erase_local, query_site, read_local
from pointit.diagnosis.observation import silence_reason
from pointit.geometry import rotation
from pointit.geometry.rotation import IDENTITY, Quaternion
from pointit.runtime.bus.contract import Bus, list_present
from pointit.runtime.errors import NoAnswerError, PointItError
from pointit.runtime.host.state_file import StateFile
from pointit.schemas import NS_PER_S, SetMounting, SetMountingReply
from pointit.schemas.system import instance_of
from pointit.schemas.topics import IMU, SERVICE_ALIVE, SET_MOUNTING, check_name
from pointit.services.imu_bridge.fitted_mounting import (
    APART_RAD,
    FittedMounting,
    MountingError,
    MountingHold,
    RestPoseCollector,
    solve_mounting,
)
from pointit.services.imu_bridge.stored_mounting import PURPOSE, StoredMountings

POSES = (
    ("ahead", "point level straight ahead, with the arm stretched and the palm down"),
    ("up", "point straight up, with the arm stretched"),
)
NOTICEABLE_RAD = math.radians(2.0)
"""Change of direction below which it is not reported."""


@dataclass(frozen=True, kw_only=True)
class GuidanceOptions:
    """Guidance of the person."""

    rest_s: float
    timeout_s: float
    waits: bool
    """Wait for Enter before each pose."""
    asks: bool
    """Confirm before the result is used."""


@site_command("mounting", cls=PanelCommand, usual=("rest_s", "yes", "show", "erase", "connect"))
@click.argument("user")
@click.option(
    "--seconds", "rest_s", type=Finite(min=0.3, max=30), default=2.0, help="time of rest in each pose, s"
)
@click.option(
    "--timeout", "timeout_s", type=Finite(min=1, max=600), default=30.0, help="timeout for each rest, s"
)
@click.option("--yes", is_flag=True, help="use the result without confirmation")
@click.option(
    "--non-interactive",
    is_flag=True,
    help="no keyboard: record each pose as soon as the arm rests in it, and use the result",
)
@click.option("--show", is_flag=True, help="only show the mounting in use, or stored on this machine")
@click.option("--erase", is_flag=True, help="delete the measured mounting, and use the configured one again")
@json_option
async def command(
    site: SiteAddress,
    user: str,
    *,
    rest_s: float,
    timeout_s: float,
    yes: bool,
    non_interactive: bool,
    show: bool,
    erase: bool,
    as_json: bool,
) -> int:
    """Measure and store the mounting of the person USER's sensor on the arm.

    USER points level ahead with the palm down, then straight up, and rests for two seconds in each. Neither
    the direction nor the twist of the arm on its way up matters. imu-bridge uses the result at once, and at
    every start with the same source and mounting.

    Example: pointit person calibrate mounting anna
    """
    check_name(user, "user")
    if show and erase:
        raise UnknownNameError("--show and --erase exclude each other")
    if show or erase:
        return await _show_or_erase(site, user, erase=erase, as_json=as_json)

    # A program that reads JSON has nobody to ask
    asks = not yes and not as_json
    guidance = GuidanceOptions(
        rest_s=rest_s,
        timeout_s=timeout_s,
        waits=not non_interactive,
        asks=asks and not non_interactive,
    )
    return await _measure(site, user, guidance, as_json=as_json)


async def _measure(site: SiteAddress, user: str, guidance: GuidanceOptions, *, as_json: bool) -> int:
    async with site.join() as bus:
        try:
            fitted = await measure(bus, user, guidance)
            if not as_json:
                for sentence in format_result(fitted):
                    say(f"{user}: {sentence}")
            if guidance.asks:
                await wait_for_enter("Press Enter to use it, Ctrl-C to leave everything as it is.", "--yes")
        except asyncio.CancelledError:
            return INTERRUPTED
        query = SetMounting(sensor_from_arm_xyzw=fitted.arm_from_true, is_relative=True)
        reply = await bus.call(SET_MOUNTING, query, user)
    if as_json:
        print_json({"user": user, **fields(fitted), **_reply_fields(reply)})
        return 0
    say(f"{user}: {reply.message}{site.note}")
    if abs(fitted.heading_change_rad) > NOTICEABLE_RAD:
        change_deg = math.degrees(fitted.heading_change_rad)
        click.echo(
            f"{user}: with it the direction turns by {change_deg:.0f}°: correct the pose with "
            f"`pointit person anchor {user}` or `pointit person pose {user} --facing DEG`"
        )
    return 0


async def measure(bus: Bus, user: str, guidance: GuidanceOptions) -> FittedMounting:
    """Guide the person through the two poses and return the mounting.

    Raises:
        NoAnswerError: If no samples arrive, or not from imu-bridge, or the arm never rests.
        PointItError: If the poses determine no mounting, with the reason.
    """
    wrist = _Wrist(bus, user)
    await wrist.check()
    holds: list[MountingHold] = []
    for name, instruction in POSES:
        text = f"{user}: {instruction}"
        if guidance.waits:
            await wait_for_enter(
                f"{text}, then press Enter and rest for {guidance.rest_s:g} s", "--non-interactive"
            )
        else:
            click.echo(f"{text}, and rest for {guidance.rest_s:g} s", err=True)
        # Without Enter, the next pose must be far from the previous one
        last: Quaternion | None = None
        if holds and not guidance.waits:
            last = holds[-1].mean_xyzw
        with progress() as tell:
            holds.append(await wrist.rest(name, guidance, tell, last))
        click.echo(f"{user}: good, the arm rested {name}", err=True)
    try:
        return solve_mounting(*holds)
    except MountingError as error:
        raise PointItError(f"{user}: {error}") from error


class _Wrist:
    def __init__(self, bus: Bus, user: str) -> None:
        self._bus = bus
        self._user = user
        self._latest = LatestMessage(bus, IMU, user)

    async def check(self) -> None:
        """Check that samples arrive, from a service with a mounting."""
        present = await list_present(self._bus, SERVICE_ALIVE, LISTEN_S)
        bridge = instance_of(SET_MOUNTING.server, self._user)
        if bridge not in present:
            raise NoAnswerError(
                f"{bridge} is not present, so there is no sensor to measure (a simulated person wears none): "
                f"start it, as in `pointit person add {self._user} --imu serial:PORT`"
            )
        with site_link.notify_if_slow(f"waiting for the wrist of {self._user} …"):
            sample = await self._latest.wait(site_link.TIMEOUT_S)
        if sample is None:
            reason = silence_reason(IMU, self._user, present)
            raise NoAnswerError(f"no samples arrive from the wrist of {self._user}: {reason}")

    async def rest(
        self, name: str, guidance: GuidanceOptions, tell: Callable[[str], None], apart_from: Quaternion | None
    ) -> MountingHold:
        """Return the next pose in which the arm rests and that is far from `apart_from`."""
        rest_poses = RestPoseCollector(guidance.rest_s)
        try:
            async with asyncio.timeout(guidance.timeout_s):
                while True:
                    # On the way from the previous pose, nothing counts
                    sample = await self._latest.wait_for_next()
                    turned_rad = math.pi
                    if apart_from is not None:
                        turned_rad = rotation.angle_between(apart_from, sample.orientation_xyzw)
                    if turned_rad < APART_RAD:
                        turned_deg = math.degrees(turned_rad)
                        tell(f"{self._user}: the arm has turned by {turned_deg:.0f}° so far")
                        continue

                    # Far from it, until the arm is at rest
                    hold = rest_poses.add(sample.orientation_xyzw, sample.stamp_ns / NS_PER_S)
                    if hold is not None:
                        return hold
                    rested = f"at rest for {rest_poses.rested_s:.1f} of {guidance.rest_s:g} s"
                    moved_deg = math.degrees(rest_poses.moved_rad)
                    tell(f"{self._user}: {rested}, moves by {moved_deg:.1f}°")
        except TimeoutError:
            raise NoAnswerError(
                f"the arm of {self._user} did not rest {name} within {guidance.timeout_s:g} s; try again, or "
                "wait longer with --timeout"
            ) from None


def format_result(fitted: FittedMounting) -> list[str]:
    """Return the result as lines of text."""
    about_deg = math.degrees(fitted.about_arm_rad)
    off_deg = math.degrees(fitted.off_axis_rad)
    direction = "clockwise" if about_deg > 0 else "counter-clockwise"
    mounting_text = (
        f"the sensor sits turned by {abs(about_deg):.0f}° about the arm ({direction}, seen from the elbow), "
        f"and the assumed axis of the arm is {off_deg:.0f}° off"
    )
    level_before = _deg(fitted.forward_before_rad)
    level_after = _deg(fitted.forward_after_rad)
    raised_before = _deg(fitted.up_before_rad)
    raised_after = _deg(fitted.up_after_rad)
    errors = (
        f"elevation of the level arm: {level_before} before, {level_after} with this mounting; of the raised "
        f"arm, less 90°: {raised_before} before, {raised_after} with it"
    )
    return [mounting_text, errors]


def _deg(angle_rad: float) -> str:
    angle_deg = round(math.degrees(angle_rad), 1) + 0.0  # no minus before 0
    return f"{angle_deg:+.1f}°"


def fields(fitted: FittedMounting) -> dict[str, Any]:
    """Return the result, for programs."""
    forward_error = _error_fields(fitted.forward_before_rad, fitted.forward_after_rad)
    up_error = _error_fields(fitted.up_before_rad, fitted.up_after_rad)
    return {
        "about_arm_deg": math.degrees(fitted.about_arm_rad),
        "off_axis_deg": math.degrees(fitted.off_axis_rad),
        "forward_error_deg": forward_error,
        "up_error_deg": up_error,
        "heading_change_deg": math.degrees(fitted.heading_change_rad),
    }


def _error_fields(before_rad: float, after_rad: float) -> dict[str, float]:
    return {"before": math.degrees(before_rad), "after": math.degrees(after_rad)}


def _reply_fields(reply: SetMountingReply) -> dict[str, Any]:
    return {"sensor_from_arm_xyzw": reply.sensor_from_arm_xyzw, "message": reply.message}


async def _show_or_erase(site: SiteAddress, user: str, *, erase: bool, as_json: bool) -> int:
    """Show the stored mounting, or delete it with `erase`, and return the exit code.

    The request goes to imu-bridge if it runs, else the file on this machine is read or changed.
    """
    # an identity rotation queries the mounting in use
    query = SetMounting() if erase else SetMounting(sensor_from_arm_xyzw=IDENTITY, is_relative=True)
    reply = await query_site(lambda bus: bus.call(SET_MOUNTING, query, user), site.join())
    if reply is not None:
        if as_json:
            print_json({"user": user, "from": "imu-bridge", **_reply_fields(reply)})
        else:
            note = site.note if erase else ""
            say(f"{user}: {reply.message}{note}")
        return 0

    # Without imu-bridge, nobody else uses the file
    file = StateFile(StoredMountings, user, PURPOSE)
    if erase:
        return erase_local(user, file, "mounting", as_json=as_json)
    stored = read_local(user, file, "mounting", as_json=as_json)
    if stored is not None:
        for source, mounting in sorted(stored.by_source.items()):
            x, y, z, w = mounting.sensor_from_arm_xyzw
            quaternion = f"x {x:.3f}, y {y:.3f}, z {z:.3f}, w {w:.3f}"
            click.echo(
                f"{user}: source {source}, measured with mounting={mounting.configured}: sensor_from_arm "
                f"{quaternion}"
            )
    return 0
