"""Promises of a recogniser: samples and their words, for tests and `pointit plugin check`."""

import numpy as np

from pointit.testing import RecogniserContract
from pointit.testing.templates.recogniser import RATE_HZ, RECOGNISER


def fake_sound(length_s: float, level: float) -> bytes:
    """Return samples of a tone of 440 Hz."""
    times_s = np.arange(round(length_s * RATE_HZ)) / RATE_HZ
    return (level * 32767 * np.sin(2 * np.pi * 440 * times_s)).astype("<i2").tobytes()


SILENCE = fake_sound(0.5, 0.0)


class RecogniserPromises(RecogniserContract):
    """Contract of this plug-in: one test for each promise."""

    plugin = RECOGNISER
    samples = SILENCE + fake_sound(0.4, 0.5) + SILENCE + fake_sound(0.4, 0.5) + SILENCE
    words = ("this", "this")
    wrong_parameters = ({"loudness": 0.0}, {"gap_s": -1.0})
