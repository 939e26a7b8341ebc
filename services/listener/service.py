"""Memory of a person's pointing: from cursors, objects, robots, people and words to referents on request."""

from collections.abc import Callable
from typing import ClassVar, TypeVar

from pointit.errors import RefusedError
from pointit.geometry.floor_sigma import yaw_sigma_rad
from pointit.geometry.vector import Vec3
from pointit.runtime.config.config import Config
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas import NS_PER_S, Cursor, FindReferents, Message, Referents, Speech, topics
from pointit.schemas.text import round_beyond
from pointit.services.listener.referents import RecogniserClock, Room, Spoken, referents
from pointit.services.listener.stays import MEMORY_S, PointingMemory

M = TypeVar("M", bound=Message)

AHEAD_S = 0.25
"""Time by which a word may be in the future, s: two clocks are never the same."""


class Listener(Service[Config]):
    """Stores the last seconds of one person in memory only, and answers what they mean by a word."""

    NAME: ClassVar[str] = "listener"
    SCOPE: ClassVar[Scope] = "user"
    CONFIG = Config
    MAKES_USER_PRESENT: ClassVar[bool] = False

    def __init__(self, config: Config, context: Context) -> None:
        super().__init__(config, context)
        self._memory = PointingMemory()
        room = Room()
        self._room = room
        self._recogniser_clock = RecogniserClock()
        self.bus.serve(topics.FIND_REFERENTS, self._find, self.user)
        self.bus.watch(topics.USER_ALIVE, self._on_presence)
        self.bus.subscribe(topics.MAP, lambda environment, _name: room.on_map(environment))
        self.bus.subscribe(topics.POSE, _store_in(room.poses))
        self.bus.subscribe(topics.OBJECTS, _store_in(room.objects))
        self.bus.subscribe(topics.ROBOT_STATE, _store_in(room.robots))
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
        # Only words of the last seconds can be answered
        now_ns = self.clock.now_ns()
        at_ns = now_ns if query.at_ns is None else query.at_ns
        age_s = (now_ns - at_ns) / NS_PER_S
        if age_s > MEMORY_S:
            limit = f"only the last {MEMORY_S:g} s are kept"
            raise RefusedError(f"that was {round_beyond(age_s, MEMORY_S)} s ago: {limit}")
        if age_s < -AHEAD_S:
            raise RefusedError(f"that is {-age_s:.1f} s ahead of the site's time: synchronize the clocks")
        self._memory.forget(now_ns)

        # The word, with what the pose tells of the rays
        own_m: Vec3 | None = None
        sigma_rad = 0.0
        pose = self._room.poses.get(user)
        if pose is not None:
            own_m = pose.position_m
            sigma_rad = yaw_sigma_rad(pose.covariance)
        spoken = Spoken(
            at_ns=at_ns,
            word=query.word,
            others_ns=query.others_ns,
            within_s=query.within_s,
            user=user,
            own_m=own_m,
            yaw_sigma_rad=sigma_rad,
        )
        self._recogniser_clock.on_word(spoken)
        targets = self._room.targets(user, at_ns, now_ns)
        cursors = self._memory.between(*spoken.span_ns)
        return referents(cursors, targets, spoken)


def _store_in(messages: dict[str, M]) -> Callable[[M, str], None]:
    """Return a handler that stores the newest message of each name."""

    def store(message: M, name: str) -> None:
        messages[name] = message

    return store


SERVICE = Listener
