"""Download of the last minute as an MCAP recording, for Foxglove and Lichtblick too."""

import asyncio
import io
from typing import IO

from starlette.requests import Request
from starlette.responses import Response

from pointit.bridges.web.playback.recent import Recent, RecentPast
from pointit.bridges.web.server.bundle import Pieces
from pointit.recording.head import make_head
from pointit.runtime.clock import Clock
from pointit.schemas import NS_PER_S
from pointit.schemas.topics import Delivery, Topic


def write_recording(past: RecentPast, since_ns: int, output: IO[bytes]) -> int:
    """Write what happened since `since_ns`, beginning with the states and presences of then.

    Slow: call it in a thread.

    Returns:
        the number of entries.
    """
    from pointit.recording.writer import RecordingWriter  # noqa: PLC0415 - 1 MB, for who downloads

    writer = RecordingWriter(output, make_head(past.site, since_ns))
    for entry in past.states_at(since_ns - 1):
        if not isinstance(entry.row, Topic) or entry.row.delivery is Delivery.STATE:
            writer.add(entry._replace(time_ns=since_ns))
    for entry in past.entries(since_ns - 1):
        writer.add(entry)
    writer.close()
    return writer.entries


def file_name(site: str, now_ns: int) -> str:
    """Return the file's name."""
    return f"pointit-{site}-{now_ns // NS_PER_S}.mcap"


class Downloads:
    """Writes recordings on request, one at a time."""

    def __init__(self, recent: Recent, window_s: float, clock: Clock) -> None:
        self._recent = recent
        self._window_ns = round(window_s * NS_PER_S)
        self._clock = clock
        self._writing: asyncio.Task[tuple[str, bytes]] | None = None

    async def answer(self, _request: Request) -> Response:
        """Return the last minute as a file. A request during writing gets that file."""
        if self._writing is None or self._writing.done():
            self._writing = asyncio.create_task(self._write(), name="web writes a recording")
        name, content = await asyncio.shield(self._writing)
        headers = {"Content-Disposition": f'attachment; filename="{name}"', "Cache-Control": "no-store"}
        return Pieces(content, headers=headers, media_type="application/octet-stream")

    def close(self) -> None:
        """Cancel the writing."""
        if self._writing is not None:
            self._writing.cancel()

    async def _write(self) -> tuple[str, bytes]:
        now_ns = self._clock.now_ns()
        output = io.BytesIO()
        past = self._recent.past(now_ns)
        await asyncio.to_thread(write_recording, past, max(past.began_ns, now_ns - self._window_ns), output)
        return file_name(past.site, now_ns), output.getvalue()
