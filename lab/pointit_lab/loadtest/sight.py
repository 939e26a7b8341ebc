"""An observer of a load test: which cursors and lights follow the samples, and when."""

import asyncio
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pointit.runtime.bus.contract import Bus, Undecoded
from pointit.schemas import NS_PER_S, Message
from pointit.schemas.topics import ANY, CURSOR, HOVER, POSE, STRIPS_FRAME

DRAIN_S = 0.3
"""Time for what still travels after the last sample."""


@dataclass
class LoadTestReceiver:
    """Messages received in the measuring time.

    It reads each message as it arrives, on the thread on which it arrives: a reader with a wake-up for each
    would take a fifth of the CPU that is measured.
    """

    users: frozenset[str]
    hovers: int = 0
    """Number of hovers."""
    stamps: set[int] = field(default_factory=set[int])
    """Those of the cursors."""
    cursor_s: list[float] = field(default_factory=list[float])
    """Age of each cursor on arrival."""
    frames: dict[int, float] = field(default_factory=dict[int, float])
    """Age of each frame on arrival, by stamp."""
    arrived: int = 0
    """Number of cursors that reached the site's lights."""
    poses: set[str] = field(default_factory=set[str])
    _counting: threading.Lock = field(default_factory=threading.Lock)

    def watch(self, bus: Bus, *, alone: bool = False) -> None:
        """Read all that is observed of people; `alone`: of `users` only, so that no link carries others'."""
        names = sorted(self.users) if alone else [ANY]
        for name in names:
            bus.tap(POSE, self._on_pose, name)
            bus.tap(CURSOR, self._on_cursor, name)
            bus.tap(HOVER, self._on_hover, name)

    def watch_light(self, bus: Bus) -> None:
        """Read the frames."""
        bus.tap(STRIPS_FRAME, self._on_frame)

    def watch_arrivals(self, bus: Bus) -> None:
        """Count all cursors, without decoding them, where led-driver reads them."""
        bus.tap(CURSOR, self._on_arrival)

    async def until_poses(self, services: "asyncio.Task[None]") -> None:
        """Wait until all poses are known, or `services` have ended."""
        # polled: poses arrive on another thread
        while not self.users <= self.poses:
            if services.done():
                return
            await asyncio.sleep(0.05)

    def clear(self) -> None:
        """Forget what was received, but for the poses."""
        self.stamps.clear()
        self.cursor_s.clear()
        self.frames.clear()
        with self._counting:
            self.hovers = 0
            self.arrived = 0

    def dump(self) -> dict[str, Any]:
        """Return all received values as JSON."""
        return {
            "hovers": self.hovers,
            "arrived": self.arrived,
            "stamps": list(self.stamps),
            "cursor_s": self.cursor_s,
            "frames": list(self.frames.items()),
        }

    def add(self, dumped: Mapping[str, Any]) -> None:
        """Add what another observer received, as it dumped it."""
        self.hovers += dumped["hovers"]
        self.arrived += dumped["arrived"]
        self.stamps.update(dumped["stamps"])
        self.cursor_s.extend(dumped["cursor_s"])
        # JSON has lists in place of tuples
        for stamp_ns, age_s in dumped["frames"]:
            self.frames[stamp_ns] = age_s

    def light_s(self) -> list[float]:
        """Return the ages of the frames that show one of our samples; others are drawn for other reasons."""
        return [age_s for stamp_ns, age_s in self.frames.items() if stamp_ns in self.stamps]

    def _on_cursor(self, message: Message | Undecoded, user: str) -> None:
        arrived_ns = time.time_ns()
        if user in self.users:
            stamp_ns = _stamp_ns(message)
            self.stamps.add(stamp_ns)
            self.cursor_s.append((arrived_ns - stamp_ns) / NS_PER_S)

    def _on_hover(self, _message: Message | Undecoded, user: str) -> None:
        if user in self.users:
            with self._counting:
                self.hovers += 1

    def _on_frame(self, message: Message | Undecoded, _name: str) -> None:
        arrived_ns = time.time_ns()
        stamp_ns = _stamp_ns(message)
        age_s = (arrived_ns - stamp_ns) / NS_PER_S
        self.frames.setdefault(stamp_ns, age_s)

    def _on_arrival(self, _message: Message | Undecoded, _user: str) -> None:
        with self._counting:
            self.arrived += 1

    def _on_pose(self, _message: Message | Undecoded, user: str) -> None:
        self.poses.add(user)


def _stamp_ns(message: Message | Undecoded) -> int:
    if isinstance(message, Message):
        return message.stamp_ns
    return message.decode().stamp_ns
