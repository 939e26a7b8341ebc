"""Stopped processes of PointIt on this machine: a stopped service looks like one that has ended."""

import contextlib
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from pointit.schemas.system import instance_of

PROGRAM = re.compile(r"(?:.*/)?pointit(?:\.exe)?|pointit\.(?:cli|services\.\w+|bridges\.\w+)")
"""Name of the program or module by which a process is one of PointIt."""
CONTINUE = "continue it: `kill -CONT {pid}`, or `fg` in its terminal"
"""Remedy of a stopped process."""
STOPPED = ("T", "t")
"""States of a process that was stopped by a signal, or by a debugger."""


@dataclass(frozen=True)
class StoppedProcess:
    """A process that a signal has stopped, for example SIGSTOP or Ctrl-Z."""

    pid: int
    arguments: tuple[str, ...]
    """Command line from the program's name or module on: `pointit`, `person`, `add`, `anna`."""

    @property
    def may_route(self) -> bool:
        """Return True if other processes may connect to it."""
        return self.arguments[1:2] in (("run",), ("router",))

    def may_run(self, instance: str, deployment: str = "") -> bool:
        """Return True if it runs `instance`, which belongs to `deployment` (`""`: that is unknown)."""
        program, *rest = self.arguments
        module = program.rpartition(".")[2] if program.startswith(("pointit.s", "pointit.b")) else ""
        words = [word for word in rest if not word.startswith("-")]
        if not module and rest[:2] == ["service", "run"]:
            module = "".join(words[2:3])
        if module:
            which = self._option("--user") or self._option("--name")
            return instance == instance_of(module.replace("_", "-"), which)
        if rest[:2] == ["person", "add"]:
            return (
                instance.partition(".")[2] == (words[2:] or [""])[0] or deployment == (words[2:] or [""])[0]
            )
        if rest[:1] == ["router"]:
            return instance.partition("-")[0] == "router"
        return rest[:1] == ["run"] and (deployment.startswith("run.") or not deployment)

    def is_of(self, site: str, addresses: Sequence[str]) -> bool:
        """Return True unless its command line names another site or address."""
        named = {self._option(name) for name in ("--connect", "--listen")} - {""}
        return self._option("--site") in ("", site) and (not named or bool(named & set(addresses)))

    def _option(self, name: str) -> str:
        for word, following in zip(self.arguments, (*self.arguments[1:], ""), strict=True):
            if word == name:
                return following
            if word.startswith(f"{name}="):
                return word.partition("=")[2]
        return ""


def stopped_processes(site: str, addresses: Sequence[str]) -> tuple[StoppedProcess, ...]:
    """Return the stopped processes of this machine that may belong to `site` at `addresses`.

    Only Linux tells them, and a container only its own.
    """
    return tuple(each for each in _stopped(Path("/proc")) if each.is_of(site, addresses))


def _stopped(proc: Path) -> Iterator[StoppedProcess]:
    for folder in proc.glob("[0-9]*"):
        with contextlib.suppress(OSError):  # it has ended meanwhile, or is another user's
            state = (folder / "stat").read_text(errors="replace").rpartition(")")[2].split()[0]
            if state not in STOPPED:
                continue
            words = (folder / "cmdline").read_bytes().decode(errors="replace").split("\0")
            at = next((i for i, word in enumerate(words[:6]) if PROGRAM.fullmatch(word)), None)
            if at is not None:
                yield StoppedProcess(int(folder.name), tuple(words[at:-1]))
