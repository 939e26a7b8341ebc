"""A simulated wrist that can be within reach, and be connected to one program."""

from dataclasses import dataclass, field
from typing import Protocol

from pointit.testing.devices.wrists.wrist import SimulatedWrist


class Listener(Protocol):
    """A scan of the program."""

    def hear(self) -> None:
        """Hear the wrist, if it advertises."""
        ...


class Link(Protocol):
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
    listeners: set[Listener] = field(default_factory=set[Listener])
    link: Link | None = None
    received: bytearray = field(default_factory=bytearray)
    """Bytes from the program since it last connected."""
