"""An action of this server that pages can request: its row, and the parts of the server that handlers use.

No core: its handlers wait for services.
"""

import asyncio
import time
from collections.abc import Awaitable, Callable, Collection
from dataclasses import dataclass, field
from typing import Any, Generic, Literal, TypeVar

from pydantic import BaseModel, ConfigDict

from pointit.bridges.web.devices.devices import Devices
from pointit.bridges.web.model.home_site import HomeSite
from pointit.bridges.web.model.map_editor import MapEditor
from pointit.bridges.web.model.people import PagePeople
from pointit.bridges.web.model.separability import FloorSeparability
from pointit.bridges.web.scan.scan_server import ScanServer
from pointit.bridges.web.server.access import Access
from pointit.bridges.web.server.lan import Lan
from pointit.bridges.web.wire import Role
from pointit.bridges.web.wrists.pairing import Pairing, offer
from pointit.bridges.web.wrists.phone import Phones
from pointit.bridges.web.wrists.wrist_control import WristControl
from pointit.runtime.bus.contract import Bus
from pointit.runtime.errors import RefusedError

JsonObject = dict[str, Any]
P = TypeVar("P", bound=BaseModel)

CONTROL: tuple[Role, ...] = ("operator",)
LOOK: tuple[Role, ...] = ("operator", "viewer")
WRIST: tuple[Role, ...] = ("operator", "wrist")
"""Pages that may request an action: those that control, those that look on too, or wrists too."""


class ActionParameters(BaseModel):
    """Parameters of an action. Unknown fields are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class NoParameters(ActionParameters):
    """No parameters."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PageSender:
    """The page that requests an action, and the person whom the action is for."""

    page: str
    role: Role
    user: str


@dataclass(kw_only=True)
class ActionContext:
    """Parts of the server that actions use."""

    bus: Bus
    people: PagePeople
    wrists: WristControl
    pairing: Pairing
    phones: Phones
    lan: Lan
    access: Access
    separability: FloorSeparability
    maps: MapEditor
    scan: ScanServer
    devices: Devices
    home: HomeSite
    present: Callable[[], Collection[str]]
    """Returns the instances that are present."""
    changed: Callable[[], None]
    """Called when the status of pages has changed."""
    drawing: asyncio.Lock = field(default_factory=asyncio.Lock)

    async def open_lan(self) -> JsonObject:
        """Open the page to the local network, and return its address.

        Raises:
            RefusedError: If it fails.
        """
        url = await self.lan.open()
        self.access.know_hosts([self.lan.address])
        self.changed()
        return {
            "url": url,
            "fingerprint": self.lan.fingerprint,
            "message": f"the local network finds the page at {url} {self.lan.note}".rstrip(),
        }

    async def offer(self, path: str, pair: Callable[[], str]) -> JsonObject:
        """Return the QR code that opens the page at `path` with the token of `pair`.

        Raises:
            RefusedError: If the local network cannot find the page.
        """
        if not self.lan.url:
            raise RefusedError("phones cannot find this page yet: open it to the local network first")
        url = f"{self.lan.url}/{path}?token={pair()}"
        async with self.drawing:  # takes 20 ms, which repeated requests must not take from other pages
            return await asyncio.to_thread(offer, url, self.lan.fingerprint)

    def notify_loser(self, user: str, loser: str, page: str, *, is_own: bool = False) -> None:
        """Notify a phone from which `page` has taken the wrist of `user`. Pages see it in their status."""
        if not loser or loser == page:
            return
        if loser == self.pairing.paired(user, time.monotonic()):
            self.phones.lost(user, is_own=is_own)


@dataclass(frozen=True, slots=True)
class Action(Generic[P]):
    """An action of this server that pages can request."""

    name: str
    scope: Literal["person", "site"]
    """`person`: it is for the person whom the request names."""
    parameters: type[P]
    """Model of its parameters."""
    roles: tuple[Role, ...]
    """Pages that may request it."""
    handle: Callable[[ActionContext, PageSender, P], Awaitable[JsonObject]]
    """Does it and returns the fields of the reply. Raises `RefusedError`."""
