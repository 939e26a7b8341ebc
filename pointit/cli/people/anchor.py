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
    yaw_deg = math.degrees(yaw_rad)
    return f"to {position_m:.2f} m and {yaw_deg:.1f}°"


def drift_degpmin(pose: UserPose) -> float:
    """Return the yaw drift of the pose by the IMU, °/min."""
    return math.degrees(pose.yaw_rate_radps) * 60.0


def fields(pose: UserPose, now_ns: int, error: PoseError | None = None) -> dict[str, Any]:
    """Return `pose` and its `error` for programs; angles in degrees, ages in seconds, None if unknown."""
    position_sigma_m, yaw_sigma = sigmas(pose)
    yaw_rad = math.remainder(pose.yaw_rad, math.tau)
    remembered = pose.remembered_bias.localizations if pose.remembered_bias else 0
    drift_sigma: float | None = None
    if pose.yaw_rate_sigma_radps is not None:
        drift_sigma = math.degrees(pose.yaw_rate_sigma_radps) * 60.0
    anchor_age_s = _age_s(pose.anchored_ns, now_ns) if pose.anchored_ns else None

    # Errors, where a tracker sees the true pose. It may know the position only
    position_error_m: float | None = None
    yaw_error_deg: float | None = None
    if error is not None:
        position_error_m = error.position_m
        if error.yaw_rad is not None:
            yaw_error_deg = math.degrees(error.yaw_rad)
    return {
        "position_m": pose.position_m,
        "position_sigma_m": position_sigma_m,
        "yaw_deg": math.degrees(yaw_rad),
        "yaw_sigma_deg": math.degrees(yaw_sigma),
        "elevation_bias_deg": math.degrees(pose.elevation_bias_rad),
        "remembered_localizations": remembered,
        "drift_deg_per_min": drift_degpmin(pose),
        "drift_sigma_deg_per_min": drift_sigma,
        "anchor_age_s": anchor_age_s,
        "method": pose.method,
        "age_s": _age_s(pose.stamp_ns, now_ns),
        "position_error_m": position_error_m,
        "yaw_error_deg": yaw_error_deg,
    }


def lines(shown: Mapping[str, Any]) -> list[str]:
    """Return the result of `fields` as lines for people."""
    # A pose that was given has no uncertainty
    x, y, z = shown["position_m"]
    is_exact = shown["position_sigma_m"] == shown["yaw_sigma_deg"] == 0.0
    position = f"x {x:.2f} m, y {y:.2f} m, z {z:.2f} m"
    yaw = f"{shown['yaw_deg']:.1f}°"
    method = METHODS[shown["method"]]
    if is_exact:
        method += ", counts as exact"
    else:
        position += f"; 1 sigma {shown['position_sigma_m']:.2f} m"
        yaw += f"; 1 sigma {shown['yaw_sigma_deg']:.1f}°"
    rows = [("position", position), ("yaw", yaw)]

    # The bias of this localization, and what earlier ones have left
    bias_deg = shown["elevation_bias_deg"]
    if bias_deg:
        side = "high" if bias_deg > 0 else "low"
        rows.append((f"rays too {side}", f"by {abs(bias_deg):.1f}°"))
    count = shown["remembered_localizations"]
    if count:
        noun = "localization" if count == 1 else "localizations"
        rows.append(("remembered", f"elevation bias of {count} {noun}"))

    drift = _drift_text(shown["drift_deg_per_min"], shown["drift_sigma_deg_per_min"])
    rows.append(("drift", drift))
    anchor_age_s = shown["anchor_age_s"]
    last_anchor = "never" if anchor_age_s is None else f"{_age(anchor_age_s)} ago"
    rows.append(("last anchor", last_anchor))
    rows.append(("method", method))
    rows.append(("published", f"{_age(shown['age_s'])} ago"))
    if shown["position_error_m"] is not None:
        yaw_error_deg = shown["yaw_error_deg"]
        yaw_error = "not known" if yaw_error_deg is None else f"{yaw_error_deg:+.1f}°"
        errors = f"position {shown['position_error_m']:.2f} m, yaw {yaw_error}, by motion capture"
        rows.append(("true error", errors))
    return [f"{name:<14}{text}" for name, text in rows]


def _drift_text(drift: float, sigma: float | None) -> str:
    """Return a drift and its sigma, °/min, as far as it is known."""
    if sigma is None:
        return "not estimated"
    if sigma >= UNKNOWN_DRIFT_DEGPMIN and abs(drift) < sigma:
        return "not known yet"
    return f"{drift:.1f} °/min; 1 sigma {sigma:.1f} °/min"


def _age_s(stamp_ns: int, now_ns: int) -> float:
    return max(0, now_ns - stamp_ns) / NS_PER_S


def _age(age_s: float) -> str:
    if age_s < 10:
        return f"{age_s:.1f} s"
    if age_s < 120:
        return f"{age_s:.0f} s"
    return f"{age_s / 60:.0f} min"


def people(present: Collection[str]) -> list[str]:
    """Return the users of the services in `present`."""
    return sorted(set(map(person_of, present)) - {""})


def missing_reason(topic: AnyTopic, user: str, present: Collection[str]) -> str:
    """Return a clause with the reason why `topic` of `user` is silent, and the remedy."""
    users = people(present)
    if user in users:
        return silence_reason(topic, user, present)
    others = "there are no people"
    if users:
        are = "is" if len(users) == 1 else "are"
        others = f"there {are} {', '.join(users)}"
    return f"{user} is not on this site, {others}; {add_or_similar(user, users)}"


def localizing(user: str, localization: Localization | None) -> str:
    """Return the progress of a person's localization, or `""` if there is none."""
    if localization is None or localization.phase != "sampling":
        return ""
    if localization.ahead:
        ahead = localization.ahead[0]
        return f"{user} waits for the lamps, which {ahead} points at; wait until it is their turn"
    if localization.purpose == "anchor":
        return f"{user} is pointing at {localization.target_id or 'a lamp'} to correct the pose; wait"
    lamp = ""
    if localization.target_count > 1:
        lamp = f", lamp {localization.target_index + 1} of {localization.target_count}"
    return f"{user} is being localized{lamp}; wait until that is done"


def out_of_map_warning(place: Vec3, room: Environment) -> str:
    """Return a warning if `place` is farther than `FAR_M` outside the map's contents, else `""`."""
    points = [lamp.position_m for lamp in room.lamps]
    for line in (*room.strips, *room.belts):
        points += line.line_m
    if not points:
        return ""
    x_m, y_m, _ = place
    x_low, x_high = _span([point[0] for point in points])
    y_low, y_high = _span([point[1] for point in points])
    away_m = max(x_low - x_m, x_m - x_high, y_low - y_m, y_m - y_high)
    if away_m <= FAR_M:
        return ""
    contents = f"x {x_low:.1f} to {x_high:.1f} m, y {y_low:.1f} to {y_high:.1f} m"
    return f"{x_m:g}, {y_m:g} m is {away_m:.0f} m outside the contents of map {room.name!r}: {contents}"


def _span(values: Sequence[float]) -> tuple[float, float]:
    return min(values), max(values)


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
        before_ns = await self._wait_for_localizer()
        self._anchor = None
        was_busy = self.is_busy
        had_work = self._localization is not None and self._localization.phase == "sampling"

        # The start: what the localizer does already is not called off
        try:
            await self._bus.call(POINT_ANCHOR, PointAnchor(lamp=lamp), self._user)
        except RefusedError as error:
            raise AnchorNotStartedError(str(error), is_busy=was_busy or self.is_busy) from error
        except asyncio.CancelledError:  # before the reply: it may have started nevertheless
            if not had_work:
                await self._call_off()
            raise

        # The pointing: from here on, it is this request's and ends with it
        try:
            async with asyncio.timeout(timeout_s) as limit:

                def wait_in_turn() -> None:  # the timeout starts when this person gets the lamps
                    limit.reschedule(asyncio.get_running_loop().time() + timeout_s)

                return await self._wait_for_result(before_ns, tell, wait_in_turn)
        except TimeoutError:
            await self._call_off()
            raise NoAnswerError(
                f"pointing at {lamp or 'a lamp'} did not finish within {timeout_s:g} s and was cancelled; "
                "does the IMU send? See `pointit doctor`"
            ) from None
        except asyncio.CancelledError:
            await self._call_off()
            raise

    async def _wait_for_localizer(self) -> int:
        """Return the stamp of the last Localization so far; newer ones belong to the next request."""
        with (
            contextlib.suppress(TimeoutError),
            notify_if_slow(f"waiting for the localizer of {self._user} …"),
        ):
            async with asyncio.timeout(TIMEOUT_S):
                while self._localization is None:
                    await self._change()
        if self._localization is None:
            present = await list_present(self._bus, SERVICE_ALIVE, LISTEN_S)
            reason = missing_reason(LOCALIZATION, self._user, present)
            raise NoAnswerError(f"no localizer of {self._user} is heard: {reason}")
        return self._localization.stamp_ns

    async def _wait_for_result(
        self, before_ns: int, tell: Callable[[str], None], wait_in_turn: Callable[[], None]
    ) -> Anchor:
        # Until the anchor, or a Localization that ends the pointing: they have different keys
        reason = None
        while self._anchor is None and reason is None:
            localization = self._localization
            if localization is not None and localization.stamp_ns > before_ns:
                reason = _ending(localization)
                if reason is not None:
                    break
                if localization.ahead:
                    wait_in_turn()
                    first, *waiting = localization.ahead
                    tell(f"wait: {first} points at the lamps{_more(waiting)}")
                else:
                    tell(f"point at {localization.target_id or 'the lamp that is lit'} and stay on it")
            await self._change()

        # An anchor that was accepted comes a moment after its Localization
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

        # The pose with the anchor, or the last one if that does not come
        corrected: UserPose | None = None
        if anchor.accepted:
            corrected = await latest_pose.wait(LATE_S, lambda pose: is_after(pose, anchor, before))
        after = corrected or latest_pose.value
    if as_json:
        print_json(_fields(user, anchor, before, after))
    else:
        result = sentence(anchor, before, after)
        say(f"{user}: {result}{site.note}")
    return 0 if anchor.accepted else EXIT_FAILED


async def point_once(anchoring: AnchorRequester, lamp: str, timeout_s: float, which: str) -> Anchor:
    """Return `anchoring.point`, whose instructions are shown behind `which`, such as the person's name."""
    with progress() as tell:

        def instruct(text: str) -> None:
            tell(f"{which}: {text}")

        return await anchoring.point(lamp, timeout_s, instruct)


def is_after(pose: UserPose, anchor: Anchor, before: UserPose | None) -> bool:
    """Return True if `pose` includes `anchor`."""
    if pose.anchored_ns >= anchor.stamp_ns:
        return True
    return before is not None and pose.anchored_ns > before.anchored_ns


def sentence(anchor: Anchor, before: UserPose | None, after: UserPose | None) -> str:
    """Return a message about the result of an anchor and the pose."""
    lamp = anchor.target_id or "the direction"
    if not anchor.accepted:
        return f"{lamp}: not accepted, the pose is as before: {anchor.reason or 'no reason is given'}"
    error_deg = math.degrees(anchor.azimuth_error_rad)
    side = "right" if error_deg > 0 else "left"
    text = f"{lamp}: the direction was {abs(error_deg):.1f}° too far {side}"
    if after is not None:
        sigma_radps = after.yaw_rate_sigma_radps
        is_significant = sigma_radps is not None and abs(after.yaw_rate_radps) > sigma_radps
        if is_significant:
            text += f" (the IMU's drift turns the pose by {drift_degpmin(after):.1f} °/min)"
        text += f" and is corrected; {_certainty(anchor, before, after)}"
    return f"{text}."


def _certainty(anchor: Anchor, before: UserPose | None, after: UserPose) -> str:
    """Return the uncertainty of the pose, and the reason if the position's has grown."""
    text = f"the pose is known {sigma_text(after)} now"
    if before is None:
        return text
    position_before_m, yaw_before_rad = sigmas(before)
    if position_before_m == yaw_before_rad == 0.0:
        return f"{text}; before, it counted as exact, as it was given"
    text += f", before {sigma_text(before)}"
    position_m, _ = sigmas(after)
    if position_m > position_before_m + LESS_M:
        reason = anchor.reason or "the direction did not fit it"
        text += (
            f"; the position is less certain than before, {reason}: localize again if the person has moved"
        )
    return text


def _fields(user: str, anchor: Anchor, before: UserPose | None, after: UserPose | None) -> dict[str, object]:
    pose_before = None if before is None else fields(before, anchor.stamp_ns)
    pose_after = None if after is None else fields(after, anchor.stamp_ns)
    return {
        "user": user,
        "lamp": anchor.target_id,
        "accepted": anchor.accepted,
        "reason": anchor.reason,
        "azimuth_error_deg": math.degrees(anchor.azimuth_error_rad),
        "elevation_error_deg": math.degrees(anchor.elevation_error_rad),
        "before": pose_before,
        "after": pose_after,
    }
