"""The people who are there, and what this server writes for them: presses and wrists."""

from typing import Literal

from pointit.runtime.bus.contract import Publisher
from pointit.runtime.clock import Clock
from pointit.runtime.errors import RefusedError
from pointit.runtime.health.service_bus import ServiceBus
from pointit.schemas import ButtonEvent, WristSample
from pointit.schemas.topics import BUTTON, WRIST

Gesture = Literal["press", "double", "hold"]


class People:
    """Writes buttons and wrists of whoever is there."""

    def __init__(self, bus: ServiceBus, clock: Clock) -> None:
        """Begin with nobody."""
        self._bus = bus
        self._clock = clock
        self._writers: dict[str, tuple[Publisher[ButtonEvent], Publisher[WristSample]]] = {}
        self._presses = 0
        self.states: dict[str, str] = {}
        """Of whom it is known: the state of their interaction."""

    @property
    def names(self) -> list[str]:
        """Return who is there."""
        return sorted(self._writers)

    def on_join(self, user: str) -> None:
        """Take that `user` is there."""
        if user not in self._writers:
            self._writers[user] = (self._bus.publisher(BUTTON, user), self._bus.publisher(WRIST, user))

    def on_leave(self, user: str) -> None:
        """Take that `user` is there no more."""
        self.states.pop(user, None)
        for writer in self._writers.pop(user, ()):
            writer.close_nowait()

    def check(self, user: str) -> None:
        """Make sure that `user` is there.

        Raises:
            RefusedError: they are not; says who is.
        """
        if user not in self._writers:
            there = ", ".join(self.names) or "nobody is"
            raise RefusedError(f"{user} is not there; there: {there}")

    def press(self, user: str, gesture: Gesture = "press") -> None:
        """Press the button of `user`, who is there."""
        self._presses += 1
        self._writers[user][0].put(
            ButtonEvent(stamp_ns=self._clock.now_ns(), seq=self._presses, gesture=gesture, source="page")
        )

    def move(self, user: str, sample: WristSample) -> None:
        """Publish how the wrist of `user` is held, if they are there."""
        writers = self._writers.get(user)
        if writers is not None:
            writers[1].put(sample)
