"""Warnings of a backend: shown while they last, logged when they begin."""

import asyncio
import logging
from collections.abc import Mapping

from pointit.runtime.service.surroundings import WarningSink

log = logging.getLogger(__name__)

QUIET_S = 10.0
"""A warning about messages is cleared this long (s) after its last cause."""


class BackendWarnings:
    """Permanent warnings, replaced as a whole; brief ones, which expire; held ones. In the loop."""

    def __init__(self, warnings: WarningSink) -> None:
        self._warnings = warnings
        self._standing: dict[str, str] = {}
        self._held: set[str] = set()
        self._passing: dict[str, asyncio.TimerHandle] = {}
        self._loop = asyncio.get_running_loop()

    def replace_all(self, sentences: Mapping[str, str]) -> None:
        """Replace all permanent warnings by these, by subject."""
        for about in [each for each in self._standing if each not in sentences]:
            del self._standing[about]
            self._warnings.clear(about)
        for about, sentence in sentences.items():
            before = self._standing.get(about)
            if before != sentence:
                self._standing[about] = sentence
                self._warnings.warn(about, sentence)
                if before is None:
                    log.warning("%s", sentence)

    def show_briefly(self, about: str, sentence: str) -> None:
        """Show a warning until its cause is absent for a while; `about` must differ from permanent ones."""
        timer = self._passing.pop(about, None)
        if timer is None:
            log.warning("%s", sentence)
        else:
            timer.cancel()
        self._warnings.warn(about, sentence)
        self._passing[about] = self._loop.call_later(QUIET_S, self._fade, about)

    def show_losses(self, topic: str, oversized: int, overrun: int, max_bytes: int) -> None:
        """Show briefly how many messages on `topic` were too long or came too fast."""
        reasons = (
            f"{oversized} were longer than {max_bytes} bytes" if oversized else "",
            f"{overrun} came faster than they could be handled" if overrun else "",
        )
        dropped = f"dropped messages on {topic}: {' and '.join(each for each in reasons if each)}"
        self.show_briefly(f"losses of {topic}", dropped)

    def show(self, about: str, sentence: str) -> None:
        """Show a warning until `clear`; `about` must not be of another kind of warning."""
        if about not in self._held:
            log.warning("%s", sentence)
        self._held.add(about)
        self._warnings.warn(about, sentence)

    def clear(self, about: str) -> None:
        """Clear a held warning, if there is one."""
        if about in self._held:
            self._held.discard(about)
            self._warnings.clear(about)

    def close(self) -> None:
        """Clear all warnings."""
        self.replace_all({})
        for about in tuple(self._held):
            self.clear(about)
        for about, timer in tuple(self._passing.items()):
            timer.cancel()
            self._fade(about)

    def _fade(self, about: str) -> None:
        del self._passing[about]
        self._warnings.clear(about)
