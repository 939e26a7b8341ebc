"""A ROS 2 bag (SQLite or MCAP) of the ROS toolkit as entries of a recording."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from pointit.conversion.bag_file import OpenBag, is_bag, open_bag, unpack_message
from pointit.conversion.bag_messages import ROUTES, BagMessages, BagRoute, UnusableError
from pointit.recording.entries import Entry, entry
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import remedy
from pointit.schemas import Environment, summarize_validation_error
from pointit.schemas.errors import KeyNameError
from pointit.schemas.topics import MAP, check_name

try:
    from pointit.bridges.ros2.types.types import Types
except ImportError as error:
    raise ConfigError(f"ROS 2 bags need {remedy('ros2')}") from error

MAX_BYTES = 1_000_000
"""Longer messages are left out unread."""

__all__ = ["Bag", "is_bag"]


@dataclass
class Bag:
    """A bag that is read once."""

    path: Path
    room: Environment | None = None
    """Map by which places on belts and strips become positions; without one they are left out."""
    taken: Counter[str] = field(default_factory=Counter[str])
    """Messages that were taken, by topic."""
    left_out: dict[str, str] = field(default_factory=dict[str, str])
    """Reasons why topics, or the first of their messages that were, are left out: by topic."""
    notes: list[str] = field(default_factory=list[str])
    """Sentences about what is missing in the bag."""

    def entries(self) -> Iterator[Entry]:
        """Yield the entries in the order of the bag.

        Raises:
            ConfigError: If it cannot be read.
        """
        try:
            with open_bag(self.path) as bag:
                self.notes += bag.notes
                if self.room is not None:
                    began_ns = bag.began_ns
                    yield entry(began_ns, MAP, "", self.room.model_copy(update={"stamp_ns": began_ns}))
                yield from self._read(bag)
        except OSError as error:
            raise ConfigError(f"{self.path}: cannot be read ({error.strerror or error})") from error

    def _read(self, bag: OpenBag) -> Iterator[Entry]:
        types, messages = Types("jazzy"), BagMessages(self.room)
        routes: dict[int, tuple[BagRoute, str]] = {}
        for connection in bag.connections:
            why, route, user = self._route(types, connection)
            if route is None:
                self.left_out[connection.topic] = why
            else:
                routes[connection.id] = route, user
        wanted = [each for each in bag.connections if each.id in routes]
        for connection, time_ns, data in bag.messages(wanted) if wanted else ():
            route, user = routes[connection.id]
            try:
                value = types.decode(route.type, unpack_message(bytes(data)), max_bytes=MAX_BYTES)
                yield from route.take(messages, value, user, max(0, time_ns))
            except ValidationError as error:
                self.left_out.setdefault(connection.topic, summarize_validation_error(error))
            except (UnusableError, KeyNameError, ValueError, OverflowError) as error:
                self.left_out.setdefault(connection.topic, str(error))
            else:
                self.taken[connection.topic] += 1

    def _route(self, types: Types, connection: Any) -> tuple[str, BagRoute | None, str]:
        for route in ROUTES:
            head, opening, tail = route.name.partition("{user}")
            name: str = connection.topic
            user = name[len(head) : len(name) - len(tail)] if opening else ""
            if f"{head}{user}{tail}" != name or bool(user) != bool(opening) or "/" in user:
                continue
            if connection.msgtype != route.type:
                return f"its type is {connection.msgtype}, not {route.type}", None, ""
            if connection.digest.startswith("RIHS01_") and connection.digest != types.kind(route.type).hash:
                return f"its definition of {route.type} is another one", None, ""
            if route.needs_map and self.room is None:
                return "its places need the room; give it by --map", None, ""
            try:
                return "", route, check_name(user) if user else ""
            except KeyNameError as error:
                return str(error), None, ""
        return "a recording has no place for it", None, ""
