"""Whose a name is: one process at a time runs a person's services.

Who is there and reports keeps the name: who comes is refused. Who is silent, because it was stopped, cut off
or its machine died, loses it: its presence ends with Zenoh's lease at the latest, and who comes waits as
long. When it comes back nevertheless, two run at once; then the one that began last keeps the name and the
other ends. Each began at a time by its own machine's clock, so that both sides compare the same two times
and exactly one ends, however long messages take.
"""

import asyncio
import logging
import os
import socket
import time
from collections.abc import Callable, Collection

from pointit.runtime.bus.contract import Bus, list_present
from pointit.runtime.errors import ConfigError
from pointit.runtime.link.link import LEASE_MS
from pointit.schemas import NS_PER_S, Health
from pointit.schemas.topics import HEALTH, Presence

log = logging.getLogger(__name__)

LISTEN_S = 0.3
"""How long to listen for who is there already."""

SILENT_S = LEASE_MS / 1000 + 1.5
"""Who is present and has not reported for so long is taken for stopped, cut off or dead."""

TELL_AFTER_S = 1.0
"""A wait that takes longer is told of."""

ADVICE = "choose another name, or end the other one first"


async def claim_names(bus: Bus, presence: Presence, names: Collection[str], advice: str = ADVICE) -> None:
    """Make sure that nobody who reports is present under one of `names`; wait for those who are silent.

    It takes `LISTEN_S` when nobody is, and at most `SILENT_S` more.

    Raises:
        ConfigError: somebody is; names them and their process.
    """
    wanted = set(names)
    if not wanted or not wanted & await list_present(bus, presence, LISTEN_S):
        return
    looking = _Looking(wanted)
    watching = bus.watch(presence, looking.on_presence)
    hearing = bus.subscribe(HEALTH, looking.on_health)
    telling = asyncio.get_running_loop().call_later(TELL_AFTER_S, _tell, wanted, bus.site)
    try:
        async with asyncio.timeout(SILENT_S):
            await looking.done.wait()
    except TimeoutError:
        log.warning(
            "%s: somebody is on site %s under that name and does not report; the name is taken over, and the "
            "other one ends when it comes back",
            _list(looking.left),
            bus.site,
        )
        return
    finally:
        telling.cancel()
        hearing.close()
        watching.close()
    if looking.holders:
        where = ", ".join(sorted(set(looking.holders.values())))
        raise ConfigError(f"{_list(looking.holders)}: already on site {bus.site}; {advice}: {where}")


def _tell(names: set[str], site: str) -> None:
    log.info("%s: on site %s already, but silent; waiting %.0f s at most", _list(names), site, SILENT_S)


def _list(names: Collection[str]) -> str:
    return ", ".join(sorted(names))


class _Looking:
    """Notes who of those that are present reports."""

    def __init__(self, names: set[str]) -> None:
        self.done = asyncio.Event()
        self.left = set(names)
        """Still present, as far as is known, and not heard of."""
        self.holders: dict[str, str] = {}
        """By name: the process that has it."""

    def on_presence(self, name: str, is_present: bool) -> None:  # noqa: FBT001 - the handler's own signature
        if not is_present:
            self.left.discard(name)
            self._judge()

    def on_health(self, health: Health, instance: str) -> None:
        for name in self.left & {instance, health.user}:
            self.holders[name] = f"process {health.pid} on {health.host or '?'}"
            self.left.discard(name)
        self._judge()

    def _judge(self) -> None:
        if not self.left or self.holders:
            self.done.set()


class TakeoverMonitor:
    """Tells a running service when another process has come to its name after it."""

    def __init__(self, bus: Bus, instance: str, now_ns: Callable[[], int] = time.time_ns) -> None:
        """Listen to the reports under `instance`; must be called in the loop."""
        self.superseded = asyncio.Event()
        """Somebody else has the name now."""
        self.successor = ""
        """Who, in words."""
        self.duplicate = ""
        """Who else runs under the name, in words, while it is heard."""
        self._rival_s = 0.0
        self._instance = instance
        self._now_ns = now_ns
        self._began_s = time.monotonic()
        self._me = (socket.gethostname(), os.getpid())
        self._hearing = bus.subscribe(HEALTH, self._on_health, instance)

    def close(self) -> None:
        """Listen no longer."""
        self._hearing.close()

    def duplicate_instance_warning(self) -> str:
        """Return in a sentence that another one runs under the name, as long as it is heard; else nothing."""
        if not self.duplicate or time.monotonic() - self._rival_s > SILENT_S:
            self.duplicate = ""
            return ""
        return f"{self._instance} runs twice: here and as {self.duplicate}; end one of the two"

    def _on_health(self, health: Health, _instance: str) -> None:
        other = (health.host, health.pid)
        if other == self._me:
            return
        self.duplicate = f"process {health.pid} on {health.host or '?'}"
        self._rival_s = time.monotonic()
        uptime_ns = int((time.monotonic() - self._began_s) * NS_PER_S)
        mine = (self._now_ns() - uptime_ns, *self._me)
        theirs = (health.stamp_ns - int(health.uptime_s * NS_PER_S), *other)
        if theirs > mine and not self.superseded.is_set():
            self.successor = self.duplicate
            self.superseded.set()
