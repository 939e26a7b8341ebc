"""Colours that smart lamps show, and those that they should show. Pure."""

from collections.abc import Collection

from pointit.schemas.base import Rgb

DARK: Rgb = (0, 0, 0)


class LampCommands:
    """Colours that lamps show, and those that they should show."""

    def __init__(self, lamp_rate_hz: float, max_rate_hz: float) -> None:
        """Create without lamps.

        Args:
            lamp_rate_hz: maximum number of commands per second to a lamp.
            max_rate_hz: maximum number of commands per second to all lamps.
        """
        self._lamp_period_s = 1.0 / lamp_rate_hz
        self._period_s = 1.0 / max_rate_hz
        self._lamps: frozenset[str] = frozenset()
        self._offline: frozenset[str] = frozenset()
        self._colors: dict[str, Rgb] = {}
        self._sent: dict[str, Rgb] = {}
        """Last commands. Lamps that may show something else are missing."""
        self._lit: set[str] = set()
        """Lamps that the last command left lit."""
        self._free_s: dict[str, float] = {}
        """Time from which a lamp takes the next command."""
        self._all_free_s = 0.0

    @property
    def lit(self) -> Collection[str]:
        """Return the ids of the lamps that their last command left lit."""
        return self._lit

    def set_lamps(self, lamps: Collection[str]) -> None:
        """Set the ids of the lamps. Others that are lit go off."""
        self._lamps = frozenset(lamps)
        removed = self._colors.keys() - self._lamps
        for lamp_id in removed & self._lit:
            self._colors[lamp_id] = DARK
        for lamp_id in removed - self._lit:
            self._colors.pop(lamp_id, None)
            self._sent.pop(lamp_id, None)
            self._free_s.pop(lamp_id, None)

    def set_offline(self, lamps: Collection[str]) -> None:
        """Set the ids of lamps that get no commands. Those that are no longer among them get their colour."""
        for lamp_id in self._offline.difference(lamps):
            self._sent.pop(lamp_id, None)
        self._offline = frozenset(lamps)

    def show(self, lamp_id: str, color: Rgb) -> None:
        """Show `color` on a lamp. Without effect if there is no such lamp."""
        if lamp_id in self._lamps:
            self._colors[lamp_id] = color

    def resend(self) -> None:
        """Send the colours of all lamps again, which may have missed them."""
        self._sent.clear()

    def wait_s(self, now_s: float) -> float | None:
        """Return the time until a command is due, s, or None if none waits."""
        lamps_free_s = [self._free_s.get(lamp_id, 0.0) for lamp_id in self._waiting_lamps()]
        if not lamps_free_s:
            return None
        lamp_wait_s = min(lamps_free_s) - now_s
        return max(0.0, lamp_wait_s, self._all_free_s - now_s)

    def take(self, now_s: float) -> tuple[str, Rgb] | None:
        """Return a lamp and its colour to send now, or None. Lamps that go off come first.

        A lamp that is to be pointed at is thus lit alone. Of the others, the one that has been free for
        longest comes first.
        """
        due: list[tuple[bool, float, str]] = []
        for lamp_id in self._waiting_lamps():
            free_s = self._free_s.get(lamp_id, 0.0)
            if free_s <= now_s:
                is_lit = self._colors[lamp_id] != DARK
                due.append((is_lit, free_s, lamp_id))
        if not due or self._all_free_s > now_s:
            return None
        _, _, lamp_id = min(due)

        # The command counts as sent: the caller sends it or resends all
        color = self._colors[lamp_id]
        self._sent[lamp_id] = color
        self._free_s[lamp_id] = now_s + self._lamp_period_s
        self._all_free_s = now_s + self._period_s
        if color == DARK:
            self._lit.discard(lamp_id)
        else:
            self._lit.add(lamp_id)
        return lamp_id, color

    def _waiting_lamps(self) -> list[str]:
        waiting: list[str] = []
        for lamp_id, color in self._colors.items():
            if lamp_id not in self._offline and self._sent.get(lamp_id) != color:
                waiting.append(lamp_id)
        return waiting
