"""State of the site: newest message of every key, present services, deployments; pure.

Times in seconds are of any monotonic clock.

Keys whose messages are no longer valid because their writer is gone; pure.

The bus does not report that a message has lost its writer, so pages would go on showing it.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from typing import Any

from pointit.bridges.web.model.status import SiteObservation
from pointit.bridges.web.pages.latest_values import LatestValueCache
from pointit.bridges.web.playback.recent import Recent
from pointit.bridges.web.wire import PersonLine, Status
from pointit.diagnosis.missing_services import home_things
from pointit.diagnosis.writers import present_writers
from pointit.schemas import Deployment, Environment, Health, Message, encode
from pointit.schemas.system import RUN, split_instance
from pointit.schemas.topics import DEPLOYMENT, HEALTH, LAMP_COLOR, MAP, OBJECTS, STRIPS_FRAME, Delivery, Topic
from pointit.services.registry import PROCESSES
from pointit.services.shown_topics import SHOWN

SILENT_S = 3.0
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
        gone = [tracker for tracker, received_s in self._received_s.items() if now_s - received_s > SILENT_S]
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
