"""`pointit person pose USER`: show or set a person's pose."""

import asyncio
import math
from dataclasses import dataclass

import click

from pointit.cli.common import site_link
from pointit.cli.common.keyboard import check_keyboard, wait_for_enter
from pointit.cli.common.latest_message import LatestMessage
from pointit.cli.common.lazy import UnknownNameError
from pointit.cli.common.output import INTERRUPTED, json_option, print_json, say
from pointit.cli.common.panels import Finite, PanelCommand
from pointit.cli.common.site_link import SiteAddress, site_command
from pointit.cli.people import anchor
from pointit.cli.people.anchor import LISTEN_S, localizing, missing_reason, out_of_map_warning, people
from pointit.forearm.true_pose import PoseError, TruePose, find_true_poses
from pointit.runtime.bus.contract import Bus, list_present
from pointit.runtime.bus.site_clock import SiteClock
from pointit.runtime.errors import NoAnswerError
from pointit.schemas import CancelLocalization, Localization, SetHeading, SetPose, TrackedObjects, UserPose
from pointit.schemas.base import FARTHEST
from pointit.schemas.printable import plain
from pointit.schemas.topics import (
    ANY,
    CANCEL_LOCALIZATION,
    LOCALIZATION,
    MAP,
    OBJECTS,
    POSE,
    SERVICE_ALIVE,
    SET_HEADING,
    SET_POSE,
    check_name,
)

TYPED_SIGMA_M = 0.05
"""Sigma of a position given without yaw, if the yaw itself is uncertain."""
CLOCK_TIMEOUT_S = 0.3
TRUTH_TIMEOUT_S = 0.3
"""Timeout for the true pose by motion capture, of which most sites have none."""
MAP_TIMEOUT_S = 0.3
"""Timeout for the map with which a position is checked; it is a state, so it arrives at once."""
YAW_TIMEOUT_S = 2.0
"""Timeout for the current yaw, if it is known. Too short, a busy machine would set the yaw to 0."""
SHORT_S = 0.3
"""Timeout for a known pose, before the localizer's progress is reported."""
WITHOUT_KEYBOARD = "--now while the person points"
"""Option of --facing that needs no keyboard."""

HELP = """Show or set the pose of the person USER.

\b
Examples:
  pointit person pose anna                  position, yaw, drift and 1 sigma;
                                            their error by motion capture
  pointit person pose anna 2.0 0.5          set the position, m; the yaw stays
  pointit person pose anna 2 0.5 --yaw 20   set the yaw, too
  pointit person pose anna --facing 90      set it: anna points level along y
  pointit person pose anna --forget-bias    another person wears the sensor

X Y alone corrects the position of a pose that was found by pointing: its
sigma is then 5 cm, that of the yaw does not change, and the drift of the IMU
is still tracked. With --yaw, or if the pose was given before, all of it counts
as exact.

With --forget-bias, the next localization by a robot expects no elevation
bias. It cancels a running localization. The pose does not change.

The exit code is 1 if the pose is unknown, or the localizer refuses.
"""

_DEGREES = Finite(-360, 360)


@site_command(
    "pose",
    help=HELP,
    cls=PanelCommand,
    usual=("yaw_deg", "facing_deg", "now", "forget_bias", "as_json", "connect"),
    # a position may be negative, which looks like an option
    context_settings={"ignore_unknown_options": True},
)
@click.argument("user")
@click.argument("numbers", nargs=-1, metavar="[X Y [Z]]")
@click.option(
    "--yaw",
    "yaw_deg",
    type=_DEGREES,
    help="with X Y: azimuth in the room at which the IMU's yaw is 0, °  [default: unchanged]",
)
@click.option(
    "--facing",
    "facing_deg",
    type=_DEGREES,
    help="azimuth in the room towards which the person points level, °: 0 along x, 90 along y",
)
@click.option("--now", is_flag=True, help="with --facing: do not wait for Enter, the person points already")
@click.option(
    "--forget-bias",
    is_flag=True,
    help="forget the elevation bias of earlier localizations, as of another person",
)
@json_option
async def command(
    site: SiteAddress,
    user: str,
    numbers: tuple[str, ...],
    *,
    yaw_deg: float | None,
    facing_deg: float | None,
    now: bool,
    forget_bias: bool,
    as_json: bool,
) -> int:
    """Show or set a person's pose."""
    check_name(user, "user")

    # What was typed is complete and consistent before the site is looked for
    query = _place(numbers, yaw_deg)
    if forget_bias and (query, yaw_deg, facing_deg) != (None, None, None):
        raise UnknownNameError("--forget-bias excludes X Y, --yaw and --facing")
    allows_yaw = query is not None and facing_deg is None
    if yaw_deg is not None and not allows_yaw:
        raise UnknownNameError(
            "--yaw belongs to X Y and excludes --facing; to turn a person where they stand: --facing"
        )
    if now and facing_deg is None:
        raise UnknownNameError("--now belongs to --facing")
    if facing_deg is not None and not now:
        check_keyboard(WITHOUT_KEYBOARD)  # before anything is changed
    request = _PoseRequest(
        query, keeps_yaw=yaw_deg is None, facing_deg=facing_deg, now=now, forget_bias=forget_bias
    )
    return await _pose(site, user, request, as_json=as_json)


@dataclass(frozen=True)
class _PoseRequest:
    position: SetPose | None
    keeps_yaw: bool
    facing_deg: float | None
    now: bool
    forget_bias: bool


def _place(words: tuple[str, ...], yaw_deg: float | None) -> SetPose | None:
    if not words:
        return None
    numbers: list[float] = []
    for word in words:
        try:
            number = float(word)
        except ValueError:
            number = math.nan
        if not abs(number) <= FARTHEST:
            raise UnknownNameError(
                f"{word!r} is neither a coordinate in metres nor an option; write X Y, or X Y Z"
            )
        numbers.append(number)
    if len(numbers) not in (2, 3):
        raise UnknownNameError(
            f"a position has two or three numbers, X Y and optionally Z, got {len(numbers)}"
        )
    x, y, z = (*numbers, 0.0)[:3]
    return SetPose(position_m=(x, y, z), yaw_rad=math.radians(yaw_deg or 0.0))


async def _pose(site: SiteAddress, user: str, request: _PoseRequest, *, as_json: bool) -> int:
    async with site.join() as bus:
        clock = SiteClock(bus)
        latest_pose = LatestMessage(bus, POSE, user)
        latest_localization = LatestMessage(bus, LOCALIZATION, user)
        latest_truth = LatestTruth(bus, user)

        # Changes first. For people, their answers are the result
        try:
            sentences = await _request_changes(bus, user, request, latest_pose)
        except NoAnswerError as error:
            present = await list_present(bus, SERVICE_ALIVE, LISTEN_S)
            if user in people(present):
                raise
            reason = missing_reason(POSE, user, present)
            raise NoAnswerError(f"nothing was changed: {reason}") from error
        except asyncio.CancelledError:
            return INTERRUPTED
        if sentences and not as_json:
            for sentence in sentences:
                say(f"{user}: {sentence}{site.note}")
            return 0

        # Forgetting succeeds without a known pose
        if request.forget_bias:
            await latest_pose.wait(YAW_TIMEOUT_S, lambda pose: pose.remembered_bias is None)
            if latest_pose.value is None:
                print_json({"user": user, "remembered_localizations": 0})
                return 0

        # The pose now, its age by the site's clock, and its error if a tracker sees the person
        pose = await found(bus, user, latest_pose, latest_localization)
        await asyncio.gather(clock.wait_for_tick(CLOCK_TIMEOUT_S), latest_truth.wait(TRUTH_TIMEOUT_S))
        shown = anchor.fields(pose, clock.now_ns(), latest_truth.error_of(pose))
    if as_json:
        print_json({"user": user, **shown})
    else:
        for line in anchor.lines(shown):
            click.echo(plain(line))
    return 0


class LatestTruth(LatestMessage[TrackedObjects]):
    """Latest message of a tracker that sees the true pose of a person."""

    def __init__(self, bus: Bus, user: str) -> None:
        """Subscribe to all trackers."""
        self._user = user
        self._true_pose: TruePose | None = None
        self._tracked: dict[str, TrackedObjects] = {}
        super().__init__(bus, OBJECTS, ANY)

    def error_of(self, pose: UserPose) -> PoseError | None:
        """Return the error of a localized pose, or None if no tracker sees the person."""
        return None if self._true_pose is None else self._true_pose.error_of(pose)

    def _on_message(self, message: TrackedObjects, name: str) -> None:
        self._tracked[name] = message
        true_pose = find_true_poses(self._tracked).get(self._user)
        if true_pose is not None:
            self._true_pose = true_pose
            super()._on_message(message, name)


async def found(
    bus: Bus, user: str, latest_pose: LatestMessage[UserPose], latest: LatestMessage[Localization]
) -> UserPose:
    """Return a person's pose.

    Raises:
        NoAnswerError: If it is not known yet, or there is no such person; says what to do.
    """
    with site_link.notify_if_slow(f"waiting for the pose of {user} …"):
        pose = await latest_pose.wait(SHORT_S)
        if pose is None and not localizing(user, latest.value):
            pose = await latest_pose.wait(site_link.TIMEOUT_S - SHORT_S)
        if pose is not None:
            return pose
        progress = localizing(user, latest.value)
        if progress:
            raise NoAnswerError(f"where {user} stands is not known yet: {progress}")
        present = await list_present(bus, SERVICE_ALIVE, LISTEN_S)
    advice = missing_reason(POSE, user, present)
    if user in people(present):
        advice += f"; or set it: pointit person pose {user} X Y"
    raise NoAnswerError(f"where {user} stands is not known: {advice}")


def with_yaw_of(query: SetPose, before: UserPose) -> SetPose:
    """Return `query` with the yaw of the current pose; a found one stays tracked."""
    if before.method not in ("static_targets", "moving_target"):
        return query.model_copy(update={"yaw_rad": before.yaw_rad})
    variance_m2 = TYPED_SIGMA_M**2
    yaw_variance_rad2 = before.covariance[8]
    return SetPose(
        position_m=query.position_m,
        yaw_rad=before.yaw_rad,
        method=before.method,
        covariance=(variance_m2, 0.0, 0.0, 0.0, variance_m2, 0.0, 0.0, 0.0, yaw_variance_rad2),
        elevation_bias_rad=before.elevation_bias_rad,
    )


async def _request_changes(
    bus: Bus, user: str, request: _PoseRequest, latest_pose: LatestMessage[UserPose]
) -> list[str]:
    """Request the changes of the pose from the localizer, and return its answers as sentences."""
    if request.forget_bias:
        cancelled = await bus.call(CANCEL_LOCALIZATION, CancelLocalization(forget_bias=True), user)
        return [cancelled.message]
    sentences: list[str] = []
    before = latest_pose.value

    # The position, with the yaw of now: both are one request
    if request.position is not None:
        before = await latest_pose.wait(YAW_TIMEOUT_S)
        query = request.position
        room = await LatestMessage(bus, MAP).wait(MAP_TIMEOUT_S)
        warning = "" if room is None else out_of_map_warning(query.position_m, room)
        if warning:
            click.echo(f"warning: {warning}", err=True)
        note = ""
        if request.keeps_yaw and before is None:
            note = "; no yaw was known, so it is 0°: give it with --yaw"
        elif request.keeps_yaw and before is not None:
            query = with_yaw_of(query, before)
            if query.method != "fixed":
                note = "; the yaw stays, and its drift is still tracked"
        moved = await bus.call(SET_POSE, query, user)
        sentences.append((moved.message or "the pose is set") + note)

    # The heading, by how the arm points at this moment
    if request.facing_deg is not None:
        direction = f"{request.facing_deg:g}°"
        if not request.now:
            await wait_for_enter(
                f"{user}: point level with a straight arm towards {direction} (0° is along x of the room, "
                "90° along y), such as at the wall there, and hold; then press Enter",
                WITHOUT_KEYBOARD,
            )
        heading = SetHeading(azimuth_rad=math.radians(request.facing_deg))
        turned = await bus.call(SET_HEADING, heading, user)
        sentences.append(turned.message or f"the direction pointed in is {direction} now")

    # What is shown next must be the new pose
    if sentences:
        changed_from = before.stamp_ns if before is not None else -1
        await latest_pose.wait(YAW_TIMEOUT_S, lambda pose: pose.stamp_ns > changed_from)
    return sentences
