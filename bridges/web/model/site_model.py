"""State of the site: newest message of every key, services, deployments, and its status. Pure.

Times in seconds are of any monotonic clock.

Keys whose messages are no longer valid because their writer is gone; pure.

The bus does not report that a message has lost its writer, so pages would go on showing it.
"""

import math
import os
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from pointit.bridges.web.pages.latest_values import LatestValueCache
from pointit.bridges.web.playback.recent import Recent
from pointit.bridges.web.wire import FindingLine, PersonLine, ServiceLine, Status
from pointit.diagnosis.diagnose import diagnose
from pointit.diagnosis.missing_services import home_things
from pointit.diagnosis.observation import DiagnosisReport, Finding, Observation, expected_services
from pointit.runtime.link.link import SILENT_S
from pointit.schemas import Deployment, Environment, Health, Message, encode
from pointit.schemas.system import RUN, split_instance
from pointit.schemas.topics import DEPLOYMENT, HEALTH, LAMP_COLOR, MAP, OBJECTS, STRIPS_FRAME, Delivery, Topic
from pointit.services.registry import PROCESSES, SHOWN, present_writers


def shown_path(path: Path) -> str:
    """Return `path` relative to the folder in which PointIt was started.

    A path elsewhere is shortened to its folder's name and its own: `…/maps/room.yaml`.
    """
    path, start = path.absolute(), Path.cwd()
    return str(path.relative_to(start) if path.is_relative_to(start) else Path("…", *path.parts[-2:]))


def with_shown_path(sentence: str, path: Path) -> str:
    """Return `sentence` with `path`, and other files of its folder, as of `shown_path`."""
    return sentence.replace(f"{path.absolute().parent}{os.sep}", shown_path(path).removesuffix(path.name))


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

    def set_present(self, instance: str, present: bool, now_s: float) -> None:  # noqa: FBT001 - the bus's signature
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
        self._is_over, self._settled_s = True, now_s + ENDING_S

    def begin_run(self, now_s: float) -> None:
        """Note that another scenario has begun: services of the previous one are not missing."""
        self._is_over, self._began_run_s, self._settled_s = False, now_s, now_s + SETTLE_S
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
        self._forget_left(expected_services(deployments), now_s)
        seen = replace(self._seen(deployments, now_s, speed), now_ns=now_ns)
        is_starting = bool(self._missed_s) and now_s < self._began_run_s + STARTING_S
        return Status(
            run="over" if self._is_over and not deployments else "starts" if is_starting else "runs",
            services=tuple(self._services(seen))[:MAX_LINES],
            findings=tuple(
                FindingLine.model_validate(finding, from_attributes=True)
                for finding in diagnose(seen, lambda finding: self._is_sure(finding, now_s))
            )[:MAX_LINES],
            people=tuple(people),
            viewers=viewers,
            lan_url=lan_url,
        )

    def _seen(self, deployments: Mapping[str, Deployment], now_s: float, speed: float) -> Observation:
        began_s = max(self._began_s, now_s - WINDOW_S)  # older than this observation
        seen = Observation(
            began_s=began_s,
            now_s=now_s,
            present=self.present,
            left=frozenset(self._left_s),
            reports={name: tuple(reports) for name, reports in self._reports.items() if reports},
            deployments=deployments,
            home_things=self.home_things,
            speed=speed,
        )
        missing = seen.expected.keys() - seen.present - self._left_s.keys()
        self._missed_s = {name: self._missed_s.get(name, now_s) for name in missing}
        return seen

    def _forget_left(self, expected: Collection[str], now_s: float) -> None:
        for name in [
            n for n, left_s in self._left_s.items() if left_s < now_s - LEFT_S and n not in expected
        ]:
            del self._left_s[name]

    def _services(self, seen: Observation) -> list[ServiceLine]:
        since_s = {**self._missed_s, **self._left_s, **self._since_s}
        return [
            ServiceLine(instance=name, present=name in seen.present, since_s=max(0.0, seen.now_s - at_s))
            for name, at_s in sorted(since_s.items())
        ]

    def _is_sure(self, finding: Finding, now_s: float) -> bool:
        name = finding.service
        is_starting = name not in self._left_s and now_s < self._began_run_s + STARTING_S
        if finding.code in {"absent", "silent", "stale"} and is_starting:
            return False
        if finding.code == "no-bridge":
            return now_s >= max(self._began_s + GRACE_S, self._began_run_s + STARTING_S)
        if finding.code == "absent":
            return now_s - self._left_s.get(name, self._missed_s.get(name, now_s)) >= GRACE_S
        if finding.code == "silent":
            return now_s - self._since_s.get(name, now_s) > SILENT_S
        return finding.code != "empty" or not self._is_over


MAX_TRACKER_AGE_S = 3.0
"""A tracker without messages for this long (s) counts as gone; it sends 25 a second."""

MISSED_S = 86_400.0
"""Deployments that vanished are reported as missing for this long (s), as by the keeper's default."""

Key = tuple[Topic[Any], str]

_NAMES = {row.name for row in PROCESSES}

WITH_WRITER = tuple(
    topic
    for topic in SHOWN
    if topic.delivery is not Delivery.EVENT and topic is not MAP and set(topic.writers) <= _NAMES
)
"""Topics that end with their last writer. Rooms stay: the walls still stand without `pui`."""

OF_PEOPLE = tuple(
    topic for topic in SHOWN if topic.placeholder == "user" and topic.delivery is not Delivery.EVENT
)


def keys_of_service(
    instance: str, present: Collection[str], names: Callable[[Topic[Any]], list[str]]
) -> Iterator[Key]:
    """Yield the keys that are invalid after `instance` has left; `names` returns those of a topic."""
    yield HEALTH, instance
    service, _ = split_instance(instance)
    for topic in WITH_WRITER:
        if service in topic.writers:
            for name in names(topic):
                if not present_writers(topic, name, present):
                    yield topic, name


def keys_of_person(user: str) -> Iterator[Key]:
    """Yield the keys that are invalid after `user` has left."""
    for topic in OF_PEOPLE:
        yield topic, user


class Trackers:
    """Times of the trackers' last messages."""

    def __init__(self) -> None:
        self._received_s: dict[str, float] = {}

    def add(self, tracker: str, now_s: float) -> None:
        """Note a message of `tracker`."""
        self._received_s[tracker] = now_s

    def silent(self, now_s: float) -> list[Key]:
        """Return the keys of trackers that have fallen silent, each once."""
        gone = [
            tracker
            for tracker, received_s in self._received_s.items()
            if now_s - received_s > MAX_TRACKER_AGE_S
        ]
        for tracker in gone:
            del self._received_s[tracker]
        return [(OBJECTS, tracker) for tracker in gone]


class Deployments:
    """Deployments that were started and not ended: vanished ones are missing."""

    def __init__(self, own: str) -> None:
        self._own = own
        self._scenario = ""
        """The scenario that runs, or the last one."""
        self._there_s: dict[str, float] = {}
        """When a service of each deployment was last present, s."""
        self.known: dict[str, Deployment] = {}

    @property
    def has_run(self) -> bool:
        """Return True if a scenario runs."""
        return any(known.scenario for known in self.known.values())

    def is_another(self, deployment: Deployment) -> bool:
        """Return True if `deployment` begins another scenario than the last one, or the same again."""
        is_new = self._scenario != deployment.scenario or not self.has_run
        return bool(deployment.scenario and self._scenario) and is_new

    def put(self, name: str, deployment: Deployment, now_s: float) -> list[Key]:
        """Add a deployment, and return the names of those that are over.

        That is the deployment itself if none of its services is to run any more, else those it replaces: a
        site runs one scenario at a time.
        """
        if not deployment.services:
            self.known.pop(name, None)
            self._there_s.pop(name, None)
            return [(DEPLOYMENT, name)]
        over = [
            other
            for other, known in self.known.items()
            if other != name and known.scenario and deployment.scenario
        ]
        self.known[name] = deployment
        self._scenario = deployment.scenario or self._scenario
        self._there_s[name] = now_s
        return [self._drop(other) for other in over]

    def over(self, present: Collection[str], now_s: float) -> list[Key]:
        """Return deployments without a present service for too long, each once."""
        there = set(present)
        for name, deployment in self.known.items():
            if self._instances(deployment) & there:
                self._there_s[name] = now_s
        gone = [name for name, there_s in self._there_s.items() if now_s - there_s >= MISSED_S]
        return [self._drop(name) for name in gone]

    def _drop(self, name: str) -> Key:
        del self.known[name], self._there_s[name]
        return DEPLOYMENT, name

    def _instances(self, deployment: Deployment) -> set[str]:
        return {each.instance for each in deployment.services if each.service != self._own}


class SiteModel:
    """Updates the state from the bus and removes what is no longer valid."""

    def __init__(self, own: str, now_s: float, recent: Recent | None = None) -> None:
        """`own`: the owning service, which may outlive its deployment; `recent` keeps the stored messages."""
        self.cache = LatestValueCache()
        self._recent = recent
        self._observation = SiteObservation(now_s)
        self._trackers = Trackers()
        self._deployments = Deployments(own)
        self._began_ns: dict[str, int] = {}
        """Start of each run that goes on, by deployment."""
        self._lamps: frozenset[str] | None = None
        """Lamps of the map, or None before the map has come."""

    @property
    def present(self) -> frozenset[str]:
        """Return the instances that are present."""
        return self._observation.present

    def take(self, topic: Topic[Any], name: str, message: Message, now_ns: int, now_s: float) -> bool:
        """Store a message, encoded once for all pages. Return False if there is no room for its key."""
        if isinstance(message, Environment):
            self._lamps = frozenset(lamp.id for lamp in message.lamps)
            self._observation.home_things = home_things(message)
        elif topic is LAMP_COLOR and self._lamps is not None and name not in self._lamps:
            return True  # possibly invented: lamps that are not on the map are not shown
        elif isinstance(message, Deployment):
            message = message.believed(name)
        payload = encode(message)
        is_urgent = topic is STRIPS_FRAME
        if not self.cache.put(topic, name, payload, stamp_ns=message.stamp_ns, urgent=is_urgent):
            return False
        if self._recent is not None:
            self._recent.add(now_ns, topic, name, message, payload)
        if topic is OBJECTS:
            self._trackers.add(name, now_s)
        elif isinstance(message, Health):
            self._observation.report(name, message, now_s)
        elif isinstance(message, Deployment):
            self._take_deployment(name, message, now_ns, now_s)
        return True

    def _take_deployment(self, name: str, deployment: Deployment, now_ns: int, now_s: float) -> None:
        is_another, has_run = self._deployments.is_another(deployment), self._deployments.has_run
        self._forget(self._deployments.put(name, deployment, now_s))
        if has_run and not self._deployments.has_run:
            self._observation.end_run(now_s)
        elif is_another:
            self._observation.begin_run(now_s)
        self._began_ns[name] = min(deployment.stamp_ns, now_ns)  # the time of a slow simulation lags behind
        runs = {run for run in self._deployments.known if run.startswith(RUN)}
        self._began_ns = {run: ns for run, ns in self._began_ns.items() if run in runs}
        self.cache.began_ns = min(self._began_ns.values(), default=0)

    def set_service(self, instance: str, present: bool, now_s: float) -> None:  # noqa: FBT001 - the bus's signature
        """Update the presence of `instance`."""
        self._observation.set_present(instance, present, now_s)
        if not present:
            self._forget(list(keys_of_service(instance, self.present, self.cache.names)))

    def on_person_left(self, user: str) -> None:
        """Remove the states of `user`, who has left."""
        self._forget(keys_of_person(user))

    def tick(self, now_s: float) -> None:
        """Remove silent trackers and deployments that are gone for too long."""
        self._forget(self._trackers.silent(now_s))
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
        for topic, name in keys:
            self.cache.forget(topic, name)
            if self._recent is not None:
                self._recent.forget(topic, name)
