"""Actions of a page for the site: phones and their network, devices, and the map.

- `pair`: a QR code for a person's phone; the reply has `url`, `qr_svg`, `expires_s`, `fingerprint`.
  `{"off": true}`: unpair their phone and revoke codes shown before.
- `open_lan`: open the page to the local network; the reply has `url`, `fingerprint`.
- `map_room`: let a phone map the room by its camera; the reply is as that of `pair`.
- `find_devices`, `connect_device`, `forget_device`, `show_device`, `check_mounting`: wrists and lights, see
  `devices/devices.py`; their parameters are in `devices/wire.py`.
- `told_apart`: number of things that pointing alone tells apart, by place on the floor; the reply has the
  fields of `Floor` in `model/separability.py`.
- `choose_act`: what a person, who is named, has chosen at the set-up that leads them, `{"choice": "walk"}`.
- `set_up_home`: an act at the cards of `pointit home`, a `SetUpHome`, and a `token` of Home Assistant,
  which is stored and goes nowhere else; the reply has the fields of `HomeSetup`, see `model/home_site.py`.
- `read_map`, `check_map`, `save_map`: the map of the site in the plan editor, see `model/map_editor.py`.

No core: it waits for devices and files.
"""

import time
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, SecretStr

from pointit.bridges.web.devices.wire import ConnectDevice, OneDevice
from pointit.bridges.web.pages.action import (
    CONTROL,
    LOOK,
    WRIST,
    Action,
    ActionContext,
    ActionParameters,
    JsonObject,
    NoParameters,
    PageSender,
)
from pointit.maps.edit import Edit
from pointit.runtime.errors import RefusedError
from pointit.schemas import SetUpHome

MAX_EDITS = 1000


class Pair(ActionParameters):
    """Pair or unpair a phone."""

    off: bool = False


async def _pair(context: ActionContext, sender: PageSender, pairing: Pair) -> JsonObject:
    user = sender.user
    if pairing.off:
        page = context.pairing.unpair(user)
        if not page:
            raise RefusedError(f"no phone is paired with {user}")
        reply: JsonObject = {"message": f"{user}'s phone is unpaired"}
    else:
        page = ""

        # The token is made only if the local network finds the page: it replaces that of the previous phone
        def pair() -> str:
            nonlocal page
            token, page = context.pairing.pair(user, time.monotonic())
            return token

        reply = await context.offer("phone", pair)
    await context.phones.cut(page)
    context.changed()
    return reply


async def _open_lan(context: ActionContext, _: PageSender, __: NoParameters) -> JsonObject:
    return await context.open_lan()


async def _map_room(context: ActionContext, _: PageSender, __: NoParameters) -> JsonObject:
    return await context.offer("scan", context.scan.pair)


async def _find_devices(context: ActionContext, _: PageSender, __: NoParameters) -> JsonObject:
    return await context.devices.find()


async def _connect_device(context: ActionContext, _: PageSender, device: ConnectDevice) -> JsonObject:
    return await context.devices.connect(device)


async def _forget_device(context: ActionContext, _: PageSender, device: OneDevice) -> JsonObject:
    return await context.devices.forget(device.id)


async def _show_device(context: ActionContext, _: PageSender, device: OneDevice) -> JsonObject:
    return await context.devices.show(device.id)


async def _check_mounting(context: ActionContext, _: PageSender, device: OneDevice) -> JsonObject:
    return await context.devices.check_mounting(device.id)


def _only_text(token: object) -> object:
    """Return a token that is a text or missing, and an empty one for all else: an error would quote it."""
    if token is None or isinstance(token, str):
        return token
    return ""


class SetUp(ActionParameters):
    """An act at the cards of a home."""

    query: SetUpHome = SetUpHome()
    token: Annotated[SecretStr | None, BeforeValidator(_only_text)] = None


async def _set_up_home(context: ActionContext, _: PageSender, act: SetUp) -> JsonObject:
    strips = dict(context.devices.strips)
    return await context.home.set_up(act.query, act.token, strips)


class ChooseAct(ActionParameters):
    """Choice of a person at the set-up that leads them: an act without values."""

    choice: Literal["walk", "stay", "take_back", "skip", "beside", "mistaken", "met", "other", "finish"]


async def _choose_act(context: ActionContext, sender: PageSender, chosen: ChooseAct) -> JsonObject:
    strips = dict(context.devices.strips)
    act = SetUpHome(choice=chosen.choice, user=sender.user)
    await context.home.set_up(act, None, strips)
    return {"message": ""}


async def _read_floor(context: ActionContext, _: PageSender, __: NoParameters) -> JsonObject:
    return await context.separability.answer()


async def _read_map(context: ActionContext, _: PageSender, __: NoParameters) -> JsonObject:
    return await context.maps.read()


class MapEdits(ActionParameters):
    """Edits of the map."""

    edits: tuple[Edit, ...] = Field(max_length=MAX_EDITS)
    digest: str = Field(max_length=64, description="of the file that was read")


async def _check_map(context: ActionContext, _: PageSender, changed: MapEdits) -> JsonObject:
    return await context.maps.check(changed.edits, changed.digest)


class SaveMap(MapEdits):
    """Edits of the map, and where to save it."""

    name: str = Field(
        default="", max_length=64, description="of a new file, without suffix; the file itself if empty"
    )


async def _save_map(context: ActionContext, _: PageSender, changed: SaveMap) -> JsonObject:
    return await context.maps.save(changed.edits, changed.digest, changed.name)


SITE_ACTIONS: tuple[Action[Any], ...] = (
    Action("pair", "person", Pair, CONTROL, _pair),
    Action("open_lan", "site", NoParameters, CONTROL, _open_lan),
    Action("map_room", "site", NoParameters, CONTROL, _map_room),
    Action("find_devices", "site", NoParameters, CONTROL, _find_devices),
    Action("connect_device", "site", ConnectDevice, CONTROL, _connect_device),
    Action("forget_device", "site", OneDevice, CONTROL, _forget_device),
    Action("show_device", "site", OneDevice, CONTROL, _show_device),
    Action("check_mounting", "site", OneDevice, CONTROL, _check_mounting),
    Action("set_up_home", "site", SetUp, CONTROL, _set_up_home),
    Action("choose_act", "person", ChooseAct, WRIST, _choose_act),
    Action("told_apart", "site", NoParameters, LOOK, _read_floor),
    Action("read_map", "site", NoParameters, CONTROL, _read_map),
    Action("check_map", "site", MapEdits, CONTROL, _check_map),
    Action("save_map", "site", SaveMap, CONTROL, _save_map),
)
