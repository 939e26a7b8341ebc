"""Pages with a playback: websocket, position and requests of each, and a server of one recording.

No core: it waits for websockets.
"""

import asyncio
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from starlette.requests import Request
from starlette.responses import Response
from starlette.websockets import WebSocket

from pointit.bridges.web.config import WebConfig
from pointit.bridges.web.pages.latest_values import TokenBucket
from pointit.bridges.web.pages.page_session import Pages, PageSession
from pointit.bridges.web.playback.playback import Playback
from pointit.bridges.web.playback.recent import Past, Recent
from pointit.bridges.web.server import access as exposure_check
from pointit.bridges.web.server.access import Access
from pointit.bridges.web.server.app import application
from pointit.bridges.web.server.bundle import Bundle, refusal
from pointit.bridges.web.server.listener import HttpListener, open_port
from pointit.bridges.web.wire import Ack, AimAt, Answer, Ask, HeadsetMotion, Hello, Play, Playing, Role
from pointit.runtime.clock import Clock, wait_up_to
from pointit.runtime.host.extras import pointit_version
from pointit.schemas import NS_PER_S
from pointit.schemas.topics import Presence

if TYPE_CHECKING:
    from pointit.bridges.web.playback.file_past import FilePast

RATE_HZ = 60.0
"""Maximum rate of batches, Hz."""

SEEK_S = 0.2
"""Least time between two seeks, which cost some ms of a core, s."""

STATUS_S = 1.0
"""Interval of the status and, while a file is read, of the timeline, s."""

CANNOT_BE_CHANGED = "what has happened cannot be changed: this page shows the past"

JUST_S = 15.0
"""Distance of the first position from the end, s."""


class PastPage:
    """Serves one page until it leaves."""

    def __init__(
        self,
        socket: WebSocket,
        past: Past,
        *,
        version: str,
        start_s: float = 0.0,
        viewer_bucket: TokenBucket | None = None,
    ) -> None:
        """Prepare it.

        Args:
            socket: of the page, not yet accepted.
            past: what it shows.
            version: of PointIt.
            start_s: first position, s from the beginning.
            viewer_bucket: budget of all pages that may only look.
        """
        self._past = past
        self._now_s = asyncio.get_running_loop().time

        # To the session, this page is the host, and its playback the site
        self._playback = Playback(past, self._now_s())
        feed = self._playback.model.cache.open(RATE_HZ)
        self._session = PageSession("past", "viewer", socket, feed, self, viewer_bucket=viewer_bucket)
        self._hello = Hello(version=version, site=past.site, role="viewer", requests=(), deeds=())
        self._next_play = Play(is_playing=True, at_s=start_s)
        """Control not yet applied. Of several seeks, only the newest is."""
        self._wake_event = asyncio.Event()
        self._wake_event.set()

    async def run(self) -> None:
        """Serve the page until it leaves."""
        self._session.tell(self._past.timeline().model_dump_json())
        async with asyncio.TaskGroup() as group:
            playing = group.create_task(self._play(), name="playback")
            await self._session.run(self._hello.model_dump_json())
            playing.cancel()

    # Host of the session.

    def header(self) -> tuple[int, float]:
        """Return the position, ns, and the speed, 0 if it stands."""
        playback = self._playback
        at_ns = playback.at_ns(self._now_s())
        return at_ns, playback.speed if playback.is_playing else 0.0

    async def answer(self, ask: Ask, session: PageSession) -> Answer:  # noqa: ARG002 - the host's interface
        """Refuse it."""
        return Answer(id=ask.id, error=CANNOT_BE_CHANGED)

    def aim(self, aim: AimAt, session: PageSession) -> None:
        """Ignore it: no arm can be moved."""

    def move_by_headset(self, motion: HeadsetMotion, session: PageSession) -> None:
        """Ignore it: no arm can be moved."""

    def play(self, play: Play) -> None:
        """Store what the page asks for, which is applied in the next round. Earlier seeks are skipped."""
        changes = play.model_dump(exclude_none=True)
        self._next_play = self._next_play.model_copy(update=changes)
        self._wake_event.set()

    def shown(self, ack: Ack) -> None:
        """Ignore it: a playback has no latency."""

    def malformed(self, sentence: str) -> None:
        """Ignore it: the session closes a page that sends many."""

    # Time.

    async def _play(self) -> None:
        """Apply the page's controls and play, until cancelled."""
        reported_s = self._now_s()
        read_ns = -1
        sought_s = -math.inf
        while True:
            # Controls, but soon after a seek only those of the next rounds
            if self._wake_event.is_set() and self._now_s() - sought_s >= SEEK_S:
                self._wake_event.clear()
                if self._next_play.at_s is not None or self._next_play.step < 0:
                    sought_s = self._now_s()
                self._apply_next_play()

            was_playing = self._playback.is_playing
            self._playback.advance(self._now_s())
            if was_playing and not self._playback.is_playing:
                self._tell_position()
            self._session.wake()

            # The timeline grows while a file is read
            now_s = self._now_s()
            if now_s - reported_s >= STATUS_S:
                reported_s = now_s
                if read_ns != self._past.read_ns:
                    read_ns = self._past.read_ns
                    self._session.tell(self._past.timeline().model_dump_json())
                self._tell_status()

            await asyncio.sleep(1.0 / RATE_HZ)
            if not self._playback.is_playing:
                await wait_up_to(self._wake_event, STATUS_S)

    def _apply_next_play(self) -> None:
        play = self._next_play
        self._next_play = Play()
        playback = self._playback
        now_s = self._now_s()
        if play.at_s is not None:
            at_ns = self._past.began_ns + round(play.at_s * NS_PER_S)
            playback.seek(at_ns, now_s)
        playback.play(now_s, is_playing=play.is_playing, speed=play.speed)
        if play.step:
            playback.step(play.step, now_s)
        has_jumped = play.at_s is not None or play.step < 0
        self._tell_position(has_jumped=has_jumped)
        self._tell_status()

    def _tell_position(self, *, has_jumped: bool = False) -> None:
        playback = self._playback
        passed_s = (playback.at_ns(self._now_s()) - self._past.began_ns) / NS_PER_S
        playing = Playing(
            at_s=max(passed_s, 0.0),
            is_playing=playback.is_playing,
            speed=playback.speed,
            has_jumped=has_jumped,
        )
        self._session.tell(playing.model_dump_json())

    def _tell_status(self) -> None:
        self._session.tell_status(self._playback.status().model_dump_json())


@dataclass
class Visits:
    """Opens pages with a playback of `recent`."""

    recent: Recent
    pages: Pages
    clock: Clock
    version: str

    def remember(self, row: Presence, name: str, *, present: bool) -> None:
        """Keep a change of presence."""
        self.recent.add(self.clock.now_ns(), row, name, present, b"1" if present else b"")

    async def open(self, socket: WebSocket) -> None:
        """Serve a page until it leaves, unless there are too many pages."""
        if self.pages.is_full or self.pages.is_past_full:
            await self.pages.refuse(socket)
            return
        past = self.recent.past(self.clock.now_ns())
        start_s = max(past.timeline().length_s - JUST_S, 0.0)
        with self.pages.count_past_page():
            page = PastPage(
                socket,
                past,
                version=self.version,
                start_s=start_s,
                viewer_bucket=self.pages.viewer_bucket,
            )
            await page.run()


class RecordingServer:
    """Serves a recording at one address. Each page has its own position."""

    def __init__(self, past: "FilePast", config: WebConfig) -> None:
        """Bind the port of `config`, which has both tokens.

        Raises:
            ConfigError: If the page would be open to everyone.
            ListenError: If the port is taken.
        """
        exposure_check.check(config)
        self._past = past
        self._version = pointit_version()
        access = Access(config.operator_token, config.viewer_token)
        access.know_hosts([config.host])
        app = application(access, Bundle(), self._open, _no_download)
        listening_socket = open_port(config.host, config.port, "--port")
        self._listener = HttpListener(app, listening_socket)

    @property
    def port(self) -> int:
        """Return the port of the listener."""
        return self._listener.port

    async def start(self) -> None:
        """Accept pages."""
        await self._listener.start()

    async def run(self) -> None:
        """Read the recording and serve pages until cancelled."""
        try:
            await self._past.read()
            await asyncio.Event().wait()
        finally:
            await self._listener.close()

    async def _open(self, socket: WebSocket, role: Role) -> None:  # noqa: ARG002 - nobody controls a past
        await PastPage(socket, self._past, version=self._version).run()


async def _no_download(_request: Request) -> Response:
    return refusal(404, "Not here", "This page plays a recording: its file is on the machine that serves it.")
