"""Keys whose messages are no longer valid because their writer is gone; pure.

The bus does not report that a message has lost its writer, so pages would go on showing it.
"""

from collections.abc import Callable, Collection, Iterator
from typing import Any

from pointit.diagnosis.writers import present_writers
from pointit.schemas import Deployment
from pointit.schemas.system import split_instance
from pointit.schemas.topics import DEPLOYMENT, HEALTH, MAP, OBJECTS, Delivery, Topic
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
        self._heard_s: dict[str, float] = {}

    def heard(self, tracker: str, now_s: float) -> None:
        """Note a message of `tracker`."""
        self._heard_s[tracker] = now_s

    def silent(self, now_s: float) -> list[Key]:
        """Return the keys of trackers that have fallen silent, each once."""
        gone = [tracker for tracker, heard_s in self._heard_s.items() if now_s - heard_s > SILENT_S]
        for tracker in gone:
            del self._heard_s[tracker]
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
