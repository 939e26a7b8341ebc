"""Services of installed packages: processes with their own rows of the tables."""

import contextlib
import re
from dataclasses import dataclass
from typing import Any, cast, get_args

from pointit.runtime.config.plugins import Plugin, PluginGroup
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import Scope, Service
from pointit.schemas import topics
from pointit.schemas.table_types import NAME
from pointit.schemas.topics import Presence, Request, Topic

Row = Topic[Any] | Request[Any, Any]

SYSTEM = (topics.CLOCK, topics.DEPLOYMENT, *topics.ACCOUNTS)
"""Topics that the runtime writes itself."""

OURS = (*topics.TOPICS, *topics.REQUESTS)
"""Rows of PointIt itself."""

PLACEHOLDER = re.compile(r"\{\w+\}\Z")


@dataclass(frozen=True, kw_only=True)
class ServicePlugin(Plugin):
    """A service, and the topics and requests that it uses: ours, or new ones of its package.

    On a secured site these rows are added to the rights of a role: `user`, of each person's identity, if its
    scope is `user`, else `services`. It runs with all rights of that role, and other services of the role get
    its rows, too.
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
        self._check_class(name)

        # The service of one person writes and answers for this person only
        is_personal = self.make.SCOPE == "user"
        for row in (*self.writes, *self.serves):
            if is_personal and row.placeholder != "user":
                raise ConfigError(f"its SCOPE is 'user', so its key {row.key} must contain {{user}}")

        # Rights: our topics except those of the runtime, and rows that name it as their owner
        for topic in self.writes:
            is_ours = topic in OURS
            may_write = is_ours or name in topic.writers
            if topic in SYSTEM or not may_write:
                writers = ", ".join(topic.writers)
                raise ConfigError(f"it cannot write {topic.key}, whose writers are {writers}")
            is_our_personal_topic = is_ours and topic.placeholder == "user"
            if is_our_personal_topic and not is_personal:
                raise ConfigError(f"it cannot write {topic.key} of all people: its SCOPE must be 'user'")
        for request in self.serves:
            if request.server != name:
                raise ConfigError(f"it cannot answer {request.key}, whose server is {request.server}")

        # Keys of its own rows
        rows: tuple[Row, ...] = (*self.reads, *self.writes, *self.serves, *self.asks)
        for row in rows:
            if row not in OURS:
                _check_key(row)

    def _check_class(self, name: str) -> None:
        """Check the service's class and its attributes."""
        make = cast("object", self.make)
        if not (isinstance(make, type) and issubclass(make, Service)):
            raise ConfigError("its make must be a subclass of Service")
        class_name = self.make.__name__
        if name != self.make.NAME or self.make.CONFIG is not self.config:
            raise ConfigError(f"NAME of {class_name} must be {name!r}, and its CONFIG the plug-in's config")
        if "." in name or not NAME.match(name):  # NAME.USER is the instance of a person
            raise ConfigError(f"its NAME {name!r} must be of letters, digits, '_' and '-' only")
        if self.make.SCOPE not in get_args(Scope):
            raise ConfigError(f"SCOPE of {class_name} must be 'site' or 'user'")

    def add_rows(self) -> None:
        """Add its topics and requests to the tables, unless they are there already."""
        for topic in (*self.reads, *self.writes):
            if topic not in topics.TOPICS:
                topics.TOPICS.append(topic)
        for request in (*self.serves, *self.asks):
            if request not in topics.REQUESTS:
                topics.REQUESTS.append(request)


def _check_key(row: Row) -> None:
    """Check that `row`, which is not ours, has a key of its own that starts with its owner's name.

    Raises:
        ConfigError: If not. The message names the key.
    """
    # It starts with the name of its owner
    first, *others = row.key.split("/")
    owners = row.writers if isinstance(row, Topic) else (row.server,)
    owner_names = {owner.replace("_", "-") for owner in owners}
    if first.replace("_", "-") not in owner_names:
        raise ConfigError(f"its key {row.key} must begin with {owners[0]}/, the name of its service")

    # It consists of names and at most one placeholder
    no_names = [part for part in others if not NAME.match(part)]
    are_placeholders = all(PLACEHOLDER.match(part) for part in no_names)
    if len(no_names) > 1 or not are_placeholders:
        raise ConfigError(
            f"its key {row.key} must consist of names of letters, digits, '_', '-' and '.', one of which may "
            "be a placeholder such as {user}"
        )

    # No message fits two rows
    rows: tuple[Row | Presence, ...] = (*topics.TOPICS, *topics.REQUESTS, *topics.PRESENCES)
    for other in rows:
        if other != row and _overlap(row.key, other.key):
            raise ConfigError(f"its key {row.key} is that of another row of the tables, {other.key}")


def _overlap(key: str, other_key: str) -> bool:
    """Return True if a key can fit both patterns."""
    parts = key.split("/")
    other_parts = other_key.split("/")
    if len(parts) != len(other_parts):
        return False
    for part, other_part in zip(parts, other_parts, strict=True):
        has_placeholder = "{" in (part[:1], other_part[:1])
        if part != other_part and not has_placeholder:
            return False
    return True


SERVICES = PluginGroup("pointit.services", ServicePlugin, "service", has_ours=False)


def usable(name: str) -> ServicePlugin:
    """Return the installed plug-in `name`, whose rows are in the tables from now on.

    Raises:
        ConfigError: If it cannot be imported or used.
    """
    plugin = SERVICES.get(name)
    try:
        plugin.check(name)
    except Exception as error:  # an object of others, whose fields may be of any type
        reason = f"{type(error).__name__}: {error}"
        if isinstance(error, ConfigError):
            reason = str(error)
        label = SERVICES.label(name)
        raise ConfigError(f"{label} cannot be used: {reason}; update or uninstall it") from error
    plugin.add_rows()
    return plugin


def add_all_rows() -> None:
    """Add the rows of all installed plug-ins that can be used. The others are reported if named."""
    for name in SERVICES.names:
        with contextlib.suppress(ConfigError):
            usable(name)
