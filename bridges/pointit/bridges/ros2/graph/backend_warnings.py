"""What a backend has to complain about: shown while it lasts, logged when it begins."""

import asyncio
import logging
from collections.abc import Mapping

from pointit.runtime.health.service_bus import WarningSink

log = logging.getLogger(__name__)

QUIET_S = 10.0
"""A complaint about messages is taken back when there was no cause for so long."""


class BackendWarnings:
    """Standing complaints, replaced as a whole; passing ones, which fade; held ones. In the loop."""

    def __init__(self, warnings: WarningSink) -> None:
        self._warnings = warnings
        self._standing: dict[str, str] = {}
        self._held: set[str] = set()
        self._passing: dict[str, asyncio.TimerHandle] = {}
        self._loop = asyncio.get_running_loop()

    def replace_all(self, sentences: Mapping[str, str]) -> None:
        """Show these, by what they are about, and none of the standing ones before."""
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
        """Show this until there was no cause for a while; `about` must be none of a standing one."""
        timer = self._passing.pop(about, None)
        if timer is None:
            log.warning("%s", sentence)
        else:
            timer.cancel()
        self._warnings.warn(about, sentence)
        self._passing[about] = self._loop.call_later(QUIET_S, self._fade, about)

    def show(self, about: str, sentence: str) -> None:
        """Show this until `clear`; `about` must be none of another kind of complaint."""
        if about not in self._held:
            log.warning("%s", sentence)
        self._held.add(about)
        self._warnings.warn(about, sentence)

    def clear(self, about: str) -> None:
        """Take back what was held, if it was."""
        if about in self._held:
            self._held.discard(about)
            self._warnings.clear(about)

    def close(self) -> None:
        """Take everything back."""
        self.replace_all({})
        for about in tuple(self._held):
            self.clear(about)
        for about, timer in tuple(self._passing.items()):
            timer.cancel()
            self._fade(about)

    def _fade(self, about: str) -> None:
        del self._passing[about]
        self._warnings.clear(about)
