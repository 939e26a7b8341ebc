"""Health metrics and warnings of a wrist that a page's mouse or phone, or ROS, moves."""

from collections.abc import Iterator

from pointit.schemas import NS_PER_S, WristSample
from pointit.services.imu_bridge.page_wrist import Device, PageWrist

DEVICE_NAMES: dict[Device, str] = {"arm": "mouse or ROS", "phone": "phone"}
"""Names of the devices; orientations from ROS arrive like those of a page's mouse."""
LOW_BATTERY = 0.1
"""Charge of a phone below which there is a warning."""


def figures(page: PageWrist, sample: WristSample | None) -> Iterator[tuple[str, float | None, str]]:
    """Yield name, value and unit of the health metrics of the newest `sample`. None removes a metric.

    `sample` is None after the page has released the wrist.
    """
    device = None if sample is None else sample.device
    for device_name, name in DEVICE_NAMES.items():
        yield f"moved by a page's {name}", 1.0 if device_name == device else None, ""
    battery = None if sample is None or device != "phone" else sample.battery
    yield "battery of the phone", None if battery is None else round(100.0 * battery), "%"
    yield "late samples of a page or ROS", float(page.late) if page.late else None, ""


def warnings(user: str, page: PageWrist, sample: WristSample | None) -> Iterator[tuple[str, str]]:
    """Yield topics and messages of warnings; `""` clears a warning."""
    ahead_ns = None if sample is None else page.ahead_ns
    yield (
        "page",
        ""
        if ahead_ns is None
        else f"the wrist that a page or ROS moves is stamped {ahead_ns / NS_PER_S:.1f} s ahead of this "
        "machine's clock and left out: synchronize the clocks of the machines",
    )
    battery = None if sample is None or sample.device != "phone" else sample.battery
    is_low = battery is not None and battery < LOW_BATTERY
    yield "battery", f"the battery of {user}'s phone is at {battery:.0%}: plug it in" if is_low else ""
