"""Recognition of a device's format, speed and restarts from its output. Pure."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

from pydantic import Field, field_validator

from pointit.geometry import vector
from pointit.geometry.rotation import rotate
from pointit.runtime.config.config import Config
from pointit.services.imu_bridge.serial import bno085, witmotion
from pointit.services.imu_bridge.serial.bno085 import Bno085Framer
from pointit.services.imu_bridge.serial.framers import SerialFramer
from pointit.services.imu_bridge.serial.line_parser import validated_form
from pointit.services.imu_bridge.serial.text_line import TextFramer
from pointit.services.imu_bridge.serial.witmotion import WitMotionFramer
from pointit.services.imu_bridge.serial.ximu3 import Ximu3Framer
from pointit.services.imu_bridge.sources import Item, RawReading, Reading, Reconnected
from pointit.services.imu_bridge.streams import Order, SensorChoice

Format = Literal["text", "witmotion", "bno085", "ximu3"]

TRY_S = 1.0
"""Time for which a speed is tried after its first byte, s."""
TRY_TEXT_S = 5.0
"""The same while only text arrives, which may be a board's report of its start, s."""
_TEXT = bytes(range(0x20, 0x7F)) + b"\t\r\n"
SILENT_S = 2.0
"""Shortest silence in which a sensor may have been restarted, s."""
LISTENING_S = 0.5
"""Most of the time between two looks at the port that counts as silence, s: a process that had no time heard
nothing."""
NEAR_RAD = math.radians(3.0)
"""Largest yaw of a sensor that has just been started: six-axis fusions begin at 0, rad. The wider, the more
often an arm that turns there in a pause of its radio is taken for a start."""
JUMP_RAD = math.radians(10.0)
"""Smallest change of the yaw that counts, rad. An arm at rest moves less in a pause of its radio."""


class SerialConfig(Config):
    """A device on a serial port, or on a Bluetooth port that looks like one."""

    port: str = Field(
        default="",
        description="path or name of the port, or empty for the only one that answers; "
        "/dev/serial/by-id/... survives plugging in again",
    )
    format: Literal["auto", "text", "witmotion", "bno085", "ximu3"] = Field(
        default="auto",
        description="format of the data: lines of text, WitMotion's, UART-RVC of a BNO085, or x-IMU3's; "
        "auto: recognized",
    )
    baud: int = Field(
        default=0,
        ge=0,
        le=4_000_000,
        description="bits per second; 0: found by trying, from 115200 and 9600 on",
    )
    order: Order = Field(default="wxyz", description="order of the quaternion's numbers in a line of text")
    line: str = Field(
        default="",
        description="form of a line of text with more than a quaternion, such as "
        "{sensor},{t_us},{w},{x},{y},{z}; {_} is passed over",
    )
    sensor: str = Field(
        default="",
        description="name or number of the sensor whose lines of text are used, if there are several",
    )
    configure: bool = Field(
        default=True,
        description="switch a WitMotion device that sends no quaternions to them, at 100 Hz (50 Hz at 9600 "
        "baud) and without magnetometer, until its power is off",
    )
    timeout_s: float = Field(
        default=3.0,
        gt=0,
        le=60,
        description="time without readable data after which a connected device is a warning, s",
    )

    _form = field_validator("line")(validated_form)


@dataclass(frozen=True, kw_only=True)
class FormatRow:
    """A format of serial devices."""

    label: str
    """Name for people."""
    make: Callable[[SerialConfig, int, SensorChoice], SerialFramer]
    """Makes a framer for a port with a speed, bits per second, and the choice of a sensor."""
    bauds: tuple[int, ...]
    """Speeds of such devices."""
    enough: int
    """Number of valid packets or lines that prove the format."""


FORMATS: Final[dict[Format, FormatRow]] = {
    "text": FormatRow(
        label="lines of text",
        make=lambda config, _baud, sensors: TextFramer(config.order, config.line, sensors),
        bauds=witmotion.BAUDS,
        enough=1,
    ),
    "witmotion": FormatRow(
        label="WitMotion",
        make=lambda config, baud, _sensors: WitMotionFramer(configure=config.configure, baud=baud),
        bauds=witmotion.BAUDS,
        enough=3,
    ),
    "bno085": FormatRow(
        label="BNO085 (UART-RVC)",
        make=lambda _config, _baud, _sensors: Bno085Framer(),
        bauds=(bno085.BAUD,),
        enough=3,
    ),
    "ximu3": FormatRow(
        label="x-IMU3", make=lambda _config, _baud, _sensors: Ximu3Framer(), bauds=witmotion.BAUDS, enough=1
    ),
}


@dataclass(frozen=True)
class DetectedSensor:
    """Format and speed of a device."""

    format: Format
    baud: int

    @property
    def label(self) -> str:
        """Return the name of the format for people."""
        return FORMATS[self.format].label

    @staticmethod
    def labels() -> list[str]:
        """Return the names of all formats."""
        return [row.label for row in FORMATS.values()]

    def __str__(self) -> str:
        return f"{self.label} at {self.baud} baud"


def sensor_choice(config: SerialConfig) -> SensorChoice:
    """Return the choice of a sensor in lines of text."""
    return SensorChoice("serial.sensor", config.sensor)


class Detection:
    """Tries formats side by side and speeds in turn until one format is recognized."""

    def __init__(
        self, config: SerialConfig, first: DetectedSensor | None = None, sensors: SensorChoice | None = None
    ) -> None:
        """Start with the speed of `first` and the choice `sensors`, if known from an earlier connection."""
        self._config = config
        self._sensors = sensor_choice(config) if sensors is None else sensors
        self._formats: tuple[Format, ...] = (config.format,) if config.format != "auto" else tuple(FORMATS)

        # Speeds in the order in which they are tried, from that of the earlier connection on
        rows = [FORMATS[name] for name in self._formats]
        self._bauds = (config.baud,) if config.baud else rows[0].bauds
        self._number = 0
        if first is not None and first.baud in self._bauds:
            self._number = self._bauds.index(first.baud)
        self.found: DetectedSensor | None = None
        """The recognized format and speed."""
        self.framer: SerialFramer | None = None
        """Framer of the recognized format."""
        self.good = 0
        """Number of valid packets or lines of the recognized format."""

        # State of the trial, which is over at once if there is only one choice
        self._restarts = RestartWatch()
        self._was_silent = False
        self._candidates: dict[Format, SerialFramer] = {}
        self._since_s: float | None = None
        """Time of the first byte at this speed."""
        self._only_text = True
        self._start_trial()
        if len(self._formats) == len(self._bauds) == 1:
            self._recognize(self._formats[0])

    @property
    def baud(self) -> int:
        """Return the speed that the port must have, bits per second."""
        return self._bauds[self._number]

    @property
    def tried(self) -> str:
        """Return the formats and speeds in question, for a warning."""
        labels = ", ".join(FORMATS[name].label for name in self._formats)
        bauds = ", ".join(map(str, self._bauds))
        return f"tried {labels} at {bauds} baud"

    @property
    def text_problem(self) -> str:
        """Return the refused last line and the reason if it is text, or `""`."""
        framer = self._candidates.get("text", self.framer)
        return framer.refused_text if isinstance(framer, TextFramer) else ""

    @property
    def passed_over(self) -> str:
        """Return a description of messages without readings from the only format in question, or `""`."""
        framers = [*self._candidates.values()] if self.framer is None else [self.framer]
        if len(framers) != 1:
            return ""
        (framer,) = framers
        if not framer.passed_over.count:
            return ""
        return f"messages without an orientation ({framer.passed_over.text}): {framer.MISSING}"

    def feed(self, data: bytes, stamp_ns: int, now_s: float) -> list[Item]:
        """Return the items in `data`, which arrived at `stamp_ns`, or now, `now_s`, of any clock in s."""
        # The format is recognized
        is_silent = self._restarts.is_silent(now_s)
        if self.framer is not None:
            if is_silent and not self._was_silent:
                self.framer.on_silence()
            self._was_silent = is_silent
            items = self.framer.feed(data, stamp_ns)
            self.good = self.framer.good
            return self._restarts.marked(items, may_be_start=is_silent and not self.framer.ran_on)

        # Try the formats. The first that has enough packets is the device's.
        for name, candidate in self._candidates.items():
            items = candidate.feed(data, stamp_ns)
            if candidate.good >= FORMATS[name].enough:
                self._recognize(name)
                return self._restarts.marked(items, may_be_start=is_silent)

        # Go on to the next speed after a while. Text may come seldom.
        if data:
            self._only_text = self._only_text and not data.translate(None, _TEXT)
            if self._since_s is None:
                self._since_s = now_s
        limit_s = TRY_TEXT_S if self._only_text else TRY_S
        if self._since_s is not None and now_s - self._since_s > limit_s:
            self._number = (self._number + 1) % len(self._bauds)
            self._start_trial()
        return []

    def forget(self) -> None:
        """Recognize again, since what arrives has become unreadable."""
        if len(self._formats) > 1 or len(self._bauds) > 1:
            self.found = self.framer = None
            self._start_trial()

    def _start_trial(self) -> None:
        candidates: dict[Format, SerialFramer] = {}
        for name in self._formats:
            row = FORMATS[name]
            if self.baud in row.bauds or self._config.baud:
                candidates[name] = row.make(self._config, self.baud, self._sensors)
        self._candidates = candidates
        self._since_s = None
        self._only_text = True

    def _recognize(self, name: Format) -> None:
        self.found = DetectedSensor(name, self.baud)
        self.framer = self._candidates[name]
        self._candidates = {}
        self.good = self.framer.good


class RestartWatch:
    """Compares the yaw before and after each silence."""

    def __init__(self) -> None:
        self._looked_s = math.inf
        self._silent_s = 0.0
        self._newest: Reading | None = None

    def is_silent(self, now_s: float) -> bool:
        """Return True if no reading has come for a while until `now_s`, s; to be called at each look."""
        self._silent_s += min(max(now_s - self._looked_s, 0.0), LISTENING_S)
        self._looked_s = now_s
        return self._newest is not None and self._silent_s >= SILENT_S

    def marked(self, items: list[Item], *, may_be_start: bool) -> list[Item]:
        """Return the `items` of one look at the port, behind a `Reconnected` if they are the first of a run.

        `may_be_start`: a silence was before, and no counter shows that the sensor ran on.
        """
        readings = [item for item in items if isinstance(item, Reading | RawReading)]
        if not readings:
            return items
        previous = self._newest
        first = readings[0]
        last = readings[-1]
        self._silent_s = 0.0
        self._newest = last if isinstance(last, Reading) else previous

        # Only the yaw may show a restart, if nothing else does
        if not may_be_start or previous is None:
            return items
        if not isinstance(first, Reading):
            return items
        if first.device_time_ns is not None or Reconnected() in items:
            return items  # decided by the elapsed time, or by the framer
        yaw_rad = _yaw_rad(first)
        jump_rad = abs(vector.wrap(yaw_rad - _yaw_rad(previous)))
        if abs(yaw_rad) < NEAR_RAD and jump_rad > JUMP_RAD:
            return [Reconnected(), *items]
        return items


def _yaw_rad(reading: Reading) -> float:
    return vector.azimuth(rotate(reading.world_from_sensor, (1.0, 0.0, 0.0)))
