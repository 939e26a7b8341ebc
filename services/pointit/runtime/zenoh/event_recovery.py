# pyright: reportUnknownMemberType=false
# (the stubs of zenoh leave return types out)
"""Events that a lost link has swallowed: their writer is asked for them until it answers.

Zenoh asks by itself, but once: when the link is lost again before the answer, it gives up and goes on with
what came later (zenoh-ext 1.10). Here what came later waits, so that events stay in order. What a writer has
sent before the first event that was heard of it is asked for three times: the link may have swallowed that.
"""

import asyncio
import collections
import contextlib
import threading
from collections.abc import Callable
from dataclasses import dataclass, field

import zenoh

from pointit.runtime.bus.contract import EVENT_CAPACITY
from pointit.runtime.bus.local_broker import Participant
from pointit.runtime.zenoh.queries import query_samples

WAITS_S = (0.0, 0.1, 0.2, 0.4, 0.8, 1.6, 2.0, 2.0, 2.0, 2.0, 2.0)
"""Before each question; what has not come after the last one counts as lost."""
MAX_OF_FIRST = 3
"""Questions about what was before the first event of a writer; not every writer keeps what it has sent."""
TIMEOUT_S = 2.0
MAX_GAPS = 32
"""Writers that are asked at a time. What others lack is not asked for, which bounds memory."""
MAX_WRITERS = 1000
"""Writers whose last sequence number is kept. The oldest is evicted first, which bounds memory."""

Writer = tuple[str, int]
"""Session and number in it."""


@dataclass(slots=True, eq=False)
class _Gap:
    """Missing samples of one writer, and those that came since."""

    about: str
    """Under which the writer is asked."""
    wanted: set[int] = field(default_factory=set[int])
    held: dict[int, zenoh.Sample] = field(default_factory=dict[int, zenoh.Sample])
    given_up: int = 0
    """More than any writer keeps are not even asked for."""
    heard_from: int = 0
    """Missing samples before it may be older than the reader, and are not counted as lost."""


class EventRecovery:
    """Hands on what one reader hears, in the order of each writer, without gaps where that is possible."""

    def __init__(
        self,
        bus: Participant,
        session: zenoh.Session,
        hand_on: Callable[[zenoh.Sample], None],
        lose: Callable[[int], None],
    ) -> None:
        """Begin with nothing heard; must be called in the loop.

        `hand_on` gets each sample, in the loop or on Zenoh's threads, one at a time. `lose` gets the
        number of lost ones.
        """
        self._bus = bus
        self._session = session
        self._hand_on = hand_on
        self._lose = lose
        self._loop = asyncio.get_running_loop()
        self._lock = threading.Lock()
        self._last: collections.OrderedDict[Writer, int] = collections.OrderedDict()
        self._gaps: dict[Writer, _Gap] = {}
        self._has_evicted = False

    def close(self) -> None:
        """Hand on nothing that is held, and ask no more."""
        with self._lock:
            self._gaps.clear()

    def on_sample(self, sample: zenoh.Sample) -> None:
        """Take what came, of each writer in order; from any thread."""
        source = sample.source_info
        if source is None:
            self._hand_on(sample)
            return
        writer, number = (str(source.source_id.zid), source.source_id.eid), source.source_sn
        with self._lock:
            last = self._last.pop(writer, None)
            self._last[writer] = number if last is None else max(last, number)
            if len(self._last) > MAX_WRITERS:
                self._last.popitem(last=False)
                self._has_evicted = True  # who is heard for the first time may have been heard before
            gap = self._gaps.get(writer)
            may_ask = gap is not None or len(self._gaps) < MAX_GAPS
            is_first = last is None and may_ask and not self._has_evicted
            if is_first:
                last = -1
            if last is not None and number > last + 1 and not may_ask:
                self._lose(number - last - 1)
            elif last is not None and number > last + 1:
                if gap is None:
                    zid, eid = writer
                    gap = self._gaps[writer] = _Gap(f"{sample.key_expr}/@adv/pub/{zid}/{eid}/**")
                    self._begin(writer, gap)
                first = max(last + 1, number - EVENT_CAPACITY)
                if is_first:
                    gap.heard_from = number
                else:
                    gap.given_up += first - last - 1
                gap.wanted.update(range(first, number))
            if gap is None:
                self._hand_on(sample)
                return
            gap.held[number] = sample
            if len(gap.held) >= EVENT_CAPACITY:
                self._end(writer, gap)

    def _begin(self, writer: Writer, gap: _Gap) -> None:
        def ask() -> None:
            if not self._bus.is_closed:
                self._bus.spawn(self._ask(writer, gap), f"asking for {gap.about}")

        with contextlib.suppress(RuntimeError):  # the loop is gone
            self._loop.call_soon_threadsafe(ask)

    async def _ask(self, writer: Writer, gap: _Gap) -> None:
        for asked, wait_s in enumerate(WAITS_S, 1):
            await asyncio.sleep(wait_s)
            with self._lock:
                if self._gaps.get(writer) is not gap:
                    return
                missing = gap.wanted - gap.held.keys()
            if not missing:  # they came late, by themselves
                break
            # One more than what is missing: its own answer, the last one, tells that the writer has said all.
            first, beyond = min(missing), max(missing) + 1
            selector = f"{gap.about}?_sn={first}..{beyond}"
            samples = await query_samples(self._session, selector, timeout_s=TIMEOUT_S, under_any_key=True)
            found = {each.source_info.source_sn: each for each in samples if each.source_info is not None}
            with self._lock:
                gap.held |= {number: each for number, each in found.items() if number in missing}
                has_sent_all = beyond in found and beyond > max(gap.wanted)
                if asked == MAX_OF_FIRST:
                    gap.wanted = {number for number in gap.wanted if number > gap.heard_from}
                if has_sent_all or gap.wanted <= gap.held.keys():
                    break
        with self._lock:
            if self._gaps.get(writer) is gap:
                self._end(writer, gap)

    def _end(self, writer: Writer, gap: _Gap) -> None:
        del self._gaps[writer]
        for number in sorted(gap.held):
            self._hand_on(gap.held[number])
        lost = gap.given_up + sum(number > gap.heard_from for number in gap.wanted - gap.held.keys())
        if lost:
            self._lose(lost)
