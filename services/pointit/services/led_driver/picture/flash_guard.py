"""Limits lamps to three flashes a second, regardless of commands, since more can trigger seizures."""

import math
from collections import deque

from pointit.schemas import NS_PER_S
from pointit.schemas.base import Rgb

FLASHES = 3
"""Limit of flashes in any second. A flash is two changes of brightness or of a colour, up and down (WCAG 2,
2.3.1)."""

CHANGE = 0.1
"""Share of full brightness below which a change does not count."""

_LUMINANCE = (0.2126, 0.7152, 0.0722)


class FlashGuard:
    """Colours of one lamp, each held back until it may be shown."""

    def __init__(self) -> None:
        """Create with a dark lamp."""
        self.shown: Rgb = (0, 0, 0)
        self._signals = [_Signal() for _ in range(4)]
        self.free_ns: int | None = None
        """Time at which the held-back colour may be shown, ns, or None if none is held back."""

    def show(self, color: Rgb, now_ns: int) -> Rgb:
        """Return the colour that the lamp may show at `now_ns`: `color`, or the one shown before."""
        values = [value / 255.0 for value in color]
        values.append(math.fsum(weight * value for weight, value in zip(_LUMINANCE, values, strict=True)))
        waits_ns = [
            signal.wait_ns(value, now_ns) for signal, value in zip(self._signals, values, strict=True)
        ]
        if any(waits_ns):
            self.free_ns = now_ns + max(waits_ns)
            return self.shown
        for signal, value in zip(self._signals, values, strict=True):
            signal.take(value, now_ns)
        self.free_ns = None
        self.shown = color
        return color


class _Signal:
    """Ups and downs of one channel."""

    def __init__(self) -> None:
        self._rising = False
        self._extreme = 0.0
        """Extreme value since the last turn."""
        self._turns_ns: deque[int] = deque(maxlen=2 * FLASHES - 1)

    def _turns(self, value: float) -> bool:
        return abs(value - self._extreme) >= CHANGE and (value > self._extreme) != self._rising

    def wait_ns(self, value: float, now_ns: int) -> int:
        """Return the time until `value` may be shown, ns."""
        if not self._turns(value) or len(self._turns_ns) < (self._turns_ns.maxlen or 0):
            return 0
        return max(self._turns_ns[0] + NS_PER_S - now_ns, 0)

    def take(self, value: float, now_ns: int) -> None:
        """Record a `value` that is shown."""
        if self._turns(value):
            self._rising = not self._rising
            self._turns_ns.append(now_ns)
            self._extreme = value
        elif (value > self._extreme) == self._rising:
            self._extreme = value
