"""Responses of the page's server: files of the built page, cached until the next build, and error pages."""

import gzip
import hashlib
import mimetypes
from dataclasses import dataclass
from html import escape
from pathlib import Path

from starlette.requests import Request
from starlette.responses import HTMLResponse, PlainTextResponse, RedirectResponse, Response
from starlette.types import Receive, Scope, Send

STATIC = Path(__file__).parents[1] / "static"
"""Output of `npm run build` in `client`."""

PLAIN_BYTES = 1024
"""Files below this size are not compressed."""

_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".txt": "text/plain; charset=utf-8",
    ".md": "text/markdown; charset=utf-8",
    ".svg": "image/svg+xml",
    ".webmanifest": "application/manifest+json",
}
"""Own table, since the system's may be anything."""

PIECE = 64 * 1024
"""Bytes of a response handed on at a time, which bounds memory for clients that do not read."""

REFUSED = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}: PointIt</title>
<link rel="icon" href="/static/icon.svg" type="image/svg+xml">
<link rel="stylesheet" href="/static/touch.css">
</head>
<body>
<header class="top"><img class="mark" src="/static/icon.svg" alt=""><p class="name">PointIt</p></header>
<main><h1>{title}</h1><p>{sentence}</p></main>
</body>
</html>
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class File:
    """A file as it is sent."""

    content: bytes
    compressed: bytes
    """Gzip data, or `b""` if the file is short."""
    etag: str
    media_type: str
    version: tuple[int, int]
    """Modification time and length, which reveal a change."""


class Bundle:
    """Files of one folder and its subfolders."""

    def __init__(self, folder: Path = STATIC) -> None:
        self._folder = folder
        self._files: dict[str, File] = {}

    def file(self, name: str) -> File | None:
        """Return the file called `name` (with slashes), or None if there is none or it may not be served."""
        parts = name.split("/")
        if not all(map(_is_served, parts)):
            return None
        path = self._folder.joinpath(*parts)
        try:
            stat = path.stat()
            version = (stat.st_mtime_ns, stat.st_size)
            known = self._files.get(name)
            if known is not None and known.version == version:
                return known
            # A link may lead out of the folder
            if not path.is_file() or not path.resolve().is_relative_to(self._folder.resolve()):
                return None
            content = path.read_bytes()
        except OSError:
            self._files.pop(name, None)
            return None
        file = _file(path, content, version)
        self._files[name] = file
        return file


def _is_served(part: str) -> bool:
    """Return True if a part of a path is neither hidden nor leads elsewhere."""
    if not part or part.startswith("."):
        return False
    return "\\" not in part and "\0" not in part


def _file(path: Path, content: bytes, version: tuple[int, int]) -> File:
    media_type = _TYPES.get(path.suffix)
    if not media_type:
        media_type, _ = mimetypes.guess_type(path.name)
    compressed = b""
    if len(content) > PLAIN_BYTES:
        compressed = gzip.compress(content, 6, mtime=0)
    digest = hashlib.sha256(content).hexdigest()
    return File(
        content=content,
        compressed=compressed if len(compressed) < len(content) else b"",
        etag=f'"{digest[:32]}"',
        media_type=media_type or "application/octet-stream",
        version=version,
    )


class Pieces(Response):
    """A response that may be long."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:  # noqa: ARG002 - ASGI
        """Send it piece by piece, each when the client has read most of those before."""
        await send({"type": "http.response.start", "status": self.status_code, "headers": self.raw_headers})
        body = memoryview(self.body)
        for start in range(0, max(len(body), 1), PIECE):
            piece = bytes(body[start : start + PIECE])
            more = start + PIECE < len(body)
            await send({"type": "http.response.body", "body": piece, "more_body": more})


def refusal(status: int, title: str, sentence: str) -> Response:
    """Return an error page of one sentence."""
    html = REFUSED.format(title=escape(title), sentence=escape(sentence))
    return HTMLResponse(html, status, headers={"Cache-Control": "no-store"})


def redirect_with_cookie(request: Request, path: str, cookie: str, secret: str, duration_s: int) -> Response:
    """Return a redirection to `path` of this site that stores `secret` in the browser's `cookie`."""
    response = RedirectResponse(path, 303, {"Cache-Control": "no-store"})
    response.set_cookie(
        cookie,
        secret,
        max_age=duration_s,
        httponly=True,
        secure=request.url.scheme == "https",
        samesite="lax",  # the QR code may have been scanned in another site's page
    )
    return response


def file_response(request: Request, bundle: Bundle, name: str) -> Response:
    """Return a file of the bundle, or status 304 if the browser has it already."""
    file = bundle.file(name)
    if file is None:
        if name == "index.html":
            return refusal(503, "The page is not built", "Build it: npm run build in bridges/web/client.")
        return PlainTextResponse("there is no such file", 404)
    headers = {"ETag": file.etag, "Cache-Control": "no-cache", "Vary": "Accept-Encoding"}
    if file.etag in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    content = file.content
    if file.compressed and "gzip" in request.headers.get("accept-encoding", ""):
        content = file.compressed
        headers["Content-Encoding"] = "gzip"
    return Pieces(content, headers=headers, media_type=file.media_type)
