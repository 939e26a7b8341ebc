"""Phones as wrists: the page that a QR code opens, its socket, and the posts of browsers that refuse one.

- `GET /phone?token=...` pairs: it sets a cookie of its own and leads to `/phone`, the page.
- `/ws/wrist`, text: `Turn` and `Ask` come in; `Hello` first, then `Answer`s and `Cue`s go out.
- `POST /wrist`: a JSON list of `Turn` and `Ask`; the answer is a list of what would have gone out since the
  post before. A post of an empty list is answered with `Hello` and the state first.

Both want the cookie and the server's own origin. A phone may move the wrist of its person, be their button,
and have them localized: `DEEDS` and `REQUESTS` below; whatever name it asks for, its own person is meant.
"""

import asyncio
import contextlib
import json
from collections import deque
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, TypeAdapter, ValidationError
from starlette.requests import ClientDisconnect, HTTPConnection, Request
from starlette.responses import FileResponse, PlainTextResponse, RedirectResponse, Response
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from pointit.bridges.web.cues import Cues
from pointit.bridges.web.pace import Bucket
from pointit.bridges.web.pairing import Pairing, Phone
from pointit.bridges.web.wire import Answer, Ask, Cue, Deed, Hello, Part, Turn
from pointit.bridges.web.wrists import Wrists
from pointit.runtime.health import Warnings
from pointit.schemas import Feedback, Interaction, Localization, WristSample, explain
from pointit.schemas.topics import CANCEL_LOCALIZATION, START_LOCALIZATION

DEEDS: tuple[Deed, ...] = ("press", "take", "give", "centre")
REQUESTS: tuple[str, ...] = (START_LOCALIZATION.key, CANCEL_LOCALIZATION.key)

CENTRED = "ahead is the middle of the room now"

MOST_BODY = 16 * 1024
MOST_ITEMS = 64
"""Of one post."""
MOST_WAITING = 64
"""Messages that wait for a phone; the oldest give way."""
MOST_ASKS = 8
"""That one phone may have open."""
FRESH_S = 2.0
"""Cues older than this are not told any more."""
POST_PATIENCE_S = 0.1
"""A post waits so long for the answers to what it asks; later ones come with the next."""
RATE_HZ = 240.0
"""What a phone may say in a second in the long run, and `BURST` at once."""
BURST = 480.0

_COOKIE_S = 12 * 3600
_REFUSED = 4403
_REPLACED = 4409

_heard: TypeAdapter[Turn | Ask] = TypeAdapter(Annotated[Turn | Ask, Field(discriminator="kind")])


@dataclass(slots=True)
class _Line:
    """What goes to one paired phone, whichever way it comes for it."""

    bucket: Bucket
    waiting: deque[tuple[float, str]] = field(default_factory=lambda: deque(maxlen=MOST_WAITING))
    """With the time of each."""
    woken: asyncio.Event = field(default_factory=asyncio.Event)
    asks: set[asyncio.Task[None]] = field(default_factory=set[asyncio.Task[None]])
    socket: WebSocket | None = None

    def put(self, part: Part, now_s: float) -> None:
        self.waiting.append((now_s, part.model_dump_json()))
        self.woken.set()

    def drain(self, now_s: float) -> list[str]:
        self.woken.clear()
        fresh = [text for when_s, text in self.waiting if now_s - when_s <= FRESH_S]
        self.waiting.clear()
        return fresh


class Phones:
    """Serves every paired phone."""

    def __init__(
        self,
        wrists: Wrists,
        pairing: Pairing,
        *,
        now_ns: Callable[[], int],
        send: Callable[[str, WristSample], None],
        answer: Callable[[str, str, Ask], Awaitable[Answer]],
        changed: Callable[[], None],
        warnings: Warnings,
        version: str,
        site: str,
        page: Path,
    ) -> None:
        """Begin without a phone.

        Args:
            wrists: who has which.
            pairing: which phones there are.
            now_ns: the site's time.
            send: publishes a sample of a person's wrist.
            answer: does what the phone with this page id asks for this person; it is among `DEEDS` and
                `REQUESTS` and has the person's name; does not raise.
            changed: is told when who moves what may have changed.
            warnings: where malformed input shows.
            version: of PointIt.
            site: its name.
            page: the file of the phone's page.
        """
        self._wrists = wrists
        self._pairing = pairing
        self._now_ns = now_ns
        self._send = send
        self._answer = answer
        self._changed = changed
        self._warnings = warnings
        self._version, self._site = version, site
        self._page = page
        self._lines: dict[str, _Line] = {}
        """By page id."""
        self._cues: dict[str, Cues] = {}
        """By user."""
        self.malformed = 0
        """Messages of phones that could not be understood."""
        self.dropped = 0
        """Messages beyond `RATE_HZ`."""

    @property
    def routes(self) -> list[BaseRoute]:
        """Return what the application serves for phones."""
        return [
            Route("/phone", self._open),
            Route("/wrist", self._post, methods=["POST"]),
            WebSocketRoute("/ws/wrist", self._connect),
        ]

    # What the bus says.

    def feedback(self, user: str, feedback: Feedback) -> None:
        """Let the phone of `user` chime and vibrate."""
        self._tell(user, self._cues_of(user).feedback(feedback))

    def interaction(self, user: str, interaction: Interaction) -> None:
        """Tell the phone of `user` what is next."""
        self._tell(user, self._cues_of(user).interaction(interaction))

    def localization(self, user: str, progress: Localization) -> None:
        """Tell the phone of `user` where to point."""
        self._tell(user, self._cues_of(user).localization(progress))

    def lost(self, user: str, page: str) -> None:
        """Tell the phone `page` of `user` that somebody else moves the arm."""
        if page in self._lines:
            self._lines[page].put(
                self._cues_of(user).say("somebody else moves your arm now; tap to take it back"), _now_s()
            )

    def forget(self, user: str) -> None:
        """Forget what was said to a person who is gone."""
        self._cues.pop(user, None)

    async def cut(self, page: str) -> None:
        """End what a phone has open that is not paired any more; an empty id is nobody's."""
        line = self._lines.pop(page, None)
        self._wrists.close(page)
        if line is None:
            return
        await _end(line.asks)
        if line.socket is not None:
            await _close(line.socket, _REFUSED, "not paired any more")
        self._changed()

    async def close(self) -> None:
        """End everything."""
        for page in list(self._lines):
            await self.cut(page)

    # What phones say.

    async def _open(self, request: Request) -> Response:
        token = request.query_params.get("token")
        if token is not None:
            secret = self._pairing.redeem(token, _now_s())
            if secret is None:
                return _not_paired()
            self._changed()
            response = RedirectResponse("/phone", status_code=303)
            response.set_cookie(
                _cookie(request),
                secret,
                max_age=_COOKIE_S,
                httponly=True,
                secure=request.url.scheme == "https",
                samesite="lax",  # the camera's app, which has read the QR code, is another site
            )
            return response
        if self._paired(request) is None:
            return _not_paired()
        return FileResponse(self._page, headers={"Cache-Control": "no-store"})

    async def _post(self, request: Request) -> Response:
        phone = self._paired(request)
        if phone is None or not _is_own(request):
            return _not_paired()
        line = self._line(phone)
        try:
            body = await _body(request)
        except ClientDisconnect:
            return Response(status_code=400)
        items = _items(body)
        if items is None:
            self._complain(
                phone, f"a post is a JSON list of at most {MOST_ITEMS} objects and {MOST_BODY} bytes"
            )
            return Response(status_code=400)
        if not items:
            line.waiting.clear()
            self._greet(phone, line)
        before = set(line.asks)
        sample: WristSample | None = None
        for item in items:
            sample = self._hear(phone, line, item) or sample
        if sample is not None:  # of several the newest: nobody wants to know where the arm has been
            self._send(phone.user, sample)
        if asked := line.asks - before:
            await asyncio.wait(asked, timeout=POST_PATIENCE_S)
        return Response(f"[{','.join(line.drain(_now_s()))}]", media_type="application/json")

    async def _connect(self, socket: WebSocket) -> None:
        phone = self._paired(socket)
        if phone is None or not _is_own(socket):
            await socket.close(_REFUSED)
            return
        await socket.accept()
        line = self._line(phone)
        if line.socket is not None:
            await _close(line.socket, _REPLACED, "opened again elsewhere")
        line.socket = socket
        line.waiting.clear()
        self._greet(phone, line)
        self._changed()
        sender = asyncio.create_task(_drain(line, socket), name=f"to the phone of {phone.user}")
        try:
            await self._listen(phone, line, socket)
        finally:
            await _end({sender})
            if line.socket is socket:
                line.socket = None
                self._wrists.close(phone.page)
                self._changed()

    async def _listen(self, phone: Phone, line: _Line, socket: WebSocket) -> None:
        while True:
            try:
                message = await socket.receive()
            except (WebSocketDisconnect, RuntimeError):  # it was closed, from there or from here
                return
            if message["type"] != "websocket.receive":
                return
            if self._lines.get(phone.page) is not line:
                return
            sample = self._hear(phone, line, message.get("text") or message.get("bytes") or "")
            if sample is not None:
                self._send(phone.user, sample)

    def _hear(self, phone: Phone, line: _Line, item: str | bytes | dict[str, Any]) -> WristSample | None:
        """Take one message; return the sample that it makes."""
        if not line.bucket.take(_now_s()):
            self.dropped += 1
            return None
        try:
            said = _heard.validate_python(item) if isinstance(item, dict) else _heard.validate_json(item)
        except (ValidationError, RecursionError) as error:
            self._complain(
                phone, explain(error) if isinstance(error, ValidationError) else "nested too deeply"
            )
            return None
        if isinstance(said, Turn):
            before = self._wrists.holder(phone.user)
            sample = self._wrists.turn(phone.user, phone.page, said, self._now_ns())
            if self._wrists.holder(phone.user) != before:
                self._changed()
            return sample
        if len(line.asks) >= MOST_ASKS:
            line.put(Answer(id=said.id, error="too much is asked at once: wait for the answers"), _now_s())
            return None
        task = asyncio.create_task(self._ask(phone, line, said), name=f"asked by the phone of {phone.user}")
        line.asks.add(task)
        task.add_done_callback(line.asks.discard)
        return None

    async def _ask(self, phone: Phone, line: _Line, ask: Ask) -> None:
        if (ask.deed not in DEEDS) if ask.deed is not None else (ask.key not in REQUESTS):
            line.put(Answer(id=ask.id, error=f"a phone cannot ask for {ask.deed or ask.key!r}"), _now_s())
            return
        answer = await self._answer(phone.page, phone.user, ask.model_copy(update={"name": phone.user}))
        line.put(answer, _now_s())
        if ask.deed == "centre" and not answer.error:
            line.put(self._cues_of(phone.user).say(CENTRED), _now_s())

    # Underneath.

    def _greet(self, phone: Phone, line: _Line) -> None:
        self._warnings.clear(f"phone of {phone.user}")
        hello = Hello(
            version=self._version,
            site=self._site,
            role="wrist",
            requests=REQUESTS,
            deeds=DEEDS,
            user=phone.user,
        )
        line.put(hello, _now_s())
        line.put(self._cues_of(phone.user).current, _now_s())

    def _tell(self, user: str, cue: Cue | None) -> None:
        page = self._pairing.paired(user, _now_s())
        if cue is not None and page in self._lines:
            self._lines[page].put(cue, _now_s())

    def _complain(self, phone: Phone, what: str) -> None:
        self.malformed += 1
        self._warnings.warn(
            f"phone of {phone.user}",
            f"the phone of {phone.user} has sent what cannot be understood ({what}), "
            f"{self.malformed} such messages in all; load its page again",
        )

    def _paired(self, connection: HTTPConnection) -> Phone | None:
        return self._pairing.phone(connection.cookies.get(_cookie(connection), ""))

    def _line(self, phone: Phone) -> _Line:
        return self._lines.setdefault(phone.page, _Line(Bucket(RATE_HZ, BURST)))

    def _cues_of(self, user: str) -> Cues:
        return self._cues.setdefault(user, Cues())


def _now_s() -> float:
    """Return the loop's time, by which people and their phones live, whatever the site's is."""
    return asyncio.get_running_loop().time()


def _scheme(connection: HTTPConnection) -> str:
    return "https" if connection.url.scheme in ("https", "wss") else "http"


def _is_own(connection: HTTPConnection) -> bool:
    """Return whether a page of this very server says it."""
    own = f"{_scheme(connection)}://{connection.headers.get('host', '')}"
    return connection.headers.get("origin", "").lower() == own.lower()


def _cookie(connection: HTTPConnection) -> str:
    """Return the cookie's name: browsers keep those of all ports of a host together."""
    port = connection.url.port
    return f"pointit-wrist-{port}" if port else "pointit-wrist"


def _not_paired() -> Response:
    return PlainTextResponse(
        "this phone is not paired, or not any more: have the page show a new QR code and scan it", 403
    )


async def _body(request: Request) -> bytes | None:
    """Return what was posted, or none where it is too long."""
    body = b""
    async for part in request.stream():
        body += part
        if len(body) > MOST_BODY:
            return None
    return body


def _items(body: bytes | None) -> list[dict[str, Any]] | None:
    try:
        found = json.loads(body or b"")
    except (ValueError, RecursionError):
        return None
    if not isinstance(found, list) or len(found) > MOST_ITEMS:  # pyright: ignore[reportUnknownArgumentType] - JSON
        return None
    return found if all(isinstance(item, dict) for item in found) else None  # pyright: ignore[reportUnknownVariableType, reportUnknownArgumentType] - JSON


async def _drain(line: _Line, socket: WebSocket) -> None:
    """Send what is put on `line` until cancelled, or until the phone is gone."""
    with contextlib.suppress(WebSocketDisconnect, RuntimeError, OSError):
        while True:
            await line.woken.wait()
            for text in line.drain(_now_s()):
                await socket.send_text(text)


async def _close(socket: WebSocket, code: int, reason: str) -> None:
    with contextlib.suppress(WebSocketDisconnect, RuntimeError, OSError):
        await socket.close(code, reason)


async def _end(tasks: set[asyncio.Task[None]]) -> None:
    for task in list(tasks):
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
