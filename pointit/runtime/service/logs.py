"""Logs: rich lines on a terminal; otherwise plain lines, or one JSON object a line."""

import json
import logging
import os
import sys
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from pointit.runtime.config.environment_variables import LOG_FORMAT
from pointit.schemas.text import hide_secrets

if TYPE_CHECKING:  # a process without a terminal loads no rich
    from rich.console import Console

LOG_FORMATS = ("plain", "json")
"""Values of the variable `POINTIT_LOG_FORMAT`: lines for people, or a JSON object a line for programs."""
PLAIN_LINE = "%(asctime)s.%(msecs)03d %(levelname)-7s %(name)s: %(message)s"
PLAIN_TIME = "%Y-%m-%dT%H:%M:%S"


class SecretFilter(logging.Filter):
    """Filter that hides secrets in messages and tracebacks, whichever library logs them."""

    def filter(self, record: logging.LogRecord) -> bool:
        """Remove secrets from the message and the traceback of `record`. Return True."""
        try:
            message = record.getMessage()
        except (TypeError, ValueError, KeyError):  # logging would print the arguments
            message = f"{record.msg} {record.args}"
        record.msg = hide_secrets(message)
        record.args = None
        if record.exc_info:
            record.exc_text = hide_secrets(logging.Formatter().formatException(record.exc_info))
            record.exc_info = None
        return True


if logging.lastResort is not None:  # the handler for commands that configure no logging
    logging.lastResort.addFilter(SecretFilter())


class JsonFormatter(logging.Formatter):
    """One JSON object a line: time, level, logger, message, and the traceback if there is one."""

    def format(self, record: logging.LogRecord) -> str:
        """Return `record` as one line of JSON."""
        written_at = datetime.fromtimestamp(record.created, UTC)
        entry = {
            "time": written_at.isoformat(),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        if record.exc_text:
            entry["traceback"] = record.exc_text
        return json.dumps(entry)


class PlainFormatter(logging.Formatter):
    """One line for each record, with the traceback below it: local time, level, logger, message."""

    def __init__(self) -> None:
        super().__init__(PLAIN_LINE, PLAIN_TIME)

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - a method of the library
        """Return the line of `record`; its further lines are indented, as none may look like a record."""
        return super().formatMessage(record).replace("\n", "\n    ")


def setup_logging(level: str = "info", console: "Console | None" = None) -> None:
    """Send logs to standard error, or through `console` so that they do not disturb a live view.

    Where standard error is no terminal, the variable `POINTIT_LOG_FORMAT` chooses one of `LOG_FORMATS`.
    """
    if console is not None or sys.stderr.isatty():
        from rich.logging import RichHandler  # noqa: PLC0415 - slow to import

        from pointit.runtime.service.plain_console import PlainConsole  # noqa: PLC0415 - as above

        handler: logging.Handler = RichHandler(
            console=console or PlainConsole(stderr=True), show_path=False, markup=False
        )
        handler.setFormatter(logging.Formatter("%(message)s", datefmt="%H:%M:%S"))
    else:
        handler = logging.StreamHandler(sys.stderr)
        is_json = os.environ.get(LOG_FORMAT) == "json"
        handler.setFormatter(JsonFormatter() if is_json else PlainFormatter())
    handler.addFilter(SecretFilter())
    logging.basicConfig(level=level.upper(), handlers=[handler], force=True)
    logging.getLogger("asyncio").setLevel(logging.WARNING)
