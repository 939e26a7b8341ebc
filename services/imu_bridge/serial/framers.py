"""Framers: bytes of a serial board to readings.

They are pure. Whatever bytes they are fed, they do not raise, buffer at most one packet, and do not spin.
"""

import re
from abc import ABC, abstractmethod
from collections import deque
from typing import ClassVar, Final

from pointit.schemas import Feedback
from pointit.services.imu_bridge.sources import Item
from pointit.services.imu_bridge.streams import PassedOver

QUATERNION: Final = 0
EULER: Final = 1
RAW: Final = 2
"""Kinds of orientations that one device may send side by side, from the best to the worst."""
RESET_TIMEOUTS = 16
"""Number of packets without a better kind after which a worse one is used."""
MAX_COMMANDS = 16
FLASH_S = 0.3
"""Duration of a cue on a device with a lamp, s."""

G_MPS2 = 9.80665


class SerialFramer(ABC):
    """Converts bytes of a device to items."""

    UNIT: ClassVar[str] = "bytes"
    """Unit of `bad`."""
    HINT: ClassVar[str] = "check cable and baud"
    """Action against unreadable data, for a warning."""
    MISSING: ClassVar[str] = "let the device send an orientation"
    """Action if all that arrives is passed over, for a warning."""

    def __init__(self) -> None:
        self.good: int = 0
        """Number of valid packets or lines so far."""
        self.bad: int = 0
        """Number of unreadable lines or bytes after the first valid one. The owner may set it back to 0."""
        self.reason: str = ""
        """Error of the last of them."""
        self.passed_over = PassedOver()
        """Valid messages without anything that is read."""
        self.commands: deque[bytes] = deque(maxlen=MAX_COMMANDS)
        """Commands to the device, to be sent one after another with a pause between them."""
        self.notice: str = ""
        """Message about what `commands` change, or `""`."""
        self.ran_on: bool = False
        """True if a counter showed after the last silence that the device had not been restarted."""

    @abstractmethod
    def feed(self, data: bytes, stamp_ns: int) -> list[Item]:
        """Return the items in the packets that `data`, arrived at `stamp_ns`, completes."""

    def on_silence(self) -> None:
        """Record a pause in the readings, after which the device may have been restarted."""
        self.ran_on = False

    def cue(self, cue: Feedback) -> tuple[bytes, bytes]:  # noqa: ARG002 - most devices have no signal
        """Return the commands that begin and end the signal for `cue`, empty if the device has none."""
        return b"", b""


class PacketCutter:
    """Cuts packets of a fixed length out of a stream, by header and checksum.

    After a wrong checksum it goes on with the next byte, since the header also occurs within packets.
    """

    def __init__(self, header: bytes, length: int, summed_from: int) -> None:
        r"""Set the regular expression of the header, also as far as it is complete at the end (`\Z`).

        Args:
            header: regular expression.
            length: of a packet, bytes.
            summed_from: index of the first byte that counts in the checksum, which is the last byte and the
                sum of all between, modulo 256.
        """
        self._header = re.compile(header, re.DOTALL)
        self._length = length
        self._summed_from = summed_from
        self._rest = b""
        self.skipped = 0
        """Number of bytes so far that belong to no packet."""

    def feed(self, data: bytes) -> list[bytes]:
        """Return the packets that `data` completes."""
        stream = self._rest + data
        packets: list[bytes] = []
        at = taken = 0
        while (match := self._header.search(stream, at)) is not None:
            at = match.start()
            packet = stream[at : at + self._length]
            if len(packet) < self._length:
                break
            if sum(packet[self._summed_from : -1]) & 0xFF == packet[-1]:
                packets.append(packet)
                at += self._length
                taken += self._length
            else:
                at += 1
        else:
            at = len(stream)
        self.skipped += at - taken
        self._rest = stream[at:]
        return packets


class Preference:
    """Selects the best of several kinds of orientations that a device sends side by side."""

    def __init__(self) -> None:
        self._ages = [0] * (RAW + 1)

    def accepts(self, kind: int) -> bool:
        """Return True if a packet of `kind`, which has just arrived, is to be used."""
        self._ages = [age + 1 for age in self._ages]
        self._ages[kind] = 0
        return all(age > RESET_TIMEOUTS for age in self._ages[:kind])
