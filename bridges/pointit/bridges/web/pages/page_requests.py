"""Requests that pages may make, by role, and their validation.

Requests of the table go to their servers unchanged: `name` is the user where the key has one, `query` has
the query's fields. Deeds are handled by this server; `name` is the person:

- `press`, `{"gesture": "press" | "double" | "hold"}`: press the person's button.
- `step`, `{"by": -1 | 1}`: from the announced thing to the one left or right of it.
- `take`: move the person's arm by this page's mouse; an idle person begins to point. `give`: give it back,
  whichever page moves it.
- `tremor`, `{"rms_deg": number}`: tremor of that arm.
- `pair`: a QR code for the person's phone; the reply has `url`, `qr_svg`, `expires_s`, `fingerprint`.
  `{"off": true}`: unpair their phone and revoke codes shown before.
- `open_lan`: open the page to the local network; the reply has `url`, `fingerprint`.
- `find_devices`, `connect_device`, `forget_device`, `show_device`, `check_mounting`: wrists and lights, see
  `devices/devices.py`; their parameters are in `devices/wire.py`.
- `told_apart`: number of things that pointing alone tells apart, by place on the floor; the reply has the
  fields of `Floor` in `model/told_apart.py`.
- `map_room`: let a phone map the room by its camera; the reply is as that of `pair`.
- `speak`, `{"words": [{"text", "start_s", "end_s", "confidence"}]}`: what the person said. Times are ages of
  onset and end when it is sent, s, so that no clock has to agree.
- `centre`: the person's arm points at the middle of the room right now.
- `read_map`, `check_map`, `save_map`: the map of the site in the plan editor, see `model/map_editor.py`.
"""

import json
from dataclasses import dataclass
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pointit.bridges.web.devices.wire import ConnectDevice, OneDevice
from pointit.bridges.web.wire import Ask, Deed, Hello, Role
from pointit.bridges.web.wrists.wrist_control import MAX_TREMOR_DEG
from pointit.maps.edit.edits import Edit
from pointit.runtime.errors import RefusedError
from pointit.schemas import Query, summarize_validation_error, topics
from pointit.schemas.base import Fraction
from pointit.schemas.person import MAX_WORDS

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

LOOKS: tuple[Deed, ...] = ("told_apart",)
"""Deeds that change nothing."""

MAPS: tuple[Deed, ...] = ("read_map", "check_map", "save_map")

DEVICES: tuple[Deed, ...] = (
    "find_devices",
    "connect_device",
    "forget_device",
    "show_device",
    "check_mounting",
)

WRIST: tuple[Deed, ...] = ("press", "step", "take", "give", "centre", "speak")

DEEDS: dict[Role, tuple[Deed, ...]] = {
    "operator": (*WRIST, "tremor", "pair", "open_lan", "map_room", *DEVICES, *MAPS, *LOOKS),
    "viewer": LOOKS,
    "wrist": WRIST,
}

SITE_DEEDS: tuple[Deed, ...] = ("open_lan", "map_room", *DEVICES, *MAPS, *LOOKS)
"""Deeds that are about no person."""

MAX_EDITS = 1000

OLDEST_S = 60.0
"""Largest age of a word, s."""

TIMEOUTS_S = {topics.RUN_SCENARIO.key: 15.0}
"""Timeouts (s) of replies that take longer than usual."""

ONLY_LOOKS_ON = "this page only looks on; open it by the operator's link to control"


class _Extras(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Press(_Extras):
    """Parameters of a press."""

    gesture: Literal["press", "double", "hold"] = "press"


class StepBeside(_Extras):
    """Direction of a step."""

    by: Literal[-1, 1]


class Tremor(_Extras):
    """Parameters of a tremor."""

    rms_deg: float = Field(ge=0, le=MAX_TREMOR_DEG)


class Pair(_Extras):
    """Whether to pair or to unpair a phone."""

    off: bool = False


class Said(_Extras):
    """A word that the browser of the person recognised."""

    text: str = Field(min_length=1, max_length=64)
    start_s: float = Field(ge=0, le=OLDEST_S, description="age of its onset")
    end_s: float = Field(ge=0, le=OLDEST_S)
    confidence: Fraction | None = None


class Speak(_Extras):
    """An utterance of the person."""

    words: tuple[Said, ...] = Field(min_length=1, max_length=MAX_WORDS)


class MapEdits(_Extras):
    """Edits of the map."""

    edits: tuple[Edit, ...] = Field(max_length=MAX_EDITS)
    digest: str = Field(max_length=64, description="of the file that was read")


class SaveMap(MapEdits):
    """Edits of the map, and where to save it."""

    name: str = Field(
        default="", max_length=64, description="of a new file, without suffix; the file itself if empty"
    )


class Plain(_Extras):
    """No parameters."""


EXTRAS: dict[Deed, type[BaseModel]] = {
    "connect_device": ConnectDevice,
    "forget_device": OneDevice,
    "show_device": OneDevice,
    "check_mounting": OneDevice,
    "press": Press,
    "step": StepBeside,
    "tremor": Tremor,
    "pair": Pair,
    "speak": Speak,
    "check_map": MapEdits,
    "save_map": SaveMap,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Call:
    """A request of the table for its server."""

    request: topics.Request[Any, Any]
    query: Query
    name: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PageAction:
    """A deed of this server."""

    deed: Deed
    user: str
    extras: BaseModel


def is_allowed(ask: Ask, role: Role) -> bool:
    """Return True if pages of this role may make this request, whatever its parameters."""
    if ask.deed is not None:
        return ask.deed in DEEDS[role]
    return any(ask.key == request.key for request in REQUESTS[role])


def greeting(
    role: Role, *, version: str, site: str, user: str = "", lamps: tuple[str, ...] = (), speaks: bool = False
) -> Hello:
    """Return the greeting of a page of this role; `user`: of a phone, the owner of the wrist."""
    return Hello(
        version=version,
        site=site,
        role=role,
        requests=tuple(request.key for request in REQUESTS[role]),
        deeds=DEEDS[role],
        user=user,
        lamps=lamps,
        speaks=speaks,
    )


def parse_request(ask: Ask, role: Role) -> Call | PageAction:
    """Return the parsed request.

    Raises:
        RefusedError: If it is invalid or not allowed for this page.
    """
    if ask.deed is not None:
        return _parse_deed(ask, ask.deed, role)
    request = next((row for row in OPERATORS if row.key == ask.key), None)
    if request is None:
        raise RefusedError(f"pages cannot ask for {ask.key!r}; they can ask for {_listed(OPERATORS)}")
    if request not in REQUESTS[role]:
        raise RefusedError(ONLY_LOOKS_ON if role == "viewer" else f"a phone cannot ask for {ask.key!r}")
    if request.placeholder:
        topics.check_name(ask.name, request.placeholder)
    elif ask.name:
        raise RefusedError(f"{request.key} takes no name, got {ask.name!r}")
    try:
        query = request.query.model_validate_json(json.dumps(ask.query))
    except (ValidationError, ValueError, RecursionError) as error:
        raise RefusedError(f"{request.key}: {_reason(error)}") from error
    return Call(request=request, query=query, name=ask.name)


def _parse_deed(ask: Ask, deed: Deed, role: Role) -> PageAction:
    if deed not in DEEDS[role]:
        raise RefusedError(ONLY_LOOKS_ON if role == "viewer" else f"a phone cannot ask for {deed!r}")
    if ask.key:
        raise RefusedError(f"one thing at a time: {ask.key!r} or {deed!r}")
    if deed not in SITE_DEEDS:
        topics.check_name(ask.name, "user")
    try:
        extras = EXTRAS.get(deed, Plain).model_validate_json(json.dumps(ask.query))
    except (ValidationError, ValueError, RecursionError) as error:
        raise RefusedError(f"{deed}: {_reason(error)}") from error
    return PageAction(deed=deed, user=ask.name, extras=extras)


def _reason(error: Exception) -> str:
    return summarize_validation_error(error) if isinstance(error, ValidationError) else str(error)


def _listed(rows: tuple[topics.Request[Any, Any], ...]) -> str:
    return ", ".join(row.key for row in rows)
