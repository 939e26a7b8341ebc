"""Encoding of commands to MetaMotion R, RL and S boards, and decoding of their notifications.

    frame = module register data*        read: register | 0x80, which the reply repeats

Readings of the fusion contain no time and no sequence number. Without its complete configuration, the fusion
sends zeros or nothing.
"""

import struct
from dataclasses import dataclass
from typing import Literal

from pointit.geometry.rotation import Quaternion
from pointit.schemas import Feedback
from pointit.schemas.base import unit_quaternion
from pointit.services.imu_bridge.ble.vibration import vibration_pulses

SERVICE = "326a9000-85cb-9195-d9dd-464cfbbae75a"
COMMAND = "326a9001-85cb-9195-d9dd-464cfbbae75a"
NOTIFY = "326a9006-85cb-9195-d9dd-464cfbbae75a"
READ = 0x80
Accelerometer = Literal["BMI160", "BMI270"]
ACCELEROMETERS: dict[int, Accelerometer] = {1: "BMI160", 4: "BMI270"}
"""Accelerometers by the implementation that their module states."""
READ_GYRO = bytes.fromhex("1380")
READ_ACCELEROMETER = bytes.fromhex("0380")
READ_FUSION = bytes.fromhex("1980")
READ_BATTERY = bytes.fromhex("118c")
SOFT_RESET = bytes.fromhex("fe01")
FAST_INTERVAL = bytes.fromhex("1109060006000000" + "5802")
"""Asks for a connection interval of 7.5 ms, latency 0 and a time-out of 6 s."""
STOP_LED = bytes.fromhex("020201")
PLAY_LED = bytes.fromhex("020101")
FULL_DUTY = 0xF8
MAX_LED = 31
"""Largest intensity of a colour."""
FLASH_MS = 300
_LED_CHANNELS = ((0, 1), (1, 0), (2, 2))
"""Number of a colour on the board, and its place in red, green, blue."""


@dataclass(frozen=True, slots=True)
class Orientation:
    """world_from_sensor, x, y, z, w with norm 1."""

    orientation_xyzw: Quaternion


@dataclass(frozen=True, slots=True)
class Charge:
    """State of the battery."""

    level: float
    """0 to 1."""
    volts: float


@dataclass(frozen=True, slots=True)
class ButtonState:
    """The button went down or up."""

    is_down: bool


@dataclass(frozen=True, slots=True)
class ModuleInfo:
    """Reply to a read of register 0: a module's implementation and revision, or None if it has none."""

    module: int
    implementation: int | None
    revision: int = 0


Notification = Orientation | Charge | ButtonState | ModuleInfo


def parse(frame: bytes) -> Notification | None:
    """Return the meaning of a notification, or None if it is another one or broken."""
    if len(frame) < 2:
        return None
    module, register, data = frame[0], frame[1], frame[2:]
    if register == READ:
        return ModuleInfo(module, data[0], data[1]) if len(data) >= 2 else ModuleInfo(module, None)
    if (module, register) == (0x19, 0x07) and len(data) == 16:
        w, x, y, z = struct.unpack("<4f", data)
        try:
            return Orientation(unit_quaternion((x, y, z, w)))
        except ValueError:  # zeros are a fusion that is not configured
            return None
    if (module, register) == (0x01, 0x01) and len(data) == 1:
        return ButtonState(data[0] != 0)
    if (module, register) == (0x11, 0x8C) and len(data) == 3:
        return Charge(min(data[0], 100) / 100.0, int.from_bytes(data[1:], "little") / 1000.0)
    return None


def teardown() -> tuple[bytes, ...]:
    """Return commands that remove what an earlier program left: processors, events, loggers, the stream."""
    return (bytes.fromhex("0908"), bytes.fromhex("0a05"), bytes.fromhex("0b0a"), *stop())


def stop() -> tuple[bytes, ...]:
    """Return commands that end the fusion and its sensors."""
    return tuple(
        bytes.fromhex(each)
        for each in (
            "190100", "1903007f", "030100", "130100", "03020001", "13020001", "150100", "15020001",
            "190700", "010100",
        )
    )  # fmt: skip


def start(accelerometer: Accelerometer, *, magnetometer: bool) -> tuple[bytes, ...]:
    """Return the whole configuration of quaternions at 100 Hz, and its start.

    Six axes (`IMU_PLUS`), or with the `magnetometer` nine (`NDOF`); ±16 g, 2000 °/s.
    """
    texts = [
        "19020113" if magnetometer else "19020213",
        "0303280c" if accelerometer == "BMI160" else "0303a803",
        "13032800",
        *(("1504040e", "150306") if magnetometer else ()),
        "190701",
        "03020100",
        "13020100",
        *(("15020100",) if magnetometer else ()),
        "030101",
        "130101",
        *(("150101",) if magnetometer else ()),
        "19030800",
        "190101",
        "010101",
    ]
    return (*map(bytes.fromhex, texts), FAST_INTERVAL)


def buzz(duration_ms: int) -> bytes:
    """Return the command that runs the motor at full strength for some ms, at most 65535."""
    return struct.pack("<BBBHB", 0x08, 0x01, FULL_DUTY, duration_ms, 0)


def flash(color: tuple[int, int, int]) -> tuple[bytes, ...]:
    """Return commands of one flash in red, green, blue, 0 to 255 each."""
    patterns = [
        struct.pack("<BBBBBBHHHHHB", 0x02, 0x03, channel, 0x02, intensity, 0, 0, FLASH_MS, 0, FLASH_MS, 0, 1)
        for channel, place in _LED_CHANNELS
        if (intensity := round(color[place] * MAX_LED / 255))
    ]
    return (STOP_LED, *patterns, PLAY_LED) if patterns else (STOP_LED,)


def cue(feedback: Feedback) -> list[tuple[float, bytes]]:
    """Return commands that play `feedback`, each with the pause before it, s. The motor comes first."""
    commands = [(pause_s, buzz(duration_ms)) for pause_s, duration_ms in vibration_pulses(feedback.haptic_ms)]
    lights = () if feedback.color is None else flash(feedback.color)
    commands[1:1] = [(0.0, each) for each in lights]
    return commands
