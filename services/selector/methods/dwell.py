"""The paper's two ways to select by staying on an object (§III-D), with a latch (pointing.md §6)."""

import math
from collections import Counter, deque
from collections.abc import Collection
from typing import Literal

from pointit.schemas import NS_PER_S
from pointit.services.selector.config import TIMESTEP_S, SelectorConfig
from pointit.services.selector.selection_methods import (
    NO_PROGRESS,
    PointingSample,
    SelectionMethod,
    SelectionProgress,
)

Method = Literal["hold", "fraction"]


class Dwell:
    """Detects when staying on an object toggles it, for one person.

    Time is cut into timesteps of the cursors' stamps. A timestep's object is the one hovered by the newest
    cursor at the end of the timestep, or nothing if that cursor is older than `longest_gap_s` by then: a
    wrist at 5 to 10 Hz leaves some timesteps without a cursor of their own. When a timestep is over, the
    window is the last `window_s / TIMESTEP_S` of them:

    - `hold`: the same object at every timestep of the window toggles. One flicker restarts it.
    - `fraction`: an object hovered at `fraction` of the window's timesteps, or more, toggles.

    Both fire only when a window is full, so never sooner than `window_s` after the last toggle or the
    start, since a fraction is defined for a whole window only. (The ROS toolkit counts 4 of the last 5 from
    the first timestep on, and fires after 0.3 to 0.4 s of its 0.5 s.) They fire when the last timestep of
    the window is over, that is with the first cursor after it.

    A toggle empties the window and latches its object: until it was not hovered for `release_s`, timesteps
    on it count as empty.
    """

    def __init__(
        self,
        method: Method = "hold",
        *,
        window_s: float = 0.8,
        fraction: float = 0.8,
        release_s: float = 0.5,
        longest_gap_s: float = 0.25,
    ) -> None:
        self._holds = method == "hold"
        self._step_ns = round(TIMESTEP_S * NS_PER_S)
        self._gap_ns = round(longest_gap_s * NS_PER_S)

        # Numbers of timesteps. Without 1e-9 a rounding error would add one
        self.window = max(1, round(window_s / TIMESTEP_S))
        """Number of timesteps in the window."""
        self.needed = self.window
        """Number of timesteps of the window that must be on the object."""
        if not self._holds:
            self.needed = max(1, math.ceil(fraction * self.window - 1e-9))
        self.release = max(1, math.ceil(release_s / TIMESTEP_S - 1e-9))
        """Number of timesteps off a toggled object before it counts again."""

        # State: finished timesteps, and the last cursor
        self._steps: deque[str | None] = deque(maxlen=self.window)
        self._away: dict[str, int] = {}
        """Latched objects, with the number of timesteps since they were hovered."""
        self._index: int | None = None
        self._stamp_ns = 0
        self._object: str | None = None

    def step(self, stamp_ns: int, object_id: str | None) -> str | None:
        """Add a cursor of `stamp_ns` on `object_id`. Return the object to toggle now, or None.

        Cursors out of order are ignored. A stamp more than a window back resets the state.
        """
        index = stamp_ns // self._step_ns
        if self._index is not None and index < self._index - self.window:
            self._steps.clear()
            self._away.clear()
        elif self._index is not None and stamp_ns < self._stamp_ns:
            return None
        toggled = None
        if self._index is not None:
            toggled = self._end_steps(self._index, index, stamp_ns)
        self._index = index
        self._stamp_ns = stamp_ns
        self._object = object_id
        return toggled

    def progress(self, object_id: str | None) -> float:
        """Return the progress of `object_id` towards its toggle, 0 to 1."""
        if object_id is None:
            return 0.0
        if not self._holds:
            hovered_share = self._steps.count(object_id) / self.needed
            return min(hovered_share, len(self._steps) / self.window)
        streak = 0
        for hovered in reversed(self._steps):
            if hovered != object_id:
                break
            streak += 1
        return streak / self.window

    def latch(self, object_id: str) -> None:
        """Ignore `object_id` until it is left, since it was changed in another way."""
        self._steps.clear()
        self._away[object_id] = 0

    @property
    def latched(self) -> Collection[str]:
        """Return the objects that toggled and were not left since."""
        return self._away

    def _end_steps(self, current: int, index: int, stamp_ns: int) -> str | None:
        """End the timesteps from `current` to before `index`, that of the next cursor."""
        if index <= current:
            return None
        if index - current > self.release and stamp_ns - self._stamp_ns > self._gap_ns:
            # too old to act on
            self._steps.extend([None] * self.window)
            self._away.clear()
            return None
        toggled = self._end_step(self._object)
        for step in range(current + 1, index):
            is_held = (step + 1) * self._step_ns - self._stamp_ns <= self._gap_ns
            toggled = self._end_step(self._object if is_held else None) or toggled
        return toggled

    def _end_step(self, hovered: str | None) -> str | None:
        """End a timestep whose last object was `hovered`. Return the object that it toggles, or None."""
        # Latched objects, which count as empty timesteps until they are left
        for latched, away in list(self._away.items()):
            if latched == hovered:
                self._away[latched] = 0
            elif away + 1 >= self.release:
                del self._away[latched]
            else:
                self._away[latched] = away + 1
        self._steps.append(None if hovered in self._away else hovered)

        # The most frequent object of a full window; from the latest timestep on, for equal counts
        if len(self._steps) < self.window:
            return None
        counts = Counter(step for step in reversed(self._steps) if step is not None)
        if not counts:
            return None
        object_id, count = counts.most_common(1)[0]
        if count < self.needed:
            return None
        self._steps.clear()
        self._away[object_id] = 0
        return object_id


class DwellMethod:
    """Method `hold` or `fraction` for one person."""

    def __init__(self, name: Method, config: SelectorConfig) -> None:
        self._dwell = Dwell(
            name, window_s=config.window_s, fraction=config.fraction, longest_gap_s=config.longest_gap_s
        )
        self.latch = self._dwell.latch

    @property
    def latched(self) -> Collection[str]:
        """Return the objects that fired and were not left since."""
        return self._dwell.latched

    def step(self, pointing: PointingSample) -> SelectionProgress:
        """Process a cursor."""
        cursor, under, _, acts = pointing
        fired = self._dwell.step(cursor.stamp_ns, under)
        if under is None and fired is None:
            return NO_PROGRESS
        if under is None or not acts(under):
            return SelectionProgress(under, 0.0, fired)
        return SelectionProgress(under, self._dwell.progress(under), fired)


HOLD = SelectionMethod(
    summary="the same object at every timestep of a window",
    config=SelectorConfig,
    make=lambda config, _surroundings: DwellMethod("hold", config),
)
FRACTION = SelectionMethod(
    summary="the same object at most timesteps of a window",
    config=SelectorConfig,
    make=lambda config, _surroundings: DwellMethod("fraction", config),
)
