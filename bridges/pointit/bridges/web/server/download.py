"""Download of the last minute as a file."""

import asyncio
import io

from starlette.requests import Request
from starlette.responses import Response

from pointit.bridges.web.model.recording import LastMinute, file_name
from pointit.bridges.web.server.responses import Pieces
from pointit.runtime.clock import Clock


class Downloads:
    """Writes recordings on request, one at a time."""

    def __init__(self, last_minute: LastMinute, site: str, clock: Clock) -> None:
        """Store the source of messages, and the site's name for the file."""
        self._last_minute = last_minute
        self._site = site
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
        """Return the name and the bytes of a recording, written in a thread."""
        now_ns = self._clock.now_ns()
        output = io.BytesIO()
        recording = self._last_minute.recording(self._site, now_ns)
        await asyncio.to_thread(recording.write, output)
        return file_name(self._site, now_ns), output.getvalue()
