"""Requests of pages and phones: permission, validation, and the answer.

Requests of the table go to their servers unchanged: `name` is the user where the key has one, `query` has
the query's fields. Actions of this server stand by subject in `arm_actions.py` and `site_actions.py`, each
with its model and its handler; `name` is the person.

No core: it waits for services.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar, cast

from pydantic import BaseModel, ValidationError
from pydantic.json_schema import models_json_schema

from pointit.bridges.web import wire
from pointit.bridges.web.pages.action import Action, ActionContext, JsonObject, PageSender
from pointit.bridges.web.pages.arm_actions import ARM_ACTIONS
from pointit.bridges.web.pages.site_actions import SITE_ACTIONS
from pointit.bridges.web.scan import wire as scan_wire
from pointit.bridges.web.wire import OWN_FAULT, Answer, Ask, Hello, Role
from pointit.maps.edit import StaleMapError
from pointit.runtime.bus.contract import REQUEST_TIMEOUT_S
from pointit.runtime.errors import PointItError, RefusedError
from pointit.schemas import Query, summarize_validation_error, topics

log = logging.getLogger(__name__)

M = TypeVar("M", bound=BaseModel)

ACTIONS: tuple[Action[Any], ...] = (*ARM_ACTIONS, *SITE_ACTIONS)
"""All actions of this server."""

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
"""Requests by role. All that see a robot may stop it."""

TIMEOUTS_S = {topics.RUN_SCENARIO.key: 15.0}
"""Timeouts (s) of replies that take longer than usual."""

ONLY_LOOKS_ON = "this page only looks on; open it by the operator's link to control"


@dataclass(frozen=True, slots=True, kw_only=True)
class Call:
    """A request of the table for its server."""

    request: topics.Request[Any, Any]
    query: Query
    name: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PageAction:
    """An action that a page requests, with its parameters."""

    action: Action[Any]
    user: str
    parameters: BaseModel


async def answer_request(context: ActionContext, page: str, role: Role, ask: Ask) -> Answer:
    """Answer a request of a page or phone, which waits for that: by the reply, or the reason of a failure."""
    try:
        return Answer.of_reply(ask.id, await _reply(context, page, role, ask))
    except PointItError as error:
        return Answer(id=ask.id, error=str(error), is_stale=isinstance(error, StaleMapError))
    except Exception:
        log.exception("%s asked %s and was not answered", page, ask.deed or ask.key)
        return Answer(id=ask.id, error=OWN_FAULT)


async def _reply(context: ActionContext, page: str, role: Role, ask: Ask) -> JsonObject:
    """Return the reply: forward the request to its service, or do the action here."""
    match parse_request(ask, role):
        case Call(request=request, query=query, name=name):
            timeout_s = TIMEOUTS_S.get(request.key, REQUEST_TIMEOUT_S)
            message = await context.bus.call(request, query, name, timeout_s=timeout_s)
            return cast("JsonObject", message.model_dump(mode="json"))
        case PageAction(action=action, user=user, parameters=parameters):
            if action.scope == "person":
                context.people.check(user)
            sender = PageSender(page=page, role=role, user=user)
            return await action.handle(context, sender, parameters)


def hello_of(
    role: Role,
    *,
    version: str,
    site: str,
    speaks: bool = False,
    language: str = "",
    user: str = "",
    has_home: bool = False,
) -> Hello:
    """Return the greeting of a page of this role. Its headset may move `user`."""
    requests = tuple(request.key for request in REQUESTS[role])
    actions = tuple(action.name for action in ACTIONS if role in action.roles)
    return Hello(
        version=version,
        site=site,
        role=role,
        requests=requests,
        deeds=actions,
        user=user,
        speaks=speaks,
        language=language,
        home=has_home and role == "operator",
    )


def parse_request(ask: Ask, role: Role) -> Call | PageAction:
    """Return the parsed request.

    Raises:
        RefusedError: If it is invalid or not allowed for this page.
    """
    if ask.deed is not None:
        return _parse_action(ask, ask.deed, role)

    # A page that may not ask gets that reason, whatever its query
    request = next((row for row in OPERATORS if row.key == ask.key), None)
    if request is None:
        known = ", ".join(row.key for row in OPERATORS)
        raise RefusedError(f"pages cannot ask for {ask.key!r}; they can ask for {known}")
    if request not in REQUESTS[role]:
        raise _no_right(role, ask.key)

    if request.placeholder:
        topics.check_name(ask.name, request.placeholder)
    elif ask.name:
        raise RefusedError(f"{request.key} takes no name, got {ask.name!r}")
    query = _validated(request.query, ask.query, request.key)
    return Call(request=request, query=query, name=ask.name)


def _parse_action(ask: Ask, name: str, role: Role) -> PageAction:
    action = next((row for row in ACTIONS if row.name == name), None)
    if action is None:
        known = ", ".join(row.name for row in ACTIONS)
        raise RefusedError(f"pages cannot request the action {name!r}; they can request {known}")
    if role not in action.roles:
        raise _no_right(role, name)
    if ask.key:
        raise RefusedError(f"one thing at a time: {ask.key!r} or {name!r}")
    if action.scope == "person":
        topics.check_name(ask.name, "user")
    parameters = _validated(action.parameters, ask.query, name)
    return PageAction(action=action, user=ask.name, parameters=parameters)


def _no_right(role: Role, name: str) -> RefusedError:
    """Return the refusal of a request `name` for which a page of `role` has no right."""
    if role == "viewer":
        return RefusedError(ONLY_LOOKS_ON)
    return RefusedError(f"a phone cannot ask for {name!r}")


def _validated(model: type[M], query: JsonObject, name: str) -> M:
    try:
        return model.model_validate(_with_tuples(query))
    except ValidationError as error:
        raise RefusedError(f"{name}: {summarize_validation_error(error)}") from error


def _with_tuples(value: Any) -> Any:
    """Return a value of JSON with tuples for its lists, as strict models have them."""
    if isinstance(value, dict):
        fields = cast("JsonObject", value)
        return {key: _with_tuples(field) for key, field in fields.items()}
    if isinstance(value, list):
        items = cast("Sequence[object]", value)
        return tuple(map(_with_tuples, items))
    return value


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of all messages to and from pages, from which `client/wire.json` is written."""
    models = (*wire.MODELS, *scan_wire.MODELS)
    _, schema = models_json_schema(
        [(model, "validation") for model in models], ref_template="#/$defs/{model}"
    )
    # The models know only that an action has a name: a page's are those of the table
    action_names = {"enum": [action.name for action in ACTIONS], "type": "string"}
    definitions = schema["$defs"]
    definitions["Ask"]["properties"]["deed"]["anyOf"][0] = action_names
    definitions["Hello"]["properties"]["deeds"]["items"] = action_names
    return schema
