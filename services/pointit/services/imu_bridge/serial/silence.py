"""A connected serial device that sends nothing readable."""

from pointit.services.imu_bridge.streams.quoted_data import quoted

SHOWN_BYTES = 32
"""Number of first bytes in the warning."""


class SilenceWatch:
    """Detects that nothing readable arrives."""

    def __init__(self, port: str, timeout_s: float, now_s: float) -> None:
        self._port = port
        self._timeout_s = timeout_s
        self._received_s = now_s
        self._good = 0
        self._first = b""
        self._silent = False
        self.received_bytes = 0
        """Number of bytes since the last readable ones."""

    def step(self, data: bytes, good: int, now_s: float, tried: str) -> str | None:
        """Return the warning when silence begins, `""` when it ends, else None.

        Args:
            data: that has arrived.
            good: number of readable packets or lines so far.
            now_s: time of the clock of the first `now_s`, s.
            tried: formats and speeds that were tried.
        """
        self.received_bytes += len(data)
        if len(self._first) < SHOWN_BYTES:
            self._first = (self._first + data)[:SHOWN_BYTES]
        if good != self._good:
            self._good = good
            self._received_s, self.received_bytes, self._first = now_s, 0, b""
            if self._silent:
                self._silent = False
                return ""
        elif not self._silent and now_s - self._received_s > self._timeout_s:
            self._silent = True
            return self._message(tried)
        return None

    def _message(self, tried: str) -> str:
        where = f"{self._port} is connected but sent nothing readable for {self._timeout_s:g} s"
        if not self.received_bytes:
            return f"{where}, not one byte: check the cable and that the device sends"
        return (
            f"{where}: {self.received_bytes} bytes, the first {quoted(self._first)}; {tried}; check baud and "
            "format, or what the device sends"
        )
