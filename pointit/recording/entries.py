"""An entry of a recording: a message, a request with its answer or a change of presence."""

import functools
from collections.abc import Sequence
from typing import Annotated, Any, Generic, NamedTuple, TypeVar

from pydantic import Field

from pointit.runtime.errors import ConfigError
from pointit.schemas import Message, Query, Reply, SchemaError, SchemaModel, ServedRequest
from pointit.schemas.base import Ns
from pointit.schemas.catalogue.json_channel import from_json
from pointit.schemas.system import split_instance
from pointit.schemas.topics import PRESENCES, REQUESTS, TOPICS, Presence, Request, Topic, check_name

Q = TypeVar("Q", bound=Query)
R = TypeVar("R", bound=Reply)
AnyRow = Topic[Any] | Request[Any, Any] | Presence
"""A row of the topic table."""


class RecordingError(ConfigError):
    """A file is no recording, or cannot be read or written as one; names the file and what to do."""


class Exchange(SchemaModel, Generic[Q, R]):
    """A request and its outcome: a reply or a refusal."""

    stamp_ns: Annotated[Ns, Field(description="when the server got it, Unix ns")]
    query: Q
    reply: Annotated[R | None, Field(description="None if it was refused")] = None
    refusal: Annotated[str, Field(description="the server's reason, or empty if it replied")] = ""


class PresenceChange(SchemaModel):
    """True if the owner of a presence is present from now on."""

    present: bool


Body = Message | Exchange[Any, Any] | bool
"""Content of an entry: a message, an answered request, or True if somebody is present from now on."""


class Entry(NamedTuple):
    """One line of a recording."""

    time_ns: int
    """When the recorder got it, site time, ns."""
    key: str
    """Key relative to the site, such as `users/anna/imu`."""
    row: AnyRow
    """Row of the topic table to which the key belongs."""
    name: str
    """Value of the placeholder in the key, or `""` if the row has none."""
    body: Body


def entry(time_ns: int, row: AnyRow, name: str, body: Body) -> Entry:
    """Return the entry of `row` for `name`.

    Raises:
        KeyNameError: `name` does not fit the row.
    """
    return Entry(time_ns, row.at(name), row, name, body)


def row_kind(row: AnyRow) -> str:
    """Return the table of `row` as it stands in a file: `topic`, `request` or `presence`."""
    return type(row).__name__.lower()


def find_row(kind: str, key: str) -> tuple[AnyRow, str] | None:
    """Return the row of the table `kind` that fits `key`, and the placeholder's value, or None."""
    tables: dict[str, Sequence[AnyRow]] = {"topic": TOPICS, "request": REQUESTS, "presence": PRESENCES}
    for row in tables.get(kind, ()):
        if row.key == key and not row.placeholder:
            return row, ""
        name = row.name_in(key)
        if not name:
            continue
        try:
            return row, check_name(name)
        except ValueError:
            continue
    return None


@functools.cache
def body_kind(row: AnyRow) -> type[SchemaModel]:
    """Return the model of what is recorded of `row`."""
    if isinstance(row, Topic):
        kind: type[SchemaModel] = row.message
        return kind
    if isinstance(row, Request):
        return Exchange[row.query, row.reply]
    return PresenceChange


@functools.cache
def schema_name(row: AnyRow) -> str:
    """Return name and version of what is recorded of `row`: `ImuSample.v1`, `SetSpeed.v1+Done.v1`."""
    if isinstance(row, Topic):
        name: str = row.message.schema_name()
        return name
    if isinstance(row, Request):
        return f"{row.query.schema_name()}+{row.reply.schema_name()}"
    return "PresenceChange.v1"


def entry_of(served: ServedRequest, instance: str, now_ns: int) -> Entry | None:
    """Return the entry of a request that `instance` says it answered, or None if it is not valid.

    It is not if its row is unknown here, or if other services answer requests of this kind, or the service of
    another person.
    """
    match = find_row("request", served.request)
    if match is None:
        return None
    row, name = match
    if not isinstance(row, Request) or not _may_answer(instance, row, name):
        return None
    kind: Any = body_kind(row)
    try:
        query = from_json(row.query, served.query.encode(), newer=True)
        reply: Reply | None = None
        if served.reply:
            reply = from_json(row.reply, served.reply.encode(), newer=True)
    except SchemaError:
        return None
    body = kind(stamp_ns=served.stamp_ns, query=query, reply=reply, refusal=served.refusal)
    return entry(now_ns, row, name, body)


def _may_answer(instance: str, row: Request[Any, Any], name: str) -> bool:
    service, owner = split_instance(instance)
    is_of_owner = row.placeholder in ("user", service)  # then it answers only what is about its owner
    if is_of_owner and owner not in ("", name):
        return False
    return service == row.server
