"""Optional dependencies of PointIt: whether they are installed."""

import importlib.metadata
import re

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
