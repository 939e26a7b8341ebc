"""Errors that services log, or that nobody handles."""

import logging
from typing import Any

from tests.simulation.kernel.process import PROCESS
from tests.simulation.kernel.timeline import Timeline
from tests.simulation.promises import promise
from tests.simulation.promises.breaches import Breaches


class LogPromises(logging.Handler):
    """Takes unexpected errors for breaches, and writes warnings to the trace."""

    def __init__(self, timeline: Timeline, breaches: Breaches) -> None:
        super().__init__(logging.WARNING)
        self._timeline = timeline
        self._breaches = breaches

    def emit(self, record: logging.LogRecord) -> None:
        """Take a line of the log."""
        process = PROCESS.get()
        if process is not None and process.is_dead:
            return
        text = f"{'-' if process is None else process.name}: {record.getMessage()}"
        error = record.exc_info[1] if record.exc_info else None
        is_unhandled = error is not None or "never retrieved" in text
        if record.levelno >= logging.ERROR and is_unhandled:
            self._breaches.add(promise.NO_EXCEPTION, f"{text}: {error!r}", error)
        else:
            self._timeline.note("log", text[:180])

    def on_loop_error(self, _loop: Any, context: dict[str, Any]) -> None:
        """Take an exception that nobody handled (an exception handler of the loop)."""
        process = PROCESS.get()
        if process is None or not process.is_dead:
            error = context.get("exception")
            self._breaches.add(promise.NO_EXCEPTION, f"{context.get('message')}: {error!r}", error)
