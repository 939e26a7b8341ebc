"""Scene and log of a site that a test writes."""

from pointit.bridges.foxglove.event_log import EventLog, LogLine
from pointit.bridges.foxglove.scene import FoxgloveScene
from pointit.schemas import Message
from pointit.schemas.topics import TOPICS
from pointit.site.site_state import Change, SiteState

TOPIC_OF = {topic.message: topic for topic in TOPICS}


class SiteScene(FoxgloveScene):
    def __init__(self) -> None:
        self.site = SiteState(self.show)
        super().__init__(self.site)

    def take(self, message: Message, name: str, now_s: float) -> None:
        self.site.take(TOPIC_OF[type(message)], name, message, now_s)


class SiteLog(EventLog):
    def __init__(self) -> None:
        self.site = SiteState(self._on_change)
        super().__init__(self.site)
        self._now_ns, self._new = 0, list[LogLine]()

    def hear(self, message: Message, name: str, now_ns: int) -> list[LogLine]:
        """Return the new lines from `message`."""
        self._now_ns = now_ns
        self._new = []
        self.site.take(TOPIC_OF[type(message)], name, message, 0.0)
        return self._new

    def _on_change(self, change: Change) -> None:
        self._new += self.take(change, self._now_ns)
