"""Memory of a person's pointing: cursors, objects, robots, people and words in; referents on request."""

from collections.abc import Callable
from typing import ClassVar, TypeVar

from pointit.errors import RefusedError
from pointit.geometry.floor_sigma import yaw_sigma_rad
from pointit.runtime.config.config import Config
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas import NS_PER_S, Cursor, FindReferents, Message, Referents, Speech, topics
from pointit.schemas.text import round_beyond
from pointit.services.listener.referents import RecogniserClock, Room, Spoken, referents
from pointit.services.listener.stays import MEMORY_S, PointingMemory

M = TypeVar("M", bound=Message)

AHEAD_S = 0.25
"""Time by which a word may be later than now, s: two clocks are never the same."""


class Listener(Service[Config]):
    """Keeps the last seconds of one person, in memory only, and answers what they mean by a word."""

    NAME: ClassVar[str] = "listener"
    SCOPE: ClassVar[Scope] = "user"
    CONFIG = Config
    MAKES_USER_PRESENT: ClassVar[bool] = False

    def __init__(self, config: Config, context: Context) -> None:
        super().__init__(config, context)
        self._memory = PointingMemory()
        self._room = room = Room()
        self._recogniser_clock = RecogniserClock()
        self.bus.serve(topics.FIND_REFERENTS, self._find, self.user)
        self.bus.watch(topics.USER_ALIVE, self._on_presence)
        self.bus.subscribe(topics.MAP, lambda environment, _name: room.on_map(environment))
        self.bus.subscribe(topics.POSE, _into(room.poses))
        self.bus.subscribe(topics.OBJECTS, _into(room.objects))
        self.bus.subscribe(topics.ROBOT_STATE, _into(room.robots))
        self.bus.subscribe(topics.CURSOR, self._on_cursor, self.user)
        self.bus.subscribe(topics.SPEECH, self._on_speech, self.user)

    def _on_cursor(self, cursor: Cursor, _user: str) -> None:
        self._memory.add(cursor)
        if self._recogniser_clock.compare(self._memory, self.clock.now_ns()):
            self.bus.warn("recogniser-clock", self._recogniser_clock.problem)

    def _on_presence(self, user: str, *, present: bool) -> None:
        if not present:
            self._room.on_absence(user)

    def _on_speech(self, speech: Speech, _user: str) -> None:
        self._recogniser_clock.on_speech(speech, self.clock.now_ns())
        self.bus.warn("recogniser-clock", self._recogniser_clock.problem)

    async def _find(self, query: FindReferents, user: str) -> Referents:
        now_ns = self.clock.now_ns()
        at_ns = now_ns if query.at_ns is None else query.at_ns
        ago_s = (now_ns - at_ns) / NS_PER_S
        if ago_s > MEMORY_S:
            kept = f"only the last {MEMORY_S:g} s are kept"
            raise RefusedError(f"that was {round_beyond(ago_s, MEMORY_S)} s ago: {kept}")
        if ago_s < -AHEAD_S:
            raise RefusedError(f"that is {-ago_s:.1f} s ahead of the site's time: synchronize the clocks")
        self._memory.forget(now_ns)
        pose = self._room.poses.get(user)
        spoken = Spoken(
            at_ns=at_ns,
            word=query.word,
            others_ns=query.others_ns,
            within_s=query.within_s,
            user=user,
            own_m=None if pose is None else pose.position_m,
            yaw_sigma_rad=0.0 if pose is None else yaw_sigma_rad(pose.covariance),
        )
        self._recogniser_clock.on_word(spoken)
        targets = self._room.targets(user, at_ns, now_ns)
        return referents(self._memory.between(*spoken.span_ns), targets, spoken)


def _into(kept: dict[str, M]) -> Callable[[M, str], None]:
    """Return a handler that keeps the newest message of each name."""

    def keep(message: M, name: str) -> None:
        kept[name] = message

    return keep


SERVICE = Listener
