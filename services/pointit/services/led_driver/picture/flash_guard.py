"""No lamp flashes more than three times a second, whatever it is told: that can trigger seizures."""

from collections import deque

from pointit.schemas import NS_PER_S
from pointit.schemas.base import Rgb

FLASHES = 3
"""In any second; a flash is two changes of brightness or of a colour, there and back (WCAG 2, 2.3.1)."""

CHANGE = 0.1
"""Of full brightness: a change that is smaller is none."""

_LUMINANCE = (0.2126, 0.7152, 0.0722)


class FlashGuard:
    """Colours of one lamp, each held back until it may be shown."""

    def __init__(self) -> None:
        """Begin with a dark lamp."""
        self.shown: Rgb = (0, 0, 0)
        self._signals = [_Signal() for _ in range(4)]
        self.free_ns: int | None = None
        """When the colour that is held back may be shown; none: it is."""

    def show(self, color: Rgb, now_ns: int) -> Rgb:
        """Return what the lamp may show of `color` at `now_ns`: that colour, or what it showed before."""
        values = [value / 255.0 for value in color]
        values.append(sum(weight * value for weight, value in zip(_LUMINANCE, values, strict=True)))
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
    """One channel's ups and downs."""

    def __init__(self) -> None:
        self._rising = False
        self._extreme = 0.0
        """Reached since the last turn."""
        self._turns_ns: deque[int] = deque(maxlen=2 * FLASHES - 1)

    def _turns(self, value: float) -> bool:
        return abs(value - self._extreme) >= CHANGE and (value > self._extreme) != self._rising

    def wait_ns(self, value: float, now_ns: int) -> int:
        """Return how long to wait until `value` may be shown."""
        if not self._turns(value) or len(self._turns_ns) < (self._turns_ns.maxlen or 0):
            return 0
        # a clock that was set back must not hold the lamp for longer than a second
        return min(max(self._turns_ns[0] + NS_PER_S - now_ns, 0), NS_PER_S)

    def take(self, value: float, now_ns: int) -> None:
        """Take note of a `value` that is shown."""
        if self._turns(value):
            self._rising = not self._rising
            self._turns_ns.append(now_ns)
            self._extreme = value
        elif (value > self._extreme) == self._rising:
            self._extreme = value
