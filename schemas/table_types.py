"""Types of the rows of the topic table: key, message and delivery."""

import re
import unicodedata
from dataclasses import dataclass
from enum import Enum
from typing import Generic, Protocol, TypeVar

from pointit.schemas.base import NAME_PATTERN, KeyNameError, Message, Query, Reply

M = TypeVar("M", bound=Message)
Q = TypeVar("Q", bound=Query)
R = TypeVar("R", bound=Reply)

ANY = "*"
"""Stands for every name of a placeholder when subscribing."""

MAX_AGE_PERIODS = 10
"""Largest age of the newest message of a topic, in its nominal periods."""

NAME = re.compile(rf"{NAME_PATTERN}\Z")
"""Valid values of a placeholder."""

_PLACEHOLDER = re.compile(r"\{(\w+)\}")


class Delivery(Enum):
    """Delivery guarantee between a writer and its readers."""

    LATEST = "latest"
    """Newest wins: never queues, never blocks the sender."""
    EVENT = "event"
    """Reliable and ordered; an overflow is counted and reported, never silent."""
    STATE = "state"
    """Reliable. Late joiners get the last value at once."""


@dataclass(frozen=True, kw_only=True)
class _Keyed:
    """A key pattern with at most one placeholder."""

    key: str

    @property
    def placeholder(self) -> str:
        """Return the placeholder's name (`user` of `users/{user}/imu`), or `""` without one."""
        match = _PLACEHOLDER.search(self.key)
        return match.group(1) if match else ""

    def at(self, name: str = "") -> str:
        """Return the key for `name`, or for all names when it is `*`.

        Raises:
            KeyNameError: `name` is missing, not wanted, or cannot stand in a key.
        """
        placeholder = self.placeholder
        if not placeholder:
            if name not in ("", ANY):
                raise KeyNameError(f"{self.key} takes no name, got {name!r}")
            return self.key
        if name != ANY:
            check_name(name, placeholder)
        return self.key.replace("{" + placeholder + "}", name)

    def name_in(self, key: str) -> str:
        """Return the value of the placeholder in `key`, or `""` if there is none or it is another key."""
        if not self.placeholder:
            return ""
        slot = "{" + self.placeholder + "}"
        head, _, tail = self.key.partition(slot)
        if not key.startswith(head) or not key.endswith(tail):
            return ""
        return key[len(head) : len(key) - len(tail)]


def check_name(name: str, what: str = "name") -> str:
    """Return `name` if it can stand in a key.

    Raises:
        KeyNameError: Names the valid characters, and a valid name.
    """
    if not NAME.match(name):
        example = valid_name(name) or "a1"
        raise KeyNameError(
            f"{what} {name!r}: use 1 to 64 letters, digits, '_', '-' or '.', no leading '-' or '.', "
            f"such as {example}"
        )
    return name


def fill_key(key: str, user: str = "") -> str:
    """Return the key pattern `key` as people read it: with `user`, and `*` for every other placeholder."""

    def value(placeholder: re.Match[str]) -> str:
        if placeholder[1] == "user" and user:
            return user
        return ANY

    return _PLACEHOLDER.sub(value, key)


def valid_name(text: str) -> str:
    """Return a name like `text` that can stand in a key, `""` if it has neither letters nor digits."""
    letters = unicodedata.normalize("NFKD", text)  # an accent is a letter of its own
    plain = "".join(letter for letter in letters if not unicodedata.combining(letter))
    name = re.sub(r"[^A-Za-z0-9_.-]+", "_", plain).lstrip("-.")[:64]
    if name == text:
        return name
    return name if name.strip("_.-") else ""


@dataclass(frozen=True, kw_only=True)
class Topic(_Keyed, Generic[M]):
    """A row of the table of topics: a key expression, its message, how it is delivered, and who may write it.

    Everybody who publishes or reads names the row, never a key, so that a key has one place, and access
    rules, documents and checks are made from the table. The key of a topic for each person has a placeholder:

    >>> from pointit.schemas import topics
    >>> topics.RAY.at("anna")
    'users/anna/ray'
    >>> topics.RAY.message.__name__, topics.RAY.delivery.name
    ('PointingRay', 'LATEST')

    `delivery` decides what a slow reader loses: of `LATEST` all but the newest, of `EVENT` nothing up to a
    limit, and of `STATE` nothing either, since the newest value is also kept for readers that come later.
    """

    message: type[M]
    delivery: Delivery
    rate_hz: float | None
    """Nominal rate. None if messages are published on change."""
    writers: tuple[str, ...]
    """Processes that may write it, as in the registry; `external`: a foreign tracker may too."""
    about: str

    @property
    def stale_after_s(self) -> float | None:
        """Return the age (s) from which the newest message counts as stale."""
        return None if self.rate_hz is None else MAX_AGE_PERIODS / self.rate_hz


@dataclass(frozen=True, kw_only=True)
class Request(_Keyed, Generic[Q, R]):
    """A row of the table of requests: one process asks another, which answers once.

    It is for what must be confirmed or refused, such as `conveyor/set_speed`; what is only to be known is a
    `Topic`. `bus.call(row, query)` asks, `bus.serve(row, handler)` answers, and an exception of the handler
    becomes one sentence for the caller. Exactly one process serves a row on a site (`server`).
    """

    query: type[Q]
    reply: type[R]
    server: str
    about: str


@dataclass(frozen=True, kw_only=True)
class Presence(_Keyed):
    """A token that exists exactly as long as its owner."""

    about: str


class PresenceHandler(Protocol):
    """Takes a name of a presence, and whether it is present now."""

    def __call__(self, name: str, /, *, present: bool) -> object:
        """Process the change."""
        ...
