"""Does what pages and phones ask for: requests go to their servers, deeds are done here."""

import time
from collections.abc import Callable, Collection
from typing import Any, cast

from pointit.bridges.web.access import Access
from pointit.bridges.web.asks import PATIENCE_S, Call, Press, Tremor, Wish, understood
from pointit.bridges.web.lan import Lan
from pointit.bridges.web.pairing import Pairing, offer
from pointit.bridges.web.phone import Phones
from pointit.bridges.web.wire import Answer, Ask, Role
from pointit.bridges.web.wrists import Hold, Wrists
from pointit.diagnosis.writers import instance_of
from pointit.runtime import Bus, Clock, Publisher, RefusedError
from pointit.runtime.bus import REQUEST_TIMEOUT_S
from pointit.runtime.health import ServiceBus
from pointit.schemas import ButtonEvent, SetYawOrigin, WristSample
from pointit.schemas.topics import BUTTON, SET_YAW_ORIGIN, WRIST

IMU_BRIDGE = "imu-bridge"
"""Who turns what a page's mouse or a phone says into what a wrist measures."""


class People:
    """The people who are there, and what this server writes for them."""

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

    def come(self, user: str) -> None:
        """Take that `user` is there."""
        if user not in self._writers:
            self._writers[user] = (self._bus.publisher(BUTTON, user), self._bus.publisher(WRIST, user))

    def go(self, user: str) -> None:
        """Take that `user` is there no more."""
        self.states.pop(user, None)
        for writer in self._writers.pop(user, ()):
            writer.retire()

    def check(self, user: str) -> None:
        """Make sure that `user` is there.

        Raises:
            RefusedError: they are not; says who is.
        """
        if user not in self._writers:
            there = ", ".join(self.names) or "nobody is"
            raise RefusedError(f"{user} is not there; there: {there}")

    def press(self, user: str, gesture: Any = "press") -> None:
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


class Desk:
    """Answers asks."""

    def __init__(
        self,
        bus: Bus,
        *,
        people: People,
        wrists: Wrists,
        pairing: Pairing,
        lan: Lan,
        doors: Access,
        present: Callable[[], Collection[str]],
        changed: Callable[[], None],
    ) -> None:
        """Answer nothing yet; `phones` is to be set before a phone is paired.

        Args:
            bus: where requests go.
            people: who is there.
            wrists: who has whose wrist.
            pairing: which phones there are.
            lan: the door to the local network.
            doors: who is let in.
            present: the instances that are there.
            changed: told when the status of pages has changed.
        """
        self._bus = bus
        self._people = people
        self._wrists = wrists
        self._pairing = pairing
        self._lan = lan
        self._doors = doors
        self._present = present
        self._changed = changed
        self.phones: Phones | None = None

    async def answer(self, page: str, role: Role, ask: Ask) -> Answer:
        """Do what is asked for.

        Raises:
            PointItError, SchemaError: it cannot be done, or may not be asked; says why.
        """
        meant = understood(ask, role)
        reply = await (self._call(meant) if isinstance(meant, Call) else self._do(meant, page, role))
        return Answer(id=ask.id, reply=reply)

    async def open_lan(self) -> dict[str, Any]:
        """Open the page to the local network; return where it is then.

        Raises:
            RefusedError: it cannot be; says what to do.
        """
        url = await self._lan.open()
        self._doors.know_hosts([url.partition("://")[2].rpartition(":")[0].strip("[]")])
        self._changed()
        return {
            "url": url,
            "fingerprint": self._lan.fingerprint,
            "message": f"the local network finds the page at {url} {self._lan.note}".rstrip(),
        }

    async def _call(self, call: Call) -> dict[str, Any]:
        request = call.request
        patience_s = PATIENCE_S.get(request.key, REQUEST_TIMEOUT_S)
        reply = await self._bus.call(request, call.query, call.name, timeout_s=patience_s)
        return cast("dict[str, Any]", reply.model_dump(mode="json"))

    async def _do(self, wish: Wish, page: str, role: Role) -> dict[str, Any]:
        user = wish.user
        if wish.deed == "open_lan":
            return await self.open_lan()
        self._people.check(user)
        if wish.deed == "press":
            assert isinstance(wish.extras, Press)  # noqa: S101 - so says `asks`
            self._people.press(user, wish.extras.gesture)
            return {"message": f"{user}'s button was pressed"}
        if wish.deed == "take":
            return self._take(user, page, "phone" if role == "wrist" else "mouse")
        if wish.deed == "give":
            return self._give(user, page, role)
        if wish.deed == "tremor":
            assert isinstance(wish.extras, Tremor)  # noqa: S101 - so says `asks`
            if not self._wrists.tremble(user, page, wish.extras.rms_deg):
                raise RefusedError(f"this page does not move {user}'s arm: take it first")
            return {"message": f"{user}'s arm trembles by {wish.extras.rms_deg:g}° rms"}
        if wish.deed == "pair":
            return await self._pair(user)
        return await self._centre(user)

    def _take(self, user: str, page: str, by: Hold) -> dict[str, Any]:
        if instance_of(IMU_BRIDGE, user) not in self._present():
            raise RefusedError(
                f"nobody makes a wrist of what a page says: start it with "
                f"`pointit service {IMU_BRIDGE} --user {user} --source page`"
            )
        loser = self._wrists.take(user, page, by)
        self._tell_loser(user, loser, page)
        if self._people.states.get(user) == "idle":
            self._people.press(user)
        self._changed()
        return {"message": f"{user}'s arm follows this {by}"}

    def _give(self, user: str, page: str, role: Role) -> dict[str, Any]:
        if role == "wrist":
            self._wrists.give(user, page)
        else:
            self._tell_loser(user, self._wrists.release(user), page)
        self._changed()
        return {"message": f"{user}'s arm is their own again"}

    async def _pair(self, user: str) -> dict[str, Any]:
        if not self._lan.url:
            raise RefusedError("phones cannot find this page yet: open it to the local network first")
        token, replaced = self._pairing.pair(user, self._now_s())
        if replaced and self.phones is not None:
            await self.phones.cut(replaced)
        self._changed()
        return offer(f"{self._lan.url}/phone?token={token}", self._lan.fingerprint)

    async def _centre(self, user: str) -> dict[str, Any]:
        query = SetYawOrigin(yaw_rad=self._wrists.ahead(user))
        reply = await self._bus.call(SET_YAW_ORIGIN, query, user)
        if self.phones is not None:
            self.phones.centred(user)
        return reply.model_dump(mode="json")

    def _tell_loser(self, user: str, loser: str, page: str) -> None:
        """Tell a phone that has lost the wrist of `user` to `page`; pages see it in their status."""
        if self.phones is not None and loser != page and loser == self._pairing.paired(user, self._now_s()):
            self.phones.lost(user)

    def _now_s(self) -> float:
        return time.monotonic()
