"""Requests of pages and phones: permission, validation, and the answer.

Requests of the table go to their servers unchanged: `name` is the user where the key has one, `query` has
the query's fields. Actions of this server are the rows of `ACTIONS`, at the end; `name` is the person:

- `press`, `{"gesture": "press" | "double" | "hold", "held_s": 0.2}`: press the person's button, which went
  down that long ago.
- `step`, `{"by": -1 | 1}`: from the announced thing to the one left or right of it, or to the nearest.
- `take`, `{"by": "mouse" | "headset"}`: move the person's arm by this page's mouse or its headset; an idle
  person begins to point. `give`: give it back, whichever page moves it.
- `tremor`, `{"rms_deg": number}`: tremor of that arm.
- `pair`: a QR code for the person's phone; the reply has `url`, `qr_svg`, `expires_s`, `fingerprint`.
  `{"off": true}`: unpair their phone and revoke codes shown before.
- `open_lan`: open the page to the local network; the reply has `url`, `fingerprint`.
- `find_devices`, `connect_device`, `forget_device`, `show_device`, `check_mounting`: wrists and lights, see
  `devices/devices.py`; their parameters are in `devices/wire.py`.
- `told_apart`: number of things that pointing alone tells apart, by place on the floor; the reply has the
  fields of `Floor` in `model/map_editor.py`.
- `map_room`: let a phone map the room by its camera; the reply is as that of `pair`.
- `speak`, `{"words": [{"text", "start_s", "end_s", "confidence"}]}`: what the person said. Times are ages of
  onset and end when it is sent, s, so that no clock has to agree.
- `centre`: the person's arm points at the middle of the room right now.
- `read_map`, `check_map`, `save_map`: the map of the site in the plan editor, see `model/map_editor.py`.
"""

import asyncio
import time
from collections.abc import Awaitable, Callable, Collection, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, Literal, TypeVar, cast

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pointit.bridges.web.devices.devices import Devices
from pointit.bridges.web.devices.wire import ConnectDevice, OneDevice
from pointit.bridges.web.model.map_editor import FloorSeparability, MapEditor
from pointit.bridges.web.model.people import People
from pointit.bridges.web.scan.scan_server import ScanServer
from pointit.bridges.web.server.access import Access
from pointit.bridges.web.server.lan import Lan
from pointit.bridges.web.wire import Answer, Ask, Hello, Role
from pointit.bridges.web.wrists.pairing import Pairing, offer
from pointit.bridges.web.wrists.phone import Phones
from pointit.bridges.web.wrists.wrist_control import MAX_TREMOR_DEG, Hold, WristControl
from pointit.maps.edit import Edit
from pointit.runtime.bus.contract import REQUEST_TIMEOUT_S, Bus
from pointit.runtime.errors import RefusedError
from pointit.schemas import Query, SetYawOrigin, summarize_validation_error, topics
from pointit.schemas.base import Fraction
from pointit.schemas.person import MAX_WORDS
from pointit.schemas.system import instance_of

IMU_BRIDGE = "imu-bridge"
"""Service that turns messages of a mouse or phone into wrist samples."""

OPERATORS: tuple[topics.Request[Any, Any], ...] = (
    topics.ADD_PACKAGE,
    topics.SET_SPEED,
    topics.SET_FEEDING,
    topics.RESET_CONVEYOR,
    topics.START_LOCALIZATION,
    topics.CANCEL_LOCALIZATION,
    topics.SET_HEADING,
    topics.POINT_ANCHOR,
    topics.CLEAR_SELECTION,
    topics.UNDO_SELECTION,
    topics.RELEASE_OBJECT,
    topics.SET_THING,
    topics.SET_METHOD,
    topics.SET_TOLERANCE,
    topics.RUN_SCENARIO,
    topics.SET_BRIGHTNESS,
    topics.SET_YAW_ORIGIN,
    topics.STOP_ROBOT,
)
"""Service requests open to operators. Poses and sensor mountings are left to calibration."""

REQUESTS: dict[Role, tuple[topics.Request[Any, Any], ...]] = {
    "operator": OPERATORS,
    "viewer": (topics.STOP_ROBOT,),
    "wrist": (topics.START_LOCALIZATION, topics.CANCEL_LOCALIZATION),
}
"""Requests by role. Everybody who sees a robot may stop it."""

MAX_EDITS = 1000

MAX_HELD_S = 2.0
"""Greatest time since the button went down, s: headsets send a press when it comes up."""

OLDEST_S = 60.0
"""Largest age of a word, s."""

TIMEOUTS_S = {topics.RUN_SCENARIO.key: 15.0}
"""Timeouts (s) of replies that take longer than usual."""

ONLY_LOOKS_ON = "this page only looks on; open it by the operator's link to control"

JsonObject = dict[str, Any]


class _Extras(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Press(_Extras):
    """Parameters of a press."""

    gesture: Literal["press", "double", "hold"] = "press"
    held_s: float = Field(
        default=0.0, ge=0.0, le=MAX_HELD_S, description="time since the button went down, s"
    )


class StepBeside(_Extras):
    """Direction of a step."""

    by: Literal[-1, 1]


class TakeArm(_Extras):
    """Device of the page that is to move the arm; a phone's page has only the phone."""

    by: Literal["mouse", "headset"] = "mouse"


class Tremor(_Extras):
    """Parameters of a tremor."""

    rms_deg: float = Field(ge=0, le=MAX_TREMOR_DEG)


class Pair(_Extras):
    """Pair or unpair a phone."""

    off: bool = False


class SpokenWord(_Extras):
    """A word that the browser of the person recognised."""

    text: str = Field(min_length=1, max_length=64)
    start_s: float = Field(ge=0, le=OLDEST_S, description="age of its onset")
    end_s: float = Field(ge=0, le=OLDEST_S)
    confidence: Fraction | None = None


class Speak(_Extras):
    """An utterance of the person."""

    words: tuple[SpokenWord, ...] = Field(min_length=1, max_length=MAX_WORDS)


class MapEdits(_Extras):
    """Edits of the map."""

    edits: tuple[Edit, ...] = Field(max_length=MAX_EDITS)
    digest: str = Field(max_length=64, description="of the file that was read")


class SaveMap(MapEdits):
    """Edits of the map, and where to save it."""

    name: str = Field(
        default="", max_length=64, description="of a new file, without suffix; the file itself if empty"
    )


class NoParameters(_Extras):
    """No parameters."""


E = TypeVar("E", bound=BaseModel)


@dataclass(frozen=True, slots=True, kw_only=True)
class Call:
    """A request of the table for its server."""

    request: topics.Request[Any, Any]
    query: Query
    name: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PageSender:
    """The page that requests an action, and the person whom the action is for."""

    page: str
    role: Role
    user: str


@dataclass(frozen=True, slots=True)
class Action(Generic[E]):
    """An action of this server that pages can request."""

    name: str
    scope: Literal["person", "site"]
    """`person`: it is for the person whom the request names."""
    extras: type[E]
    """Model of its parameters."""
    roles: tuple[Role, ...]
    """Pages that may request it."""
    handle: Callable[["RequestDispatcher", PageSender, E], Awaitable[JsonObject]]
    """Does it and returns the fields of the reply. Raises `RefusedError`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PageAction:
    """An action that a page requests, with its parameters."""

    action: Action[Any]
    user: str
    extras: BaseModel


@dataclass(kw_only=True)
class RequestDispatcher:
    """Answers requests of pages and phones: forwards them to services, or does actions here."""

    bus: Bus
    people: People
    wrists: WristControl
    pairing: Pairing
    phones: Phones
    lan: Lan
    access: Access
    separability: FloorSeparability
    maps: MapEditor
    scan: ScanServer
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
        match parse_request(ask, role):
            case Call() as call:
                reply = await self._call(call)
            case PageAction(action=action, user=user, extras=extras):
                if action.scope == "person":
                    self.people.check(user)
                reply = await action.handle(self, PageSender(page=page, role=role, user=user), extras)
        return Answer(id=ask.id, reply=reply)

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
        if loser and loser != page and loser == self.pairing.paired(user, time.monotonic()):
            self.phones.lost(user, is_own=is_own)

    async def _call(self, call: Call) -> JsonObject:
        timeout_s = TIMEOUTS_S.get(call.request.key, REQUEST_TIMEOUT_S)
        reply = await self.bus.call(call.request, call.query, call.name, timeout_s=timeout_s)
        return cast("JsonObject", reply.model_dump(mode="json"))


def _source_of(dispatcher: RequestDispatcher, sender: PageSender) -> str:
    """Return the name of the device in messages."""
    is_headset = dispatcher.wrists.holder(sender.user) == (sender.page, "headset")
    return "headset" if is_headset else "page"


async def _press(dispatcher: RequestDispatcher, sender: PageSender, press: Press) -> JsonObject:
    source = _source_of(dispatcher, sender)
    dispatcher.people.press(sender.user, press.gesture, source=source, held_s=press.held_s)
    return {"message": f"{sender.user}'s button was pressed"}


async def _step(dispatcher: RequestDispatcher, sender: PageSender, step: StepBeside) -> JsonObject:
    dispatcher.people.step(sender.user, step.by, source=_source_of(dispatcher, sender))
    return {"message": ""}


async def _take(dispatcher: RequestDispatcher, sender: PageSender, take: TakeArm) -> JsonObject:
    user = sender.user
    if instance_of(IMU_BRIDGE, user) not in dispatcher.present():
        raise RefusedError(
            f"no service turns the page's messages into wrist samples: start it with "
            f"`pointit service run {IMU_BRIDGE} --user {user} --source page`"
        )
    is_phone = sender.page == dispatcher.pairing.paired(user, time.monotonic())
    if sender.role == "wrist" and is_phone is (take.by == "headset"):
        raise RefusedError(f"this page moves {user}'s arm as a {'phone' if is_phone else 'headset'} only")
    mover: Hold = "phone" if is_phone else take.by
    loser = dispatcher.wrists.acquire(user, sender.page, mover)
    dispatcher.notify_loser(user, loser, sender.page)
    if dispatcher.people.states.get(user) == "idle":
        dispatcher.people.press(user, source=_source_of(dispatcher, sender))
    dispatcher.changed()
    return {"message": f"{user}'s arm follows this {mover}"}


async def _give(dispatcher: RequestDispatcher, sender: PageSender, _: NoParameters) -> JsonObject:
    user = sender.user
    if sender.role == "wrist":
        dispatcher.wrists.release_from(user, sender.page)
    else:
        dispatcher.notify_loser(user, dispatcher.wrists.release(user), sender.page, is_own=True)
    dispatcher.changed()
    return {"message": f"{user}'s arm is their own again"}


async def _set_tremor(dispatcher: RequestDispatcher, sender: PageSender, tremor: Tremor) -> JsonObject:
    if not dispatcher.wrists.set_tremor(sender.user, sender.page, tremor.rms_deg):
        raise RefusedError(f"this page does not move {sender.user}'s arm: take it first")
    return {"message": f"{sender.user}'s arm trembles by {tremor.rms_deg:g}° rms"}


async def _pair(dispatcher: RequestDispatcher, sender: PageSender, wanted: Pair) -> JsonObject:
    user = sender.user
    if wanted.off:
        page = dispatcher.pairing.unpair(user)
        if not page:
            raise RefusedError(f"no phone is paired with {user}")
        reply: JsonObject = {"message": f"{user}'s phone is unpaired"}
    else:
        page = ""

        def pair() -> str:
            nonlocal page
            token, page = dispatcher.pairing.pair(user, time.monotonic())
            return token

        reply = await dispatcher.offer("phone", pair)
    await dispatcher.phones.cut(page)
    dispatcher.changed()
    return reply


async def _centre(dispatcher: RequestDispatcher, sender: PageSender, _: NoParameters) -> JsonObject:
    page, mover = dispatcher.wrists.holder(sender.user)
    if mover == "headset":
        raise RefusedError(f"a headset knows where {sender.user} points: align it again if that is wrong")
    if sender.role == "wrist" and page != sender.page:
        raise RefusedError(f"this page does not move {sender.user}'s arm: take it first")
    query = SetYawOrigin(yaw_rad=dispatcher.wrists.ahead(sender.user))
    reply = await dispatcher.bus.call(topics.SET_YAW_ORIGIN, query, sender.user)
    dispatcher.phones.centred(sender.user)
    return reply.model_dump(mode="json")


async def _speak(dispatcher: RequestDispatcher, sender: PageSender, speak: Speak) -> JsonObject:
    dispatcher.people.speak(sender.user, [word.model_dump() for word in speak.words])
    return {"message": ""}


async def _read_floor(dispatcher: RequestDispatcher, _: PageSender, __: NoParameters) -> JsonObject:
    return {**await dispatcher.separability.answer()}


async def _check_map(dispatcher: RequestDispatcher, _: PageSender, changed: MapEdits) -> JsonObject:
    return await dispatcher.maps.check(changed.edits, changed.digest)


async def _save_map(dispatcher: RequestDispatcher, _: PageSender, changed: SaveMap) -> JsonObject:
    return await dispatcher.maps.save(changed.edits, changed.digest, changed.name)


_WRIST: tuple[Role, ...] = ("operator", "wrist")
_CONTROL: tuple[Role, ...] = ("operator",)
_LOOK: tuple[Role, ...] = ("operator", "viewer")

ACTIONS: tuple[Action[Any], ...] = (
    Action("press", "person", Press, _WRIST, _press),
    Action("step", "person", StepBeside, _WRIST, _step),
    Action("take", "person", TakeArm, _WRIST, _take),
    Action("give", "person", NoParameters, _WRIST, _give),
    Action("tremor", "person", Tremor, _CONTROL, _set_tremor),
    Action("pair", "person", Pair, _CONTROL, _pair),
    Action("open_lan", "site", NoParameters, _CONTROL, lambda self, _, __: self.open_lan()),
    Action("find_devices", "site", NoParameters, _CONTROL, lambda self, _, __: self.devices.find()),
    Action(
        "connect_device",
        "site",
        ConnectDevice,
        _CONTROL,
        lambda self, _, device: self.devices.connect(device),
    ),
    Action(
        "forget_device", "site", OneDevice, _CONTROL, lambda self, _, device: self.devices.forget(device.id)
    ),
    Action("show_device", "site", OneDevice, _CONTROL, lambda self, _, device: self.devices.show(device.id)),
    Action(
        "check_mounting",
        "site",
        OneDevice,
        _CONTROL,
        lambda self, _, device: self.devices.check_mounting(device.id),
    ),
    Action("told_apart", "site", NoParameters, _LOOK, _read_floor),
    Action("centre", "person", NoParameters, _WRIST, _centre),
    Action("speak", "person", Speak, _WRIST, _speak),
    Action(
        "map_room", "site", NoParameters, _CONTROL, lambda self, _, __: self.offer("scan", self.scan.pair)
    ),
    Action("read_map", "site", NoParameters, _CONTROL, lambda self, _, __: self.maps.read()),
    Action("check_map", "site", MapEdits, _CONTROL, _check_map),
    Action("save_map", "site", SaveMap, _CONTROL, _save_map),
)
"""All actions. One more is a row here, with the model of its parameters and its handler above."""


def hello_of(role: Role, *, version: str, site: str, speaks: bool = False, user: str = "") -> Hello:
    """Return the greeting of a page of this role. Its headset may move `user`."""
    return Hello(
        version=version,
        site=site,
        role=role,
        requests=tuple(request.key for request in REQUESTS[role]),
        deeds=tuple(action.name for action in ACTIONS if role in action.roles),
        user=user,
        speaks=speaks,
    )


def parse_request(ask: Ask, role: Role) -> Call | PageAction:
    """Return the parsed request.

    Raises:
        RefusedError: If it is invalid or not allowed for this page.
    """
    if ask.deed is not None:
        return _parse_action(ask, ask.deed, role)
    request = next((row for row in OPERATORS if row.key == ask.key), None)
    if request is None:
        known = ", ".join(row.key for row in OPERATORS)
        raise RefusedError(f"pages cannot ask for {ask.key!r}; they can ask for {known}")
    if request not in REQUESTS[role]:
        raise RefusedError(ONLY_LOOKS_ON if role == "viewer" else f"a phone cannot ask for {ask.key!r}")
    if request.placeholder:
        topics.check_name(ask.name, request.placeholder)
    elif ask.name:
        raise RefusedError(f"{request.key} takes no name, got {ask.name!r}")
    return Call(request=request, query=_validated(request.query, ask.query, request.key), name=ask.name)


def _parse_action(ask: Ask, name: str, role: Role) -> PageAction:
    action = next((row for row in ACTIONS if row.name == name), None)
    if action is None:
        known = ", ".join(row.name for row in ACTIONS)
        raise RefusedError(f"pages cannot request the action {name!r}; they can request {known}")
    if role not in action.roles:
        raise RefusedError(ONLY_LOOKS_ON if role == "viewer" else f"a phone cannot ask for {name!r}")
    if ask.key:
        raise RefusedError(f"one thing at a time: {ask.key!r} or {name!r}")
    if action.scope == "person":
        topics.check_name(ask.name, "user")
    return PageAction(action=action, user=ask.name, extras=_validated(action.extras, ask.query, name))


def _validated(model: type[E], query: JsonObject, name: str) -> E:
    try:
        return model.model_validate(_with_tuples(query))
    except ValidationError as error:
        raise RefusedError(f"{name}: {summarize_validation_error(error)}") from error


def _with_tuples(value: Any) -> Any:
    """Return a value of JSON with tuples for its lists, as strict models have them."""
    if isinstance(value, dict):
        return {key: _with_tuples(each) for key, each in cast("JsonObject", value).items()}
    return tuple(map(_with_tuples, cast("Sequence[object]", value))) if isinstance(value, list) else value
