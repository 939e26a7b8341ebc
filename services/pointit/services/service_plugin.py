"""Services of installed packages: processes with rows of the tables of their own."""

from dataclasses import dataclass
from typing import Any

from pointit.runtime.config.plugins import Plugin, PluginGroup
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import Service
from pointit.schemas.topics import (
    CLOCK,
    DEPLOYMENT,
    HEALTH,
    PRESENCES,
    REQUESTS,
    TOPICS,
    Presence,
    Request,
    Topic,
)

Row = Topic[Any] | Request[Any, Any]

SYSTEM = (CLOCK, DEPLOYMENT, HEALTH)
"""Topics that the runtime writes itself."""


@dataclass(frozen=True, kw_only=True)
class ServicePlugin(Plugin):
    """A service, and the topics and requests that it uses: ours, or new ones of its package.

    On a secured site it may do what these rows say, and nothing else.
    """

    make: type[Service[Any]]
    """The service. Its `NAME` is the name of the entry point, its `CONFIG` is `config`."""
    reads: tuple[Topic[Any], ...] = ()
    writes: tuple[Topic[Any], ...] = ()
    serves: tuple[Request[Any, Any], ...] = ()
    """Requests that it answers."""
    asks: tuple[Request[Any, Any], ...] = ()
    """Requests that it sends."""

    def check(self, name: str) -> None:
        """Check that it can run as the service `name` beside the rows of the tables.

        Raises:
            ConfigError: If not. The message names the attribute, topic or request.
        """
        if name != self.make.NAME or self.make.CONFIG is not self.config:
            raise ConfigError(
                f"NAME of {self.make.__name__} must be {name!r}, and its CONFIG the plug-in's config"
            )
        for topic in self.writes:
            if topic in SYSTEM or (topic not in TOPICS and name not in topic.writers):
                raise ConfigError(
                    f"it cannot write {topic.key}, whose writers are {', '.join(topic.writers)}"
                )
        for request in self.serves:
            if request.server != name:
                raise ConfigError(f"it cannot answer {request.key}, whose server is {request.server}")
        for row in (*self.reads, *self.writes, *self.serves, *self.asks):
            others: tuple[Row | Presence, ...] = (*TOPICS, *REQUESTS, *PRESENCES)
            taken = [other.key for other in others if other is not row and _overlap(row.key, other.key)]
            if taken:
                raise ConfigError(f"its key {row.key} is that of another row of the tables, {taken[0]}")

    def add_rows(self) -> None:
        """Add its topics and requests to the tables, unless they are there already."""
        TOPICS.extend(topic for topic in (*self.reads, *self.writes) if topic not in TOPICS)
        REQUESTS.extend(request for request in (*self.serves, *self.asks) if request not in REQUESTS)


def _overlap(one: str, other: str) -> bool:
    """Return True if a key can fit both patterns."""
    parts, others = one.split("/"), other.split("/")
    return len(parts) == len(others) and all(
        part == each or "{" in (part[:1], each[:1]) for part, each in zip(parts, others, strict=True)
    )


SERVICES = PluginGroup("pointit.services", ServicePlugin, "service", has_ours=False)
