"""Whether somebody looks on from a page, for whom a run goes on. Pure."""

import math

from pointit.launch.plan.launches import PAGE
from pointit.runtime.link.outage import SILENT_S
from pointit.schemas import Health

VIEWERS = "viewers"
"""Metric in a page's Health: number of open pages."""


class Onlookers:
    """Tracks until when viewers count as present: a page that is reloaded is not gone at once."""

    def __init__(self) -> None:
        self.until_s = -math.inf
        """Viewers count as present until then, on the clock of `on_health`."""

    def on_health(self, health: Health, now_s: float) -> bool:
        """Update from a service's Health. Return True if it changes whether viewers are present."""
        is_open = any(figure.name == VIEWERS and figure.value > 0 for figure in health.figures)
        if is_open and health.service == PAGE:
            self.until_s = max(self.until_s, now_s + SILENT_S)
            return True
        return False

    def are_there(self, now_s: float) -> bool:
        """Return True if viewers are present at `now_s`."""
        return now_s < self.until_s
