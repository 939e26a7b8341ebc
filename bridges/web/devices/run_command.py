"""A command of `pointit` as a child process: what it prints, and its end.

No core: it waits for a process.
"""

import asyncio
import contextlib
import json
import os
import sys
from collections.abc import Callable, Sequence
from typing import Any, cast

from pointit.runtime.host.state_file import VARIABLE, state_directory
from pointit.schemas.text import system_reason

JsonObject = dict[str, Any]

BEGIN = (
    "from pointit.runtime.service.process import exit_with_parent; exit_with_parent(); "
    "from pointit.__main__ import begin; begin()"
)
"""Program of the process. It ends when its standard input closes, so no child survives a killed parent."""
STOP_TIMEOUT_S = 3.0
"""Time after which a process that does not end is killed, s."""
MAX_LINE_BYTES = 64 * 1024
ERROR = "Error: "
"""Beginning of the line with the reason for which a command ended."""


async def run_command(
    arguments: Sequence[str], on_log_line: Callable[[str], None], on_object: Callable[[JsonObject], None]
) -> str:
    """Run `pointit` until it ends or this task is cancelled, which ends it. Returns when it has ended.

    Args:
        arguments: its command line, without `pointit`.
        on_log_line: called with each line of its log.
        on_object: called with each JSON object that it prints.

    Returns:
        `""` if it succeeded, else the reason in one sentence.
    """
    running = asyncio.create_task(_run_child(arguments, on_log_line, on_object))
    try:
        return await asyncio.shield(running)
    finally:
        running.cancel()  # once: a second time, it would leave the process behind
        while not running.done():
            with contextlib.suppress(asyncio.CancelledError):
                await asyncio.wait([running])


async def _run_child(
    arguments: Sequence[str], on_log_line: Callable[[str], None], on_object: Callable[[JsonObject], None]
) -> str:
    """Run `pointit` as `run_command`. A cancellation ends the process."""
    command = (sys.executable, "-c", BEGIN, *arguments)
    try:
        environment = {**os.environ, VARIABLE: str(state_directory())}
        child = await asyncio.create_subprocess_exec(
            *command,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            limit=MAX_LINE_BYTES,
            env=environment,
            process_group=0,  # a terminal's Ctrl-C goes to the parent, which ends it
        )
    except OSError as error:
        return f"no process could be started: {system_reason(error)}"
    reason = ""

    # The reason for a failure is the last line with `Error: `, or the last line if there is none
    def on_log(line: str) -> None:
        nonlocal reason
        sentence = _sentence(line)
        if line.startswith(ERROR):
            reason = line
        elif not reason.startswith(ERROR):
            reason = sentence
        on_log_line(sentence)

    # Both pipes are read to their ends: a full one would stop the process
    try:
        await asyncio.gather(_read_lines(child.stderr, on_log), _read_objects(child.stdout, on_object))
        code = await child.wait()
    finally:
        await _stop_process(child)
    if not code:
        return ""
    return reason.removeprefix(ERROR).rstrip(".") or f"it ended with exit code {code}"


def _sentence(line: str) -> str:
    """Return the message of a line of a log, which may be a JSON object, as logs on pipes are."""
    try:
        message = json.loads(line)["message"]
    except (ValueError, LookupError, TypeError):
        message = line.removeprefix(ERROR)
    return str(message)


async def _read_lines(stream: asyncio.StreamReader | None, on_line: Callable[[str], None]) -> None:
    while stream is not None and not stream.at_eof():
        with contextlib.suppress(ValueError):  # longer than `MAX_LINE_BYTES`, and dropped
            line = await stream.readline()
            text = line.decode(errors="replace").strip()
            if text:
                on_line(text)


async def _read_objects(stream: asyncio.StreamReader | None, on_object: Callable[[JsonObject], None]) -> None:
    """Pass on each JSON object, which may have several lines."""
    parts: list[str] = []

    # Lines are gathered until they are valid JSON
    def on_line(line: str) -> None:
        parts.append(line)
        with contextlib.suppress(ValueError):
            value = json.loads("\n".join(parts))
            parts.clear()
            if isinstance(value, dict):
                on_object(cast("JsonObject", value))

    await _read_lines(stream, on_line)


async def _stop_process(child: asyncio.subprocess.Process) -> None:
    """End the process and close its pipes, even if this task is cancelled meanwhile: a loop closes."""
    # It may end in its own time, but is killed after that
    if child.returncode is None:
        child.terminate()
        with contextlib.suppress(TimeoutError, asyncio.CancelledError):
            async with asyncio.timeout(STOP_TIMEOUT_S):
                await child.wait()
    while child.returncode is None:
        with contextlib.suppress(ProcessLookupError):
            child.kill()
        with contextlib.suppress(asyncio.CancelledError):
            await child.wait()

    if child.stdin is not None:
        child.stdin.close()  # left to the garbage collector, it may outlive the loop, which it needs
        with contextlib.suppress(OSError):
            await child.stdin.wait_closed()
    with contextlib.suppress(TimeoutError):  # a grandchild may hold the pipes
        async with asyncio.timeout(STOP_TIMEOUT_S):
            for stream in filter(None, (child.stdout, child.stderr)):
                while await stream.read(MAX_LINE_BYTES):
                    pass
