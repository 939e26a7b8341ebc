"""The device's side of a wrist by Bluetooth Low Energy, whatever carries its bytes."""

from collections.abc import Iterable, Mapping
from typing import ClassVar, Literal

from pointit.plugins import Quaternion

Property = Literal["read", "write", "write-without-response", "notify"]
Sent = Iterable[tuple[str, bytes]]
"""Notifications: characteristic and bytes."""


class SimulatedWrist:
    """A wrist's characteristics, and its answers to what is written to them."""

    name: ClassVar[str]
    service: ClassVar[str]
    characteristics: ClassVar[Mapping[str, tuple[Property, ...]]]
    stream: ClassVar[str]
    """Characteristic of its readings."""

    def __init__(self) -> None:
        self.is_streaming = False
        """True if it sends readings."""
        self.values: dict[str, bytes] = {}
        """Values of characteristics that can be read."""

    def connected(self) -> None:
        """Begin a new connection."""

    def write(self, characteristic: str, data: bytes) -> Sent:
        """Return its answers to bytes that were written."""
        raise NotImplementedError

    def frame(self, orientation_xyzw: Quaternion) -> bytes:
        """Return the notification of one reading."""
        raise NotImplementedError
