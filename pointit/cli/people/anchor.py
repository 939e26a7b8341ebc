"""`pointit person anchor USER [LAMP]`: a person points at one lamp without a cursor."""

import asyncio
import contextlib
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import click

from pointit.api.inputs import add_or_similar
from pointit.cli.common.latest_message import LatestMessage
from pointit.cli.common.output import INTERRUPTED, json_option, print_json, progress, say
from pointit.cli.common.panels import Finite
from pointit.cli.common.site_link import SiteAddress, notify_if_slow, site_command
from pointit.diagnosis.observation import silence_reason
from pointit.forearm.true_pose import PoseError
from pointit.geometry.floor_sigma import position_sigma_m, yaw_sigma_rad
from pointit.runtime.bus.contract import AnyTopic, Bus, list_present
from pointit.runtime.errors import NoAnswerError, RefusedError, RequestError
from pointit.runtime.service.process import EXIT_FAILED
from pointit.schemas import (
    NS_PER_S,
    Anchor,
    CancelLocalization,
    Environment,
    Localization,
    PointAnchor,
    UserPose,
)
from pointit.schemas.base import Vec3
from pointit.schemas.topics import (
    ANCHOR,
    CANCEL_LOCALIZATION,
    LOCALIZATION,
    POINT_ANCHOR,
    POSE,
    SERVICE_ALIVE,
    check_name,
)
from pointit.services.registry import person_of

UNKNOWN_DRIFT_DEGPMIN = 10.0
"""1 sigma from which a drift counts as unknown; real IMUs drift by as much."""

METHODS = {
    "fixed": "given",
    "static_targets": "found by pointing at lamps",
    "moving_target": "found by pointing at a moving robot",
    "external": "from a tracker",
}

FAR_M = 5.0
"""Distance outside the map's contents beyond which a position is likely a mistake."""

TIMEOUT_S = 2.0
"""Timeout of the localizer's first message, s."""
LATE_S = 1.0
"""Time an anchor may arrive after the Localization that ends it: they have different keys."""
CANCEL_TIMEOUT_S = 0.5
LISTEN_S = 0.3
"""Time to listen for present services, for an error message."""
RETRY_S = 0.5
"""Minimum wait before a request to a busy localizer is repeated."""

SHORT_S = 0.2
"""Timeout for the pose before the anchor."""
LESS_M = 0.01
"""Growth of a sigma below which it is not reported."""


def sigmas(pose: UserPose) -> tuple[float, float]:
    """Return 1 sigma of the position along its worse direction, m, and of the yaw, rad."""
    return position_sigma_m(pose.covariance), yaw_sigma_rad(pose.covariance)


def sigma_text(pose: UserPose) -> str:
    """Return 1 sigma as `to 0.05 m and 1.2°`; a pose that was given counts as exact."""
    position_m, yaw_rad = sigmas(pose)
    if position_m == yaw_rad == 0.0:
        return "exactly, as it was given"
    return f"to {position_m:.2f} m and {math.degrees(yaw_rad):.1f}°"


def drift_degpmin(pose: UserPose) -> float:
    """Return the yaw drift of the pose by the IMU, °/min."""
    return math.degrees(pose.yaw_rate_radps) * 60.0


def fields(pose: UserPose, now_ns: int, error: PoseError | None = None) -> dict[str, Any]:
    """Return `pose` and its `error` for programs; angles in degrees, ages in seconds, None if unknown."""
    yaw_error_rad = None if error is None else error.yaw_rad
    position_m, yaw_rad = sigmas(pose)
    rate_sigma = pose.yaw_rate_sigma_radps
    return {
        "position_m": pose.position_m,
        "position_sigma_m": position_m,
        "yaw_deg": math.degrees(math.remainder(pose.yaw_rad, math.tau)),
        "yaw_sigma_deg": math.degrees(yaw_rad),
        "elevation_bias_deg": math.degrees(pose.elevation_bias_rad),
        "remembered_localizations": pose.remembered_bias.localizations if pose.remembered_bias else 0,
        "drift_deg_per_min": drift_degpmin(pose),
        "drift_sigma_deg_per_min": None if rate_sigma is None else math.degrees(rate_sigma) * 60.0,
        "anchor_age_s": _age_s(pose.anchored_ns, now_ns) if pose.anchored_ns else None,
        "method": pose.method,
        "age_s": _age_s(pose.stamp_ns, now_ns),
        "position_error_m": None if error is None else error.position_m,
        "yaw_error_deg": None if yaw_error_rad is None else math.degrees(yaw_error_rad),
    }


def lines(shown: Mapping[str, Any]) -> list[str]:
    """Return the result of `fields` as lines for people."""
    x, y, z = shown["position_m"]
    is_exact = shown["position_sigma_m"] == shown["yaw_sigma_deg"] == 0.0
    place = f"x {x:.2f} m, y {y:.2f} m, z {z:.2f} m"
    turn = f"{shown['yaw_deg']:.1f}°"
    if not is_exact:
        place += f"; 1 sigma {shown['position_sigma_m']:.2f} m"
        turn += f"; 1 sigma {shown['yaw_sigma_deg']:.1f}°"
    drift = "not estimated"
    sigma = shown["drift_sigma_deg_per_min"]
    if sigma is not None and sigma >= UNKNOWN_DRIFT_DEGPMIN and abs(shown["drift_deg_per_min"]) < sigma:
        drift = "not known yet"
    elif sigma is not None:
        drift = f"{shown['drift_deg_per_min']:.1f} °/min; 1 sigma {sigma:.1f} °/min"
    anchor = "never" if shown["anchor_age_s"] is None else f"{_age(shown['anchor_age_s'])} ago"
    rows = [
        ("position", place),
        ("yaw", turn),
        ("drift", drift),
        ("last anchor", anchor),
        ("method", METHODS[shown["method"]] + (", counts as exact" if is_exact else "")),
        ("published", f"{_age(shown['age_s'])} ago"),
    ]
    if count := shown["remembered_localizations"]:
        rows.insert(2, ("remembered", f"elevation bias of {count} localization{'s' * (count > 1)}"))
    if shown["elevation_bias_deg"]:
        which = "high" if shown["elevation_bias_deg"] > 0 else "low"
        rows.insert(2, (f"rays too {which}", f"by {abs(shown['elevation_bias_deg']):.1f}°"))
    if shown["position_error_m"] is not None:
        turn = "not known" if shown["yaw_error_deg"] is None else f"{shown['yaw_error_deg']:+.1f}°"
        rows.append(
            ("true error", f"position {shown['position_error_m']:.2f} m, yaw {turn}, by motion capture")
        )
    return [f"{name:<14}{text}" for name, text in rows]


def _age_s(stamp_ns: int, now_ns: int) -> float:
    return max(0, now_ns - stamp_ns) / NS_PER_S


def _age(age_s: float) -> str:
    return f"{age_s:.1f} s" if age_s < 10 else f"{age_s:.0f} s" if age_s < 120 else f"{age_s / 60:.0f} min"


def people(present: Collection[str]) -> list[str]:
    """Return the users of the services in `present`."""
    return sorted({user for user in map(person_of, present) if user})


def missing_reason(topic: AnyTopic, user: str, present: Collection[str]) -> str:
    """Return a clause with the reason why `topic` of `user` is silent, and the remedy."""
    there = people(present)
    if user in there:
        return silence_reason(topic, user, present)
    who = f"there {'is' if len(there) == 1 else 'are'} {', '.join(there)}" if there else "there are no people"
    return f"{user} is not on this site, {who}; {add_or_similar(user, there)}"


def localizing(user: str, localization: Localization | None) -> str:
    """Return the progress of a person's localization, or `""` if there is none."""
    if localization is None or localization.phase != "sampling":
        return ""
    if localization.ahead:
        ahead = localization.ahead[0]
        return f"{user} waits for the lamps, which {ahead} points at; wait until it is their turn"
    if localization.purpose == "anchor":
        return f"{user} is pointing at {localization.target_id or 'a lamp'} to correct the pose; wait"
    lamp = (
        f", lamp {localization.target_index + 1} of {localization.target_count}"
        if localization.target_count > 1
        else ""
    )
    return f"{user} is being localized{lamp}; wait until that is done"


def out_of_map_warning(place: Vec3, room: Environment) -> str:
    """Return a warning if `place` is farther than `FAR_M` outside the map's contents, else `""`."""
    points = [lamp.position_m for lamp in room.lamps]
    lines = [*(strip.line_m for strip in room.strips), *(belt.line_m for belt in room.belts)]
    points += [point for line in lines for point in line]
    if not points:
        return ""
    spans = [(min(point[axis] for point in points), max(point[axis] for point in points)) for axis in (0, 1)]
    away_m = max(max(low - place[axis], place[axis] - high) for axis, (low, high) in enumerate(spans))
    if away_m <= FAR_M:
        return ""
    (x_low, x_high), (y_low, y_high) = spans
    return (
        f"{place[0]:g}, {place[1]:g} m is {away_m:.0f} m outside the contents of map {room.name!r}: "
        f"x {x_low:.1f} to {x_high:.1f} m, y {y_low:.1f} to {y_high:.1f} m"
    )


class AnchorNotStartedError(RefusedError):
    """The localizer refused to start, with the reason."""

    def __init__(self, reason: str, *, is_busy: bool = False) -> None:
        """Create it; `is_busy`: a person is or was being localized, so a retry may succeed."""
        super().__init__(reason)
        self.is_busy = is_busy


class AnchorRequester:
    """Requests anchors from one person's localizer, one after the other."""

    def __init__(self, bus: Bus, user: str) -> None:
        self._bus = bus
        self._user = user
        self._localizations: dict[str, Localization] = {}
        """Last Localization of every user."""
        self._anchor: Anchor | None = None
        self._changed = asyncio.Event()
        bus.subscribe(LOCALIZATION, self._on_localization)
        bus.subscribe(ANCHOR, self._on_anchor, user)

    @property
    def _localization(self) -> Localization | None:
        return self._localizations.get(self._user)

    @property
    def is_busy(self) -> bool:
        """Return True if any person is being localized or points at a lamp."""
        return any(localization.phase == "sampling" for localization in self._localizations.values())

    async def wait_until_idle(self, timeout_s: float) -> bool:
        """Wait until no person is being localized. Return False after `timeout_s`."""
        await asyncio.sleep(RETRY_S)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(timeout_s):
                while self.is_busy:
                    await self._change()
        return not self.is_busy

    async def point(self, lamp: str, timeout_s: float, tell: Callable[[str], None]) -> Anchor:
        """Return the anchor from pointing at `lamp`; it may be a rejected one.

        Args:
            lamp: its id, or `""` for the localizer's choice.
            timeout_s: time, without others' turns at the lamps, after which the anchor is cancelled. It
            is also cancelled when this task is.
            tell: receives instructions.

        Raises:
            AnchorNotStartedError: If it did not start, with the reason.
            RefusedError: If it failed, with the reason.
            NoAnswerError: If there is no localizer, or it did not finish in time.
        """
        before_ns = await self._before()
        self._anchor = None
        was_busy = self.is_busy
        had_work = self._localization is not None and self._localization.phase == "sampling"
        try:
            await self._bus.call(POINT_ANCHOR, PointAnchor(lamp=lamp), self._user)
        except RefusedError as error:
            raise AnchorNotStartedError(str(error), is_busy=was_busy or self.is_busy) from error
        except asyncio.CancelledError:  # before the reply: it may have started nevertheless
            if not had_work:
                await self._call_off()
            raise
        try:
            async with asyncio.timeout(timeout_s) as limit:

                def wait_in_turn() -> None:  # the timeout starts when this person gets the lamps
                    limit.reschedule(asyncio.get_running_loop().time() + timeout_s)

                return await self._result(before_ns, tell, wait_in_turn)
        except TimeoutError:
            await self._call_off()
            raise NoAnswerError(
                f"pointing at {lamp or 'a lamp'} did not finish within {timeout_s:g} s and was cancelled; "
                "does the IMU send? See `pointit doctor`"
            ) from None
        except asyncio.CancelledError:
            await self._call_off()
            raise

    async def _before(self) -> int:
        """Return the stamp of the last Localization so far; newer ones belong to the next request."""
        with (
            contextlib.suppress(TimeoutError),
            notify_if_slow(f"waiting for the localizer of {self._user} …"),
        ):
            async with asyncio.timeout(TIMEOUT_S):
                while self._localization is None:
                    await self._change()
        if self._localization is None:
            there = await list_present(self._bus, SERVICE_ALIVE, LISTEN_S)
            raise NoAnswerError(
                f"no localizer of {self._user} is heard: {missing_reason(LOCALIZATION, self._user, there)}"
            )
        return self._localization.stamp_ns

    async def _result(
        self, before_ns: int, tell: Callable[[str], None], wait_in_turn: Callable[[], None]
    ) -> Anchor:
        reason = None
        while self._anchor is None and reason is None:
            localization = self._localization
            if localization is not None and localization.stamp_ns > before_ns:
                reason = _ending(localization)
                if reason is not None:
                    break
                if localization.ahead:
                    wait_in_turn()
                    tell(f"wait: {localization.ahead[0]} points at the lamps{_more(localization.ahead[1:])}")
                else:
                    tell(f"point at {localization.target_id or 'the lamp that is lit'} and stay on it")
            await self._change()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(LATE_S):
                while self._anchor is None:
                    await self._change()
        if self._anchor is None:
            raise RefusedError(reason or "pointing at the lamp was cancelled")
        return self._anchor

    async def _change(self) -> None:
        self._changed.clear()
        await self._changed.wait()

    async def _call_off(self) -> None:
        with contextlib.suppress(RequestError):
            await self._bus.call(
                CANCEL_LOCALIZATION, CancelLocalization(), self._user, timeout_s=CANCEL_TIMEOUT_S
            )

    def _on_localization(self, localization: Localization, user: str) -> None:
        self._localizations[user] = localization
        self._changed.set()

    def _on_anchor(self, anchor: Anchor, _user: str) -> None:
        self._anchor = anchor
        self._changed.set()


def _more(waiting: Sequence[str]) -> str:
    return f", then {', '.join(waiting)}" if waiting else ""


def _ending(localization: Localization) -> str | None:
    if localization.phase == "idle":
        return "the localizer was restarted; try again"
    if localization.purpose != "anchor":
        return "the localizer is busy with another procedure; try again when it is done"
    return None if localization.phase == "sampling" else localization.reason


def timeout_option() -> click.Option:
    """Return the option for the timeout of one pointing."""
    return click.Option(
        ["--timeout", "timeout_s"],
        type=Finite(min=1, max=600),
        default=30.0,
        help="timeout of one pointing, s",
    )


@site_command("anchor", params=[timeout_option()])
@click.argument("user")
@click.argument("lamp", default="")
@json_option
async def command(site: SiteAddress, user: str, lamp: str, *, timeout_s: float, as_json: bool) -> int:
    """Correct the pose of USER, who points at LAMP without a cursor.

    The lamp lights up; USER points at it with a straight arm until it goes dark. LAMP may also be a robot
    that stands or hovers. Without LAMP the localizer chooses the most informative one. Prints the error of
    the direction (the drift of the IMU), and the sigma of the pose before and after.

    Example: pointit person anchor anna led_1

    The exit code is 1 if it was not accepted.
    """
    check_name(user, "user")
    async with site.join() as bus:
        latest_pose = LatestMessage(bus, POSE, user)
        anchoring = AnchorRequester(bus, user)
        before = await latest_pose.wait(SHORT_S)
        try:
            anchor = await point_once(anchoring, lamp, timeout_s, user)
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
        say(f"{user}: {sentence(anchor, before, after)}{site.note}")
    return 0 if anchor.accepted else EXIT_FAILED


async def point_once(anchoring: AnchorRequester, lamp: str, timeout_s: float, which: str) -> Anchor:
    """Return `anchoring.point`, whose instructions are shown behind `which`, such as the person's name."""
    with progress() as tell:
        return await anchoring.point(lamp, timeout_s, lambda text: tell(f"{which}: {text}"))


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
            text += f" (the IMU's drift turns the pose by {drift_degpmin(after):.1f} °/min)"
        text += " and is corrected; " + _certainty(anchor, before, after)
    return f"{text}."


def _certainty(anchor: Anchor, before: UserPose | None, after: UserPose) -> str:
    """Return the uncertainty of the pose, and the reason if the position's has grown."""
    text = f"the pose is known {sigma_text(after)} now"
    if before is None:
        return text
    (place_before_m, yaw_before_rad), (place_m, _) = sigmas(before), sigmas(after)
    if place_before_m == yaw_before_rad == 0.0:
        return f"{text}; before, it counted as exact, as it was given"
    text += f", before {sigma_text(before)}"
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
        "before": None if before is None else fields(before, anchor.stamp_ns),
        "after": None if after is None else fields(after, anchor.stamp_ns),
    }
