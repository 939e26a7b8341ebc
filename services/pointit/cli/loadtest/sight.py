"""An observer of a load test: which cursors and lights follow the samples, and when."""

import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from pointit.runtime.bus.contract import ANY, Bus
from pointit.schemas import NS_PER_S, Cursor, Hover, Message, StripsFrame, UserPose
from pointit.schemas.topics import CURSOR, HOVER, POSE, STRIPS_FRAME


@dataclass
class Sight:
    """Messages received in the measuring time."""

    users: frozenset[str]
    hovers: int = 0
    stamps: set[int] = field(default_factory=set[int])
    """Those of the cursors."""
    cursor_s: list[float] = field(default_factory=list[float])
    """Age of each cursor on arrival."""
    frames: dict[int, float] = field(default_factory=dict[int, float])
    """Age of each frame on arrival, by stamp."""
    poses: set[str] = field(default_factory=set[str])

    def watch(self, bus: Bus, *, alone: bool = False) -> None:
        """Read all that is observed of people; `alone`: of `users` only, so that no link carries others'."""
        for name in sorted(self.users) if alone else (ANY,):
            bus.subscribe(POSE, self._on_pose, name)
            bus.subscribe(CURSOR, self._on_cursor, name)
            bus.subscribe(HOVER, self._on_hover, name)

    def watch_light(self, bus: Bus) -> None:
        """Read the frames."""
        bus.subscribe(STRIPS_FRAME, self._on_frame)

    def clear(self) -> None:
        """Forget what was received, but for the poses."""
        self.hovers = 0
        for kept in (self.stamps, self.cursor_s, self.frames):
            kept.clear()

    def dump(self) -> dict[str, Any]:
        """Return what was received as JSON."""
        return {
            "hovers": self.hovers,
            "stamps": list(self.stamps),
            "cursor_s": self.cursor_s,
            "frames": list(self.frames.items()),
        }

    def add(self, dumped: Mapping[str, Any]) -> None:
        """Add what another observer received, as it dumped it."""
        self.hovers += dumped["hovers"]
        self.stamps.update(dumped["stamps"])
        self.cursor_s.extend(dumped["cursor_s"])
        self.frames.update((stamp_ns, age_s) for stamp_ns, age_s in dumped["frames"])

    def light_s(self) -> list[float]:
        """Return the ages of the frames that show one of our samples; others are drawn for other reasons."""
        return [age_s for stamp_ns, age_s in self.frames.items() if stamp_ns in self.stamps]

    def _on_cursor(self, cursor: Cursor, user: str) -> None:
        if user in self.users:
            self.stamps.add(cursor.stamp_ns)
            self.cursor_s.append(_age_s(cursor))

    def _on_hover(self, _hover: Hover, user: str) -> None:
        self.hovers += user in self.users

    def _on_frame(self, frame: StripsFrame, _name: str) -> None:
        self.frames.setdefault(frame.stamp_ns, _age_s(frame))

    def _on_pose(self, _pose: UserPose, user: str) -> None:
        self.poses.add(user)


def _age_s(message: Message) -> float:
    return (time.time_ns() - message.stamp_ns) / NS_PER_S
