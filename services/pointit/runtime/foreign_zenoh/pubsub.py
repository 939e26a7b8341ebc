# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownLambdaType=false
# (the stubs of zenoh leave return types out)
"""Samples and publishers of a plain session."""

from typing import Any

import zenoh
from zenoh import ext

from pointit.runtime.bus.contract import Declaration
from pointit.runtime.errors import BusClosedError
from pointit.runtime.zenoh.declarations import declare_publisher

HEARTBEAT_S = 0.5
"""Period (s) after which a reader notices that it lost the last message of a reliable, caching writer."""
MAX_ATTACHMENT_BYTES = 4096
"""Messages with a longer attachment are dropped."""


def bytes_of(data: zenoh.ZBytes | None) -> bytes | None:
    """Return the content of a payload or attachment."""
    return None if data is None else data.to_bytes()


def is_oversized(payload: zenoh.ZBytes | None, attachment: zenoh.ZBytes | None, max_bytes: int) -> bool:
    """Return True if a message exceeds the size limit. Its bytes are not copied."""
    return (payload is not None and len(payload) > max_bytes) or (
        attachment is not None and len(attachment) > MAX_ATTACHMENT_BYTES
    )


class RawSample:
    """A received sample; its bytes are copied when they are read."""

    __slots__ = ("_sample",)

    def __init__(self, sample: zenoh.Sample) -> None:
        self._sample = sample

    @property
    def key(self) -> str:
        """Return the key that it was put to."""
        return str(self._sample.key_expr)

    @property
    def payload(self) -> bytes:
        """Return its bytes."""
        return self._sample.payload.to_bytes()

    @property
    def attachment(self) -> bytes | None:
        """Return the bytes of its attachment, or None if it has none."""
        return bytes_of(self._sample.attachment)

    def is_oversized(self, max_bytes: int) -> bool:
        """Return True if it exceeds the size limit."""
        return is_oversized(self._sample.payload, self._sample.attachment, max_bytes)


class RawPublisher(Declaration):
    """Writes one key."""

    def __init__(self, session: zenoh.Session, key: str, cache_size: int, reliable: bool) -> None:  # noqa: FBT001
        missed = ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=HEARTBEAT_S) if reliable else None
        self._writer = declare_publisher(session, key, cache=cache_size, missed=missed)
        super().__init__(self._writer.undeclare)

    @property
    def is_read(self) -> bool:
        """Return True if Zenoh knows a reader in another session; a writer that keeps messages does not."""
        if self.is_closed or not isinstance(self._writer, zenoh.Publisher):
            return False
        status: Any = self._writer.matching_status  # no bool, whatever the stubs say: always true
        return bool(status.matching)

    def put(self, payload: bytes, attachment: bytes | None) -> None:
        """Send; returns at once.

        Raises:
            BusClosedError: this writer or its session is closed.
        """
        try:
            self._writer.put(payload, attachment=attachment)
        except zenoh.ZError as error:
            raise BusClosedError("the writer or its session was closed") from error
