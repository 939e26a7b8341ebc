"""Phones as wrists: the page that a QR code opens, the connection of each phone, and its messages.

- `GET /phone?token=...` pairs: it sets a cookie of its own and leads to `/phone`, the page.
- `/ws/wrist`, text: `Turn` and `Ask` come in; `Hello` first, then `Answer`s and `Cue`s go out.
- `POST /wrist`: a JSON list of `Turn` and `Ask`; the answer is a list of what would have gone out since the
  post before. A post of an empty list is answered with `Hello` and the state first.

All want the phone's cookie. A phone may move the wrist of its person, be their button, and have them
localized (`phone_connection`); whatever name it asks for, its own person is meant.

No core: it waits for websockets.
"""

import asyncio
import contextlib
import logging
import time
from collections import deque
from collections.abc import Awaitable, Callable, Collection
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Field, TypeAdapter, ValidationError
from starlette.requests import ClientDisconnect, HTTPConnection, Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from pointit.bridges.web.pages.latest_values import TokenBucket
from pointit.bridges.web.server.bundle import Bundle, file_response, redirect_with_cookie, refusal
from pointit.bridges.web.wire import MAX_TOLD, REPLACED, UNPAIRED, Answer, Ask, Cue, Hello, Turn, WireModel
from pointit.bridges.web.wrists.pairing import Pairing, Phone
from pointit.bridges.web.wrists.wrist_control import WristControl
from pointit.runtime.service.plugin_guard import WarningSink
from pointit.schemas import (
    Announced,
    Feedback,
    Interaction,
    Localization,
    Understood,
    WristSample,
    summarize_validation_error,
)

log = logging.getLogger(__name__)

MAX_WAITING = 64
"""Maximum number of queued messages to a phone; the oldest are dropped."""

MAX_ASKS = 8
"""Maximum number of open requests of one phone."""

MAX_CUE_AGE_S = 2.0
"""Queued messages older than this (s) are not sent: late cues are useless."""

RATE_HZ = 240.0
"""Rate limit of a phone's messages in the long run, and `BURST` at once."""
BURST = 480.0

DROPPED_PAUSE_S = 0.05
"""Time for which a phone's socket is not read after a message beyond that, s."""

_message_adapter: TypeAdapter[Turn | Ask] = TypeAdapter(Annotated[Turn | Ask, Field(discriminator="kind")])

LOST = "another device moves your arm now: take it back when you want to"
RETURNED = "your arm does not follow this phone any more, it is your own again: take it when you want to"

STEPS = 20
"""Number of steps in which progress is sent."""

MAX_ITEMS = 64
"""Maximum number of items in a post."""

POST_PATIENCE_S = 0.1
"""A post waits this long (s) for the answers to its requests; later ones come with the next post."""

COOKIE_S = 12 * 3600

NOT_PAIRED = "This phone is not paired, or no longer: let the page show a new QR code and scan it."
CENTRED = "ahead is the middle of the room now"

_posted: TypeAdapter[list[dict[str, Any]]] = TypeAdapter(
    Annotated[list[dict[str, Any]], Field(max_length=MAX_ITEMS)]
)


@dataclass(frozen=True, kw_only=True)
class PhoneHost:
    """Functions of the service for phones."""

    wrists: WristControl
    now_ns: Callable[[], int]
    """The site's time."""
    send: Callable[[str, WristSample], None]
    """Publishes a sample of a person's wrist."""
    answer: Callable[[str, Ask], Awaitable[Answer]]
    """Handles a request of the phone with this page id, which names its person; raises a `PointItError` or
    `SchemaError` if it is refused."""
    changed: Callable[[], None]
    """Called when the holder of a wrist may have changed."""
    warnings: WarningSink
    """Warnings about malformed input."""
    greeting: Hello
    """Greeting of all phones: site and rights, without the person."""


class PhoneConnection:
    """Messages from and to one phone, from pairing to unpairing."""

    def __init__(self, phone: Phone, host: PhoneHost) -> None:
        self.phone = phone
        self._host = host
        self._bucket = TokenBucket(RATE_HZ, BURST)
        self._waiting: deque[tuple[float, str]] = deque(maxlen=MAX_WAITING)
        """Queued messages with their times."""
        self.woken = asyncio.Event()
        """Set while messages are queued."""
        self.asks: set[asyncio.Task[None]] = set()
        """Requests that are not answered yet."""
        self.malformed = 0
        """Number of malformed messages."""
        self.dropped = 0
        """Number of messages beyond `RATE_HZ`."""

    def put(self, part: WireModel) -> None:
        """Queue `part` for the phone."""
        self._waiting.append((time.monotonic(), part.model_dump_json()))
        self.woken.set()

    def clear(self) -> None:
        """Clear the queue: the phone reconnects."""
        self._waiting.clear()
        self._host.warnings.clear("phone", self.phone.user)

    def drain(self) -> list[str]:
        """Empty the queue, and return its messages as JSON, oldest first."""
        now_s = time.monotonic()
        fresh = [text for queued_s, text in self._waiting if now_s - queued_s <= MAX_CUE_AGE_S]
        self._waiting.clear()
        self.woken.clear()
        return fresh

    def hear(self, item: str | bytes | dict[str, Any]) -> WristSample | None:
        """Process a message, JSON or its object, and return its wrist sample, or None if it has none."""
        if not self._bucket.take(time.monotonic()):
            self.dropped += 1
            self._host.warnings.warn(
                "phone",
                f"the phone of {self.phone.user} sends more than {RATE_HZ:.0f} messages a second, "
                f"{self.dropped} were dropped in all; load its page again",
                self.phone.user,
            )
            return None
        try:
            if isinstance(item, dict):
                message = _message_adapter.validate_python(item)
            else:
                message = _message_adapter.validate_json(item)
        except ValidationError as error:
            self.on_malformed(summarize_validation_error(error))
            return None
        if isinstance(message, Turn):
            return self._process_turn(message)

        # A request is answered beside the samples, which must not wait for it
        if len(self.asks) >= MAX_ASKS:
            self.put(Answer(id=message.id, error="too much is asked at once: wait for the answers"))
            return None
        task = asyncio.create_task(
            self._answer_request(message), name=f"asked by the phone of {self.phone.user}"
        )
        self.asks.add(task)
        task.add_done_callback(self.asks.discard)
        return None

    def on_malformed(self, what: str) -> None:
        """Count a malformed message, and warn of it."""
        self.malformed += 1
        self._host.warnings.warn(
            "phone",
            f"the phone of {self.phone.user} has sent malformed messages ({what[:MAX_TOLD]}), "
            f"{self.malformed} such messages in all; load its page again",
            self.phone.user,
        )

    async def end(self) -> None:
        """Cancel open requests."""
        tasks = list(self.asks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    def _process_turn(self, turn: Turn) -> WristSample | None:
        phone = self.phone
        wrists = self._host.wrists
        holder_before = wrists.holder(phone.user)
        sample = wrists.turn(phone.user, phone.page, turn, self._host.now_ns())
        if wrists.holder(phone.user) != holder_before:
            self._host.changed()
        return sample

    async def _answer_request(self, ask: Ask) -> None:
        own = ask.model_copy(update={"name": self.phone.user})
        answer = await self._host.answer(self.phone.page, own)
        self.put(answer)


class PhoneCues:
    """One person's cues, and the current state for a phone that connects later."""

    def __init__(self) -> None:
        self._current = Cue()
        self._announcement: tuple[str, str, str] = ("idle", "", "")
        """Phase, target and reason of the last localization of which the person was told."""

    @property
    def current(self) -> Cue:
        """Return the state without chime and text."""
        return self._current

    def say(self, text: str) -> Cue:
        """Return `text` as a cue."""
        return self.current.model_copy(update={"text": text})

    def loss(self, *, is_own: bool = False) -> Cue:
        """Return the cue that the phone has lost the arm; `is_own`: to the person's own device."""
        cue = self.say(RETURNED if is_own else LOST)
        return cue.model_copy(update={"has_lost_arm": True})

    def feedback(self, feedback: Announced | Feedback | Understood) -> Cue | None:
        """Return a cue of the bus for the phone.

        None: an `Announced` has no name, and the phone knows already that names are spoken.
        """
        if isinstance(feedback, Announced):
            changed = self._update_state(has_names=True)
            if not feedback.label:
                return changed
            return self.current.model_copy(update={"announced": feedback.label})
        if isinstance(feedback, Understood):
            outcome = feedback.message or feedback.result
            return self.say(f'"{feedback.text}": {outcome}')
        cue = self.say(feedback.text)
        return cue.model_copy(update={"chime": feedback.chime, "haptic_ms": feedback.haptic_ms})

    def end_names(self) -> Cue | None:
        """Return the state in which no names are spoken, or None if it is unchanged."""
        return self._update_state(has_names=False)

    def interaction(self, interaction: Interaction) -> Cue | None:
        """Return the new state, or None if it is unchanged."""
        return self._update_state(
            state=interaction.state,
            next_step=interaction.next_step,
            press=interaction.press,
            wants_double=interaction.is_unsure,
            is_guided=interaction.is_guided,
            choices=interaction.choices,
        )

    def localization(self, localization: Localization) -> Cue | None:
        """Return changes for the person (target, progress, reason of a refusal), or None."""
        has_target = bool(localization.target_id) and not localization.ahead
        is_aiming = localization.phase == "sampling" and has_target
        progress = None
        if is_aiming:
            progress = round(STEPS * localization.progress) / STEPS
        changed = self._update_state(progress=progress)

        # A sentence once for each phase, target and reason
        announcement = (localization.phase, localization.target_id, localization.reason)
        if announcement == self._announcement:
            return changed
        self._announcement = announcement
        if is_aiming:
            sentence = f"point at {localization.target_id}"
            has_several_targets = localization.target_count > 1
            if has_several_targets and not localization.candidates:  # else that is the number of robots
                sentence += f", {localization.target_index + 1} of {localization.target_count}"
            return self.say(sentence)
        if localization.phase == "refused":
            return self.say(localization.reason)
        return changed

    def _update_state(self, **fields: Any) -> Cue | None:
        previous = self._current
        self._current = previous.model_copy(update=fields)
        return None if self._current == previous else self._current


class Phones:
    """Serves every paired phone."""

    def __init__(self, host: PhoneHost, pairing: Pairing, bundle: Bundle) -> None:
        self._host = host
        self._pairing = pairing
        self._bundle = bundle
        self._connections: dict[str, PhoneConnection] = {}
        """By page id."""
        self._sockets: dict[str, WebSocket] = {}
        """Open sockets by page id."""
        self._cues: dict[str, PhoneCues] = {}
        """By user."""
        self._lamps: tuple[str, ...] = ()

    @property
    def routes(self) -> list[BaseRoute]:
        """Return the routes for phones."""
        return [
            Route("/phone", self._open_page, methods=["GET"]),
            Route("/wrist", self._on_post, methods=["POST"]),
            WebSocketRoute("/ws/wrist", self._on_connect),
        ]

    def is_paired(self, connection: HTTPConnection) -> bool:
        """Return True if a request comes from a paired phone."""
        return self._phone(connection) is not None

    def paired_user(self, connection: HTTPConnection) -> str:
        """Return the person whose phone's link the browser of a request has opened, or `""`."""
        phone = self._phone(connection)
        return "" if phone is None else phone.user

    def feedback(self, user: str, feedback: Announced | Feedback | Understood) -> None:
        """Send a cue, a name to speak, or what became of their words, to the phone of `user`."""
        self._send_cue(user, self._cues_of(user).feedback(feedback))

    def interaction(self, user: str, interaction: Interaction) -> None:
        """Send the phone of `user` the state of the interaction."""
        self._send_cue(user, self._cues_of(user).interaction(interaction))

    def localization(self, user: str, progress: Localization) -> None:
        """Send the phone of `user` the target to point at."""
        self._send_cue(user, self._cues_of(user).localization(progress))

    def set_lamps(self, lamps: tuple[str, ...]) -> None:
        """Set the lamps of the map, whose names the phones show."""
        if lamps != self._lamps:
            self._lamps = lamps
            for connection in self._connections.values():
                connection.put(self._greeting_of(connection.phone))

    def lost(self, user: str, *, is_own: bool = False) -> None:
        """Notify the phone of `user` that it has lost the wrist; `is_own`: to the person's own device."""
        self._send_cue(user, self._cues_of(user).loss(is_own=is_own))

    def centred(self, user: str) -> None:
        """Notify the phone of `user` that its direction was set."""
        self._send_cue(user, self._cues_of(user).say(CENTRED))

    def end_names_except(self, users: Collection[str]) -> None:
        """Notify the phones of all but `users` that no selector announces names to them any more."""
        for user, cues in self._cues.items():
            if user not in users:
                self._send_cue(user, cues.end_names())

    def forget(self, user: str) -> None:
        """Forget the cues of a person who has left."""
        self._cues.pop(user, None)

    async def cut(self, page: str) -> None:
        """Close the connections of the unpaired phone with this page id; `""` is ignored."""
        connection = self._connections.pop(page, None)
        if connection is None:
            return
        connection.clear()
        self._host.wrists.close(page)
        await connection.end()
        socket = self._sockets.pop(page, None)
        if socket is not None:
            await _close(socket, UNPAIRED, "not paired any more")
        self._host.changed()

    async def close(self) -> None:
        """Close all connections."""
        for page in list(self._connections):
            await self.cut(page)

    async def _open_page(self, request: Request) -> Response:
        token = request.query_params.get("token")
        if token is None:
            if self._phone(request) is None:
                return refusal(403, "Not paired", NOT_PAIRED)
            return file_response(request, self._bundle, "phone.html")
        secret = self._pairing.redeem(token, time.monotonic())
        if secret is None:
            return refusal(403, "Not paired", NOT_PAIRED)
        self._host.changed()
        return redirect_with_cookie(request, "/phone", _cookie(request), secret, COOKIE_S)

    async def _on_post(self, request: Request) -> Response:
        phone = self._phone(request)
        if phone is None:
            return PlainTextResponse(NOT_PAIRED, 403)
        connection = self._connection_of(phone)
        try:
            items = _items(await request.body())
        except ClientDisconnect:
            return Response(status_code=400)
        if items is None:
            connection.on_malformed(f"a post is a JSON list of at most {MAX_ITEMS} objects")
            return PlainTextResponse("a list is expected", 400)
        if not items:
            self._send_greeting(connection)
        earlier_asks = set(connection.asks)
        sample = None
        for item in items:
            sample = connection.hear(item) or sample
        self._send_sample(phone, sample)  # only the newest orientation counts

        # Answers that come soon go out with this post
        new_asks = connection.asks - earlier_asks
        if new_asks:
            await asyncio.wait(new_asks, timeout=POST_PATIENCE_S)
        messages = ",".join(connection.drain())
        return Response(f"[{messages}]", media_type="application/json")

    async def _on_connect(self, socket: WebSocket) -> None:
        phone = self._phone(socket)
        if phone is None:
            await socket.send_denial_response(PlainTextResponse(NOT_PAIRED, 403))
            return
        await socket.accept()

        # This socket is stored first: the end of the replaced one must not release the wrist
        connection = self._connection_of(phone)
        replaced = self._sockets.get(phone.page)
        self._sockets[phone.page] = socket
        if replaced is not None:
            await _close(replaced, REPLACED, "opened again elsewhere")
        self._send_greeting(connection)
        self._host.changed()

        sender = asyncio.create_task(_send_queued(connection, socket), name=f"to the phone of {phone.user}")
        try:
            await self._receive_messages(connection, socket)
        finally:
            sender.cancel()
            await asyncio.gather(sender, return_exceptions=True)
            if self._sockets.get(phone.page) is socket:
                del self._sockets[phone.page]
                self._host.wrists.close(phone.page)
                self._host.changed()

    async def _receive_messages(self, connection: PhoneConnection, socket: WebSocket) -> None:
        """Receive until the socket ends, or is not the phone's any more."""
        while True:
            try:
                message = await socket.receive()
            except (WebSocketDisconnect, RuntimeError):  # RuntimeError: closed by this side
                return
            has_message = message["type"] == "websocket.receive"
            if not has_message or self._sockets.get(connection.phone.page) is not socket:
                return
            dropped = connection.dropped
            text = message.get("text") or message.get("bytes") or ""
            self._send_sample(connection.phone, connection.hear(text))
            if connection.dropped > dropped:
                # what waits pauses the transport, so that a flood is not even parsed
                await asyncio.sleep(DROPPED_PAUSE_S)

    def _send_sample(self, phone: Phone, sample: WristSample | None) -> None:
        if sample is not None:
            self._host.send(phone.user, sample)

    def _send_greeting(self, connection: PhoneConnection) -> None:
        connection.clear()
        connection.put(self._greeting_of(connection.phone))
        connection.put(self._cues_of(connection.phone.user).current)

    def _greeting_of(self, phone: Phone) -> Hello:
        return self._host.greeting.model_copy(update={"user": phone.user, "lamps": self._lamps})

    def _send_cue(self, user: str, cue: Cue | None) -> None:
        connection = self._connections.get(self._pairing.paired(user, time.monotonic()))
        if cue is not None and connection is not None:
            connection.put(cue)

    def _phone(self, connection: HTTPConnection) -> Phone | None:
        return self._pairing.phone(connection.cookies.get(_cookie(connection), ""))

    def _connection_of(self, phone: Phone) -> PhoneConnection:
        connection = self._connections.get(phone.page)
        if connection is None:
            connection = PhoneConnection(phone, self._host)
            self._connections[phone.page] = connection
        return connection

    def _cues_of(self, user: str) -> PhoneCues:
        return self._cues.setdefault(user, PhoneCues())


def _cookie(connection: HTTPConnection) -> str:
    port = connection.url.port
    return f"pointit-wrist-{port}" if port else "pointit-wrist"


def _items(body: bytes) -> list[dict[str, Any]] | None:
    """Return the objects of a post, or None if it is no list or too long."""
    try:
        return _posted.validate_json(body)
    except ValidationError:
        return None


async def _send_queued(connection: PhoneConnection, socket: WebSocket) -> None:
    """Send what is put on `connection` until cancelled, or until the phone is gone."""
    with contextlib.suppress(WebSocketDisconnect, RuntimeError, OSError):
        while True:
            await connection.woken.wait()
            for text in connection.drain():
                await socket.send_text(text)


async def _close(socket: WebSocket, code: int, reason: str) -> None:
    with contextlib.suppress(WebSocketDisconnect, RuntimeError, OSError):
        await socket.close(code, reason)
