"""Requests that a person points at a lamp without a cursor, and waits for the result."""

import asyncio
import contextlib
from collections.abc import Callable, Sequence

from pointit.cli.common.site_link import notify_if_slow
from pointit.cli.people.pose_text import missing_reason
from pointit.runtime.bus.contract import Bus, list_present
from pointit.runtime.errors import NoAnswerError, RefusedError, RequestError
from pointit.schemas import Anchor, CancelLocalization, Localization, PointAnchor
from pointit.schemas.topics import ANCHOR, CANCEL_LOCALIZATION, LOCALIZATION, POINT_ANCHOR, SERVICE_ALIVE

TIMEOUT_S = 2.0
"""Timeout of the localizer's first message, s."""
LATE_S = 1.0
"""Time an anchor may arrive after the Localization that ends it: they have different keys."""
CANCEL_TIMEOUT_S = 0.5
LISTEN_S = 0.3
"""Time to listen for present services, for an error message."""
RETRY_S = 0.5
"""Minimum wait before a request to a busy localizer is repeated."""


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
