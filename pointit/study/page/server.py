"""Server of the pages of a study: two links, each with a token of its own, and their websockets."""

import asyncio
import contextlib
import json
import logging
import time
from collections.abc import AsyncGenerator
from dataclasses import replace
from pathlib import Path

from starlette.applications import Starlette
from starlette.requests import HTTPConnection, Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp
from starlette.websockets import WebSocket, WebSocketDisconnect

from pointit.bridges.web.config import WebConfig
from pointit.bridges.web.server.access import Access, new_token
from pointit.bridges.web.server.app import SecurityMiddleware, info_of
from pointit.bridges.web.server.bundle import Bundle, Pieces, file_response, refusal
from pointit.bridges.web.server.lan import Lan
from pointit.bridges.web.server.listener import HttpListener, open_port, url
from pointit.study.page.view import Page, PageView

log = logging.getLogger(__name__)

STATIC = Path(__file__).parent / "static"
HOST = "127.0.0.1"
MAX_PAGES = 8
"""Maximum number of open pages of a kind; a further one is refused."""
END_S = 1.0
"""Time in which open pages receive the last content, s."""
REFUSED = "Open a link that `pointit study run` has printed; each run has links of its own."


@contextlib.asynccontextmanager
async def served(view: PageView, *, lan: bool = False) -> AsyncGenerator[tuple[str, str]]:
    """Serve the pages of `view` on this machine, or in the local network by HTTPS.

    Yields:
        The participant's link, then the experimenter's.

    Raises:
        PointItError: If there is no free port, or no local network.
    """
    tokens: dict[Page, str] = {"participant": new_token(), "experimenter": new_token()}
    access = Access(tokens["experimenter"], tokens["participant"])
    app = _application(view, access)
    async with contextlib.AsyncExitStack() as stack:
        if lan:
            network = Lan(WebConfig(), "study", app)
            stack.push_async_callback(network.close)
            base = await network.open()
            access.know_hosts([network.address])
            if network.note:
                log.warning("%s", network.note)
        else:
            listener = HttpListener(app, open_port(HOST, 0, "--page"))
            stack.push_async_callback(listener.close)
            await listener.start()
            base = url("http", HOST, listener.port)
        yield f"{base}/{tokens['participant']}/", f"{base}/{tokens['experimenter']}/"
        if view.is_over:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(END_S):
                    while any(view.pages.values()):
                        await view.changed.wait()


def _application(view: PageView, access: Access) -> ASGIApp:
    own = Bundle(STATIC)
    shared = Bundle()

    def page_of(connection: HTTPConnection) -> Page | None:
        info = replace(info_of(connection), bearer=connection.path_params["token"], cookies={})
        role = access.admit(info, time.monotonic())
        return None if role is None else "experimenter" if role == "operator" else "participant"

    async def index(request: Request) -> Response:
        page = page_of(request)
        if page is None:
            return refusal(403, "This page needs a link", REFUSED)
        return file_response(request, own, f"{page}.html")

    async def static(request: Request) -> Response:
        name = request.path_params["name"]
        return file_response(request, own if own.file(name) else shared, name)

    async def image(request: Request) -> Response:
        number: int = request.path_params["number"]
        if page_of(request) is None or number >= len(view.pictures):
            return PlainTextResponse("there is no such picture", 404)
        picture = view.pictures[number]
        return Pieces(picture.content, media_type=picture.media_type, headers={"Cache-Control": "no-store"})

    async def socket(connection: WebSocket) -> None:
        page = page_of(connection)
        if page is None:
            await connection.send_denial_response(PlainTextResponse(REFUSED, 403))
        elif view.pages[page] >= MAX_PAGES:
            await connection.send_denial_response(PlainTextResponse("too many pages are open", 503))
        else:
            await _serve(view, page, connection)

    routes = [
        Route("/static/{name}", static, methods=["GET"]),
        Route("/{token}/", index, methods=["GET"]),
        Route("/{token}/image/{number:int}", image, methods=["GET"]),
        WebSocketRoute("/{token}/ws", socket),
    ]
    return SecurityMiddleware(Starlette(routes=routes), access)


async def _serve(view: PageView, page: Page, socket: WebSocket) -> None:
    """Show a page the newest content and obey its messages until it goes or the study ends."""
    await socket.accept()
    view.pages[page] += 1
    view.change()
    sending = asyncio.create_task(_send(view, page, socket), name=f"{page}'s page")
    try:
        while (message := await socket.receive())["type"] != "websocket.disconnect":
            if problem := view.hear(page, message.get("text") or ""):
                await socket.send_text(json.dumps({"problem": problem}))
    except WebSocketDisconnect:
        pass
    finally:
        sending.cancel()
        view.pages[page] -= 1
        view.change()


async def _send(view: PageView, page: Page, socket: WebSocket) -> None:
    sent = ""
    with contextlib.suppress(WebSocketDisconnect):
        while True:
            changed, text = view.changed, json.dumps(view.content(page))
            if text != sent:
                await socket.send_text(text)
                sent = text
            if view.is_over:
                await socket.close()
                return
            await changed.wait()
