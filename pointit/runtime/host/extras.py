"""Optional parts of PointIt: rooms that a build may lack, extras and the commands that install them."""

import functools
import importlib
import re
import sys
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.util import find_spec
from operator import attrgetter
from pathlib import Path
from types import ModuleType
from typing import Any, Generic, NamedTuple, TypeVar

from pointit.runtime.errors import ConfigError

T = TypeVar("T")

CHECKOUT = Path(__file__).parents[3]
"""Root of the checkout, if PointIt is installed from one."""

REQUIREMENT = re.compile(r"([\w.-]+).*?extra\s*==\s*['\"]([\w.-]+)['\"]")
"""Name and extra of a distribution's requirement (PEP 508)."""


class OptionalPart(NamedTuple, Generic[T]):
    """An object of an optional room: `MODULE:ATTRIBUTE`, and further packages that it needs."""

    target: str
    rooms: tuple[str, ...] = ()


def present(parts: Iterable[OptionalPart[T]]) -> list[T]:
    """Return those of `parts` whose packages are installed, in their order. Imports no others."""
    installed: list[T] = []
    for part in parts:
        module = part.target.partition(":")[0]
        if all(map(is_there, (module, *part.rooms))):
            installed.append(load_object(part.target, "a part"))
    return installed


def load_object(target: str, part: str) -> Any:
    """Return the object at `target`, `MODULE:ATTRIBUTE`, imported for `part`.

    Raises:
        ConfigError: If its module or package is not part of this build.
    """
    module, _, attribute = target.partition(":")
    return attrgetter(attribute)(import_room(module, part))


def is_there(room: str) -> bool:
    """Return True if the module or package `room` is part of this build. Does not import it."""
    try:
        return find_spec(room) is not None
    except ModuleNotFoundError:  # its parent package is also missing
        return False


def import_room(module: str, part: str) -> ModuleType:
    """Return `module`, imported for `part`.

    Raises:
        ConfigError: If it or its parent package is not part of this build.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if not f"{module}.".startswith(f"{error.name}."):
            raise
        raise ConfigError(f"{part} is not part of this build of PointIt: there is no {error.name}") from error


def has_extra(extra: str) -> bool:
    """Return True if the requirements of `extra` are installed; imports none of them."""
    for requirement in requires("pointit") or ():
        match = REQUIREMENT.match(requirement)
        if match is None or match[2] != extra:
            continue
        try:
            version(match[1])
        except PackageNotFoundError:
            return False
    return True


def remedy(extra: str) -> str:
    """Return the command that installs `extra`, or the package `lab`, in backticks: a script, else pip's."""
    if (CHECKOUT / "scripts" / "setup").is_file():
        return f"`scripts/setup {extra}` in the folder of PointIt"
    if extra == "lab":
        wheel = f"pointit_lab-{pointit_version()}-py3-none-any.whl"
        return f"`pip install {wheel}`; `scripts/wheel` makes this file in a checkout of PointIt"
    return f"`{_install_command(Path(sys.prefix))} 'pointit[{extra}]'`"


def _install_command(prefix: Path) -> str:
    """Return the command that installs into the environment at `prefix`: those of uv have no pip."""
    if "archive-v0" in prefix.parts:  # uv's cache, in which `uvx` runs programs
        return "uvx --from"
    if prefix.parts[-3:-1] == ("uv", "tools"):
        return "uv tool install"
    is_of_uv = find_spec("pip") is None and (prefix / "pyvenv.cfg").is_file()
    return "uv pip install" if is_of_uv else "pip install"


@functools.cache
def pointit_version() -> str:
    """Return the version of PointIt, or `""` if its sources run without being installed."""
    try:
        return version("pointit")
    except PackageNotFoundError:
        return ""
