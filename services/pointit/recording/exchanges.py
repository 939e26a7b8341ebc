"""Answered requests as entries of a recording; pure."""

from typing import Any

from pointit.recording.entries import Entry, body_kind, entry, find_row
from pointit.schemas import SchemaError, ServedRequest
from pointit.schemas.catalogue.json_channel import from_json
from pointit.schemas.system import split_instance
from pointit.schemas.topics import Request


def entry_of(served: ServedRequest, instance: str, now_ns: int) -> Entry | None:
    """Return the entry of an answered request, or None if it is not valid.

    Args:
        served: the account of the service that answered.
        instance: whose account it is, by its key; services may write no other's.
        now_ns: when it arrived, ns.

    An account is not valid if its row is unknown here, or if requests of this kind are answered by other
    services, or by the service of another person.
    """
    found = find_row("request", served.request)
    if found is None:
        return None
    row, name = found
    if not isinstance(row, Request) or not _may_answer(instance, row, name):
        return None
    kind: Any = body_kind(row)
    try:
        query = from_json(row.query, served.query.encode(), newer=True)
        reply = from_json(row.reply, served.reply.encode(), newer=True) if served.reply else None
    except SchemaError:
        return None
    body = kind(stamp_ns=served.stamp_ns, query=query, reply=reply, refusal=served.refusal)
    return entry(now_ns, row, name, body)


def _may_answer(instance: str, row: Request[Any, Any], name: str) -> bool:
    service, which = split_instance(instance)
    is_own = row.placeholder not in ("user", service) or which in ("", name)
    return service == row.server and is_own
