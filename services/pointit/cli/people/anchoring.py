"""Has a person point at a lamp without a cursor, and waits for what comes of it."""

import asyncio
import contextlib
from collections.abc import Callable, Sequence

from pointit.cli.common.site_link import PATIENCE_S, notify_if_slow
from pointit.cli.people.pose_messages import missing_reason
from pointit.runtime.bus.contract import Bus, list_present
from pointit.runtime.errors import NoAnswerError, RefusedError, RequestError
from pointit.schemas import Anchor, CancelLocalization, Localization, PointAnchor
from pointit.schemas.topics import (
    ANCHOR,
    CANCEL_LOCALIZATION,
    LOCALIZATION,
    POINT_ANCHOR,
    SERVICE_ALIVE,
)

LATE_S = 1.0
"""How much later than the news of its end an anchor may arrive: the two have keys of their own."""
CANCEL_PATIENCE_S = 0.5
LISTEN_S = 0.3
"""How long to listen for who is present, for a complaint."""
RETRY_S = 0.5
"""How long to wait at least before a localizer that was busy is asked again."""


class AnchorNotStartedError(RefusedError):
    """The localizer does not even begin; says why."""

    def __init__(self, reason: str, *, is_busy: bool = False) -> None:
        """Say why; `is_busy`: somebody is or was being localized, so that it may be otherwise soon."""
        super().__init__(reason)
        self.is_busy = is_busy


class Anchoring:
    """Asks one person's localizer for anchors, one after the other."""

    def __init__(self, bus: Bus, user: str) -> None:
        self._bus = bus
        self._user = user
        self._everybody: dict[str, Localization] = {}
        """What everybody's localizers said last."""
        self._anchor: Anchor | None = None
        self._changed = asyncio.Event()
        bus.subscribe(LOCALIZATION, self._on_news)
        bus.subscribe(ANCHOR, self._on_anchor, user)

    @property
    def _news(self) -> Localization | None:
        return self._everybody.get(self._user)

    @property
    def is_busy(self) -> bool:
        """Return True if somebody is being localized, or points at a lamp: this person or another."""
        return any(news.phase == "sampling" for news in self._everybody.values())

    async def wait_until_idle(self, patience_s: float) -> bool:
        """Wait until nobody is localized any more. Return True if that was within `patience_s`."""
        await asyncio.sleep(RETRY_S)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(patience_s):
                while self.is_busy:
                    await self._change()
        return not self.is_busy

    async def point(self, lamp: str, timeout_s: float, tell: Callable[[str], None]) -> Anchor:
        """Return the anchor that came of pointing at `lamp`; it may be one that was not accepted.

        Args:
            lamp: its id; empty: the localizer's choice.
            timeout_s: after so long, not counting others' turns at the lamps, it is called off, as it is
                when this is cancelled.
            tell: shown what to do now.

        Raises:
            NotBegunError: it did not begin; says why.
            RefusedError: it came to nothing; says why.
            NoAnswerError: there is no localizer, or it came to no end in time.
        """
        before_ns = await self._before()
        self._anchor = None
        was_busy = self.is_busy
        had_work = self._news is not None and self._news.phase == "sampling"
        try:
            await self._bus.call(POINT_ANCHOR, PointAnchor(lamp=lamp), self._user)
        except RefusedError as error:
            raise AnchorNotStartedError(str(error), is_busy=was_busy or self.is_busy) from error
        except asyncio.CancelledError:  # before the answer: it may have begun all the same
            if not had_work:
                await self._call_off()
            raise
        try:
            async with asyncio.timeout(timeout_s) as limit:

                def wait_in_turn() -> None:  # the time counts from when the lamps are this person's
                    limit.reschedule(asyncio.get_running_loop().time() + timeout_s)

                return await self._result(before_ns, tell, wait_in_turn)
        except TimeoutError:
            await self._call_off()
            raise NoAnswerError(
                f"pointing at {lamp or 'a lamp'} came to no end within {timeout_s:g} s and was called off; "
                "does the IMU send? See `pointit doctor`"
            ) from None
        except asyncio.CancelledError:
            await self._call_off()
            raise

    async def _before(self) -> int:
        """Return the stamp of the newest news so far: what is newer is of what is asked for next."""
        with (
            contextlib.suppress(TimeoutError),
            notify_if_slow(f"waiting for the localizer of {self._user} …"),
        ):
            async with asyncio.timeout(PATIENCE_S):
                while self._news is None:
                    await self._change()
        if self._news is None:
            there = await list_present(self._bus, SERVICE_ALIVE, LISTEN_S)
            raise NoAnswerError(
                f"no localizer of {self._user} is heard: {missing_reason(LOCALIZATION, self._user, there)}"
            )
        return self._news.stamp_ns

    async def _result(
        self, before_ns: int, tell: Callable[[str], None], wait_in_turn: Callable[[], None]
    ) -> Anchor:
        reason = None
        while self._anchor is None and reason is None:
            news = self._news
            if news is not None and news.stamp_ns > before_ns:
                reason = _ending(news)
                if reason is not None:
                    break
                if news.ahead:
                    wait_in_turn()
                    tell(f"wait: {news.ahead[0]} points at the lamps{_more(news.ahead[1:])}")
                else:
                    tell(f"point at {news.target_id or 'the lamp that is lit'} and stay on it")
            await self._change()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(LATE_S):
                while self._anchor is None:
                    await self._change()
        if self._anchor is None:
            raise RefusedError(reason or "pointing at the lamp was called off")
        return self._anchor

    async def _change(self) -> None:
        self._changed.clear()
        await self._changed.wait()

    async def _call_off(self) -> None:
        with contextlib.suppress(RequestError):
            await self._bus.call(
                CANCEL_LOCALIZATION, CancelLocalization(), self._user, timeout_s=CANCEL_PATIENCE_S
            )

    def _on_news(self, news: Localization, user: str) -> None:
        self._everybody[user] = news
        self._changed.set()

    def _on_anchor(self, anchor: Anchor, _user: str) -> None:
        self._anchor = anchor
        self._changed.set()


def _more(waiting: Sequence[str]) -> str:
    return f", then {', '.join(waiting)}" if waiting else ""


def _ending(news: Localization) -> str | None:
    """Return what `news` says of the anchor's end; none while it goes on."""
    if news.phase == "idle":
        return "the localizer was restarted; ask again"
    if news.purpose != "anchor":
        return "the localizer does something else by now; ask again when it is done"
    return None if news.phase == "sampling" else news.reason
