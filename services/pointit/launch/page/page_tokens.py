"""The stored tokens of a site's pages, with which an open page reconnects after its service restarts."""

import json
import os
import secrets
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pointit.launch.plan.launches import PAGE
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.atomic_file import write_atomically
from pointit.runtime.host.state_file import site_folder

TOKEN_BYTES = 18
"""Length of a token: 144 bits, and the URL fits a line of 80 columns."""
FILE = "tokens.json"
MAX_BYTES = 4096
OTHERS = 0o077
"""Mode bits of a file for its group and others."""


def _new() -> str:
    return secrets.token_urlsafe(TOKEN_BYTES)


@dataclass(frozen=True, kw_only=True)
class Tokens:
    """Tokens for control and for viewing; random unless given."""

    operator: str = field(default_factory=_new)
    viewer: str = field(default_factory=_new)


class _StoredTokens(BaseModel):
    model_config = ConfigDict(strict=True, extra="forbid")

    operator: str = Field(min_length=22, max_length=64, pattern=r"^[\w-]+$")
    viewer: str = Field(min_length=22, max_length=64, pattern=r"^[\w-]+$")


def stored_tokens(site: str, *, renew: bool = False) -> tuple[Tokens, Sequence[str]]:
    """Return the tokens of the pages of `site`, the same at every start, and notices about them.

    They are in a file of the site's state that only its owner may read. A missing or untrusted file is
    replaced by one with new tokens.

    `renew`: replace the stored tokens, which revokes earlier links.

    Raises:
        KeyNameError: If `site` is not a valid name.
    """
    path = site_folder(site, PAGE) / FILE
    notes: list[str] = []
    if not renew:
        try:
            return _read(path), ()
        except FileNotFoundError:
            pass
        except (OSError, ValueError) as error:
            why = error.strerror or str(error) if isinstance(error, OSError) else str(error)
            notes.append(f"the page has a new link, the old one is revoked: {path} {why}")
    tokens = Tokens()
    try:
        text = json.dumps({"operator": tokens.operator, "viewer": tokens.viewer})
        write_atomically(path, f"{text}\n".encode())
    except ConfigError as error:
        notes.append(f"the link of the page is valid for this run only: {error}")
    return tokens, notes


def _read(path: Path) -> Tokens:
    """Return the tokens in the file at `path`.

    Raises:
        OSError: If it cannot be read.
        ValueError: If it cannot be trusted. The message continues a sentence that starts with the path.
    """
    with path.open("rb") as file:
        status = os.fstat(file.fileno())
        if os.name == "posix" and status.st_mode & OTHERS:
            raise ValueError("could be read by others")
        if os.name == "posix" and status.st_uid != os.geteuid():
            raise ValueError("belongs to another user")
        data = file.read(MAX_BYTES)
    try:
        stored = _StoredTokens.model_validate_json(data)
    except ValidationError:  # its details would reveal the contents
        raise ValueError("does not hold two tokens") from None
    if stored.operator == stored.viewer:
        raise ValueError("does not hold two tokens")
    return Tokens(operator=stored.operator, viewer=stored.viewer)
