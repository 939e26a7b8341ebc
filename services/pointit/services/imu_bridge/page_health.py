"""Who moves the wrist, for whoever looks at health: a page's mouse or phone, and how it does."""

import logging

from pointit.runtime.health import ServiceBus
from pointit.schemas import NS_PER_S, WristSample
from pointit.services.imu_bridge.page_wrist import Device, PageWrist

log = logging.getLogger(__name__)

CALLED: dict[Device, str] = {"arm": "mouse", "phone": "phone"}
"""What moves the wrist, in words."""
LOW_BATTERY = 0.1
"""A phone that has less charge left is warned of."""


class PageHealth:
    """Shows figures and warnings as long as a page moves the wrist."""

    def __init__(self, bus: ServiceBus, user: str) -> None:
        self._bus = bus
        self._user = user
        self._device: Device | None = None
        """What moves the wrist; none: no page does."""

    def show(self, page: PageWrist, sample: WristSample) -> None:
        """Take note of a `sample` that `page` has taken."""
        if sample.device != self._device:
            self._hand_over(sample.device)
            log.info("%s: a page's %s moves the wrist", self._user, CALLED[sample.device])
        if page.ahead_ns is not None:
            self._bus.warn(
                "page",
                f"the wrist that a page moves is stamped {page.ahead_ns / NS_PER_S:.1f} s ahead of this "
                "machine's clock and left out: synchronize the clocks of the machines",
            )
        else:
            self._bus.clear("page")
        if page.late:
            self._bus.figure("late samples of a page", page.late)
        if sample.device == "phone" and sample.battery is not None:
            self._show_battery(sample.battery)

    def end(self) -> None:
        """Take note that the page has let go."""
        if self._device is not None:
            log.info("%s: the page's %s has let go of the wrist", self._user, CALLED[self._device])
        self._hand_over(None)
        self._bus.clear("page")

    def _show_battery(self, charge: float) -> None:
        self._bus.figure("battery of the phone", round(100.0 * charge), "%")
        if charge < LOW_BATTERY:
            self._bus.warn("battery", f"the battery of {self._user}'s phone is at {charge:.0%}: plug it in")
        else:
            self._bus.clear("battery")

    def _hand_over(self, device: Device | None) -> None:
        self._device = device
        for one, called in CALLED.items():
            self._bus.figure(f"moved by a page's {called}", 1.0 if one == device else None)
        if device != "phone":
            self._bus.figure("battery of the phone", None)
            self._bus.clear("battery")
