"""A simulated wrist by Bluetooth Low Energy: the device's side, whatever carries its bytes."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Literal, Protocol

from pointit.plugins import Quaternion

Property = Literal["read", "write", "write-without-response", "notify"]

Sent = Iterable[tuple[str, bytes]]
"""Notifications: characteristic and bytes."""


class SimulatedWrist:
    """A wrist's characteristics, and its answers to what is written to them."""

    name: ClassVar[str]
    service: ClassVar[str]
    advertised_service: ClassVar[str] = ""
    """Service in its advertisements, if it is another one."""
    manufacturer_data: ClassVar[Mapping[int, bytes]] = {}
    """Data in its advertisements by the number of the company."""
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


class WristListener(Protocol):
    """A scan of the program."""

    def hear(self) -> None:
        """Hear the wrist, if it advertises."""
        ...


class WristLink(Protocol):
    """The program's end of a connection."""

    def notify(self, characteristic: str, data: bytes) -> None:
        """Pass on a notification."""
        ...

    def lose(self) -> None:
        """Lose the connection."""
        ...


@dataclass
class Peripheral:
    """A wrist with an address."""

    wrist: SimulatedWrist
    address: str
    is_there: bool = False
    listeners: set[WristListener] = field(default_factory=set[WristListener])
    link: WristLink | None = None
    received: bytearray = field(default_factory=bytearray)
    """Bytes from the program since it last connected."""
