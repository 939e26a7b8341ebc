"""The audit of assistants: each call of a tool, with its caller and its result, in a file."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pointit.assistants.results import MAX_SENTENCE, plain
from pointit.errors import ConfigError, PointItError
from pointit.runtime.host.state_file import site_folder
from pointit.runtime.machine import this_machine
from pointit.schemas.text import system_reason

FOLDER = "assistants"
FILE = "audit.jsonl"
OLDER = "audit.old.jsonl"
MAX_BYTES = 4 * 1024 * 1024
"""Size at which a file becomes the older one, which replaces the one before."""


class AuditFile:
    """Appends one JSON object a line. Only its owner may read the file."""

    def __init__(self, folder: Path) -> None:
        """Write nothing yet."""
        self._path = folder / FILE

    def begin(self, caller: str, role: str, tool: str, arguments: dict[str, Any]) -> str:
        """Record that a tool is called, before it has an effect. Return an id of the call.

        Raises:
            PointItError: If the file cannot be written. Then nothing may be done.
        """
        call = this_machine().random_name(4)  # several processes may write the same file
        text = json.dumps(arguments, default=str, ensure_ascii=False)
        shown = plain(text, MAX_SENTENCE)
        self._append(call=call, caller=plain(caller), role=role, tool=tool, arguments=shown)
        return call

    def end(self, call: str, outcome: str, text: str = "") -> None:
        """Record the outcome of a call: done, refused, cancelled or failed.

        Raises:
            PointItError: If the file cannot be written.
        """
        self._append(call=call, outcome=outcome, text=plain(text, MAX_SENTENCE))

    def _append(self, **fields: Any) -> None:
        line = json.dumps({"stamp_ns": this_machine().now_ns(), **fields}, ensure_ascii=False)
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            if self._path.exists() and self._path.stat().st_size > MAX_BYTES:
                self._path.replace(self._path.with_name(OLDER))
            self._path.touch(mode=0o600)
            with self._path.open("a+b") as file:
                file.seek(max(0, file.tell() - 1))
                is_cut_off = file.read() not in (b"", b"\n")  # a record begins a line
                file.write(b"\n" * is_cut_off + line.encode() + b"\n")
        except OSError as error:
            raise PointItError(
                f"the audit cannot be written, so nothing is done: {system_reason(error)}; make room, or "
                f"see who may write {self._path}"
            ) from error


def read_audit(site: str) -> Iterator[dict[str, Any]]:
    """Yield the records of assistants on `site`, oldest first. A damaged line is left out.

    Raises:
        ConfigError: If there are none.
    """
    folder = site_folder(site, FOLDER)
    paths = [path for path in (folder / OLDER, folder / FILE) if path.exists()]
    if not paths:
        raise ConfigError(f"{folder / FILE}: there is none; no assistant has asked site {site} from here")
    for path in paths:
        for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
            try:
                record = json.loads(line)
            except ValueError:
                continue
            if isinstance(record, dict):
                yield record
