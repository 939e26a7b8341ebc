"""Receives every state and gives the newest to late subscribers when its writer is gone."""

import asyncio
import functools
from pathlib import Path
from typing import ClassVar

from pointit.runtime.bus.contract import AnyTopic
from pointit.runtime.bus.timeliness import REMEDY, ClockSkewMonitor
from pointit.runtime.clock import WallClock, sleep
from pointit.runtime.config.parameters import set_option
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import site_folder
from pointit.runtime.machine import this_machine
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas import NS_PER_S, Health, Message
from pointit.schemas.problems import CLOCK, CLOCK_CLAIM, CLOCK_LIMIT, UNWRITABLE
from pointit.schemas.system import split_instance
from pointit.schemas.topics import HEALTH, SERVICE_ALIVE, USER_ALIVE
from pointit.services.keeper.retained_states import FILE, KeeperConfig, RetainedStates, read, retained, write
from pointit.services.service_plugin import add_all_rows

SETTLE_S = 0.5
"""Wall time after the start until presence and living writers' states are known, and queries are answered."""
EXPIRE_S = 1.0
"""Period of checks for expired states."""


class Keeper(Service[KeeperConfig]):
    """Retains the newest value of every state for late or restarted subscribers when its writer is gone."""

    NAME: ClassVar[str] = "keeper"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = KeeperConfig
    TIME_MAY_STEP: ClassVar[bool] = True

    @classmethod
    def discard_saved_state(cls, site: str, now_ns: int) -> None:
        """Delete the states of an earlier run of `site`."""
        del now_ns
        _path(site).unlink(missing_ok=True)

    def __init__(self, config: KeeperConfig, context: Context) -> None:
        super().__init__(config, context)

        # States, and their file
        add_all_rows()  # their services may run in other processes
        self._topics = retained()
        self._retained = RetainedStates(config)
        self._path = _path(self.bus.site)
        self._written = 0
        """`changes` of the states on disk."""
        self._changed = asyncio.Event()

        # Clocks of other machines
        self._wall = WallClock()
        self._skews = ClockSkewMonitor(this_machine().host_name)
        self._skewed_hosts: set[str] = set()
        """Machines with a clock warning."""

        # Restored states first: what is received is newer
        if config.file.enabled:
            self._restore()
        self.bus.watch(USER_ALIVE, self._on_user)
        self.bus.watch(SERVICE_ALIVE, self._on_service)
        for topic in self._topics:
            self.bus.subscribe(topic, functools.partial(self._on_state, topic), retained=False)
        self.bus.subscribe(HEALTH, self._on_health)

    async def run(self) -> None:
        """Answer queries once presence is known. Expire states and write changes."""
        try:
            # until then a state whose writer is present would look like one whose writer is gone
            await asyncio.sleep(SETTLE_S)
            self.bus.serve_retained(self._topics, self._retained.lookup)
            async with asyncio.TaskGroup() as group:
                group.create_task(self._expire_periodically(), name="keeper forgets")
                if self.config.file.enabled:
                    group.create_task(self._write_changes(), name="keeper writes")
        finally:
            if self.config.file.enabled and self._retained.changes != self._written:
                try:
                    write(self._path, self._retained.record(self.clock.now_ns()))
                except ConfigError as error:
                    self._on_write_error(error)

    def _on_user(self, user: str, *, present: bool) -> None:
        self._retained.set_user(user, self.clock.now_ns(), present=present)

    def _on_service(self, instance: str, *, present: bool) -> None:
        self._retained.set_instance(instance, self.clock.now_ns(), present=present)

    def _on_state(self, topic: AnyTopic, message: Message, name: str) -> None:
        self._retained.take(topic, name, message, self.clock.now_ns())
        self._changed.set()

    def _on_health(self, health: Health, instance: str) -> None:
        if health.host:
            now_s = asyncio.get_running_loop().time()
            _service, person = split_instance(instance)  # its owner may forge it
            self._skews.on_report(health.host, health.stamp_ns, self._wall.now_ns(), now_s, person)

    def _warn_of_clocks(self) -> None:
        """Warn of clocks of other machines by three codes, each in force or cleared for each machine."""
        now_s = asyncio.get_running_loop().time()
        skews = {skew.host: skew for skew in self._skews.skews(now_s)}
        for host in self._skewed_hosts | skews.keys():
            claim = ""
            beyond_limit = ""
            within_limit = ""
            skew = skews.get(host)
            if skew is not None:
                sentence = f"{skew.sentence(self._skews.here)}; {REMEDY}"
                if skew.claimant:
                    claim = sentence
                elif skew.exceeds_limit:
                    beyond_limit = sentence
                else:
                    within_limit = sentence
            self.bus.warn(CLOCK_CLAIM, claim, host)
            self.bus.warn(CLOCK_LIMIT, beyond_limit, host)
            self.bus.warn(CLOCK, within_limit, host)
        self._skewed_hosts = set(skews)

    async def _expire_periodically(self) -> None:
        """Expire states, and report their number, until cancelled."""
        while True:
            self._warn_of_clocks()
            self._retained.expire(self.clock.now_ns())
            count = len(self._retained)
            size_mb = self._retained.size / 1e6
            self.bus.set_metric("kept", float(count), "states")
            self.bus.set_metric("size", size_mb, "MB")
            if self._retained.refused:
                self.bus.warn(
                    "room",
                    f"{self._retained.refused} states found no room among {count} of "
                    f"{size_mb:.1f} MB and will not outlive their writers; find the "
                    f"service that writes them, or raise the limits of the keeper, as by "
                    f"{set_option('keeper', 'max_mb', 64)}",
                )
            if self._retained.changes != self._written:  # by an expiry, or after a write error
                self._changed.set()
            await sleep(self.clock, EXPIRE_S)

    async def _write_changes(self) -> None:
        """Write the states after changes, at most once a `write_every_s`, until cancelled."""
        while True:
            await self._changed.wait()
            self._changed.clear()
            changes = self._retained.changes
            if changes != self._written:
                record = self._retained.record(self.clock.now_ns())
                try:
                    await asyncio.to_thread(write, self._path, record)
                except ConfigError as error:
                    self._on_write_error(error)
                else:
                    self._written = changes
                    self.bus.clear(UNWRITABLE)
            await asyncio.sleep(self.config.file.write_every_s)

    def _on_write_error(self, error: ConfigError) -> None:
        self.bus.warn(UNWRITABLE, f"states would not outlive a restart of the keeper: {error}")

    def _restore(self) -> None:
        try:
            record = read(self._path)
        except ConfigError as error:
            self.bus.warn("restored", f"earlier states are not restored: {error}")
            return
        if record is None:
            return
        now_ns = self.clock.now_ns()
        if abs(now_ns - record.stamp_ns) > self.config.file.restore_within_s * NS_PER_S:
            return
        unusable = self._retained.restore(record, now_ns)
        if unusable:
            self.bus.warn(
                "restored",
                f"{unusable} earlier states were not usable: {self._path} is of another version, or damaged",
            )


def _path(site: str) -> Path:
    return site_folder(site, Keeper.NAME) / FILE


SERVICE = Keeper
