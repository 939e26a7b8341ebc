"""What was said on the bus and is no longer true, because who said it has gone; pure.

The bus tells nobody that a message has lost its writer, so pages would go on showing it.
"""

from collections.abc import Callable, Collection, Iterator
from typing import Any

from pointit.diagnosis.writers import instance_of, present_writers, split_instance
from pointit.schemas import Deployment
from pointit.schemas.topics import DEPLOYMENT, HEALTH, MAP, OBJECTS, Delivery, Topic
from pointit.services.registry import PROCESSES, SHOWN

SILENT_S = 3.0
"""A tracker that has said nothing for so long is gone; it says something 25 times a second."""

MISSED_S = 86_400.0
"""What was started and vanished is missed for so long; the keeper's default is the same."""

Key = tuple[Topic[Any], str]

_NAMES = {row.name for row in PROCESSES}

WITH_WRITER = tuple(
    topic
    for topic in SHOWN
    if topic.delivery is not Delivery.EVENT and topic is not MAP and set(topic.writers) <= _NAMES
)
"""What goes with its last writer. Rooms stay: the walls still stand when `pui` does not."""

OF_PEOPLE = tuple(
    topic for topic in SHOWN if topic.placeholder == "user" and topic.delivery is not Delivery.EVENT
)


def keys_of_service(
    instance: str, present: Collection[str], names: Callable[[Topic[Any]], list[str]]
) -> Iterator[Key]:
    """Yield what is no longer true now that `instance` has left.

    Args:
        instance: who has left.
        present: who is still there.
        names: at which names something of a topic is known.
    """
    yield HEALTH, instance
    service, _ = split_instance(instance)
    for topic in WITH_WRITER:
        if service in topic.writers:
            for name in names(topic):
                if not present_writers(topic, name, present):
                    yield topic, name


def keys_of_person(user: str) -> Iterator[Key]:
    """Yield what is no longer true now that `user` has left."""
    for topic in OF_PEOPLE:
        yield topic, user


class Trackers:
    """Which trackers still speak."""

    def __init__(self) -> None:
        """Know none."""
        self._heard_s: dict[str, float] = {}

    def heard(self, tracker: str, now_s: float) -> None:
        """Take that `tracker` has said something."""
        self._heard_s[tracker] = now_s

    def silent(self, now_s: float) -> list[Key]:
        """Return what is no longer true because its tracker is silent, each once."""
        gone = [tracker for tracker, heard_s in self._heard_s.items() if now_s - heard_s > SILENT_S]
        for tracker in gone:
            del self._heard_s[tracker]
        return [(OBJECTS, tracker) for tracker in gone]


class Deployments:
    """What was started and was not ended: what has vanished is missed."""

    def __init__(self, own: str) -> None:
        """Know none; `own` is the service that looks, which may outlive what it was started with."""
        self._own = own
        self._scenario = ""
        """That runs, or ran last."""
        self._there_s: dict[str, float] = {}
        """When some service of each was there last."""
        self.known: dict[str, Deployment] = {}

    def is_another(self, deployment: Deployment) -> bool:
        """Return True if `deployment` begins another scenario than the one that ran last."""
        return bool(deployment.scenario) and self._scenario not in ("", deployment.scenario)

    def put(self, name: str, deployment: Deployment, now_s: float) -> list[Key]:
        """Take one; return those that are over.

        Itself when nothing of it is to run any more; else those that it replaces: a site runs one scenario at
        a time.
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
        """Return those of which no service was there for too long, each once."""
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
        return {
            instance_of(each.service, each.user) for each in deployment.services if each.service != self._own
        }
