"""Observation of a site by one who joins it: until everybody was heard, and what may pass has passed."""

import asyncio
import contextlib
import dataclasses
import socket
import time

from pointit.diagnosis.causes import may_pass
from pointit.diagnosis.diagnose import diagnose, is_about
from pointit.diagnosis.observation import DiagnosisReport, Observation
from pointit.diagnosis.presence import is_anything_starting
from pointit.diagnosis.stopped_processes import stopped_processes
from pointit.runtime.link.link import DEFAULT_ENDPOINT, DEFAULT_SITE, Link
from pointit.runtime.link.outage import SILENT_S
from pointit.runtime.zenoh.sites import sites_at
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import ClockTick, Deployment, Health
from pointit.schemas.topics import ANY, CLOCK, DEPLOYMENT, HEALTH, SERVICE_ALIVE, SHARD_ALIVE

MIN_S = 1.2
"""Minimum listening time: long enough for services that report once a second."""

LONGEST_S = SILENT_S + 0.4
"""Listening time after which services not heard count as silent."""

CONFIRM_S = 6.0
"""Listening time in which a pause of a busy machine passes: its own start makes one, too."""

STARTS_S = 120.0
"""Listening time after which a service that is starting counts as missing."""

CHECK_S = 0.5
"""Period of checks if nothing arrives."""


def _options(link: Link) -> str:
    """Return the options by which another command reaches the same site; "" if the defaults do.

    Of a secured site these are the credentials of each identity.
    """
    if link.credentials is not None:
        return ""
    site = "" if link.site == DEFAULT_SITE else f" --site {link.site}"
    return site + "".join(f" --connect {each}" for each in link.connect if each != DEFAULT_ENDPOINT)


def _identities(link: Link) -> str:
    """Return the folder of the identities of a secured site, as far as it is here, else `""`."""
    if link.credentials is None:
        return ""
    folder = link.credentials.folder.parent
    return str(folder) if (folder / "supervisor").is_dir() else "FOLDER/identities"


class SiteObserver:
    """Observes until every service, or every one of a name, was heard twice."""

    def __init__(self, only: str = "") -> None:
        self._only = only
        self.seen: Observation | None = None
        self._began_s = time.monotonic()
        self._changed = asyncio.Event()
        self._present: set[str] = set()
        self._ever: set[str] = set()
        self._shards: set[str] = set()
        self._reports: dict[str, list[DiagnosisReport]] = {}
        self._deployments: dict[str, Deployment] = {}
        self._speed = 1.0

    async def watch(self, bus: ZenohBus) -> None:
        """Observe until there is enough data; `seen` holds it afterwards."""
        self._began_s = time.monotonic()
        bus.subscribe(CLOCK, self._on_clock)
        bus.subscribe(DEPLOYMENT, self._on_deployment)
        bus.subscribe(HEALTH, self._on_health)
        bus.watch(SERVICE_ALIVE, self._on_presence)
        bus.watch(SHARD_ALIVE, lambda name, here: (self._shards.add if here else self._shards.discard)(name))
        await asyncio.sleep(MIN_S)
        while time.monotonic() < self._began_s + self._listening_s(self._observe(bus.link)):
            self._changed.clear()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(CHECK_S):
                    await self._changed.wait()
        sees_no_process = not self._present and not self._deployments
        is_open = sees_no_process and bus.link.credentials is None  # with credentials there is a site
        self.seen = dataclasses.replace(
            self._observe(bus.link),
            is_patient=False,
            other_sites=await sites_at(bus.link) if is_open else (),
            denied=await bus.denial_reason("reads", HEALTH, ANY) if sees_no_process else "",
        )

    def _observe(self, link: Link) -> Observation:
        reports, now_s = self._reports, time.monotonic()
        return Observation(
            began_s=self._began_s,
            now_s=now_s,
            present=frozenset(self._present),
            left=frozenset(self._ever - self._present),
            shards=frozenset(self._shards),
            reports={name: tuple(reports[name]) for name in reports},
            deployments=dict(self._deployments),
            host=socket.gethostname(),
            stopped=stopped_processes(link.site, link.addresses),
            now_ns=time.time_ns(),
            speed=self._speed,
            options=_options(link),
            identities=_identities(link),
        )

    def _listening_s(self, seen: Observation) -> float:
        """Return the listening time, s: longer while services start, or while a problem may pass."""
        wanted = {each for each in seen.present if not self._only or is_about(each, self._only)}
        is_complete = all(len(seen.reports.get(instance, ())) >= 2 for instance in wanted)
        if not seen.stopped and is_anything_starting(seen):
            return STARTS_S
        if not is_complete or (self._only and not wanted):
            return LONGEST_S
        return CONFIRM_S if any(map(may_pass, diagnose(seen))) else 0.0

    def _on_presence(self, instance: str, present: bool) -> None:  # noqa: FBT001 - the bus's signature
        (self._present.add if present else self._present.discard)(instance)
        self._ever.add(instance)
        self._changed.set()

    def _on_health(self, health: Health, instance: str) -> None:
        self._reports.setdefault(instance, []).append(
            DiagnosisReport(received_s=time.monotonic(), health=health, arrived_ns=time.time_ns())
        )
        self._changed.set()

    def _on_deployment(self, deployment: Deployment, name: str) -> None:
        believed = deployment.believed(name)
        if believed.services:
            self._deployments[name] = believed
        else:  # ended on purpose
            self._deployments.pop(name, None)

    def _on_clock(self, tick: ClockTick, _name: str) -> None:
        self._speed = tick.speed
