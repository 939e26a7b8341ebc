"""Whether somebody looks on at a run, from what its pages say of themselves; pure."""

import math

from pointit.cli.launches import PAGE
from pointit.diagnosis.observation import SILENT_S
from pointit.schemas import Health

VIEWERS = "viewers"
"""The figure of a page's health: how many have it open."""


class Onlookers:
    """Knows how long somebody looks on at least: a page that is loaded anew is not gone at once."""

    def __init__(self) -> None:
        self.until_s = -math.inf
        """Somebody looks on until then, unless more is heard; on the clock of `on_health`."""

    def on_health(self, health: Health, now_s: float) -> bool:
        """Take note of what a service says; return whether it is news of people who look on."""
        is_open = any(figure.name == VIEWERS and figure.value > 0 for figure in health.figures)
        if is_open and health.service == PAGE:
            self.until_s = max(self.until_s, now_s + SILENT_S)
            return True
        return False

    def are_there(self, now_s: float) -> bool:
        """Return whether somebody looks on at `now_s`."""
        return now_s < self.until_s
