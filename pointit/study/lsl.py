"""Streams of a session in the Lab Streaming Layer: markers of trials, ray, cursor, selections, true pose."""

import importlib
import importlib.util
import json
import math
from typing import Any

from pointit.errors import ConfigError
from pointit.forearm.true_pose import TruePose
from pointit.runtime.host.extras import remedy
from pointit.schemas import NS_PER_S, Cursor, SelectionEvent

NOT_KNOWN = (float("nan"),) * 3
CHANNELS = {
    "markers": ("marker",),
    "ray": ("origin_x", "origin_y", "origin_z", "direction_x", "direction_y", "direction_z"),
    "cursor": ("x", "y", "z"),
    "selection": ("event",),
    "truth": ("x", "y", "z", "yaw"),
}
"""Channels by stream. Points in {W}, m, NaN where the ray meets nothing; texts are JSON.
The yaw is that of {H}, rad, NaN if it is not known."""

UNITS = {"x": "m", "y": "m", "z": "m", "yaw": "rad"}
"""Units of channels by label."""


def check_lsl() -> None:
    """Check that pylsl is installed. Raises: ConfigError: If it is not."""
    if importlib.util.find_spec("pylsl") is None:
        raise ConfigError(f"--lsl needs pylsl, which is not installed; run {remedy('lsl')}")


class LslOutlets:
    """Outlets `PointIt markers`, `ray`, `cursor`, `selection` and `truth` with capture times.

    LSL announces them to the whole local network.
    """

    def __init__(self, study: str, participant: str) -> None:
        """Open the outlets. Their source ids stay the same, so that inlets find them again after a crash."""
        lsl: Any = importlib.import_module("pylsl")
        self._clock = lsl.local_clock
        self._outlets: dict[str, Any] = {}
        self._last_captures: dict[type[object], tuple[int, float]] = {}
        """Time of capture of the last message: site time, ns, and LSL time, s. By its type."""
        for stream, channels in CHANNELS.items():
            is_text = len(channels) == 1
            kind, form = ("Markers", lsl.cf_string) if is_text else ("Position", lsl.cf_float32)
            source = f"pointit-{study}-{participant}-{stream}"
            info = lsl.StreamInfo(f"PointIt {stream}", kind, len(channels), lsl.IRREGULAR_RATE, form, source)
            described = info.desc().append_child("channels")
            for label in channels:
                channel = described.append_child("channel").append_child_value("label", label)
                channel.append_child_value("unit", UNITS.get(label.removeprefix("origin_"), ""))
            self._outlets[stream] = lsl.StreamOutlet(info)

    def mark(self, **marker: object) -> None:
        """Send a marker of this moment."""
        self._outlets["markers"].push_sample([json.dumps(marker)], self._clock())

    def send(self, message: object, now_ns: int) -> None:
        """Send a cursor, with its ray, a selection or a true pose that has arrived at `now_ns`, site time."""
        if isinstance(message, Cursor):
            stamp_s = self._capture_s(message, now_ns)
            ray = [*(message.origin_m or NOT_KNOWN), *(message.direction or NOT_KNOWN)]
            self._outlets["ray"].push_sample(ray, stamp_s)
            self._outlets["cursor"].push_sample(list(message.point_m or NOT_KNOWN), stamp_s)
        elif isinstance(message, SelectionEvent):
            text = message.model_dump_json(include={"event", "object_id", "user"})
            self._outlets["selection"].push_sample([text], self._capture_s(message, now_ns))

        elif isinstance(message, TruePose):
            yaw_rad = math.nan if message.yaw_rad is None else message.yaw_rad
            sample = [*message.position_m, yaw_rad]
            self._outlets["truth"].push_sample(sample, self._capture_s(message, now_ns))

    def _capture_s(self, message: Cursor | SelectionEvent | TruePose, now_ns: int) -> float:
        """Return the time of capture of `message` by LSL's clock, s: the same in all its streams.

        LSL's clock is read after `now_ns`, and a busy machine delays it. So that times do not go back, it is
        at least the time of an earlier capture.
        """
        stamp_s = self._clock() - (now_ns - message.stamp_ns) / NS_PER_S
        last_ns, last_s = self._last_captures.get(type(message), (message.stamp_ns, stamp_s))
        if message.stamp_ns >= last_ns:
            stamp_s = max(stamp_s, last_s)
        self._last_captures[type(message)] = (message.stamp_ns, stamp_s)
        return float(stamp_s)
