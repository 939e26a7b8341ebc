"""`pointit person anchor USER [LAMP]`: point at one lamp to correct the pose."""

import asyncio
import math
from typing import Unpack

import click

from pointit.cli.common import site_link
from pointit.cli.common.latest_message import LatestMessage
from pointit.cli.common.option_types import Finite
from pointit.cli.common.output import INTERRUPTED, json_option, print_json, say
from pointit.cli.people import pose_text
from pointit.cli.people.anchoring import LATE_S, AnchorRequester
from pointit.cli.people.changing_line import changing_line
from pointit.runtime.service.shutdown import EXIT_FAILED, run_until_shutdown
from pointit.schemas import Anchor, UserPose
from pointit.schemas.topics import POSE, check_name

SHORT_S = 0.2
"""Timeout for the pose before the anchor."""
LESS_M = 0.01
"""Growth of a sigma below which it is not reported."""


def timeout_option(default_s: float = 30.0) -> click.Option:
    """Return the option for the timeout of one pointing."""
    return click.Option(
        ["--timeout", "timeout_s"],
        type=Finite(min=1, max=600),
        default=default_s,
        help="timeout of one pointing, s",
    )


@click.command("anchor", params=[timeout_option(), *site_link.site_options()])
@click.argument("user")
@click.argument("lamp", default="")
@json_option
def command(user: str, lamp: str, *, timeout_s: float, as_json: bool, **at: Unpack[site_link.AtSite]) -> int:
    """Correct the pose of USER, who points at LAMP without a cursor.

    The lamp lights up; USER points at it with a straight arm until it goes dark. LAMP may also be a robot
    that stands or hovers. Without LAMP the localizer chooses the most informative one. Prints the error of
    the direction (the drift of the IMU), and the sigma of the pose before and after.

    Example: pointit person anchor anna led_1

    The exit code is 1 if it was not accepted.
    """
    check_name(user, "user")
    site_link.quiet()
    return run_until_shutdown(_anchor(user, lamp, timeout_s, as_json=as_json, **at))


async def _anchor(
    user: str, lamp: str, timeout_s: float, *, as_json: bool, **at: Unpack[site_link.AtSite]
) -> int:
    async with site_link.join_site(**at) as bus:
        latest_pose = LatestMessage(bus, POSE, user)
        anchoring = AnchorRequester(bus, user)
        before = await latest_pose.wait(SHORT_S)
        try:
            with changing_line() as show:
                anchor = await anchoring.point(lamp, timeout_s, lambda text: show(f"{user}: {text}"))
        except asyncio.CancelledError:
            return INTERRUPTED
        after = latest_pose.value
        if anchor.accepted:
            after = (
                await latest_pose.wait(LATE_S, lambda pose: is_after(pose, anchor, before))
                or latest_pose.value
            )
    if as_json:
        print_json(_fields(user, anchor, before, after))
    else:
        say(f"{user}: {sentence(anchor, before, after)}{site_link.default_address_note(**at)}")
    return 0 if anchor.accepted else EXIT_FAILED


def is_after(pose: UserPose, anchor: Anchor, before: UserPose | None) -> bool:
    """Return True if `pose` includes `anchor`."""
    return pose.anchored_ns >= anchor.stamp_ns or (
        before is not None and pose.anchored_ns > before.anchored_ns
    )


def sentence(anchor: Anchor, before: UserPose | None, after: UserPose | None) -> str:
    """Return a message about the result of an anchor and the pose."""
    lamp = anchor.target_id or "the direction"
    if not anchor.accepted:
        return f"{lamp}: not accepted, the pose is as before: {anchor.reason or 'no reason is given'}"
    off_deg = math.degrees(anchor.azimuth_error_rad)
    text = f"{lamp}: the direction was {abs(off_deg):.1f}° too far {'right' if off_deg > 0 else 'left'}"
    if after is not None:
        sigma_radps = after.yaw_rate_sigma_radps
        if sigma_radps is not None and abs(after.yaw_rate_radps) > sigma_radps:  # else it is not significant
            text += f" (the IMU's drift turns the pose by {pose_text.drift_degpmin(after):.1f} °/min)"
        text += " and is corrected; " + _certainty(anchor, before, after)
    return f"{text}."


def _certainty(anchor: Anchor, before: UserPose | None, after: UserPose) -> str:
    """Return the uncertainty of the pose, and the reason if the position's has grown."""
    text = f"the pose is known {pose_text.sigma_text(after)} now"
    if before is None:
        return text
    (place_before_m, yaw_before_rad), (place_m, _) = pose_text.sigmas(before), pose_text.sigmas(after)
    if place_before_m == yaw_before_rad == 0.0:
        return f"{text}; before, it counted as exact, as it was given"
    text += f", before {pose_text.sigma_text(before)}"
    if place_m > place_before_m + LESS_M:
        why = anchor.reason or "the direction did not fit it"
        text += f"; the position is less certain than before, {why}: localize again if the person has moved"
    return text


def _fields(user: str, anchor: Anchor, before: UserPose | None, after: UserPose | None) -> dict[str, object]:
    return {
        "user": user,
        "lamp": anchor.target_id,
        "accepted": anchor.accepted,
        "reason": anchor.reason,
        "azimuth_error_deg": math.degrees(anchor.azimuth_error_rad),
        "elevation_error_deg": math.degrees(anchor.elevation_error_rad),
        "before": None if before is None else pose_text.fields(before, anchor.stamp_ns),
        "after": None if after is None else pose_text.fields(after, anchor.stamp_ns),
    }
