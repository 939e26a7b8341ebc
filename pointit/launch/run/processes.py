"""Child processes of a run, one for each service: their configuration, logs, restart and end."""

import asyncio
import json
import logging
import os
import shlex
import shutil
import signal
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Literal, Self

from pointit.runtime.config.environment_variables import LOG_FORMAT
from pointit.runtime.errors import EXIT_USAGE
from pointit.runtime.service.plugin_guard import RestartDelay
from pointit.runtime.service.service import Launch
from pointit.services import registry

log = logging.getLogger(__name__)

Warnings = Sequence[tuple[int, str]]
"""Level and message of each."""

STOP_TIMEOUT_S = 1.2
"""Time children get to end before they are killed."""
LAST_WORDS = 2000
"""Bytes at the end of a child's log that are searched for its last error."""
LOG_PERIOD_S = 1.0
"""Interval at which the log of a supervised child is searched for warnings, s."""
MAX_LOG_BYTES = 16 * 1024
"""Bytes of a child's log that are searched in an interval. Of more, only the last are: it may be a flood."""
MAX_WARNINGS = 5
"""Warnings of a child that are passed on in an interval."""
LEVELS = {"warning": logging.WARNING, "error": logging.ERROR, "critical": logging.CRITICAL}
"""Levels of a child's log that are passed on, by their names there."""


class Processes:
    """Child processes, one per launch; all end on exit of the context.

    A child that ends by itself is reported with the command that restarts it. Restarting it is up to
    the operator, compose or systemd, unless the children are supervised.
    """

    def __init__(
        self,
        launches: Sequence[Launch],
        *,
        site: str,
        connect: str,
        clock: Literal["site", "wall"] = "site",
        is_supervised: bool = False,
    ) -> None:
        """Start nothing yet.

        `is_supervised`: a child that ends by itself is started again, with back-off, unless its parameters
        are wrong; and what it warns of is logged here, too.
        """
        self._launches = launches
        self._site = site
        self._connect = connect
        self._clock = clock
        self._is_supervised = is_supervised
        self._children: dict[str, asyncio.subprocess.Process] = {}
        self._failed: set[str] = set()
        """Instances that have ended by themselves."""
        self._watches: list[asyncio.Task[None]] = []
        self.folder = Path(tempfile.mkdtemp(prefix="pointit-"))
        """Holds each service's configuration and log; kept if one of them failed."""

    def command(self, launch: Launch) -> tuple[str, ...]:
        """Return the command that starts `launch`."""
        row = registry.process(launch.service.NAME)
        file = str(self.folder / f"{launch.instance}.yaml")
        command = [sys.executable, *row.command, "--config", file]
        if launch.user:
            command += ["--user", launch.user]
        if launch.name:
            command += ["--name", launch.name]
        return (*command, "--site", self._site, "--connect", self._connect, "--clock", self._clock)

    async def __aenter__(self) -> Self:
        try:
            for launch in self._launches:
                path = self.folder / f"{launch.instance}.yaml"
                path.write_text(launch.config.model_dump_json(), encoding="utf-8")
            for launch in self._launches:
                await self._start(launch)
        except BaseException:
            await self._end()
            raise
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        await self._end()

    async def _end(self) -> None:
        # first, or a watch could start a child that nobody would end
        for watch in self._watches:
            watch.cancel()
        await asyncio.gather(*self._watches, return_exceptions=True)

        # the others, which end by the signal, have not failed
        ended = {instance for instance, child in self._children.items() if child.returncode is not None}
        failed = self._failed | ended
        waits = [asyncio.create_task(child.wait()) for child in self._children.values()]
        for child in self._children.values():
            if child.returncode is None:
                child.send_signal(signal.SIGTERM)
        if waits:
            await asyncio.wait(waits, timeout=STOP_TIMEOUT_S)
        for instance, child in self._children.items():
            if child.returncode is None:
                log.warning("%s did not end within %g s and was killed", instance, STOP_TIMEOUT_S)
                failed.add(instance)
                child.kill()
        await asyncio.gather(*waits)

        for child in self._children.values():
            await _close_pipe(child)
        if not failed:
            shutil.rmtree(self.folder, ignore_errors=True)

    async def _start(self, launch: Launch) -> None:
        child = await self._start_child(launch)
        watch = self._supervise if self._is_supervised else self._watch
        self._watches.append(asyncio.create_task(watch(launch, child), name=f"watch {launch.instance}"))

    async def _start_child(self, launch: Launch) -> asyncio.subprocess.Process:
        environment = None
        if self._is_supervised:  # its log is read here: fields of JSON, not lines for people
            environment = {**os.environ, LOG_FORMAT: "json"}
        with self._log_path(launch).open("ab") as output:
            command = self.command(launch)
            child = await asyncio.create_subprocess_exec(
                *command,
                "--while-parent-lives",
                stdin=asyncio.subprocess.PIPE,
                stdout=output,
                stderr=output,
                env=environment,
                process_group=0,  # a terminal's Ctrl-C goes to the parent, which ends the children in order
            )
        self._children[launch.instance] = child
        return child

    def _log_path(self, launch: Launch) -> Path:
        return self.folder / f"{launch.instance}.log"

    async def _watch(self, launch: Launch, child: asyncio.subprocess.Process) -> None:
        """Report the child's end."""
        code = await child.wait()
        self._failed.add(launch.instance)
        path = self._log_path(launch)
        restart = shlex.join(self.command(launch))
        end = end_sentence(code, path)
        log.error("%s %s; start it again with: %s (its log: %s)", launch.instance, end, restart, path)

    async def _supervise(self, launch: Launch, child: asyncio.subprocess.Process) -> None:
        """Start the child again whenever it ends, until its parameters are refused."""
        path = self._log_path(launch)
        delay = RestartDelay()
        now_s = asyncio.get_running_loop().time
        while True:
            started_s = now_s()
            code = await self._forward_warnings_until_end(launch, child)
            if code == EXIT_USAGE:  # the same again would be refused again
                await self._watch(launch, child)
                return

            self._failed.add(launch.instance)
            wait_s = delay.after_failure_s(now_s() - started_s)
            log.error(
                "%s %s; it will be restarted in %g s (its log: %s)",
                launch.instance,
                end_sentence(code, path),
                wait_s,
                path,
            )
            await asyncio.sleep(wait_s)
            await _close_pipe(child)
            child = await self._start_child(launch)

    async def _forward_warnings_until_end(self, launch: Launch, child: asyncio.subprocess.Process) -> int:
        """Log what the child warns of. Return its exit code."""
        path = self._log_path(launch)
        position = path.stat().st_size
        end = asyncio.create_task(child.wait(), name=f"end of {launch.instance}")
        try:
            while not end.done():
                await asyncio.wait({end}, timeout=LOG_PERIOD_S)
                warnings, position = read_warnings(path, position)
                for level, message in warnings[:MAX_WARNINGS]:
                    log.log(level, "%s: %s", launch.instance, message)
        finally:
            end.cancel()
        return end.result()


async def _close_pipe(child: asyncio.subprocess.Process) -> None:
    """Close the pipe of an ended child: one left to the garbage collector may outlive the loop."""
    if child.stdin is None:
        return
    child.stdin.close()
    await asyncio.gather(child.stdin.wait_closed(), return_exceptions=True)


def end_sentence(code: int, path: Path) -> str:
    """Return the end of a child, such as `was ended by SIGKILL`, from its exit code and the log at `path`."""
    if code < 0:
        return f"was ended by {signal.Signals(-code).name}"
    reason = last_log_error(path)
    return f"ended with exit code {code}: {reason}" if reason else f"ended with exit code {code}"


def last_log_error(path: Path) -> str:
    """Return the last error in a service's log, or else the log's last line."""
    try:
        with path.open("rb") as file:
            file.seek(max(0, path.stat().st_size - LAST_WORDS))
            lines = file.read().decode(errors="replace").strip().splitlines()
    except OSError:
        return ""
    errors = [line.removeprefix("Error: ") for line in lines if line.startswith("Error: ")]
    last = (errors or lines or [""])[-1]
    entry = _log_entry(last)
    if entry is not None:
        _, last = entry
    return last.rstrip(".")


def read_warnings(path: Path, position: int) -> tuple[Warnings, int]:
    """Return warnings and errors of a service's log from `position` on, and the position after its last line.

    Of more than `MAX_LOG_BYTES`, the last are searched. An unreadable log has no warnings.
    """
    try:
        with path.open("rb") as file:
            size = path.stat().st_size
            start = max(position, size - MAX_LOG_BYTES)
            file.seek(start)
            text = file.read(MAX_LOG_BYTES)
    except OSError:
        return (), position
    complete, newline, _ = text.rpartition(b"\n")
    warnings: list[tuple[int, str]] = []
    for line in complete.splitlines():
        entry = _log_entry(line)
        if entry is None:
            continue
        level, message = entry
        if level in LEVELS:
            warnings.append((LEVELS[level], message))
    return warnings, start + len(complete) + len(newline)


def _log_entry(line: str | bytes) -> tuple[str, str] | None:
    """Return level and message of a line of a log in JSON, or None if it is none."""
    try:
        entry = json.loads(line)
        return str(entry["level"]), str(entry["message"])
    except (ValueError, LookupError, TypeError):
        return None
