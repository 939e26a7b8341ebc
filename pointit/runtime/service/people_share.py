"""Shares of users: the users that each instance of a service serves if it runs in shards.

The default instance serves all users without a shard. Shards are further instances. They should run on the
host of their users, so that rays and cursors cross a link only to viewers. The default instance detects
shards by their presence: when a shard ends or is disconnected, the default instance serves its users again.
For a moment both may serve a user and write the same topics. Readers then accept the message with the newer
stamp.
"""

import logging
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from typing import Any, Generic, TypeVar

from pointit.runtime.bus.contract import Closable, Handler, Server, list_present
from pointit.runtime.bus.instrumented import MeteredSubscription
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.instance_takeover import LISTEN_S, SILENT_S
from pointit.schemas import KeyNameError, Message, Query, Reply
from pointit.schemas.system import check_user, instance_of, split_instance
from pointit.schemas.topics import ANY, SHARD_ALIVE, USER_ALIVE, Delivery, Request, Topic, check_name

log = logging.getLogger(__name__)

M = TypeVar("M", bound=Message)
Q = TypeVar("Q", bound=Query)
R = TypeVar("R", bound=Reply)

FORGET_S = 120.0
"""Time without a message after which the default instance stops reading an absent user, s."""


class PeopleShare:
    """Reader and server for the users of one instance: those of a shard, or those without a shard.

    Without shards, the default instance has one subscription for all users. With shards, it subscribes to
    *latest* topics for each user separately, so that messages for shards do not travel here. It then knows
    the users with a `USER_ALIVE` token, with states or events, or with a message within `FORGET_S`, and
    receives no *latest* topic of others. Health shows the number of users that it reads. It receives the
    states and events of all users, in order and without gaps, and delivers those of the users that it serves.
    When it takes a user over, it delivers the newest value of each state.
    """

    def __init__(
        self,
        bus: ServiceBus,
        service: str,
        people: Sequence[str] = (),
        *,
        name: str = "",
        lost: Callable[[str], None] | None = None,
    ) -> None:
        """Serve `people` after `announce`, or all users without a shard. Call this in the loop.

        `people` are the users of a shard, empty for the default instance. `name` is the instance's name, or
        `""`. The default instance calls `lost` with each user that a shard takes over.

        Raises:
            ConfigError: If a shard has no name or no users, or if a user's name is invalid.
        """
        check_people(service, people, name)
        self._bus = bus
        self._service = service
        self._own_users = frozenset(people)
        self._lost = lost
        self._known_users: set[str] = set()
        """Users known to the default instance."""
        self._present: set[str] = set()
        """Known users that are present."""
        self._leaving: set[str] = set()
        """Known users that are removed after a silence, unless they return."""
        self._remote_users: set[str] = set()
        """Users that shards serve."""
        self._splits: list[_Split] = []
        self._states: list[_States[Any]] = []
        self._names: Collection[str] = () if people else (ANY,)
        """Users whose per-user topics are subscribed. `*` for all."""
        self._tokens: list[Closable] = []
        if not people:
            bus.watch(SHARD_ALIVE, self._on_shard)
            bus.watch(USER_ALIVE, self._on_user)

    def serves(self, user: str) -> bool:
        """Return True if this instance serves `user`."""
        return user in self._own_users if self._own_users else user not in self._remote_users

    def subscribe(
        self, topic: Topic[M], handler: Handler[M], *, drops_late: Callable[[M], object] | None = None
    ) -> None:
        """Call `handler(message, user)` for each message on `topic` of the served users."""
        if not self._own_users and topic.delivery is not Delivery.LATEST:
            states = _States(handler, self._is_subscribed, keeps=topic.delivery is Delivery.STATE)
            self._states.append(states)
            self._bus.subscribe(topic, states.on_message, drops_late=drops_late)
        else:
            self._add(lambda name: self._bus.subscribe(topic, handler, name, drops_late=drops_late))

    def serve(self, request: Request[Q, R], server: Server[Q, R]) -> None:
        """Answer `request` for the served users only."""
        self._add(lambda name: self._bus.serve(request, server, name))

    async def announce(self) -> None:
        """Start to serve the users of a shard. Does nothing in the default instance, or if called again.

        It takes `LISTEN_S`, and `SILENT_S` more if another shard seems to serve one of the users. If that
        shard continues, health shows a warning.
        """
        if not self._own_users or self._tokens:
            return
        tokens = {instance_of(self._service, user): user for user in sorted(self._own_users)}
        duplicates = tokens.keys() & await list_present(self._bus, SHARD_ALIVE, LISTEN_S)
        if duplicates:  # a process that died is present until its lease ends
            duplicates &= await list_present(self._bus, SHARD_ALIVE, SILENT_S)
        if duplicates:
            users = ", ".join(tokens[token] for token in sorted(duplicates))
            problem = f"another shard of {self._service} serves {users}, too: end both, and start one again"
            log.warning("%s", problem)
            self._bus.warn("shards", problem)
        # Subscribe before the tokens: with them, the default instance stops to serve these users
        self._subscribe_to(self._own_users)
        self._tokens = [self._bus.announce(SHARD_ALIVE, token) for token in tokens]

    def withdraw(self) -> None:
        """Return the users of a shard to the default instance, until `announce`."""
        while self._tokens:
            self._tokens.pop().close()
            self._subscribe_to(())

    def _add(self, declare: Callable[[str], Closable]) -> None:
        split = _Split(declare)
        self._splits.append(split)
        split.follow(self._names)

    def _subscribe_to(self, names: Collection[str]) -> None:
        self._names = names
        for split in self._splits:
            split.follow(names)

    def _update_share(self) -> None:
        if self._remote_users and ANY in self._names:
            for user in filter(_is_person, self._received_users()):
                self._known_users.add(user)
                self._forget_later(user)
        self._subscribe_to(self._known_users - self._remote_users if self._remote_users else {ANY})
        for figure, people in (("people heard", self._names), ("people of shards", self._remote_users)):
            self._bus.set_metric(figure, len(people) if self._remote_users else None)

    def _received_users(self) -> set[str]:
        users = set[str]()
        for split in self._splits:
            users.update(split.active_names(FORGET_S))
        return users

    def _on_user(self, user: str, *, present: bool) -> None:
        if present and _is_person(user):
            self._present.add(user)
            self._known_users.add(user)
            self._update_share()
        elif user in self._known_users:
            self._present.discard(user)
            self._forget_later(user)

    def _forget_later(self, user: str) -> None:
        if user not in self._leaving and user not in self._present:
            self._leaving.add(user)
            self._bus.call_later(FORGET_S, lambda: self._forget(user))

    def _forget(self, user: str) -> None:
        self._leaving.discard(user)
        if user in self._received_users():
            self._forget_later(user)
        elif user not in self._present:
            self._known_users.discard(user)
            self._update_share()

    def _is_subscribed(self, user: str) -> bool:
        """Record a message of `user` in the default instance. Return True if it serves them."""
        if user not in self._known_users and _is_person(user):
            self._known_users.add(user)
            self._update_share()
        return user not in self._remote_users

    def _on_shard(self, name: str, *, present: bool) -> None:
        service, user = split_instance(name)
        if service != self._service or not _is_person(user):
            return
        if present:
            self._remote_users.add(user)
            self._update_share()
            if self._lost is not None:
                self._lost(user)
            return
        self._remote_users.discard(user)
        self._update_share()
        for states in self._states:
            states.repeat(user)


class _Split:
    """One reader or server, declared for all users together or for each separately."""

    def __init__(self, declare: Callable[[str], Closable]) -> None:
        self._declare = declare
        self._declared: dict[str, Closable] = {}

    def follow(self, names: Iterable[str]) -> None:
        """Declare for exactly `names`. New ones come first, so that no user is missed in between."""
        required = set(names)
        for name in sorted(required - self._declared.keys()):
            self._declared[name] = self._declare(name)
        for name in self._declared.keys() - required:
            self._declared.pop(name).close()

    def active_names(self, within_s: float) -> Iterator[str]:
        """Yield the users with a message in the last `within_s` seconds."""
        for declared in self._declared.values():
            if isinstance(declared, MeteredSubscription):
                yield from declared.active_names(within_s)


class _States(Generic[M]):
    """States or events of all users, delivered for those that are served."""

    def __init__(self, handler: Handler[M], is_subscribed: Callable[[str], bool], *, keeps: bool) -> None:
        self._handler = handler
        self._is_subscribed = is_subscribed
        self._keeps = keeps
        self._newest: dict[str, M] = {}

    def on_message(self, message: M, user: str) -> None:
        if self._keeps:
            self._newest[user] = message
        if self._is_subscribed(user):
            self._handler(message, user)

    def repeat(self, user: str) -> None:
        """Deliver the newest state of `user`, who is served from now on."""
        message = self._newest.get(user)
        if message is not None:
            self._handler(message, user)


def _is_person(user: str) -> bool:
    try:
        return bool(check_user(user))
    except KeyNameError:
        return False


def check_people(service: str, people: Sequence[str], name: str) -> None:
    """Check the users of the instance `name`, or of the default one.

    Raises:
        ConfigError: If the users do not fit the instance. The message contains the remedy.
    """
    if name and not people:
        raise ConfigError(
            f"people: name whom {service}.{name} serves; all whom no shard serves are those of {service}"
        )
    if people and not name:
        raise ConfigError(f"people: only an instance with a name of its own has some: start {service}.NAME")
    for user in people:
        try:
            check_name(instance_of(service, check_user(user)))
        except KeyNameError as error:
            raise ConfigError(f"people: {error}") from error
    if len(set(people)) < len(people):
        raise ConfigError(f"people: each once, got {', '.join(people)}")
