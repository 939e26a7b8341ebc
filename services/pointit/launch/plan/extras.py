"""Optional dependencies of services: whether they are installed, and the error message if they are not."""

import importlib.metadata
import re
from typing import Any

from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import remedy
from pointit.services.registry import Process

NAME = re.compile(r"[\w.-]+")
EXTRA = re.compile(r"extra\s*==\s*['\"](?P<extra>[\w.-]+)['\"]")
"""Extra in the marker of a distribution's requirement (PEP 508)."""


def has_extra(extra: str) -> bool:
    """Return True if the requirements of `extra` are installed; imports none of them."""
    for requirement in importlib.metadata.requires("pointit") or ():
        named, of = NAME.match(requirement), EXTRA.search(requirement)
        if named is None or of is None or of["extra"] != extra:
            continue
        try:
            importlib.metadata.version(named[0])
        except importlib.metadata.PackageNotFoundError:
            return False
    return True


def load(row: Process) -> Any:
    """Return the service class of a row of the process table.

    Raises:
        ConfigError: If it needs an extra that is not installed.
    """
    try:
        return row.load()
    except ImportError as error:
        if not row.extra or (error.name or "").partition(".")[0] == "pointit":
            raise  # not a missing extra but a bug of ours
        raise ConfigError(f"{row.name} needs {remedy(row.extra)}") from error
