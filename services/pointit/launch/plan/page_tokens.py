"""The tokens of a site's pages, kept so that an open page comes back when what serves it is started again."""

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
"""Of a token: 144 bits, and an address that fits a line of 80 columns."""

FILE = "tokens.json"

MAX_BYTES = 4096

OTHERS = 0o077
"""Of a file's mode: what its group and everybody else may do."""


def _new() -> str:
    return secrets.token_urlsafe(TOKEN_BYTES)


@dataclass(frozen=True, kw_only=True)
class Tokens:
    """Who has the one may control, who has the other may look on; random unless given."""

    operator: str = field(default_factory=_new)
    viewer: str = field(default_factory=_new)


class _Kept(BaseModel):
    """What the file holds."""

    model_config = ConfigDict(strict=True, extra="forbid")

    operator: str = Field(min_length=22, max_length=64, pattern=r"^[\w-]+$")
    viewer: str = Field(min_length=22, max_length=64, pattern=r"^[\w-]+$")


def kept_tokens(site: str, *, renew: bool = False) -> tuple[Tokens, Sequence[str]]:
    """Return the tokens of the pages of `site`, the same at every start, and what is to be said of them.

    They are in a file of the site's state that nobody but its owner may read. Where there is none, or it
    cannot be trusted any more, it is made anew.

    Args:
        site: whose pages.
        renew: forget those that are kept, so that links from before open nothing.

    Raises:
        KeyNameError: `site` cannot be a name.
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
            notes.append(f"the page has a new link, the one from before opens nothing: {path} {why}")
    tokens = Tokens()
    try:
        write_atomically(
            path, (json.dumps({"operator": tokens.operator, "viewer": tokens.viewer}) + "\n").encode()
        )
    except ConfigError as error:
        notes.append(f"the link of the page is for this time only: {error}")
    return tokens, notes


def _read(path: Path) -> Tokens:
    """Return the tokens in a file.

    Raises:
        OSError: it cannot be read.
        ValueError: it cannot be trusted; says why, as what follows its name.
    """
    with path.open("rb") as file:
        status = os.fstat(file.fileno())
        if os.name == "posix" and status.st_mode & OTHERS:
            raise ValueError("could be read by others")
        if os.name == "posix" and status.st_uid != os.geteuid():
            raise ValueError("belongs to somebody else")
        data = file.read(MAX_BYTES)
    try:
        kept = _Kept.model_validate_json(data)
    except ValidationError:  # not told in detail: that would show what it holds
        raise ValueError("does not hold two tokens") from None
    if kept.operator == kept.viewer:
        raise ValueError("does not hold two tokens")
    return Tokens(operator=kept.operator, viewer=kept.viewer)
