"""Session with one QTM server: names of its bodies, times of its frames. Pure; time is an argument."""

import math
import xml.etree.ElementTree as ET
from collections import deque
from collections.abc import Callable, Sequence

from pointit.bridges.mocap.timed_frame import ARRIVAL_SIGMA_S, TimedFrame, body_sample
from pointit.geometry.rotation import Quaternion
from pointit.schemas import NS_PER_S

SILENCE_NS = 3 * NS_PER_S
"""Time without frames after which that is reported."""
REPORT_NS = 10 * NS_PER_S
"""Time for which a damaged packet is reported."""
WINDOW_NS = 10 * NS_PER_S
"""Time over which the shortest delay between exposure and arrival is taken, ns."""
MAX_LATE_NS = 2 * NS_PER_S
"""Time by which a frame may come later than the fastest one."""
LIVE, PLAYBACK = frozenset({1, 2, 3, 4, 9, 10}), 8
"""Events after which the cameras may measure, and the one after which QTM plays a file."""
SETTINGS_CHANGED = frozenset({1, 3, 8, 11})
"""Events after which bodies may have other names."""

Body6D = tuple[Sequence[float], Sequence[float], float]
"""Position in mm, rotation matrix by columns, and residual in mm."""


class QtmSession:
    """Understands the frames and settings of one server."""

    def __init__(self, server: str, on_frame: Callable[[TimedFrame], None]) -> None:
        self.server = server
        """Name of the server in messages."""
        self.damaged = 0
        """Number of packets that could not be read."""
        self.are_settings_stale = True
        """True if the names of the bodies must be asked for."""
        self._on_frame = on_frame
        self._names: tuple[str, ...] = ()
        self._up = ""
        self._is_connected = self._is_playback = False
        self._since_ns = self._arrived_ns = self._used_ns = self._damage_ns = 0
        self._last_us = -1
        self._delays: deque[tuple[int, int]] = deque()
        """Arrivals of frames, and their times of arrival less those of exposure, rising."""
        self._frame_fault = ""

    def restart(self, now_ns: int, *, is_connected: bool) -> None:
        """Begin or end a connection."""
        self._is_connected, self._is_playback, self._since_ns = is_connected, False, now_ns
        self._arrived_ns = self._used_ns = 0
        self._last_us, self.are_settings_stale = -1, True
        self._delays.clear()

    def set_parameters(self, text: bytes) -> None:
        """Use the settings of 3D and 6DOF.

        Raises:
            ValueError: If they are no XML that can be read.
        """
        if b"<!DOCTYPE" in text:
            raise ValueError("its settings have a document type")
        try:
            root = ET.fromstring(_decoded(text))  # noqa: S314 - entities need a document type
        except ET.ParseError as error:
            raise ValueError(f"its settings are no XML ({error})") from error
        names = [(each.findtext("Name") or "").strip() for each in root.iterfind("The_6D/Body")]
        self._names = tuple(name or f"body {number}" for number, name in enumerate(names, start=1))
        self._up = (root.findtext("The_3D/AxisUpwards") or "+Z").strip().lower()
        self.are_settings_stale = False

    def set_event(self, event: int) -> None:
        """Follow the state of QTM."""
        self._is_playback = event == PLAYBACK or (self._is_playback and event not in LIVE)
        self.are_settings_stale = self.are_settings_stale or event in SETTINGS_CHANGED

    def note_damage(self, now_ns: int) -> None:
        """Count a packet that could not be read."""
        self.damaged += 1
        self._damage_ns = now_ns

    def problem(self, now_ns: int) -> str:
        """Return a sentence if there is no usable stream, or something is odd, else `""`."""
        if not self._is_connected:
            return ""  # the connection says why
        if now_ns - max(self._arrived_ns, self._since_ns) > SILENCE_NS:
            return (
                f"{self.server} answers, but no frames come: start a measurement in QTM (File, New) and "
                "switch on `Calculate 6DOF` under its real-time actions"
            )
        if self._frame_fault and now_ns - max(self._used_ns, self._since_ns) > NS_PER_S:
            return f"{self.server}: {self._frame_fault}"
        if self._damage_ns and now_ns - self._damage_ns < REPORT_NS:
            return f"{self.server} sent {self.damaged} packets that cannot be read: update PointIt or QTM"
        return ""

    def clock_sigma_s(self, now_ns: int) -> float | None:  # noqa: ARG002 - as of NatNet
        """Return None: QTM tells no clock."""
        return None

    def receive(self, time_us: int, bodies: Sequence[Body6D], now_ns: int) -> None:
        """Use a frame that was exposed `time_us` after the measurement began."""
        self._arrived_ns = now_ns
        is_repeated, is_restarted = time_us == self._last_us, time_us < self._last_us
        self._last_us = time_us
        if is_restarted:
            self._delays.clear()
        fault = self._fault(len(bodies), is_repeated=is_repeated)
        stamp_ns, late_ns = self._stamp(time_us, now_ns)
        if not fault and late_ns > MAX_LATE_NS:
            fault = f"its frames come {late_ns / NS_PER_S:.1f} s late: use a cable, or a lower camera rate"
        self._frame_fault = fault
        if fault:
            return
        self._used_ns = now_ns
        samples = (
            body_sample(
                number, (x / 1000.0, y / 1000.0, z / 1000.0), _quaternion(matrix), max(0.0, mm / 1000.0)
            )
            for number, ((x, y, z), matrix, mm) in enumerate(bodies, start=1)
        )
        named = tuple(zip(self._names, samples, strict=True))
        self._on_frame(TimedFrame(stamp_ns, ARRIVAL_SIGMA_S, named, self._up[-1:]))

    def _fault(self, count: int, *, is_repeated: bool) -> str:
        if self._is_playback:
            return "QTM plays a file, whose frames are not used: start a measurement (File, New)"
        if self._up not in ("+y", "+z"):
            return f"its axis {self._up.upper()} points up: choose +Z or +Y under Calibration in QTM"
        if is_repeated:
            return "its frames stand still: end the pause in QTM"
        if count != len(self._names):
            self.are_settings_stale = True
            return (
                f"its frames have {count} bodies, its settings {len(self._names)}: enable all bodies in QTM"
            )
        if self.are_settings_stale:
            return "QTM has not named its bodies yet: start a measurement there (File, New)"
        return ""

    def _stamp(self, time_us: int, now_ns: int) -> tuple[int, int]:
        """Return the site's time of exposure, less the shortest delay, and the delay beyond that, ns."""
        delay_ns = now_ns - 1000 * time_us
        while self._delays and self._delays[-1][1] >= delay_ns:
            self._delays.pop()
        self._delays.append((now_ns, delay_ns))
        while now_ns - self._delays[0][0] > WINDOW_NS:
            self._delays.popleft()
        late_ns = delay_ns - self._delays[0][1]
        return now_ns - late_ns, late_ns


def _decoded(text: bytes) -> str:
    """Return the text of old versions, too, which write names in the code page of Windows."""
    text = text.rstrip(b"\0")
    try:
        return text.decode("utf-8")
    except UnicodeDecodeError:
        return text.decode("cp1252", "replace")


def _quaternion(matrix: Sequence[float]) -> Quaternion:
    """Return the rotation of a matrix that is given by columns. Its length differs from 1 if it is none."""
    a, b, c, d, e, f, g, h, i = matrix
    if a + e + i >= 0.0:
        square = 1.0 + a + e + i
        row = (f - h, g - c, b - d, square)
    elif a >= e and a >= i:
        square = 1.0 + a - e - i
        row = (square, b + d, g + c, f - h)
    elif e >= i:
        square = 1.0 - a + e - i
        row = (b + d, square, f + h, g - c)
    else:
        square = 1.0 - a - e + i
        row = (g + c, f + h, square, b - d)
    if not square > 0.0:  # also NaN
        return (0.0, 0.0, 0.0, 0.0)
    scale = 0.5 / math.sqrt(square)
    x, y, z, w = row
    return (scale * x, scale * y, scale * z, scale * w)
