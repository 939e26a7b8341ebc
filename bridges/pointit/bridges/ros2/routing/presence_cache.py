"""Who has gone, and what was heard of whom; pure.

What others say of somebody who has left, as that their cursor has ended, brings nobody back; nor does a
service's last report that comes after it has gone. Who returns,
after a restart or because a router was lost, does not say their states again: who has heard them knows them.
"""

import collections
from typing import Any

from pointit.schemas import Message
from pointit.schemas.topics import Delivery, Topic

MOST_REMEMBERED = 1000
"""Those heard of first are forgotten first."""

States = tuple[tuple[Topic[Any], Message], ...]


class PresenceCache:
    """Remembers the states of people, or of services, and who has left."""

    def __init__(self, placeholder: str) -> None:
        """Begin with nobody; who was never here has not left.

        Args:
            placeholder: of the topics that tell of them; all others are let through.
        """
        self._placeholder = placeholder
        self._gone: collections.OrderedDict[str, None] = collections.OrderedDict()
        self._states: collections.OrderedDict[str, dict[Topic[Any], Message]] = collections.OrderedDict()

    def admits(self, topic: Topic[Any], message: Message, name: str) -> bool:
        """Take what came under `name`. Return True if it is to be shown now."""
        if topic.placeholder != self._placeholder:
            return True
        if topic.delivery is Delivery.STATE:
            self._states.setdefault(name, {})[topic] = message
            if len(self._states) > MOST_REMEMBERED:
                self._states.popitem(last=False)
        return name not in self._gone

    def on_join(self, name: str) -> States:
        """Take that somebody is here; return what is to be shown of them who had left."""
        if name not in self._gone:
            return ()
        del self._gone[name]
        return tuple(self._states.get(name, {}).items())

    def on_leave(self, name: str) -> None:
        """Take that somebody has left."""
        self._gone[name] = None
        if len(self._gone) > MOST_REMEMBERED:
            self._gone.popitem(last=False)
