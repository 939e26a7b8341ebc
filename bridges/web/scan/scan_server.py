"""Access to the scan, and the paths of its page.

- `GET /scan` opens the page: for operators by their cookie, and for a phone that was paired for it, with
  `?token=...` from a QR code, or is a person's wrist while a scan is open: from an operator's first message
  until the page is left, or nobody uses it for 30 minutes. Wrists begin a scan only within 30 minutes of an
  operator's last message, so that none of them keeps it open.
- `POST /scan`: see `wire`. `GET /scan/map.yaml`: the map of what is known.
- `GET /scan/room` and `/scan/lights`: what a simulated camera sees, if the configuration has one.

No core: it waits for a websocket.
"""

import asyncio
import math
import time
from collections.abc import Callable, Mapping

from pydantic import BaseModel, ValidationError
from starlette.requests import HTTPConnection, Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import BaseRoute, Route

from pointit.bridges.web.scan import wire
from pointit.bridges.web.scan.session import ScanSession
from pointit.bridges.web.scan.simulated_room import SimulatedRoom
from pointit.bridges.web.server.access import Access
from pointit.bridges.web.server.app import info_of
from pointit.bridges.web.server.bundle import Bundle, file_response, redirect_with_cookie, refusal
from pointit.bridges.web.wrists.pairing import Pairing
from pointit.runtime.clock import wait_up_to
from pointit.runtime.errors import PointItError
from pointit.schemas import summarize_validation_error

COOKIE_S = 2 * 3600
OPEN_S = 30 * 60.0
"""Time for which a scan is open after its last message or the pairing of a phone, s."""
CAMERA = "camera"
"""Name under which the one phone is paired that maps the room."""
LIGHTS_S = 1.0
"""A request for lights waits this long (s) for their next change."""
CLOSED = (
    "Nobody has opened a scan, or this phone is not paired: press Map this room in the operator's page, or "
    "start `pointit map scan`, and scan the QR code that is shown."
)


class ScanServer:
    """Serves the page that maps the room."""

    def __init__(
        self,
        session: ScanSession,
        access: Access,
        bundle: Bundle,
        *,
        is_wrist: Callable[[HTTPConnection], bool],
        token: str = "",
        room: SimulatedRoom | None = None,
    ) -> None:
        """Create it.

        Args:
            session: the scan.
            access: access of operators.
            bundle: files of the page.
            is_wrist: returns True for requests of phones that are paired as wrists.
            token: pairs phones for the scan from the start. `""`: none does, and no scan is open.
            room: what a simulated camera sees, None: there is none.
        """
        self._session = session
        self._access = access
        self._bundle = bundle
        self._is_wrist = is_wrist
        self._pairing = Pairing()
        self._room = room
        self._lit: dict[str, str] = {}
        """Colours of all lights in hexadecimal digits, by strip or lamp, and their number so far."""
        self._lit_seq = 0
        self._changed = asyncio.Event()

        # Three times, so that a wrist that goes on scanning cannot begin another scan for ever
        open_until_s = math.inf if token else 0.0
        self._begin_until_s = open_until_s
        """Time until which wrists may begin a scan."""
        self._open_until_s = open_until_s
        """Time until which wrists may scan."""
        self._paired_until_s = open_until_s
        """Time until which the phone that was paired for it may scan."""
        if token:
            self._pairing.pair(CAMERA, time.monotonic(), token)

    @property
    def routes(self) -> list[BaseRoute]:
        """Return the routes for pages that map the room."""
        routes: list[BaseRoute] = [
            Route("/scan", self._open_scan, methods=["GET"]),
            Route("/scan", self._on_message, methods=["POST"]),
            Route("/scan/map.yaml", self._download_map, methods=["GET"]),
        ]
        if self._room is not None:
            routes.append(Route("/scan/room", self._see_room, methods=["GET"]))
            routes.append(Route("/scan/lights", self._see_lights, methods=["GET"]))
        return routes

    def pair(self) -> str:
        """Open a scan, and return a token for a phone. It replaces the phone paired before."""
        now_s = time.monotonic()
        until_s = now_s + OPEN_S
        self._begin_until_s = until_s
        self._open_until_s = until_s
        self._paired_until_s = until_s
        token, _ = self._pairing.pair(CAMERA, now_s)
        return token

    def lights(self, colors: Mapping[str, bytes]) -> None:
        """Show colours of the LED driver to the simulated camera: RGB of each pixel, by strip or lamp."""
        if self._room is not None:
            self._lit.update({name: rgb.hex() for name, rgb in colors.items()})
            self._lit_seq += 1
            self._changed.set()

    async def _open_scan(self, request: Request) -> Response:
        token = request.query_params.get("token")
        if token is not None:
            secret = self._pairing.redeem(token, time.monotonic())
            if secret is None:
                return refusal(403, "Not paired", CLOSED)
            return redirect_with_cookie(request, "/scan", _cookie(request), secret, COOKIE_S)
        if not self._is_admitted(request):
            return refusal(403, "Not paired", CLOSED)
        return file_response(request, self._bundle, "scan.html")

    async def _on_message(self, request: Request) -> Response:
        if not self._is_admitted(request):
            return PlainTextResponse(CLOSED, 403)
        session = self._session
        may_begin = self._extend_times(request)
        try:
            message = wire.SCAN_MESSAGE.validate_json(await request.body())
            match message:
                case wire.ScanLight():
                    if message.colors is None:  # the page is left
                        self._begin_until_s = 0.0
                        self._open_until_s = 0.0
                    await session.light(message)
                    return Response(status_code=204)
                case wire.ScanSave():
                    await asyncio.to_thread(session.save, message)
                case wire.ScanBegin() if not may_begin:
                    return PlainTextResponse(CLOSED, 403)
                case _:
                    session.take(message)
        except ValidationError as error:
            return PlainTextResponse(f"malformed: {summarize_validation_error(error)}", 400)
        except PointItError as error:
            return PlainTextResponse(str(error), 409)
        # The page draws the state: of its own message, and of what the solver has found meanwhile
        return _json(session.state(is_simulated=self._room is not None))

    def _extend_times(self, request: Request) -> bool:
        """Keep the scan open for the sender of `request`. Return True if they may begin one."""
        now_s = time.monotonic()
        if self._is_operator(request):
            until_s = max(self._open_until_s, now_s + OPEN_S)
            self._begin_until_s = until_s
            self._open_until_s = until_s
            return True
        if self._is_paired(request):
            self._paired_until_s = max(self._paired_until_s, now_s + OPEN_S)
            return True
        may_begin = now_s < self._begin_until_s
        self._open_until_s = now_s + OPEN_S
        return may_begin

    async def _download_map(self, request: Request) -> Response:
        if not self._is_admitted(request):
            return PlainTextResponse(CLOSED, 403)
        try:
            text = self._session.map_text(request.query_params.get("origin", ""))
        except PointItError as error:
            return PlainTextResponse(str(error), 409)
        headers = {"Content-Disposition": 'attachment; filename="room.yaml"', "Cache-Control": "no-store"}
        return Response(text, headers=headers, media_type="application/yaml")

    async def _see_room(self, request: Request) -> Response:
        if self._room is None or not self._is_admitted(request):
            return PlainTextResponse(CLOSED, 403)
        return _json(self._room.seen)

    async def _see_lights(self, request: Request) -> Response:
        if not self._is_admitted(request):
            return PlainTextResponse(CLOSED, 403)
        if str(self._lit_seq) == request.query_params.get("after"):
            self._changed.clear()
            await wait_up_to(self._changed, LIGHTS_S)
        return JSONResponse({"seq": self._lit_seq, "strips": self._lit})

    def _is_admitted(self, request: Request) -> bool:
        now_s = time.monotonic()
        if self._is_operator(request):
            return True
        if self._is_paired(request):
            return now_s < self._paired_until_s
        return now_s < self._open_until_s and self._is_wrist(request)

    def _is_paired(self, request: Request) -> bool:
        return self._pairing.phone(request.cookies.get(_cookie(request), "")) is not None

    def _is_operator(self, request: Request) -> bool:
        return self._access.admit(info_of(request), time.monotonic()) == "operator"


def _cookie(connection: HTTPConnection) -> str:
    return f"pointit-scan-{connection.url.port or ''}"


def _json(model: BaseModel) -> Response:
    return Response(
        model.model_dump_json(), headers={"Cache-Control": "no-store"}, media_type="application/json"
    )
