"""The newest of every state, its retention and lookup, and the file of all, written atomically.

The newest is the last received: stamps of writers on different machines, or of another run's simulated time,
cannot be compared. States from disk are older than any received one.

No core: it writes a file.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from pydantic import Field

from pointit.runtime.config.config import Config
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import read_limited, write_atomically
from pointit.schemas import (
    NS_PER_S,
    DecodeError,
    Deployment,
    Environment,
    Localization,
    Message,
    SchemaError,
    SchemaModel,
    UserPose,
    decode,
    encode,
    topics,
)
from pointit.schemas.base import Many, Ns
from pointit.schemas.topics import TOPICS, Delivery, Topic

FILE = "states.msgpack"

NOT_RETAINED: tuple[Topic[Any], ...] = (
    topics.CLOCK,
    topics.LAMP_LEASES,
    topics.CONFIGURATION,
    topics.THING_STATES,
)
"""States that end with their writers."""


class FileConfig(Config):
    """Storage of states on disk, for a restarted keeper."""

    enabled: bool = Field(
        default=True, description="store states on disk, too, for a restart of this service"
    )
    write_every_s: float = Field(
        default=1.0,
        gt=0.0,
        le=60.0,
        description="shortest time between writes, s; newer states die with the process",
    )
    restore_within_s: float = Field(
        default=600.0, ge=0.0, le=86_400.0, description="largest age of states that are restored, s"
    )


class KeeperConfig(Config):
    """Amount of retained states and their retention times."""

    forget_person_after_s: float = Field(
        default=30.0,
        ge=0.0,
        le=3600.0,
        description="retention of a person's states after their last service has left, s; they "
        "are not handed out meanwhile",
    )
    forget_deployment_after_s: float = Field(
        default=86_400.0,
        ge=0.0,
        le=604_800.0,
        description="retention of what `run` or `user` has started after its last service has left"
        ", s; `doctor` reports it as missing meanwhile, until it is started again and ended by Ctrl-C",
    )
    forget_site_after_s: float = Field(
        default=3600.0,
        ge=0.0,
        le=604_800.0,
        description="retention of shared states after the last of their possible writers has left, s",
    )
    max_values: int = Field(default=4096, ge=1, le=65_536, description="largest number of states")
    max_mb: float = Field(default=32.0, ge=1.0, le=64.0, description="largest total size of states, MB")
    file: FileConfig = Field(default=FileConfig(), description="storage on disk")


class StoredState(SchemaModel):
    """One encoded state."""

    key: str
    """Key of its topic."""
    name: str
    schema_name: str
    payload: bytes


class StateRecord(SchemaModel):
    """All stored states."""

    max_bytes: ClassVar[int] = 80 * 1024 * 1024
    """More than the largest `max_mb`."""

    stamp_ns: Ns
    states: Many[StoredState] = ()


def read(path: Path) -> StateRecord | None:
    """Return the record in the file at `path`, or None if there is no file.

    Raises:
        ConfigError: If there is a file but it cannot be read or used; names the file.
    """
    try:
        return decode(StateRecord, read_limited(path, StateRecord.max_bytes + 1))
    except FileNotFoundError:
        return None
    except DecodeError as error:
        raise ConfigError(f"{path}: cannot be used and will be overwritten ({error})") from error


def write(path: Path, record: StateRecord) -> None:
    """Replace the file by `record`, readable by its owner only.

    Raises:
        ConfigError: If it cannot be written; names the file.
    """
    write_atomically(path, encode(record))


def retained() -> tuple[Topic[Any], ...]:
    """Return the topics of retained states, with those that services of other packages have added."""
    states = [topic for topic in TOPICS if topic.delivery is Delivery.STATE]
    return tuple(topic for topic in states if topic not in NOT_RETAINED)


def dies_with_writer(message: Message) -> bool:
    """Return True if `message` must not outlive its writer."""
    if isinstance(message, UserPose):
        return message.method == "external"
    if isinstance(message, Deployment):
        return not message.services
    return isinstance(message, Localization) and message.phase == "sampling"


def is_personal(topic: Topic[Any]) -> bool:
    """Return True if `topic` belongs to a person and is not handed out while they are absent."""
    return topic.placeholder == "user"


@dataclass(slots=True)
class _Value:
    topic: Topic[Any]
    message: Message
    payload: bytes
    owned_ns: int
    """Last time at which an owner was known to be present."""


class RetainedStates:
    """Stores states within limits of number, size and time, in the order of arrival."""

    def __init__(self, config: KeeperConfig) -> None:
        self._max_values = config.max_values
        self._max_bytes = int(config.max_mb * 1e6)
        self._person_ns = int(config.forget_person_after_s * NS_PER_S)
        self._deployment_ns = int(config.forget_deployment_after_s * NS_PER_S)
        self._site_ns = int(config.forget_site_after_s * NS_PER_S)
        self._values: dict[tuple[str, str], _Value] = {}
        self._users: set[str] = set()
        self._instances: set[str] = set()
        self._lamps: frozenset[str] = frozenset()
        """The map's lamps. States of other lamps are evicted first."""
        self.size = 0
        """Total size of the stored states, bytes."""
        self.refused = 0
        """Number of states that were not stored, as the limits were reached."""
        self.changes = 0
        """Number of changes of the stored states."""

    def __len__(self) -> int:
        return len(self._values)

    def take(self, topic: Topic[Any], name: str, message: Message, now_ns: int) -> None:
        """Store `message` under `name`, or only drop the old state if it must not be retained."""
        self._forget((topic.key, name))
        if isinstance(message, Environment):
            self._lamps = frozenset(lamp.id for lamp in message.lamps)
        if isinstance(message, Deployment):
            message = message.believed(name)
            if message.scenario:
                self._forget_scenarios()
        if not dies_with_writer(message):
            self._store(topic, name, message, encode(message), now_ns)

    def _forget_scenarios(self) -> None:
        """Drop the deployments of scenarios: a site runs one at a time. People come and go independently."""
        for key, value in list(self._values.items()):
            if isinstance(value.message, Deployment) and value.message.scenario:
                self._forget(key)

    def set_user(self, user: str, now_ns: int, *, present: bool) -> None:
        """Update the presence of a person."""
        self.expire(now_ns)  # users were present until now
        if present:
            self._users.add(user)
        else:
            self._users.discard(user)

    def set_instance(self, instance: str, now_ns: int, *, present: bool) -> None:
        """Update the presence of a service."""
        self.expire(now_ns)
        if present:
            self._instances.add(instance)
        else:
            self._instances.discard(instance)

    def lookup(self, topic: Topic[Any]) -> Iterator[tuple[str, Message]]:
        """Yield name and value of the states of `topic` that may be handed out."""
        for (key, name), value in list(self._values.items()):
            if key != topic.key:
                continue
            if not is_personal(topic) or self._is_owned(name, value):
                yield name, value.message

    def expire(self, now_ns: int) -> None:
        """Drop states whose owners have been absent for too long."""
        for (key, name), value in list(self._values.items()):
            if self._is_owned(name, value) or value.owned_ns > now_ns:  # the clock was set back
                value.owned_ns = now_ns
            elif now_ns - value.owned_ns >= self._limit_ns(value.topic):
                self._forget((key, name))

    def record(self, now_ns: int) -> StateRecord:
        """Return the record for the next keeper."""
        states: list[StoredState] = []
        for (key, name), value in self._values.items():
            schema_name = value.topic.message.schema_name()
            states.append(StoredState(key=key, name=name, schema_name=schema_name, payload=value.payload))
        return StateRecord(stamp_ns=now_ns, states=tuple(states))

    def restore(self, record: StateRecord, now_ns: int) -> int:
        """Restore the states of `record` that are not replaced yet. Return the number of unusable ones."""
        unusable = 0
        topics_by_key = {topic.key: topic for topic in retained()}
        for state in record.states:
            # Unusable: of another version, or damaged
            topic = topics_by_key.get(state.key)
            if topic is None:
                unusable += 1
                continue
            try:
                topic.at(state.name)
                message = decode(topic.message, state.payload, state.schema_name)
            except SchemaError:
                unusable += 1
                continue

            # A state that has been received since the start is newer
            is_replaced = (topic.key, state.name) in self._values
            if not is_replaced and not dies_with_writer(message):
                self._store(topic, state.name, message, state.payload, now_ns)
        return unusable

    def _store(self, topic: Topic[Any], name: str, message: Message, payload: bytes, now_ns: int) -> None:
        """Store a state, in place of the oldest ones that can be evicted. If there are none, refuse it."""
        while len(self._values) >= self._max_values or self.size + len(payload) > self._max_bytes:
            evictable = self._first_evictable()
            if evictable is None:
                self.refused += 1
                return
            self._forget(evictable)
        value = _Value(topic, message, payload, now_ns)
        self._values[topic.key, name] = value
        self.size += len(payload)
        self.changes += 1

    def _limit_ns(self, topic: Topic[Any]) -> int:
        """Return the retention time of a state whose owners are absent, ns."""
        if is_personal(topic):
            return self._person_ns
        return self._deployment_ns if topic is topics.DEPLOYMENT else self._site_ns

    def _first_evictable(self) -> tuple[str, str] | None:
        """Return the key of the oldest state that can be evicted, or None."""
        for key, value in self._values.items():
            _topic_key, name = key
            if self._is_evictable(name, value):
                return key
        return None

    def _is_evictable(self, name: str, value: _Value) -> bool:
        """Return True if a state is of a lamp of no map, or of somebody who is absent."""
        if value.topic is topics.LAMP_COLOR:
            return name not in self._lamps
        may_be_left = is_personal(value.topic) or value.topic is topics.DEPLOYMENT
        return may_be_left and not self._is_owned(name, value)

    def _forget(self, key: tuple[str, str]) -> None:
        value = self._values.pop(key, None)
        if value is not None:
            self.size -= len(value.payload)
            self.changes += 1

    def _is_owned(self, name: str, value: _Value) -> bool:
        """Return True if an owner is present: the person, a service of the deployment, or a writer."""
        if is_personal(value.topic):
            return name in self._users
        if isinstance(value.message, Deployment):
            for service in value.message.services:
                instance = f"{service.service}.{service.user}" if service.user else service.service
                if instance in self._instances:
                    return True
            return False
        for instance in self._instances:
            service_name, _, _ = instance.partition(".")
            if service_name in value.topic.writers:
                return True
        return False
