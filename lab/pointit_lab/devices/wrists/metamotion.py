"""A MetaMotion board in software: it streams only after the whole configuration of its fusion."""

import struct
from collections.abc import Mapping
from typing import ClassVar, Literal

from pointit.plugins import Quaternion
from pointit_lab.devices.wrists.wrist import Property, Sent, SimulatedWrist

_COMMAND = "326a9001-85cb-9195-d9dd-464cfbbae75a"
_NOTIFY = "326a9006-85cb-9195-d9dd-464cfbbae75a"
_SERIAL_NUMBER = "00002a25-0000-1000-8000-00805f9b34fb"

_NEEDED = {
    "BMI160": (
        "1902",
        "0303280c",
        "13032800",
        "190701",
        "03020100",
        "13020100",
        "030101",
        "130101",
        "19030800",
    ),
    "BMI270": (
        "1902",
        "0303a803",
        "13032800",
        "190701",
        "03020100",
        "13020100",
        "030101",
        "130101",
        "19030800",
    ),
}
"""First bytes of the commands without which the fusion sends nothing."""
_NEEDED_WITH_MAGNETOMETER = ("1504040e", "150306", "15020100", "150101")
_REPLIES = {
    "BMI160": {"0380": "03800101", "1380": "13800001", "1980": "19800003", "118c": "118c633410"},
    "BMI270": {"0380": "03800401", "1380": "13800101", "1980": "19800003", "118c": "118c633410"},
}
"""Answers to reads: accelerometer, gyroscope, fusion, battery."""


class SimulatedMetaMotion(SimulatedWrist):
    """A board with one of both accelerometers. It keeps running when a connection ends."""

    name: ClassVar[str] = "MetaWear"
    service: ClassVar[str] = "326a9000-85cb-9195-d9dd-464cfbbae75a"
    characteristics: ClassVar[Mapping[str, tuple[Property, ...]]] = {
        _COMMAND: ("write", "write-without-response"),
        _NOTIFY: ("notify",),
        _SERIAL_NUMBER: ("read",),
    }
    stream: ClassVar[str] = _NOTIFY

    def __init__(self, chip: Literal["BMI160", "BMI270"] = "BMI160", serial_number: str = "05E1F2") -> None:
        super().__init__()
        self.values[_SERIAL_NUMBER] = serial_number.encode()
        self.commands: list[bytes] = []
        """Commands since the last restart, oldest first."""
        self.wants_reset = False
        """True if it streams only after a soft reset."""
        self.is_button_on = False
        self.resets = 0
        self._chip = chip
        self._done: set[str] = set()

    def write(self, characteristic: str, data: bytes) -> Sent:
        """Return its answers to a command."""
        if characteristic != _COMMAND:
            return
        self.commands.append(data)
        text = data.hex()

        # A read is answered; any other command changes the state. Only the fusion needs what was done before.
        reply = _REPLIES[self._chip].get(text)
        if reply is not None:
            yield _NOTIFY, bytes.fromhex(reply)
        elif text == "fe01":
            self.resets += 1
            self.restart()
            self.wants_reset = False
        elif text == "190101":
            self.is_streaming = not self.wants_reset and self._is_configured()
        elif text in ("190100", "190700"):
            self.is_streaming = False
            self._done.clear()
        elif data[:2] == b"\x01\x01":
            self.is_button_on = data[2:] == b"\1"
        self._done.add(text)

    def restart(self) -> None:
        """Forget everything, as when the battery was empty."""
        self.is_streaming = self.is_button_on = False
        self._done.clear()
        self.commands.clear()

    def button(self, *, is_down: bool) -> Sent:
        """Return the notification of a change of its button, none if the program has not asked for it."""
        if not self.is_button_on:
            return []
        return [(_NOTIFY, bytes((0x01, 0x01, is_down)))]

    def frame(self, orientation_xyzw: Quaternion) -> bytes:
        """Return the notification of one quaternion."""
        x, y, z, w = orientation_xyzw
        return b"\x19\x07" + struct.pack("<4f", w, x, y, z)

    def _is_configured(self) -> bool:
        needed = [*_NEEDED[self._chip]]
        if "19020113" in self._done:
            needed += _NEEDED_WITH_MAGNETOMETER
        return all(self._has_done(prefix) for prefix in needed)

    def _has_done(self, prefix: str) -> bool:
        return any(command.startswith(prefix) for command in self._done)
