"""A watch with the Touch SDK app in software: it asks for approval, streams, and ends connections."""

import struct
from collections.abc import Mapping
from typing import ClassVar, Literal

from pointit.geometry.rotation import inverse, rotate
from pointit.plugins import Quaternion
from pointit_lab.devices.wrists.wrist import Property, Sent, SimulatedWrist

Hand = Literal["right", "left"]

_OUTPUT = "f9d60371-5325-4c64-b874-a68c7c555bad"
_INPUT = "f9d60372-5325-4c64-b874-a68c7c555bad"
DISCONNECT = bytes.fromhex("320101")
"""Message with the signal that ends a connection."""
PERIOD_MS = 20
BEGAN_MS = 1_800_000_000_000
"""Unix time of the watch at its start, ms."""


class SimulatedTouchSdkWatch(SimulatedWrist):
    """A watch whose clock goes on by one period with each message."""

    name: ClassVar[str] = "Galaxy Watch6 (A1B2)"
    service: ClassVar[str] = "f9d60370-5325-4c64-b874-a68c7c555bad"
    advertised_service: ClassVar[str] = "008e74d0-7bb3-4ac5-8baf-e5e372cced76"
    manufacturer_data: ClassVar[Mapping[int, bytes]] = {0xFFFF: b"a1b2"}
    characteristics: ClassVar[Mapping[str, tuple[Property, ...]]] = {
        _OUTPUT: ("read", "notify"),
        _INPUT: ("write",),
    }
    stream: ClassVar[str] = _OUTPUT

    def __init__(
        self,
        approval: Literal["given", "pending", "declined"] = "given",
        hand: Hand | None = None,
        battery_percent: int = 74,
    ) -> None:
        super().__init__()
        self.approval = approval
        self.inputs: list[bytes] = []
        """Messages of the program, oldest first."""
        self.unix_ms = BEGAN_MS
        self.describe(hand, battery_percent)

    def describe(self, hand: Hand | None, battery_percent: int) -> None:
        """Set what a read returns: the description and one frame at rest."""
        info = b""
        if hand is not None:
            info += bytes((0x08, 1 if hand == "right" else 2))
        if battery_percent:
            info += bytes((0x48, battery_percent))
        screen = struct.pack("<BfBf", 0x0D, 454.0, 0x15, 454.0)
        info += bytes((0x5A, len(screen))) + screen
        frame = self.frame((0.0, 0.0, 0.0, 1.0))
        description = bytes((0x4A, len(info))) + info
        self.values[_OUTPUT] = frame + description

    def connected(self) -> None:
        """Stream nothing until the program has introduced itself."""
        self.is_streaming = False

    def write(self, characteristic: str, data: bytes) -> Sent:
        """Note an input. An introduction is approved, declined, or waits."""
        if characteristic != _INPUT:
            return
        self.inputs.append(data)
        if data[:1] != b"\x12":
            return
        if self.approval == "declined":
            yield _OUTPUT, DISCONNECT
        elif self.approval == "given":
            self.is_streaming = True

    def approve(self) -> None:
        """Confirm the connection, as the person does on the screen."""
        self.approval = "given"
        self.is_streaming = True

    def frame(self, orientation_xyzw: Quaternion) -> bytes:
        """Return the next message: one frame at rest, and the time."""
        x, y, z, w = orientation_xyzw
        up = rotate(inverse(orientation_xyzw), (0.0, 0.0, 9.80665))
        self.unix_ms += PERIOD_MS
        up_numbers = _numbers(*up)

        # Protocol Buffers: within part 1 are the frame's parts 2 to 5; the times 7 and 8 follow it.
        frame = b"\x0a\x00"
        frame += _part(2, up_numbers)
        frame += _part(3, up_numbers)
        frame += _part(4, _numbers(w, x, y, z))
        frame += bytes((0x28, PERIOD_MS))
        times = bytes((0x38, PERIOD_MS, 0x40)) + _varint(self.unix_ms)
        return _part(1, frame) + times


def _part(number: int, content: bytes) -> bytes:
    key = number << 3 | 2
    return bytes((key, len(content))) + content


def _numbers(*values: float) -> bytes:
    fields = b""
    for number, value in enumerate(values, 1):
        if value != 0.0:  # Protocol Buffers leave zeros out
            key = number << 3 | 5
            fields += struct.pack("<Bf", key, value)

    return fields


def _varint(value: int) -> bytes:
    pieces = bytearray()
    while value > 0x7F:
        pieces.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes((*pieces, value))
