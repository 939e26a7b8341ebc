"""Ownership of names: one process at a time runs a person's services.

A present process that reports keeps the name, and a second instance is refused. A silent process was stopped
or disconnected, or its machine failed. It loses the name: its presence ends with Zenoh's lease at the latest,
and the second instance waits that long. If it returns, two instances run at once. Then the one that started
last keeps the name and the other ends. Start times come from each machine's clock. Both sides compare the
same two times, so exactly one ends, however long messages take.
"""

import asyncio
import logging
from collections.abc import Callable, Collection

from pointit.runtime.bus.contract import Bus, list_present
from pointit.runtime.errors import ConfigError
from pointit.runtime.link.link import LEASE_MS
from pointit.runtime.machine import this_machine
from pointit.schemas import NS_PER_S, Health
from pointit.schemas.topics import HEALTH, Presence

log = logging.getLogger(__name__)

LISTEN_S = 0.3
"""Time to wait for the names already present."""
SILENT_S = LEASE_MS / 1000 + 1.5
"""A present instance without Health for this long (s) counts as dead."""
LOG_AFTER_S = 1.0
"""Waits longer than this are logged, s."""
ADVICE = "choose another name, or end the other one first"


async def claim_names(bus: Bus, presence: Presence, names: Collection[str], advice: str = ADVICE) -> None:
    """Check that no instance that reports uses one of `names`. Wait for silent ones.

    It takes `LISTEN_S` if no name is present, and at most `SILENT_S` more.

    Raises:
        ConfigError: If a name is in use. The message contains the name and its process.
    """
    required = set(names)
    if not required or not required & await list_present(bus, presence, LISTEN_S):
        return

    # A present name may be that of a process that died: its token lasts until the lease ends. A process that
    # lives reports its health.
    search = _HolderSearch(required)
    watching = bus.watch(presence, search.on_presence)
    subscription = bus.subscribe(HEALTH, search.on_health)
    waits = "%s: already on site %s, but not reporting; waiting %.0f s at most"
    loop = asyncio.get_running_loop()
    log_timer = loop.call_later(LOG_AFTER_S, log.info, waits, _list(required), bus.site, SILENT_S)
    try:
        async with asyncio.timeout(SILENT_S):
            await search.done.wait()
    except TimeoutError:
        log.warning(
            "%s: an instance of that name on site %s does not report; its name is taken over, and it ends "
            "when it comes back",
            _list(search.silent_names),
            bus.site,
        )
        return
    finally:
        log_timer.cancel()
        subscription.close()
        watching.close()
    if search.holders:
        held_names = _list(search.holders)
        processes = _list(set(search.holders.values()))
        raise ConfigError(f"{held_names}: already on site {bus.site}; {advice}: {processes}")


def _list(names: Collection[str]) -> str:
    return ", ".join(sorted(names))


class _HolderSearch:
    def __init__(self, names: set[str]) -> None:
        self.done = asyncio.Event()
        self.silent_names = set(names)
        """Present names without a report."""
        self.holders: dict[str, str] = {}
        """Owning process by name."""

    def on_presence(self, name: str, *, present: bool) -> None:
        if not present:
            self.silent_names.discard(name)
            self._end_if_decided()

    def on_health(self, health: Health, instance: str) -> None:
        for name in self.silent_names & {instance, health.user}:
            host = health.host or "?"
            self.holders[name] = f"process {health.pid} on {host}"
            self.silent_names.discard(name)
        self._end_if_decided()

    def _end_if_decided(self) -> None:
        if not self.silent_names or self.holders:
            self.done.set()


class TakeoverMonitor:
    """Detects that another process has taken over the name of a running service."""

    def __init__(self, bus: Bus, instance: str, now_ns: Callable[[], int] | None = None) -> None:
        """Subscribe to the reports of `instance`. Call this in the loop."""
        self.superseded = asyncio.Event()
        """Set when another process owns the name."""
        self.successor = ""
        """Description of the new owner."""
        self.duplicate = ""
        """Description of another process with the same name, while it reports."""
        self._rival_s = 0.0
        self._instance = instance
        machine = this_machine()
        self._now_ns = now_ns or machine.now_ns
        self._time = asyncio.get_running_loop().time
        self._began_s = self._time()
        self._me = (machine.host_name, machine.process_id)
        self._subscription = bus.subscribe(HEALTH, self._on_health, instance)

    def close(self) -> None:
        """Unsubscribe."""
        self._subscription.close()

    def duplicate_instance_warning(self) -> str:
        """Return a warning while another process runs under the name, else `""`."""
        if not self.duplicate or self._time() - self._rival_s > SILENT_S:
            self.duplicate = ""
            return ""
        return f"{self._instance} runs twice: here and as {self.duplicate}; end one of the two"

    def _on_health(self, health: Health, _instance: str) -> None:
        sender = (health.host, health.pid)
        if sender == self._me:
            return
        self.duplicate = f"process {health.pid} on {health.host or '?'}"
        self._rival_s = self._time()

        # The process that started last keeps the name. Host and process decide between equal starts.
        uptime_ns = int((self._time() - self._began_s) * NS_PER_S)
        own = (self._now_ns() - uptime_ns, *self._me)
        others = (health.stamp_ns - int(health.uptime_s * NS_PER_S), *sender)
        if others > own and not self.superseded.is_set():
            self.successor = self.duplicate
            self.superseded.set()
