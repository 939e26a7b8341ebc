"""Programs that are started when people point at a thing."""

import asyncio
import contextlib
import os
import re
import shlex
import shutil
import signal
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

from pointit.runtime.config.nearest_name import nearest
from pointit.runtime.errors import ConfigError

MAX_S = 60.0
"""Time after which a program is ended, s."""
GRACE_S = 1.0
"""Time from SIGTERM to SIGKILL, s."""
PLACEHOLDER = re.compile(r"\{(\w+)\}")
PLACEHOLDERS = ("thing", "user", "confidence", "state")


def check_placeholders(text: str) -> None:
    """Check that all placeholders in `text` are known. Raises ConfigError."""
    for name in PLACEHOLDER.findall(text):
        if name not in PLACEHOLDERS:
            raise ConfigError(f"there is no {{{name}}}; {nearest(name, PLACEHOLDERS)}")


def filled(text: str, values: Mapping[str, str]) -> str:
    """Return `text` with the values of its placeholders, which are those of `PLACEHOLDERS`."""
    return PLACEHOLDER.sub(lambda match: values[match[1]], text)


@dataclass(frozen=True, kw_only=True)
class Program:
    """A program with its arguments, in which there are placeholders."""

    arguments: Sequence[str]
    is_shown: bool = False
    """Its output goes to that of this process."""
    interruption: ClassVar[str] = ""
    """A program that ends with the run has not failed."""

    @classmethod
    def parse(cls, line: str) -> Self:
        """Return the program in `line`, which is quoted as in a shell.

        Raises:
            ConfigError: If it is none, has an unknown placeholder, or there is no such program.
        """
        try:
            arguments = shlex.split(line)
        except ValueError as error:
            raise ConfigError(f"{str(error).lower()}; close it") from error
        check_placeholders(line)
        if not PLACEHOLDER.search(program := arguments[0]) and shutil.which(program) is None:
            raise ConfigError(f"no program {program}; give a path, and `chmod +x` a script")
        return cls(arguments=arguments)

    def describe(self, values: Mapping[str, str]) -> str:
        """Return its words, with the values of placeholders."""
        return shlex.join(filled(argument, values) for argument in self.arguments)

    async def react(self, values: Mapping[str, str]) -> str:
        """Run it, and end all that it has started. Return what went wrong, or `""`."""
        nothing = asyncio.subprocess.DEVNULL
        output = None if self.is_shown else nothing
        arguments = [filled(argument, values) for argument in self.arguments]
        try:
            program = await asyncio.create_subprocess_exec(
                *arguments, stdin=nothing, stdout=output, stderr=output, start_new_session=True
            )
        except OSError as error:
            return f"could not be started ({error.strerror or error})"
        try:
            async with asyncio.timeout(MAX_S):
                code = await program.wait()
        except TimeoutError:
            return f"was ended after {MAX_S:g} s"
        finally:
            await _end_group(program.pid)
        if not code:
            return ""
        return f"ended with {f'exit code {code}' if code > 0 else f'signal {-code}'}"


async def _end_group(group: int) -> None:
    """End what is left of a process group, at once if this is cancelled."""
    try:
        os.killpg(group, signal.SIGTERM)
        await asyncio.sleep(GRACE_S)
    except OSError:  # nothing is left, or it belongs to another user
        return
    finally:
        with contextlib.suppress(OSError):
            os.killpg(group, signal.SIGKILL)
