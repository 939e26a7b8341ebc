"""A reader who follows a page: one shell and some terminals, on a machine of their own."""

import asyncio
import os
import shlex
import signal
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

from tests.docs.blocks import ROOT, Block, difference
from tests.support import there
from tests.support.pace import Patience

ENDLESS = 'pointit() { [ "$1" != run ] || set -- "$@" --duration 3600; command pointit "$@"; }'
"""A run in a terminal ends when its reader is through, however long a busy machine takes for the page."""
PATIENCE_S = 60.0
"""Longest time of a block on a quiet machine."""
STOPPED = {0, 128 + signal.SIGINT}
"""Exit codes after Ctrl-C."""
NAMESPACES = ("unshare", "--net", "--pid", "--fork", "--kill-child", "--mount-proc")
"""A network of their own, where no address is in use, and processes that all end with the shell."""
ADDRESS = "192.168.1.5"
"""Address of the machine in the documents."""


class BlockError(AssertionError):
    """A block does not do what the page says."""


@dataclass
class Terminal:
    """A command that is left running, and its output."""

    block: Block
    process: int
    output: Path


class Shell:
    """Runs the blocks of a page in order, in one bash."""

    def __init__(self, bash: asyncio.subprocess.Process, folder: Path) -> None:
        self._bash = bash
        self._folder = folder
        self._terminals: dict[str, Terminal] = {}
        self._count = 0

    async def run(self, block: Block) -> None:
        """Run a block.

        Raises:
            BlockError: If it fails, or prints something other than the page shows.
        """
        for terminal in self._terminals.values():
            if terminal.block.terminal != block.terminal:
                await self._check_running(terminal)
        self._count += 1
        code, output = (self._folder / f"{self._count}.{kind}" for kind in ("sh", "out"))
        code.write_text(block.code, encoding="utf-8")
        if block.language == "python":
            source = code.rename(code.with_suffix(".py"))
            code.write_text(f"python {source}\n", encoding="utf-8")
        if block.terminal:
            await self._start(block, code, output)
            return
        failed = self._folder / "failed"
        failed.unlink(missing_ok=True)
        await self._say(
            f"trap 'echo \"$BASH_COMMAND\" >>{failed}' ERR; . {code} >{output} 2>&1 </dev/null; trap - ERR",
            block,
        )
        printed = _read(output)
        if failed.exists() and not block.exit:
            raise BlockError(f"{block.place}: {failed.read_text().strip()} failed and printed\n{printed}")
        if block.exit == "fails" and not failed.exists():
            raise BlockError(f"{block.place} should fail, but printed\n{printed}")
        if block.output is not None and (problem := difference(block.output, printed)):
            raise BlockError(problem)

    async def end(self) -> None:
        """Press Ctrl-C in every terminal, the last one first.

        Raises:
            BlockError: If a command failed.
        """
        for name in reversed(list(self._terminals)):
            await self._stop(name)

    async def _start(self, block: Block, code: Path, output: Path) -> None:
        """Press Ctrl-C in its terminal, then run a block until it has printed what is shown, or anything."""
        if block.terminal in self._terminals:
            await self._stop(block.terminal)
        process = await self._say(f"({ENDLESS}; . {code}) >{output} 2>&1 </dev/null & printf '%s ' $!", block)
        self._terminals[block.terminal] = Terminal(block=block, process=int(process), output=output)
        patience = Patience(PATIENCE_S)
        while not (printed := _read(output)) or (block.output and difference(block.output, printed)):
            await self._check_running(self._terminals[block.terminal])
            await asyncio.sleep(0.05)
            if patience.is_over():
                raise BlockError(
                    f"{block.place} did not print what is shown within {patience}, but\n{printed}"
                )

    async def _check_running(self, terminal: Terminal) -> None:
        if await self._say(f"kill -0 {terminal.process} 2>&- || printf ended", terminal.block):
            raise BlockError(f"{terminal.block.place}: ended and printed\n{_read(terminal.output)}")

    async def _stop(self, name: str) -> None:
        terminal = self._terminals.pop(name)
        group = terminal.process
        code = await self._say(f"kill -INT -- -{group} 2>&-; wait {group}; printf '%s ' $?", terminal.block)
        printed = _read(terminal.output)
        if int(code) not in STOPPED or ("Traceback" in printed and "KeyboardInterrupt" not in printed):
            raise BlockError(
                f"{terminal.block.place}: terminal {name} ended with {code} and printed\n{printed}"
            )

    async def _say(self, command: str, block: Block) -> str:
        """Return the line that `command` prints to the standard output of the shell itself."""
        assert self._bash.stdin is not None
        assert self._bash.stdout is not None
        self._bash.stdin.write(f"{command}; echo\n".encode())
        patience = Patience(PATIENCE_S)
        reading = asyncio.ensure_future(self._bash.stdout.readline())
        while not (await asyncio.wait({reading}, timeout=1.0))[0]:
            if patience.is_over():
                reading.cancel()
                raise BlockError(f"{block.place} did not end within {patience}; is it `terminal 1`?")
        line = await reading
        if not line:
            raise BlockError(f"{block.place} ended the shell")
        return line.decode().strip()


def _read(output: Path) -> str:
    return output.read_text(encoding="utf-8", errors="replace") if output.exists() else ""


def prepare(folder: Path, root: Path) -> dict[str, str]:
    """Make the reader's folder, which looks like the checkout `root`. Return the environment."""
    for each in root.iterdir():
        if each.name != "scripts":
            (folder / each.name).symlink_to(each)
    (folder / "scripts").mkdir()
    for script in (root / "scripts").iterdir():  # they look for the project beside themselves
        if script.is_file() and os.access(script, os.X_OK):
            (folder / "scripts" / script.name).write_text(
                f'#!/bin/sh\nexec {shlex.quote(str(script))} "$@"\n'
            )
            (folder / "scripts" / script.name).chmod(0o755)
    home = folder.with_name("home")
    home.mkdir()
    inherited = {key: value for key, value in os.environ.items() if not key.startswith(("POINTIT_", "XDG_"))}
    return {
        **inherited,
        "HOME": str(home),
        "PATH": f"{root / '.venv/bin'}:{os.environ['PATH']}",
        "COLUMNS": "100",
        "PYTHONUNBUFFERED": "1",
    }


@asynccontextmanager
async def shell(folder: Path, root: Path = ROOT) -> AsyncGenerator[Shell]:
    """Yield a shell in the new folder `folder`/page, with namespaces of its own, for a reader of `root`."""
    page = folder / "page"
    notes = folder / "blocks"
    page.mkdir()
    notes.mkdir()
    environment = prepare(page, root)
    user = () if os.geteuid() == 0 else ("--user", "--map-root-user")
    with (notes / "bash").open("wb") as errors:
        bash = await asyncio.create_subprocess_exec(
            *(NAMESPACES[0], *user, *NAMESPACES[1:]), *("bash", "--noprofile", "--norc"),
            stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE, stderr=errors, cwd=page,
            env=environment,
        )  # fmt: skip
    try:
        there(bash.stdin).write(f"set -m; ip link set lo up; ip address add {ADDRESS}/32 dev lo\n".encode())
        yield Shell(bash, notes)
        there(bash.stdin).close()
        async with asyncio.timeout(PATIENCE_S):
            await bash.wait()
    finally:
        if bash.returncode is None:
            bash.kill()
            await bash.wait()
