"""Source ids of samples, which their writers state themselves, and writers that state those of others.

A source id is of one writer, and a writer has one key. Under whose key a source id is its own cannot be told
from outside: who copies one may be heard before its owner. So nobody is refused for it, numbers are counted
for each key, and both keys are named. A process knows its own session, so it names who copies that for sure.
"""

import collections
import logging
import math
import threading
import time
from dataclasses import dataclass

import zenoh

from pointit.runtime.zenoh.queries import ExcessReplies
from pointit.schemas.text import one_line

log = logging.getLogger(__name__)

MAX_SOURCES = 4096
"""Maximum number of sources whose key is stored. The one that is silent longest is evicted."""
MAX_SHOWN = 100
"""Maximum number of characters of a key in a message."""
SHOWN_S = 20.0
"""Time for which a message is shown after the last copy, s."""
LOG_PERIOD_S = 10.0
"""Minimum interval of lines in the log, s."""


class CopiedSources:
    """Notices writers that state the source id of another. For all readers of a process, from any thread."""

    def __init__(self, own_session: str) -> None:
        """Begin. `own_session` is the id of this process's session."""
        self._own_session = own_session
        self._own_keys: set[str] = set()
        self._lock = threading.Lock()
        self._keys: collections.OrderedDict[tuple[str, int], str] = collections.OrderedDict()
        """Key under which a source was first seen."""
        self._sentence = ""
        self._last_s = self._logged_s = -math.inf

    def add_own_key(self, key: str) -> None:
        """Note that this process writes `key`."""
        self._own_keys.add(key)

    def is_own(self, sample: zenoh.Sample) -> bool:
        """Return True for a sample of this process's session, which comes back from its own cache.

        Notices a copied source. Such a sample of another process counts for its own key as any other.
        """
        info = sample.source_info
        if info is None:
            return False
        key = str(sample.key_expr)
        session = str(info.source_id.zid)
        if session == self._own_session:
            if key in self._own_keys:
                return True
            self._report(f"the writer of {_shown(key)} states the source id of this process")
            return False
        source = (session, info.source_id.eid)
        with self._lock:
            first_key = self._keys.setdefault(source, key)
            self._keys.move_to_end(source)
            if len(self._keys) > MAX_SOURCES:
                self._keys.popitem(last=False)
        if first_key != key:
            self._report(
                f"the writers of {_shown(first_key)} and {_shown(key)} state the same source id, which only "
                "one of them can have"
            )
        return False

    def problem(self, now_s: float) -> str:
        """Return a message for `SHOWN_S` after the last copy, else `""`."""
        with self._lock:
            return "" if now_s - self._last_s > SHOWN_S else self._sentence

    def _report(self, fact: str) -> None:
        now_s = time.monotonic()
        sentence = f"{fact}: each counts under its own key; find the program that copies it"
        with self._lock:
            self._sentence = sentence
            self._last_s = now_s
            if now_s - self._logged_s < LOG_PERIOD_S:
                return
            self._logged_s = now_s
        log.warning("%s", sentence)


@dataclass(frozen=True)
class SenderChecks:
    """What readers of a session notice about senders."""

    sources: CopiedSources
    excess: ExcessReplies


def _shown(key: str) -> str:
    return one_line(key, MAX_SHOWN)
