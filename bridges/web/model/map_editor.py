"""The map in the plan editor of pages: read, checked and saved.

The page's process reads and writes the file at the path that `pui` has, so both run on one machine.

No core: it reads and writes a file.
"""

import asyncio
import contextlib
import dataclasses
import functools
import hashlib
import logging
from collections.abc import Callable, Generator, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, TypeVar

from pointit.bridges.web.model.site_model import shown_path, with_shown_path
from pointit.maps.edit import Edit, StaleMapError, edited, write_new
from pointit.maps.file import FOLDER, PACKAGE, SUFFIX, map_path, parse_map_file
from pointit.maps.model import MapFile
from pointit.runtime.bus.contract import Bus
from pointit.runtime.config.yaml_file import MAX_YAML_BYTES
from pointit.runtime.errors import PointItError, RefusedError
from pointit.runtime.host.state_file import read_limited, write_atomically
from pointit.runtime.host.threads import in_daemon_thread
from pointit.schemas import UseMap
from pointit.schemas.topics import USE_MAP, check_name

log = logging.getLogger(__name__)

T = TypeVar("T")

MAX_FINDINGS = 100
"""Maximum of findings in a reply."""


class MapEditor:
    """Reads, checks and saves the map that people point at."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._work = asyncio.Lock()
        """Held while a file is read or written: requests of several pages come one after the other."""

    async def read(self) -> dict[str, Any]:
        """Return the map that is in use.

        `path`: of its file; `shipped`: true if it comes with PointIt, so that only a copy can be saved;
        `digest`: of the file's content; `sections`: entries by section and name, in the words of the file;
        `findings`: `severity`, `where` and `text`, as of `pointit map check`.

        Raises:
            PointItError: If it cannot be read here.
        """
        return await self._run_in_thread(_read_file, await self._used_path())

    async def check(self, edits: Sequence[Edit], digest: str) -> dict[str, Any]:
        """Return the `findings` on the map after `edits`.

        Raises:
            PointItError: If the edits are impossible, or the file is not that of `digest` any more.
        """
        return await self._run_in_thread(_check_file, await self._used_path(), edits, digest)

    async def save(self, edits: Sequence[Edit], digest: str, name: str) -> dict[str, Any]:
        """Save the map after `edits`, as another file beside it if `name` is one, and have it used.

        Returns:
            That of `read`, and `message`.

        Raises:
            PointItError: If the edits are impossible, the file is not that of `digest` any more, a file
                `name` is there already, or it cannot be written. Then nothing is.
        """
        path = await self._run_in_thread(_save_file, await self._used_path(), edits, digest, name)
        log.info("a page has saved the map %s with %d edits", path, len(edits))
        shown = shown_path(path)
        message = f"saved as {shown}, and people point at it"
        if name:
            option = f"--set pui.map={shown}"
            if shown.startswith("…"):
                option = f"the path of {path.name} in --set pui.map"
            message += f"; from the next start on with {option}"

        # The file is saved from here on, even if the site cannot use it
        try:
            await self._bus.call(USE_MAP, UseMap(path=str(path)))
        except PointItError as error:
            reason = with_shown_path(str(error), path)
            message = f"saved as {shown}, but the site still uses the map as it was: {reason}"
        saved_map = await self._run_in_thread(_read_file, str(path))
        return {**saved_map, "message": message}

    async def _used_path(self) -> str:
        reply = await self._bus.call(USE_MAP, UseMap())
        return reply.path

    async def _run_in_thread(self, work: Callable[..., T], *arguments: Any) -> T:
        async with self._work:
            return await in_daemon_thread(functools.partial(work, *arguments), "map editor")


@contextlib.contextmanager
def _opened_file(name_or_path: str) -> Generator[tuple[Path, bytes]]:
    """Yield the path and content of a map."""
    with map_path(name_or_path) as path:
        try:
            yield path, read_limited(path, MAX_YAML_BYTES + 1)
        except FileNotFoundError as error:
            raise RefusedError(
                f"{path.name} is not on the machine of this page; open a page where `pui` runs"
            ) from error
        except PointItError as error:
            refusal = StaleMapError if isinstance(error, StaleMapError) else RefusedError
            raise refusal(with_shown_path(str(error), path)) from error


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _is_shipped(path: Path) -> bool:
    folder = files(PACKAGE).joinpath(FOLDER)
    return isinstance(folder, Path) and path.resolve().parent == folder.resolve()


def _examine(path: Path, read: Callable[[], MapFile]) -> tuple[str, list[dict[str, str]]]:
    """Return a map's contents in words, `""` if it cannot be read, and the first findings."""
    from pointit.maps.checks.check import examined  # noqa: PLC0415 - loads scipy, which most pages never need

    has, findings = examined(path.stem, path, read)
    return has, [dataclasses.asdict(finding) for finding in findings[:MAX_FINDINGS]]


def _read_file(name_or_path: str) -> dict[str, Any]:
    with _opened_file(name_or_path) as (path, content):
        file = parse_map_file(content, path)
        _, findings = _examine(path, lambda: file)
        return {
            "path": str(path),
            "shipped": _is_shipped(path),
            "digest": _digest(content),
            "sections": file.model_dump(mode="json", by_alias=True, exclude_unset=True),
            "findings": findings,
        }


def _edited_content(path: Path, content: bytes, edits: Sequence[Edit], digest: str) -> bytes:
    if _digest(content) != digest:
        raise StaleMapError(f"{path} was changed by somebody else since it was loaded here: load it again")
    return edited(content, edits, path)


def _check_file(name_or_path: str, edits: Sequence[Edit], digest: str) -> dict[str, Any]:
    with _opened_file(name_or_path) as (path, content):
        text = _edited_content(path, content, edits, digest)
        _, findings = _examine(path, lambda: parse_map_file(text, path))
        return {"findings": findings}


def _save_file(name_or_path: str, edits: Sequence[Edit], digest: str, name: str) -> Path:
    with _opened_file(name_or_path) as (path, content):
        text = _edited_content(path, content, edits, digest)
        is_shipped = _is_shipped(path)
        if is_shipped and not name:
            raise RefusedError(f"{path.stem} comes with PointIt and stays as it is: give your copy a name")

        # A copy stands beside the file, but never inside the package
        target = path
        if name:
            stem = name.removesuffix(SUFFIX)
            check_name(stem)
            folder = Path.cwd() if is_shipped else path.parent
            target = folder / f"{stem}{SUFFIX}"

        # It is written only if it can be read again
        has, findings = _examine(target, lambda: parse_map_file(text, target))
        if not has:
            raise RefusedError(f"not saved: {findings[0]['where']}: {findings[0]['text']}")
        if name:
            write_new(target, text)
        else:
            mode = target.stat().st_mode & 0o777
            write_atomically(target.resolve(), text, mode=mode)  # a link stays one
        return target
