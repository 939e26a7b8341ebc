"""State of the site: newest message of every key, present services, deployments; pure.

Times in seconds are of any monotonic clock.
"""

from collections.abc import Iterable, Sequence
from typing import Any

from pointit.bridges.web.model.stale_keys import Deployments, Key, Trackers, keys_of_person, keys_of_service
from pointit.bridges.web.model.status import SiteObservation
from pointit.bridges.web.pages.latest_values import LatestValueCache
from pointit.bridges.web.playback.recent import Recent
from pointit.bridges.web.wire import PersonLine, Status
from pointit.schemas import Deployment, Environment, Health, Message, encode
from pointit.schemas.system import RUN
from pointit.schemas.topics import LAMP_COLOR, OBJECTS, STRIPS_FRAME, Topic


class SiteModel:
    """Updates the state from the bus and removes what is no longer valid."""

    def __init__(self, own: str, now_s: float, recent: Recent | None = None) -> None:
        """`own`: the owning service, which may outlive its deployment; `recent` keeps the stored messages."""
        self.hub = LatestValueCache()
        self._recent = recent
        self._sight = SiteObservation(now_s)
        self._trackers = Trackers()
        self._deployments = Deployments(own)
        self._began_ns: dict[str, int] = {}
        """Start of each run that goes on, by deployment."""
        self._lamps: frozenset[str] | None = None
        """Lamps of the map, or None before the map has come."""

    @property
    def present(self) -> frozenset[str]:
        """Return the instances that are present."""
        return self._sight.present

    def take(self, topic: Topic[Any], name: str, message: Message, now_ns: int, now_s: float) -> bool:
        """Store a message, encoded once for all pages. Return False if there is no room for its key."""
        if isinstance(message, Environment):
            self._lamps = frozenset(lamp.id for lamp in message.lamps)
        elif topic is LAMP_COLOR and self._lamps is not None and name not in self._lamps:
            return True  # possibly invented: lamps that are not on the map are not shown
        elif isinstance(message, Deployment):
            message = message.believed(name)
        payload = encode(message)
        is_urgent = topic is STRIPS_FRAME
        if not self.hub.put(topic, name, payload, stamp_ns=message.stamp_ns, urgent=is_urgent):
            return False
        if self._recent is not None:
            self._recent.add(now_ns, topic, name, message, payload)
        if topic is OBJECTS:
            self._trackers.heard(name, now_s)
        elif isinstance(message, Health):
            self._sight.report(name, message, now_s)
        elif isinstance(message, Deployment):
            self._take_deployment(name, message, now_ns, now_s)
        return True

    def _take_deployment(self, name: str, deployment: Deployment, now_ns: int, now_s: float) -> None:
        is_another, has_run = self._deployments.is_another(deployment), self._deployments.has_run
        self._forget(self._deployments.put(name, deployment, now_s))
        if has_run and not self._deployments.has_run:
            self._sight.end_run(now_s)
        elif is_another:
            self._sight.begin_run(now_s)
        self._began_ns[name] = min(deployment.stamp_ns, now_ns)  # the time of a slow simulation lags behind
        runs = {run for run in self._deployments.known if run.startswith(RUN)}
        self._began_ns = {run: ns for run, ns in self._began_ns.items() if run in runs}
        self.hub.began_ns = min(self._began_ns.values(), default=0)

    def set_service(self, instance: str, present: bool, now_s: float) -> None:  # noqa: FBT001 - the bus's signature
        """Update the presence of `instance`."""
        self._sight.set_present(instance, present, now_s)
        if not present:
            self._forget(list(keys_of_service(instance, self.present, self.hub.names)))

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
        return self._sight.status(
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
            self.hub.forget(topic, name)
            if self._recent is not None:
                self._recent.forget(topic, name)
