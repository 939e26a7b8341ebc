"""Who moves the wrist, for whoever looks at health: a page's mouse or phone, or ROS, and how that does."""

from collections.abc import Iterator

from pointit.schemas import NS_PER_S, WristSample
from pointit.services.imu_bridge.page_wrist import Device, PageWrist

CALLED: dict[Device, str] = {"arm": "mouse or ROS", "phone": "phone"}
"""What moves the wrist, in words: a page's, but the arm's orientation comes through ROS, too."""
LOW_BATTERY = 0.1
"""A phone that has less charge left is warned of."""


def figures(page: PageWrist, sample: WristSample | None) -> Iterator[tuple[str, float | None, str]]:
    """Yield name, value and unit of what health shows of the newest `sample`; no value takes it away.

    No sample: the page has let go.
    """
    device = None if sample is None else sample.device
    for one, called in CALLED.items():
        yield f"moved by a page's {called}", 1.0 if one == device else None, ""
    battery = None if sample is None or device != "phone" else sample.battery
    yield "battery of the phone", None if battery is None else round(100.0 * battery), "%"
    yield "late samples of a page or ROS", float(page.late) if page.late else None, ""


def warnings(user: str, page: PageWrist, sample: WristSample | None) -> Iterator[tuple[str, str]]:
    """Yield topics of warnings with what is wrong and what to do; empty where nothing is."""
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
