"""Passes visible messages to a simulated person, and publishes their wristband's samples."""

import zlib
from typing import Any, ClassVar

import numpy as np

from pointit.runtime.bus.contract import Publisher
from pointit.runtime.clock import ticks
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas import NS_PER_S, WRIST_PATIENCE_S, Message, Speech, Word, WristSample, topics
from pointit.services.user_sim.behaviour import Behaviour
from pointit.services.user_sim.config import UserSimConfig
from pointit.services.user_sim.person import SimulatedPerson

IN_THE_ROOM: tuple[topics.Topic[Any], ...] = (
    topics.MAP,
    topics.OBJECTS,
    topics.ROBOT_STATE,
    topics.STRIPS_FRAME,
    topics.LAMP_COLOR,
)
"""Topics that all people in the room perceive."""
OWN: tuple[topics.Topic[Any], ...] = (topics.FEEDBACK, topics.PROFILE, topics.ANNOUNCED)
"""Topics that only this person perceives, and their own profile."""


class UserSim(Service[UserSimConfig]):
    """A simulated person together with their wristband.

    While a page or ROS moves their wrist, they watch and send nothing.
    """

    NAME: ClassVar[str] = "user-sim"
    SCOPE: ClassVar[Scope] = "user"
    CONFIG = UserSimConfig
    READS: ClassVar[tuple[topics.Topic[Any], ...]] = (*IN_THE_ROOM, *OWN, topics.WRIST)
    """Topics that a simulated person reads, also one of another package."""
    WRITES: ClassVar[tuple[topics.Topic[Any], ...]] = (topics.IMU, topics.BUTTON)
    """Topics that they write. Those who `say` something also write `topics.SPEECH`."""

    def __init__(self, config: UserSimConfig, context: Context) -> None:
        super().__init__(config, context)
        # the name is part of the seed, so that several people with one seed are not the same person
        seed = None if config.seed is None else [config.seed, zlib.crc32(self.user.encode())]
        self._person = SimulatedPerson(config, self.user, np.random.default_rng(seed), self.new_behaviour)
        self._page_ns: int | None = None
        """Time of the last sample from the page that moves the wrist, ns."""
        self._has_yielded = False
        self._imu = self.bus.publisher(topics.IMU, self.user)
        self._button = self.bus.publisher(topics.BUTTON, self.user)
        self._speech: Publisher[Speech] | None = None
        """Publisher of what they say. None: they have said nothing."""
        for shared in IN_THE_ROOM:
            self.bus.subscribe(shared, self.see)
        for own in OWN:
            self.bus.subscribe(own, self.see, self.user)
        self.bus.subscribe(topics.WRIST, self._on_wrist, self.user)

    async def run(self) -> None:
        """Step at the band's rate until cancelled."""
        async for now_ns in ticks(self.clock, self.config.rate_hz):
            yields = self._yields(now_ns)
            if yields != self._has_yielded:
                self._has_yielded = yields
                self.bus.set_metric("a page or ROS moves the wrist", 1.0 if yields else None)
            sample, press = self._person.step(now_ns, yields=yields)
            if sample is not None:
                self._imu.put(sample)
            if press is not None:
                self._button.put(press)

    def _on_wrist(self, _sample: WristSample, _user: str) -> None:
        self._page_ns = self.clock.now_ns()

    def _yields(self, now_ns: int) -> bool:
        timeout_ns = WRIST_PATIENCE_S * NS_PER_S * self.clock.speed
        if self._page_ns is None:
            return False
        return abs(now_ns - self._page_ns) <= timeout_ns

    def new_behaviour(self) -> Behaviour | None:
        """Return the behaviour of the person while they may point, or None for that of the parameters."""
        return None

    def see(self, message: Message, name: str) -> None:
        """Show a message to the person."""
        self._person.see(self.clock.now_ns(), message, name)

    def say(self, text: str) -> None:
        """Speak `text`, as a recogniser would understand it."""
        if self._speech is None:
            self._speech = self.bus.publisher(topics.SPEECH, self.user)
        now_ns = self.clock.now_ns()
        words = tuple(Word(text=word, start_ns=now_ns, end_ns=now_ns) for word in text.split())
        self._speech.put(Speech(stamp_ns=now_ns, words=words, recogniser="simulated"))


SERVICE = UserSim
