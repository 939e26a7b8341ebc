"""Responses of the page's server: files of the bundle, and error pages of one sentence."""

from html import escape

from starlette.requests import Request
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.types import Receive, Scope, Send

from pointit.bridges.web.server.bundle import Bundle

PIECE = 64 * 1024
"""Bytes of a response handed on at a time, which bounds memory for clients that do not read."""

REFUSED = """<!doctype html><html lang="en"><meta charset="utf-8">
<meta name="viewport" content="width=device-width"><title>PointIt</title>
<h1>{title}</h1><p>{sentence}</p></html>
"""


class Pieces(Response):
    """A response that may be long."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:  # noqa: ARG002 - ASGI
        """Send it piece by piece, each when the client has read most of those before."""
        await send({"type": "http.response.start", "status": self.status_code, "headers": self.raw_headers})
        body = memoryview(self.body)
        for start in range(0, max(len(body), 1), PIECE):
            piece, more = bytes(body[start : start + PIECE]), start + PIECE < len(body)
            await send({"type": "http.response.body", "body": piece, "more_body": more})


def refusal(status: int, title: str, sentence: str) -> Response:
    """Return an error page of one sentence."""
    return HTMLResponse(
        REFUSED.format(title=escape(title), sentence=escape(sentence)),
        status,
        headers={"Cache-Control": "no-store"},
    )


def file_response(request: Request, bundle: Bundle, name: str) -> Response:
    """Return a file of the bundle, or status 304 if the browser has it already."""
    file = bundle.file(name)
    if file is None:
        if name == "index.html":
            return refusal(
                503, "The page is not built", "Build it: npm run build in bridges/pointit/bridges/web/client."
            )
        return PlainTextResponse("there is no such file", 404)
    headers = {"ETag": file.etag, "Cache-Control": "no-cache", "Vary": "Accept-Encoding"}
    if file.etag in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    content = file.content
    if file.compressed and "gzip" in request.headers.get("accept-encoding", ""):
        content, headers["Content-Encoding"] = file.compressed, "gzip"
    return Pieces(content, headers=headers, media_type=file.media_type)
