"""Shares of people: the persons whom each instance of a service serves, if it runs in shards.

The default instance serves everybody whom no shard serves. Shards are further instances, best on the host of
their people, so that rays and cursors cross a link only to who looks at them. The default instance learns of
them by their presence: when a shard ends or is cut off, its people are served by the default instance again.
For a moment both may serve a person, so that two write the same: readers take the newer by stamp.
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

FORGET_S = 120.0
"""Silence after which the default instance no longer reads a person who is not present, s."""
M = TypeVar("M", bound=Message)
Q = TypeVar("Q", bound=Query)
R = TypeVar("R", bound=Reply)

log = logging.getLogger(__name__)


class PeopleShare:
    """Reader and server of the people of one instance: those of a shard, or those whom no shard serves.

    The default instance has one subscription for all people, as long as there is no shard of its service.
    With shards it reads each person by themselves in topics of class *latest*, so that what shards read does
    not travel here. It then knows people by `USER_ALIVE`, by their states and events, and whom it has heard
    within `FORGET_S`: of somebody else it hears no *latest* topic. Health tells how many people it reads.
    States and events it hears of all people, in order and without gaps, and hands on those of the people whom
    it serves; when it takes a person over, the newest of each state.
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
        """Serve `people`, after `announce`, or all whom no shard serves; must be called in the loop.

        `people` are those of a shard, empty for the default instance; `name` is its own, or `""`.
        `lost` is called in the default instance with a person whom a shard serves from now on.

        Raises:
            ConfigError: A shard has no name or no people, or nobody may be called so.
        """
        check_people(service, people, name)
        self._bus = bus
        self._service = service
        self._mine = frozenset(people)
        self._lost = lost
        self._here: set[str] = set()
        """People known to the default instance."""
        self._present: set[str] = set()
        """Those of them who are present."""
        self._leaving: set[str] = set()
        """Those of them who are forgotten when they are silent, unless they come back."""
        self._remote_users: set[str] = set()
        """People whom shards serve."""
        self._splits: list[_Split] = []
        self._states: list[_States[Any]] = []
        self._names: Collection[str] = () if people else (ANY,)
        """People, or `*` for all, of whom is read what is read of each."""
        self._tokens: list[Closable] = []
        if not people:
            bus.watch(SHARD_ALIVE, self._on_shard)
            bus.watch(USER_ALIVE, self._on_user)

    def serves(self, user: str) -> bool:
        """Return True if this instance serves the person `user`."""
        return user in self._mine if self._mine else user not in self._remote_users

    def subscribe(
        self, topic: Topic[M], handler: Handler[M], *, drops_late: Callable[[M], object] | None = None
    ) -> None:
        """Call `handler(message, user)` for what arrives on `topic` of each person served."""
        if not self._mine and topic.delivery is not Delivery.LATEST:
            states = _States(handler, self._is_subscribed, keeps=topic.delivery is Delivery.STATE)
            self._states.append(states)
            self._bus.subscribe(topic, states.on_message, drops_late=drops_late)
        else:
            self._add(lambda name: self._bus.subscribe(topic, handler, name, drops_late=drops_late))

    def serve(self, request: Request[Q, R], server: Server[Q, R]) -> None:
        """Answer `request` for each person served; nobody else's is answered here."""
        self._add(lambda name: self._bus.serve(request, server, name))

    async def announce(self) -> None:
        """Begin to serve the people of a shard. Nothing happens in the default instance, or if it does.

        It takes `LISTEN_S`, and `SILENT_S` more if another shard seems to serve one of them: if it goes on,
        that is a warning in health.
        """
        if not self._mine or self._tokens:
            return
        tokens = {instance_of(self._service, user): user for user in sorted(self._mine)}
        twice = tokens.keys() & await list_present(self._bus, SHARD_ALIVE, LISTEN_S)
        if twice:  # who died is present till its lease ends
            twice &= await list_present(self._bus, SHARD_ALIVE, SILENT_S)
        if twice:
            both = ", ".join(tokens[token] for token in sorted(twice))
            problem = f"another shard of {self._service} serves {both}, too: end both, and start one again"
            log.warning("%s", problem)
            self._bus.warn("shards", problem)
        self._follow(self._mine)
        self._tokens = [self._bus.announce(SHARD_ALIVE, token) for token in tokens]

    def withdraw(self) -> None:
        """Leave the people of a shard to the default instance, until `announce`."""
        while self._tokens:
            self._tokens.pop().close()
            self._follow(())

    def _add(self, declare: Callable[[str], Closable]) -> None:
        split = _Split(declare)
        self._splits.append(split)
        split.follow(self._names)

    def _follow(self, names: Collection[str]) -> None:
        self._names = names
        for split in self._splits:
            split.follow(names)

    def _share(self) -> None:
        if self._remote_users and ANY in self._names:
            for user in filter(_is_person, self._received_users()):
                self._here.add(user)
                self._forget_later(user)
        self._follow(self._here - self._remote_users if self._remote_users else {ANY})
        for figure, people in (("people heard", self._names), ("people of shards", self._remote_users)):
            self._bus.set_metric(figure, len(people) if self._remote_users else None)

    def _received_users(self) -> set[str]:
        return {user for split in self._splits for user in split.heard(FORGET_S)}

    def _on_user(self, user: str, present: bool) -> None:  # noqa: FBT001 - the bus's signature
        if present and _is_person(user):
            self._present.add(user)
            self._here.add(user)
            self._share()
        elif user in self._here:
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
            self._here.discard(user)
            self._share()

    def _is_subscribed(self, user: str) -> bool:
        """Note that the default instance hears of `user`. Return True if it serves them."""
        if user not in self._here and _is_person(user):
            self._here.add(user)
            self._share()
        return user not in self._remote_users

    def _on_shard(self, name: str, present: bool) -> None:  # noqa: FBT001 - the bus's signature
        service, user = split_instance(name)
        if service != self._service or not _is_person(user):
            return
        if present:
            self._remote_users.add(user)
            self._share()
            if self._lost is not None:
                self._lost(user)
            return
        self._remote_users.discard(user)
        self._share()
        for states in self._states:
            states.repeat(user)


class _Split:
    """One reader or server, declared for all people at once or for each by themselves."""

    def __init__(self, declare: Callable[[str], Closable]) -> None:
        self._declare = declare
        self._declared: dict[str, Closable] = {}

    def follow(self, names: Iterable[str]) -> None:
        """Be declared for exactly `names`; the new ones first, so that nobody is unheard between."""
        wanted = set(names)
        for name in sorted(wanted - self._declared.keys()):
            self._declared[name] = self._declare(name)
        for name in self._declared.keys() - wanted:
            self._declared.pop(name).close()

    def heard(self, within_s: float) -> Iterator[str]:
        """Yield the people whose streams were heard in the last `within_s` seconds."""
        for declared in self._declared.values():
            if isinstance(declared, MeteredSubscription):
                yield from declared.heard(within_s)


class _States(Generic[M]):
    """States or events of all people, handed on for those who are served."""

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
        """Hand on the newest state of `user`, who is served from now on."""
        message = self._newest.get(user)
        if message is not None:
            self._handler(message, user)


def _is_person(user: str) -> bool:
    try:
        return bool(check_user(user))
    except KeyNameError:
        return False


def check_people(service: str, people: Sequence[str], name: str) -> None:
    """Check the people of an instance called `name`, or of the default one.

    Raises:
        ConfigError: What is wrong, and what to do.
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
