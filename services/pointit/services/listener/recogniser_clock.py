"""Check that the times of a recogniser's words agree with the site's time.

No word ends after it has arrived. Arrivals tell nothing of a clock that is behind, as recognisers are slow.
But arms arrive about their words: the median time between them tells of clocks in both directions.
"""

import math
from collections import deque
from statistics import median

import numpy as np

from pointit.schemas import NS_PER_S, Speech
from pointit.services.listener.memory import PointingMemory
from pointit.services.listener.referents import Spoken
from pointit.services.listener.stays import TimingModel, chances, stays_of

UTTERANCES = 5
"""Number of utterances whose arrival decides."""
WORDS = 24
"""Number of deictic words whose gestures decide."""
TYPICAL_S = -0.2
"""Median time from a word to the arrival of the arm, s, with a clock that is right. It scatters by 0.08 s, of
people simulated as in `pointit evaluate referents`."""
EARLIEST_S, LATEST_S = -0.42, 0.03
"""Range of that median beyond which a clock is named, s: of simulated ones that are right less than 1 of 60,
of those that are 0.5 s off 9 of 10."""
REMEDY = "synchronize it, or send the site's time"
WINDOW_S = 1.5
"""Time about a word in which its gesture is searched, s: wider than for its meaning."""
MODEL = TimingModel(lag_sigma_s=0.8, held=0.0)
"""Times of gestures about words of an unknown clock."""


class RecogniserClock:
    """Compares times of words with their arrival and with gestures."""

    def __init__(self, limit_s: float) -> None:
        """`limit_s`: time by which words may end after they arrive."""
        self._limit_s = limit_s
        self._ahead_s = deque[float](maxlen=UTTERANCES)
        self._lags_s = deque[float](maxlen=WORDS)
        self._asked = deque[Spoken](maxlen=WORDS)
        """Words whose gestures may still come."""

    def on_speech(self, speech: Speech, now_ns: int) -> None:
        """Compare with the arrival of `speech`."""
        if speech.words and speech.is_final:
            self._ahead_s.append((speech.words[-1].end_ns - now_ns) / NS_PER_S)

    def on_word(self, spoken: Spoken) -> None:
        """Note a word that is asked about; it is looked at later."""
        if spoken.word not in ("", "these") and all(each.at_ns != spoken.at_ns for each in self._asked):
            self._asked.append(spoken)

    def compare(self, memory: PointingMemory, now_ns: int) -> bool:
        """Compare words with gestures that are complete by now. Return True if there was any."""
        window_ns, has_compared = round(WINDOW_S * NS_PER_S), False
        while self._asked:
            spoken = self._asked[0]
            times_ns = (spoken.at_ns, *spoken.others_ns)
            if max(times_ns) + window_ns > now_ns:
                break
            self._asked.popleft()
            cursors = memory.between(min(times_ns) - window_ns, max(times_ns) + window_ns)
            if not cursors:
                continue
            times_s = np.array([(each.stamp_ns - spoken.at_ns) / NS_PER_S for each in cursors])
            directions = np.array([each.direction for each in cursors], dtype=np.float64)
            stays = stays_of(times_s, directions, MODEL)
            words_s = sorted((each - spoken.at_ns) / NS_PER_S for each in times_ns)
            shares = chances(stays, words_s, words_s.index(0.0), MODEL)
            begin_s = stays[int(np.argmax(shares))].begin_s
            if max(shares) > 0.0 and math.isfinite(begin_s):
                self._lags_s.append(begin_s)
                has_compared = True
        return has_compared

    @property
    def problem(self) -> str:
        """Return a sentence on the recogniser's clock, or `""` if it may be right."""
        ahead_s = max(self._ahead_s, default=0.0)
        if ahead_s > self._limit_s:
            return f"words end {ahead_s:.1f} s after they arrive: the recogniser's clock is ahead; {REMEDY}"
        lag_s = median(self._lags_s) if len(self._lags_s) == WORDS else TYPICAL_S
        if EARLIEST_S <= lag_s <= LATEST_S:
            return ""
        which, side = ("later", "behind") if lag_s > LATEST_S else ("earlier", "ahead")
        off = f"arms arrive about {abs(lag_s - TYPICAL_S):.1f} s {which} about words than they should"
        return f"{off}: the recogniser's clock is {side}, or it dates words wrongly; {REMEDY}"
