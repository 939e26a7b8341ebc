"""The built page's files, cached in memory and read again after a build."""

import gzip
import hashlib
import mimetypes
from dataclasses import dataclass
from pathlib import Path

STATIC = Path(__file__).parents[1] / "static"
"""Output of `npm run build` in `client`."""

MAX_BYTES = 8 * 1024 * 1024
"""Maximum size of a served file."""

MAX_FILES = 256
"""Maximum number of cached files. On case-insensitive file systems one file has many names."""

PLAIN_BYTES = 1024
"""Files below this size are not compressed."""

_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".txt": "text/plain; charset=utf-8",
    ".svg": "image/svg+xml",
    ".webmanifest": "application/manifest+json",
}
"""Own table, since the system's may be anything."""


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
        """Begin with an empty cache."""
        self._folder = folder
        self._files: dict[str, File] = {}

    def file(self, name: str) -> File | None:
        """Return the file called `name` (with slashes), or None if there is none or it may not be served."""
        parts = name.split("/")
        if any(part in ("", "..") or part.startswith(".") or "\\" in part or "\0" in part for part in parts):
            return None
        path = self._folder.joinpath(*parts)
        try:
            stat = path.stat()
            version = (stat.st_mtime_ns, stat.st_size)
            known = self._files.get(name)
            if known is not None and known.version == version:
                return known
            if not path.is_file() or stat.st_size > MAX_BYTES:
                return None
            if not path.resolve().is_relative_to(self._folder.resolve()):
                return None
            content = path.read_bytes()
        except OSError:
            self._files.pop(name, None)
            return None
        if len(self._files) >= MAX_FILES:
            self._files.clear()
        file = self._files[name] = _file(path, content, version)
        return file


def _file(path: Path, content: bytes, version: tuple[int, int]) -> File:
    media_type = _TYPES.get(path.suffix) or mimetypes.guess_type(path.name)[0] or "application/octet-stream"
    compressed = gzip.compress(content, 6, mtime=0) if len(content) > PLAIN_BYTES else b""
    return File(
        content=content,
        compressed=compressed if len(compressed) < len(content) else b"",
        etag=f'"{hashlib.sha256(content).hexdigest()[:32]}"',
        media_type=media_type,
        version=version,
    )
