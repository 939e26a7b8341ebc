"""Optional parts of PointIt: rooms that a build may lack, extras and the commands that install them."""

import functools
import importlib
import re
import shlex
import sys
from collections.abc import Iterable, Sequence
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
    """Return the command that installs `extra`, or the package `lab`, in backticks: a script, else pip's.

    A command names the packages of an extra and never `pointit`: no index has that name, so whoever took it
    there would be installed.
    """
    if (CHECKOUT / "scripts" / "setup").is_file():
        return f"`scripts/setup {extra}` in the folder of PointIt"
    prefix = Path(sys.prefix)
    if extra == "lab":
        wheel = f"pointit_lab-{pointit_version()}-py3-none-any.whl"
        command = _install_command(prefix, [wheel])
        return f"{command}; `scripts/wheel` makes this file in a checkout of PointIt"
    return _install_command(prefix, missing_packages(extra))


def missing_packages(extra: str) -> list[str]:
    """Return the requirements of `extra` that are not installed, such as `aiomqtt>=2.3`, or else all."""
    wanted: list[str] = []
    missing: list[str] = []
    for requirement in requires("pointit") or ():
        match = REQUIREMENT.match(requirement)
        if match is None or match[2] != extra:
            continue
        package = requirement.partition(";")[0].strip()
        wanted.append(package)
        try:
            version(match[1])
        except PackageNotFoundError:
            missing.append(package)
    return missing or wanted


def _install_command(prefix: Path, packages: Sequence[str]) -> str:
    """Return the command, in backticks, that installs into the environment at `prefix`.

    Environments of uv have no pip. Those of pipx and of uv's tools are not the one of a pip on the path.
    """
    words = shlex.join(packages)
    if "archive-v0" in prefix.parts:  # uv's cache, in which `uvx` runs programs
        options = " ".join(f"--with {shlex.quote(package)}" for package in packages)
        return f"`uvx {options}` with the other words of your command"
    if prefix.parts[-3:-1] == ("pipx", "venvs"):
        return f"`pipx inject {prefix.name} {words}`"
    python = shlex.quote(str(prefix / "bin" / "python"))
    is_of_uv = find_spec("pip") is None and (prefix / "pyvenv.cfg").is_file()
    if prefix.parts[-3:-1] == ("uv", "tools") or is_of_uv:
        return f"`uv pip install --python {python} {words}`"
    return f"`{python} -m pip install {words}`"


@functools.cache
def pointit_version() -> str:
    """Return the version of PointIt, or `""` if its sources run without being installed."""
    try:
        return version("pointit")
    except PackageNotFoundError:
        return ""
