"""Departed people and services, and their last states; pure.

Late messages about people who have left, as the end of their cursor, must not bring them back, nor a
service's last report. People who return after a restart or a lost router do not repeat their states, which
are kept here.
"""

import collections
from typing import Any

from pointit.schemas import Message
from pointit.schemas.topics import Delivery, Topic

MAX_REMEMBERED = 1000
"""Maximum number of names; the oldest are evicted first."""

States = tuple[tuple[Topic[Any], Message], ...]


class PresenceCache:
    """Remembers the states of people, or of services, and their departures."""

    def __init__(self, placeholder: str) -> None:
        """Create an empty cache. Unknown names count as present.

        Args:
            placeholder: placeholder of their topics. All other topics pass.
        """
        self._placeholder = placeholder
        self._gone: collections.OrderedDict[str, None] = collections.OrderedDict()
        self._states: collections.OrderedDict[str, dict[Topic[Any], Message]] = collections.OrderedDict()

    def admits(self, topic: Topic[Any], message: Message, name: str) -> bool:
        """Store a message about `name`. Return True if it is to be shown now."""
        if topic.placeholder != self._placeholder:
            return True
        if topic.delivery is Delivery.STATE:
            self._states.setdefault(name, {})[topic] = message
            if len(self._states) > MAX_REMEMBERED:
                self._states.popitem(last=False)
        return name not in self._gone

    def on_join(self, name: str) -> States:
        """Record an arrival. Return the states to publish if the name had left."""
        if name not in self._gone:
            return ()
        del self._gone[name]
        return tuple(self._states.get(name, {}).items())

    def on_leave(self, name: str) -> None:
        """Record a departure."""
        self._gone[name] = None
        if len(self._gone) > MAX_REMEMBERED:
            self._gone.popitem(last=False)
