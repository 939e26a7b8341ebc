"""Who has gone, and what was heard of whom; pure.

What others say of somebody who has left, as that their cursor has ended, brings nobody back. Who returns,
after a restart or because a router was lost, does not say their states again: who has heard them knows them.
"""

import collections
from typing import Any

from pointit.schemas import Message
from pointit.schemas.topics import Delivery, Topic

MOST_PEOPLE = 1000
"""Who are remembered; those heard of first are forgotten first."""

States = tuple[tuple[Topic[Any], Message], ...]


class Attendance:
    """Remembers the states of people, and who has left."""

    def __init__(self) -> None:
        """Begin with nobody; who was never here has not left."""
        self._gone: collections.OrderedDict[str, None] = collections.OrderedDict()
        self._states: collections.OrderedDict[str, dict[Topic[Any], Message]] = collections.OrderedDict()

    def admits(self, topic: Topic[Any], message: Message, name: str) -> bool:
        """Take what came under `name`; return whether it is to be shown now."""
        if topic.placeholder != "user":
            return True
        if topic.delivery is Delivery.STATE:
            self._states.setdefault(name, {})[topic] = message
            if len(self._states) > MOST_PEOPLE:
                self._states.popitem(last=False)
        return name not in self._gone

    def come(self, user: str) -> States:
        """Take that somebody is here; return what is to be shown of them who had left."""
        if user not in self._gone:
            return ()
        del self._gone[user]
        return tuple(self._states.get(user, {}).items())

    def go(self, user: str) -> None:
        """Take that somebody has left."""
        self._gone[user] = None
        if len(self._gone) > MOST_PEOPLE:
            self._gone.popitem(last=False)
