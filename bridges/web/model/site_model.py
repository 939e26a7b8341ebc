"""State of the site for pages: newest message of every key as bytes, deployments, and status. Pure.

Times in seconds are of any monotonic clock.
"""

import math
import os
from collections import deque
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from pointit.bridges.web.pages.latest_values import LatestValueCache
from pointit.bridges.web.playback.recent import Recent
from pointit.bridges.web.wire import ArmSource, FindingLine, PersonLine, ServiceLine, Status
from pointit.diagnosis.diagnose import diagnose
from pointit.diagnosis.missing_services import home_things
from pointit.diagnosis.observation import DiagnosisReport, Finding, Observation, expected_services
from pointit.diagnosis.symptoms import figure
from pointit.runtime.host.advised_commands import advised_commands
from pointit.runtime.link.link import SILENT_S
from pointit.schemas import Deployment, Environment, Health, Message, encode
from pointit.schemas.system import OWN_SOURCE, RUN, instance_of, split_instance
from pointit.schemas.topics import DEPLOYMENT, LAMP_COLOR, STRIPS_FRAME, Topic
from pointit.services.registry import IMU_BRIDGE, moves_arm
from pointit.site.site_state import Change, Key, SiteState

WINDOW_S = 10.0
"""Window of reports, s: counters that grew in it are growing now."""

LEFT_S = 60.0
"""A service that left this long ago (s) and is not expected is no longer listed."""

GRACE_S = 2.0
"""An expected service may be absent this long (s) before it counts as missing: it may be starting."""

SETTLE_S = 2.0
"""Time (s) that services of the previous scenario have to leave after another one has begun."""

ENDING_S = 30.0
"""Time (s) that services of a run have to leave after its end."""

STARTING_S = 15.0
"""Services that another scenario expects may be absent or silent this long (s) after it has begun."""

MAX_LINES = 256
"""Maximum number of findings, or services, sent to a page."""

MISSED_S = 86_400.0
"""Deployments that vanished are reported as missing for this long (s), as by the keeper's default."""


def shown_path(path: Path) -> str:
    """Return `path` relative to the folder in which PointIt was started.

    A path elsewhere is shortened to its folder's name and its own: `…/maps/room.yaml`.
    """
    path = path.absolute()
    start = Path.cwd()
    if path.is_relative_to(start):
        return str(path.relative_to(start))
    return str(Path("…", *path.parts[-2:]))


def with_shown_path(sentence: str, path: Path) -> str:
    """Return `sentence` with `path`, and other files of its folder, as of `shown_path`."""
    folder = f"{path.absolute().parent}{os.sep}"
    shown_folder = shown_path(path).removesuffix(path.name)
    return sentence.replace(folder, shown_folder)


class SiteObservation:
    """Observations of the site's services; times are seconds of any monotonic clock."""

    def __init__(self, now_s: float) -> None:
        self._began_s = now_s
        self._since_s: dict[str, float] = {}
        """Start of presence, by present service."""
        self._left_s: dict[str, float] = {}
        """Time of leaving, by service that has left."""
        self._missed_s: dict[str, float] = {}
        """Time of the first expectation, by expected service that was never present."""
        self._reports: dict[str, deque[DiagnosisReport]] = {}
        self._began_run_s = -math.inf
        """Start of the scenario that runs, if another one ran before."""
        self._settled_s = -math.inf
        """Until then services may leave: their run has ended, or another scenario has replaced theirs."""
        self._is_over = False
        """The last run has ended on purpose."""
        self.home_things: tuple[str, ...] = ()
        """Things of the map that are entities of a Home Assistant."""

    @property
    def present(self) -> frozenset[str]:
        """Return the services that are present."""
        return frozenset(self._since_s)

    def set_present(self, instance: str, present: bool, now_s: float) -> None:
        """Update the presence of `instance`."""
        if present:
            self._since_s.setdefault(instance, now_s)
            self._left_s.pop(instance, None)
            self._missed_s.pop(instance, None)
        elif self._since_s.pop(instance, None) is not None:
            if now_s >= self._settled_s:
                self._left_s[instance] = now_s
            self._reports.pop(instance, None)

    def end_run(self, now_s: float) -> None:
        """Note that the run has ended on purpose: services that leave from now on are not missing."""
        self._is_over = True
        self._settled_s = now_s + ENDING_S

    def begin_run(self, now_s: float) -> None:
        """Note that another scenario has begun: services of the previous one are not missing."""
        self._is_over = False
        self._began_run_s = now_s
        self._settled_s = now_s + SETTLE_S
        self._left_s.clear()
        self._missed_s.clear()

    def report(self, instance: str, health: Health, now_s: float) -> None:
        """Store the report of `instance` if it is present."""
        if instance not in self._since_s:
            return
        reports = self._reports.setdefault(instance, deque())
        reports.append(DiagnosisReport(received_s=now_s, health=health))
        while now_s - reports[0].received_s > WINDOW_S:
            reports.popleft()

    def status(
        self,
        deployments: Mapping[str, Deployment],
        people: Sequence[PersonLine],
        now_s: float,
        *,
        viewers: int = 0,
        lan_url: str = "",
        speed: float = 1.0,
        now_ns: int | None = None,
    ) -> Status:
        """Return the status of the site now, at `now_ns` of the wall clock, Unix ns, if that is known."""
        # Before the observation, which lists the services that have left
        self._forget_left(expected_services(deployments), now_s)
        observation = replace(self._observe(deployments, now_s, speed), now_ns=now_ns)

        run: Literal["runs", "starts", "over"] = "runs"
        if self._is_over and not deployments:
            run = "over"
        elif self._missed_s and now_s < self._began_run_s + STARTING_S:
            run = "starts"

        findings: list[FindingLine] = []
        for finding in diagnose(observation, lambda finding: self._is_sure(finding, now_s)):
            findings.append(FindingLine.model_validate(finding, from_attributes=True))
        lines: list[PersonLine] = []
        for line in people:
            lines.append(line.model_copy(update={"source": self._source(line)}))
        return Status(
            run=run,
            services=tuple(self._services(observation)[:MAX_LINES]),
            findings=tuple(findings[:MAX_LINES]),
            people=tuple(lines),
            viewers=viewers,
            lan_url=lan_url,
        )

    def _source(self, line: PersonLine) -> ArmSource:
        """Return the source of an arm that no page moves: a simulation, a device, or nothing yet."""
        for service, user in map(split_instance, self.present):
            if user == line.user and moves_arm(service):
                return "simulation"
        bridge = instance_of(IMU_BRIDGE, line.user)
        if bridge not in self.present:
            return "device"  # something else writes the samples
        reports = self._reports.get(bridge)
        if not reports:
            return "unknown"
        own_source = figure(reports[-1].health, OWN_SOURCE)
        return "none" if own_source == 0.0 else "device"

    def _observe(self, deployments: Mapping[str, Deployment], now_s: float, speed: float) -> Observation:
        """Return the observation of the site now, and store the services that are missing from now on."""
        began_s = max(self._began_s, now_s - WINDOW_S)  # older than this observation
        reports = {name: tuple(received) for name, received in self._reports.items() if received}
        observation = Observation(
            began_s=began_s,
            now_s=now_s,
            present=self.present,
            left=frozenset(self._left_s),
            reports=reports,
            deployments=deployments,
            home_things=self.home_things,
            speed=speed,
            commands=advised_commands(),
        )
        missing = observation.expected.keys() - observation.present - self._left_s.keys()
        self._missed_s = {name: self._missed_s.get(name, now_s) for name in missing}
        return observation

    def _forget_left(self, expected: Collection[str], now_s: float) -> None:
        for name, left_s in list(self._left_s.items()):
            if left_s < now_s - LEFT_S and name not in expected:
                del self._left_s[name]

    def _services(self, observation: Observation) -> list[ServiceLine]:
        # The presence of a service counts before its leaving, and that before its absence
        since_s = {**self._missed_s, **self._left_s, **self._since_s}
        lines: list[ServiceLine] = []
        for name, begin_s in sorted(since_s.items()):
            is_present = name in observation.present
            duration_s = max(0.0, observation.now_s - begin_s)
            lines.append(ServiceLine(instance=name, present=is_present, since_s=duration_s))
        return lines

    def _is_sure(self, finding: Finding, now_s: float) -> bool:
        """Return True if a finding has lasted longer than a start, an end or a change of the run explains."""
        name = finding.service
        is_starting = name not in self._left_s and now_s < self._began_run_s + STARTING_S
        if finding.code in {"absent", "silent", "stale"} and is_starting:
            return False
        if finding.code == "no-bridge":
            return now_s >= max(self._began_s + GRACE_S, self._began_run_s + STARTING_S)
        if finding.code == "absent":
            missed_s = self._missed_s.get(name, now_s)
            absent_s = self._left_s.get(name, missed_s)
            return now_s - absent_s >= GRACE_S
        if finding.code == "silent":
            return now_s - self._since_s.get(name, now_s) > SILENT_S
        return finding.code != "empty" or not self._is_over


class Deployments:
    """Deployments that were started and not ended: vanished ones are missing."""

    def __init__(self, own: str) -> None:
        self._own = own
        self._scenario = ""
        """The scenario that runs, or the last one."""
        self._present_s: dict[str, float] = {}
        """When a service of each deployment was last present, s."""
        self.known: dict[str, Deployment] = {}

    @property
    def has_run(self) -> bool:
        """Return True if a scenario runs."""
        return any(known.scenario for known in self.known.values())

    def is_another(self, deployment: Deployment) -> bool:
        """Return True if `deployment` begins another scenario than the last one, or the same again."""
        if not deployment.scenario or not self._scenario:
            return False
        return self._scenario != deployment.scenario or not self.has_run

    def put(self, name: str, deployment: Deployment, now_s: float) -> list[Key]:
        """Add a deployment, and return the names of those that it replaces: a site runs one at a time."""
        replaced: list[Key] = []
        for known_name, known in self.known.items():
            if known_name != name and known.scenario and deployment.scenario:
                replaced.append((DEPLOYMENT, known_name))
        self.known[name] = deployment
        self._scenario = deployment.scenario or self._scenario
        self._present_s[name] = now_s
        return replaced

    def over(self, present: Collection[str], now_s: float) -> list[Key]:
        """Return deployments without a present service for too long, each once."""
        instances = set(present)
        for name, deployment in self.known.items():
            if self._instances(deployment) & instances:
                self._present_s[name] = now_s
        return [(DEPLOYMENT, name) for name, last_s in self._present_s.items() if now_s - last_s >= MISSED_S]

    def drop(self, name: str) -> None:
        """Forget a deployment that is over."""
        self.known.pop(name, None)
        self._present_s.pop(name, None)

    def _instances(self, deployment: Deployment) -> set[str]:
        return {entry.instance for entry in deployment.services if entry.service != self._own}


class SiteModel:
    """Updates the state from the bus, and what pages get of it."""

    def __init__(
        self,
        own: str,
        now_s: float,
        recent: Recent | None = None,
        show: Callable[[Change], object] = lambda _: None,
        *,
        on_person: Callable[[str, bool], object] | None = None,
        on_service: Callable[[str, bool], object] | None = None,
    ) -> None:
        """Create an empty model.

        Args:
            own: the owning service, which may outlive its deployment.
            now_s: time, s.
            recent: the store of all messages, if they are to be kept.
            show: called with each change that has a message.
            on_person: called with each change of presence, as by `SiteState`.
            on_service: the same, of service instances.
        """
        self.cache = LatestValueCache()
        self.state = SiteState(self._on_change, on_person=on_person, on_service=on_service)
        self._show = show
        self._recent = recent

        # For the status
        self._observation = SiteObservation(now_s)
        self._deployments = Deployments(own)
        self._began_ns: dict[str, int] = {}
        """Start of each run that goes on, by deployment."""
        self._lamps: frozenset[str] | None = None
        """Lamps of the map, or None before the map has come."""
        self._now_ns = 0
        self._now_s = now_s

    @property
    def present(self) -> frozenset[str]:
        """Return the instances that are present."""
        return self.state.services

    def take(self, topic: Topic[Any], name: str, message: Message, now_ns: int, now_s: float) -> bool:
        """Store a message. Return False if there is no room for its key."""
        if topic is LAMP_COLOR and self._lamps is not None and name not in self._lamps:
            return True  # possibly invented: lamps that are not on the map are not shown
        self._now_ns = now_ns
        self._now_s = now_s
        return self.cache.has_room(topic, name) and self.state.take(topic, name, message, now_s)

    def _on_change(self, change: Change) -> None:
        topic = change.topic
        name = change.name
        message = change.message

        # It is no longer valid
        if message is None:
            self.cache.forget(topic, name)
            if self._recent is not None:
                self._recent.forget(topic, name)
            if topic is DEPLOYMENT:
                self._end_deployment(name)
            return

        payload = encode(message)  # once for all pages
        self.cache.put(topic, name, payload, stamp_ns=message.stamp_ns, urgent=topic is STRIPS_FRAME)
        if self._recent is not None:
            self._recent.add(self._now_ns, topic, name, message, payload)

        # What the status depends on, before those who show the change may read it
        if isinstance(message, Environment):
            self._lamps = frozenset(lamp.id for lamp in message.lamps)
            self._observation.home_things = home_things(message)
        elif isinstance(message, Health):
            self._observation.report(name, message, self._now_s)
        elif isinstance(message, Deployment):
            self._on_deployment(name, message)
        self._show(change)

    def _on_deployment(self, name: str, deployment: Deployment) -> None:
        if self._deployments.is_another(deployment):
            self._observation.begin_run(self._now_s)
        self._began_ns[name] = min(deployment.stamp_ns, self._now_ns)  # a slow simulation's time lags behind
        replaced = self._deployments.put(name, deployment, self._now_s)
        self._forget(replaced)
        self._set_began()

    def _end_deployment(self, name: str) -> None:
        has_run = self._deployments.has_run
        self._deployments.drop(name)
        if has_run and not self._deployments.has_run:
            self._observation.end_run(self._now_s)
        self._set_began()

    def _set_began(self) -> None:
        runs = {run for run in self._deployments.known if run.startswith(RUN)}
        self._began_ns = {run: began_ns for run, began_ns in self._began_ns.items() if run in runs}
        self.cache.began_ns = min(self._began_ns.values(), default=0)

    def set_service(self, instance: str, present: bool, now_s: float) -> None:
        """Update the presence of `instance`."""
        self._now_s = now_s
        self._observation.set_present(instance, present, now_s)
        self.state.set_service(instance, present=present)

    def set_person(self, user: str, *, present: bool) -> None:
        """Update the presence of `user`."""
        self.state.set_person(user, present=present)

    def tick(self, now_s: float) -> None:
        """Remove silent trackers and deployments that are gone for too long."""
        self._now_s = now_s
        self.state.tick(now_s)
        self._forget(self._deployments.over(self.present, now_s))

    def status(
        self,
        people: Sequence[PersonLine],
        now_s: float,
        *,
        viewers: int,
        lan_url: str,
        speed: float,
        now_ns: int | None = None,
    ) -> Status:
        """Return the status of the site, see `SiteObservation.status`."""
        return self._observation.status(
            self._deployments.known,
            people,
            now_s,
            viewers=viewers,
            lan_url=lan_url,
            speed=speed,
            now_ns=now_ns,
        )

    def _forget(self, keys: Iterable[Key]) -> None:
        for key in keys:
            self.state.forget(*key)
