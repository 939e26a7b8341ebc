"""Messages that services skip in a replay on a site, whose time waits for nobody."""

import logging

from pointit.schemas import Health

log = logging.getLogger(__name__)


class Skipped:
    """Numbers of messages that services have not got, or skipped for newer ones, as their health tells."""

    def __init__(self) -> None:
        self._counts: dict[tuple[str, str], int] = {}
        """By instance and key."""

    def add(self, instance: str, health: Health) -> None:
        """Take a report, whose numbers count from the start of the service."""
        for key in health.keys:
            if key.direction == "in":
                self._counts[instance, key.key] = key.dropped + key.lost

    def log(self) -> None:
        """Log a warning if there are any."""
        if total := sum(self._counts.values()):
            keys = ", ".join(sorted({key for (_, key), count in self._counts.items() if count}))
            log.warning(
                "services skipped %d messages (%s), as this machine is too slow: replay at a lower --speed, "
                "or without --live",
                total,
                keys,
            )
