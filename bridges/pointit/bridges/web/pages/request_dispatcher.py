"""Answers requests of pages and phones: forwards them to services, or handles deeds here."""

import asyncio
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import Any, cast

from pointit.bridges.web.devices.devices import Devices
from pointit.bridges.web.devices.wire import ConnectDevice, OneDevice
from pointit.bridges.web.model.map_editor import MapEditor
from pointit.bridges.web.model.people import People
from pointit.bridges.web.model.told_apart import ToldApart
from pointit.bridges.web.pages.page_requests import (
    DEVICES,
    SITE_DEEDS,
    TIMEOUTS_S,
    Call,
    MapEdits,
    PageAction,
    Pair,
    Press,
    SaveMap,
    Speak,
    StepBeside,
    Tremor,
    parse_request,
)
from pointit.bridges.web.scan.door import ScanDoor
from pointit.bridges.web.server.access import Access
from pointit.bridges.web.server.lan import Lan
from pointit.bridges.web.wire import Answer, Ask, Role
from pointit.bridges.web.wrists.pairing import Pairing, offer
from pointit.bridges.web.wrists.phone import Phones
from pointit.bridges.web.wrists.wrist_control import Hold, WristControl
from pointit.runtime.bus.contract import REQUEST_TIMEOUT_S, Bus
from pointit.runtime.errors import RefusedError
from pointit.schemas import SetYawOrigin
from pointit.schemas.system import instance_of
from pointit.schemas.topics import SET_YAW_ORIGIN

IMU_BRIDGE = "imu-bridge"
"""Service that turns messages of a mouse or phone into wrist samples."""


@dataclass(kw_only=True)
class RequestDispatcher:
    """Handles requests of pages and phones."""

    bus: Bus
    people: People
    wrists: WristControl
    pairing: Pairing
    phones: Phones
    lan: Lan
    doors: Access
    told_apart: ToldApart
    maps: MapEditor
    scan: ScanDoor
    devices: Devices
    present: Callable[[], Collection[str]]
    """Returns the instances that are present."""
    changed: Callable[[], None]
    """Called when the status of pages has changed."""
    drawing: asyncio.Lock = field(default_factory=asyncio.Lock)

    async def answer(self, page: str, role: Role, ask: Ask) -> Answer:
        """Handle a request.

        Raises:
            PointItError, SchemaError: If it fails or is not allowed.
        """
        meant = parse_request(ask, role)
        reply = await (self._call(meant) if isinstance(meant, Call) else self._do(meant, page, role))
        return Answer(id=ask.id, reply=reply)

    async def open_lan(self) -> dict[str, Any]:
        """Open the page to the local network, and return its address.

        Raises:
            RefusedError: If it fails.
        """
        url = await self.lan.open()
        self.doors.know_hosts([self.lan.address])
        self.changed()
        return {
            "url": url,
            "fingerprint": self.lan.fingerprint,
            "message": f"the local network finds the page at {url} {self.lan.note}".rstrip(),
        }

    async def _call(self, call: Call) -> dict[str, Any]:
        request = call.request
        patience_s = TIMEOUTS_S.get(request.key, REQUEST_TIMEOUT_S)
        reply = await self.bus.call(request, call.query, call.name, timeout_s=patience_s)
        return cast("dict[str, Any]", reply.model_dump(mode="json"))

    async def _do(self, wish: PageAction, page: str, role: Role) -> dict[str, Any]:
        if wish.deed in SITE_DEEDS:
            return await self._do_of_site(wish)
        user = wish.user
        self.people.check(user)
        if wish.deed == "press":
            assert isinstance(wish.extras, Press)  # noqa: S101 - so says `asks`
            self.people.press(user, wish.extras.gesture)
            return {"message": f"{user}'s button was pressed"}
        if wish.deed == "step":
            assert isinstance(wish.extras, StepBeside)  # noqa: S101 - so says `asks`
            self.people.step(user, wish.extras.by)
            return {"message": ""}
        if wish.deed == "speak":
            assert isinstance(wish.extras, Speak)  # noqa: S101 - so says `asks`
            self.people.speak(user, [word.model_dump() for word in wish.extras.words])
            return {"message": ""}
        if wish.deed == "take":
            return self._take(user, page, "phone" if role == "wrist" else "mouse")
        if wish.deed == "give":
            return self._give(user, page, role)
        if wish.deed == "tremor":
            assert isinstance(wish.extras, Tremor)  # noqa: S101 - so says `asks`
            if not self.wrists.set_tremor(user, page, wish.extras.rms_deg):
                raise RefusedError(f"this page does not move {user}'s arm: take it first")
            return {"message": f"{user}'s arm trembles by {wish.extras.rms_deg:g}° rms"}
        if wish.deed == "pair":
            assert isinstance(wish.extras, Pair)  # noqa: S101 - so says `asks`
            return await (self._unpair(user) if wish.extras.off else self._pair(user))
        return await self._centre(user)

    async def _do_of_site(self, wish: PageAction) -> dict[str, Any]:
        match wish.extras:
            case SaveMap(edits=edits, digest=digest, name=name):
                return await self.maps.save(edits, digest, name)
            case MapEdits(edits=edits, digest=digest):
                return await self.maps.check(edits, digest)
            case _:
                pass
        if wish.deed == "read_map":
            return await self.maps.read()
        if wish.deed == "told_apart":
            return {**await self.told_apart.answer()}
        if wish.deed == "map_room":
            return await self._offer("scan", self.scan.pair)
        if wish.deed in DEVICES:
            return await self._do_of_devices(wish)
        return await self.open_lan()

    async def _do_of_devices(self, wish: PageAction) -> dict[str, Any]:
        match wish.extras:
            case ConnectDevice():
                return await self.devices.connect(wish.extras)
            case OneDevice(id=device) if wish.deed == "forget_device":
                return await self.devices.forget(device)
            case OneDevice(id=device) if wish.deed == "show_device":
                return await self.devices.show(device)
            case OneDevice(id=device):
                return await self.devices.check_mounting(device)
            case _:
                return await self.devices.find()

    def _take(self, user: str, page: str, by: Hold) -> dict[str, Any]:
        if instance_of(IMU_BRIDGE, user) not in self.present():
            raise RefusedError(
                f"no service turns the page's messages into wrist samples: start it with "
                f"`pointit service run {IMU_BRIDGE} --user {user} --source page`"
            )
        loser = self.wrists.acquire(user, page, by)
        self._tell_loser(user, loser, page)
        if self.people.states.get(user) == "idle":
            self.people.press(user)
        self.changed()
        return {"message": f"{user}'s arm follows this {by}"}

    def _give(self, user: str, page: str, role: Role) -> dict[str, Any]:
        if role == "wrist":
            self.wrists.release_from(user, page)
        else:
            self._tell_loser(user, self.wrists.release(user), page, is_own=True)
        self.changed()
        return {"message": f"{user}'s arm is their own again"}

    async def _pair(self, user: str) -> dict[str, Any]:
        replaced = ""

        def pair() -> str:
            nonlocal replaced
            token, replaced = self.pairing.pair(user, time.monotonic())
            return token

        offered = await self._offer("phone", pair)
        await self.phones.cut(replaced)
        self.changed()
        return offered

    async def _offer(self, path: str, pair: Callable[[], str]) -> dict[str, Any]:
        """Return the QR code that opens the page at `path` with the token of `pair`."""
        if not self.lan.url:
            raise RefusedError("phones cannot find this page yet: open it to the local network first")
        url = f"{self.lan.url}/{path}?token={pair()}"
        async with self.drawing:  # takes 20 ms, which repeated requests must not take from other pages
            return await asyncio.to_thread(offer, url, self.lan.fingerprint)

    async def _unpair(self, user: str) -> dict[str, Any]:
        page = self.pairing.unpair(user)
        if not page:
            raise RefusedError(f"no phone is paired with {user}")
        await self.phones.cut(page)
        self.changed()
        return {"message": f"{user}'s phone is unpaired"}

    async def _centre(self, user: str) -> dict[str, Any]:
        query = SetYawOrigin(yaw_rad=self.wrists.ahead(user))
        reply = await self.bus.call(SET_YAW_ORIGIN, query, user)
        self.phones.centred(user)
        return reply.model_dump(mode="json")

    def _tell_loser(self, user: str, loser: str, page: str, *, is_own: bool = False) -> None:
        """Notify a phone from which `page` has taken the wrist of `user`. Pages see it in their status."""
        if loser and loser != page and loser == self.pairing.paired(user, time.monotonic()):
            self.phones.lost(user, is_own=is_own)
