"""Vibration of cues."""

from collections.abc import Sequence


def vibration_pulses(haptic_ms: Sequence[int]) -> list[tuple[float, int]]:
    """Return pause before, s, and duration, ms, of each pulse of alternating times on and off."""
    pulses: list[tuple[float, int]] = []
    pause_ms = 0
    for number, duration_ms in enumerate(haptic_ms):
        if number % 2 == 0:
            pulses.append((pause_ms / 1000.0, duration_ms))
            pause_ms = 0
        pause_ms += duration_ms
    return pulses
